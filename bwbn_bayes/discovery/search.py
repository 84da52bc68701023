"""The search: the most probable explanation that was not yet built upon is given every further effect, again and again.

Several partial answers stay in the running (a best-first beam): a step that gains nothing ends nothing. Effects that
occur together are tried together from the start, and each effect of the best answers is left out once, so that what
later ones made superfluous is seen to be so. How far the search goes is a matter of budget alone; what it found is
judged in :mod:`~bwbn_bayes.discovery.probability`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product, takewhile

import numpy as np

from bwbn_bayes.discovery.build import (
    N_KEPT,
    TOGETHER,
    WITH,
    built_upon,
    explained,
    fitted,
    in_forms,
    in_other_forms,
    left_out,
    rebuilt,
)
from bwbn_bayes.discovery.candidates import MOST_CARRIED, Hypothesis
from bwbn_bayes.discovery.explanation import Explanation, Key, key_of
from bwbn_bayes.discovery.outcome import Step
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.race import FAR
from bwbn_bayes.discovery.run import Run, hypotheses_of
from bwbn_bayes.discovery.second_look import searched
from bwbn_bayes.discovery.unfinished import Unfinished
from bwbn_bayes.discovery.unnamed import follow, weigh_to_first_order
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.modes import N_CANDIDATES, distinct, find_modes, polish, settled

REACH = 6.0
"""Explanations this far below the best are built upon. [nat]"""
BEAM = 2
"""Explanations of one number of effects that are built upon at most."""
_FOLLOWED_AFTER = 2
"""Rounds after which another first step is tried, and then what has no name is looked for, where what a building's best
laws leave is not noise yet."""
_MOST_RESHAPED = 2
"""Rounds in which forms of free shape are tried at a specimen."""
_N_STARTS, _N_ITERATIONS = 512, 20
"""Draws of its priors from which such a law is searched, and steps to its optima."""
_MOST_ANEW = 6
"""Laws that leave noise, and are searched anew before they are weighed against each other."""
_MOST_RIVALS = 3
"""Other effects that are tried in free shape in the place of one of the best explanation's."""

_WEIGHED = "Weighed what was found"


def search(given: Explanation, run: Run) -> Pool:
    """Look for explanations, from the model as given on.

    Parameters
    ----------
    given : Explanation
        The model as given, fitted.
    run : Run
        Its settings hold the budget.
    """
    pool = Pool(run=run)
    pool.add([given])
    pool.count()
    given = pool.plain[frozenset()]
    run.consider(hypotheses_of(given, run, np.inf if given.is_specimen else MOST_CARRIED))
    followed = given.is_specimen  # a specimen's laws never leave noise
    for number in range(run.settings.most_rounds):
        _look_wider(number, given, pool, run)
        parent = _next(pool, run)
        if not followed and (parent is None or number == _FOLLOWED_AFTER) and not pool.laws.best.is_noise:
            followed = True
            follow(pool, run)
            parent = _next(pool, run)
        if parent is None:
            break
        _round(parent, pool, run)
    if not given.is_specimen:
        _exchange(pool, run)
    elif not run.stopped:
        _draw_closer(pool, run)
    if not run.stopped:
        _change_forms(pool, run)
    if not given.is_specimen:
        _search_anew(pool, run)
    done = _beside_a_force(given, pool, run)
    if run.steps or not run.stopped:
        _tell(_WEIGHED if run.stopped else done, pool.ranked()[0].label, pool, run)
    if run.stopped:
        sentence = (
            f"The search was stopped by the time limit of {run.settings.time_limit_s:g} s, "
            f"{_when_stopped(len(pool.expanded), len(pool.finished))}: what it had not tried by then has no part in "
            "the probabilities."
        )
        run.cut_short = (sentence,)
        run.say(sentence)
    return pool


def _beside_a_force(given: Explanation, pool: Pool, run: Run) -> str:
    """What is done at the end, in words: in a building a force of no known law is asked for."""
    pool.weigh(last=True)
    if given.is_specimen:
        return _WEIGHED
    if not pool.laws.best.is_noise:
        follow(pool, run)
    weigh_to_first_order(pool, run, REACH)
    return "Asked for an unnamed force"


def _when_stopped(n_begun: int, n_whole: int) -> str:
    """After how many rounds."""
    if n_whole == 0:
        return "in its first round" if n_begun else "before its first round"
    after = f"after {n_whole} round{'' if n_whole == 1 else 's'}"
    return f"{after} and a part of the next" if n_begun > n_whole else after


def _round(parent: Explanation, pool: Pool, run: Run) -> None:
    """Build upon an explanation, and weigh what came of it; where the time runs out, what was found by then."""
    pool.expanded.add(parent.effects_key)
    pool.add(built_upon(parent, run))
    if not parent.added:
        pool.add(_together(parent, pool, run))
    pool.weigh()
    if not run.stopped:
        pool.add(_reshaped(pool, run))
        pool.add(left_out(pool.ranked()[0], pool.plain, run))
        pool.weigh()
    if not run.stopped:
        pool.finished.add(parent.effects_key)
    _tell(f"Built upon {parent.label}", parent.label, pool, run)


def _look_wider(number: int, given: Explanation, pool: Pool, run: Run) -> None:
    """Before later rounds of a building, at what its first round may have missed."""
    if given.is_specimen:
        return
    if number == 1 and not pool.laws.best.is_quiet:
        _look_deeper(given, pool, run)
    if number == _FOLLOWED_AFTER and not pool.compared.best.is_noise:
        _step_otherwise(pool, run)


def _look_deeper(given: Explanation, pool: Pool, run: Run) -> None:
    """Search a building's leading hypotheses from all over their priors, which a specimen's first round does itself.

    A fit that the lack of the effect has bent may be thousands of nats from the best one with it, and everything that
    is built upon it is then built upon that.
    """
    if run.must_stop() or not run.first_fits:
        return
    run.say("looking deeper at the leading hypotheses of the first round")
    run.first_fits = searched(run.first_fits, run.rng, n_threads=run.settings.n_workers, pace=run.pace)
    pool.add(explained(given, fit, run) for fit in run.first_fits[:N_KEPT])
    pool.weigh()


def _step_otherwise(pool: Pool, run: Run) -> None:
    """Build upon the best other effect, however far behind it is, if it is ahead of the model as given.

    Of two effects that a building lacks neither is what it looks like alone: what looks most like both together may be
    a third one, from which no further step leads to them.
    """
    better, best = takewhile(lambda one: one.effects_key, pool.compared.explanations), pool.compared.best
    others = (one for one in better if len(one.added) == 1 and not one.names <= best.names)
    other = next((one for one in others if one.effects_key not in pool.expanded), None)
    if other is not None and not run.must_stop():
        _round(pool.plain[other.effects_key], pool, run)


def _next(pool: Pool, run: Run) -> Explanation | None:
    """The most probable explanation that was not built upon, near the best; its modes looked around first.

    A force of no known law beside them counts: where one explains what laws do not, none is sought in its place.
    """
    done = Counter(len(key) for key in pool.expanded)
    compared = pool.compared
    for one, log_joint in zip(compared.explanations, compared.log_joint, strict=True):
        if log_joint < compared.log_joint[0] - REACH:
            return None
        key = one.effects_key
        if key in pool.expanded or done[len(key)] >= BEAM or len(key) >= run.settings.most_effects:
            continue
        if run.must_stop():
            return None
        own = pool.plain[key]
        modes = settled(own.posterior, own.modes[:N_CANDIDATES], run.rng) if one.added else own.modes
        if modes[0].log_likelihood > own.modes[0].log_likelihood + 0.5:
            pool.add([own.with_modes(modes)])
        return pool.plain[key]
    return None


def _together(given: Explanation, pool: Pool, run: Run) -> Iterator[Explanation]:
    """What occurs together, at a specimen, from all over its priors: each loss in its usual form and in its best."""
    if not given.is_specimen or run.settings.most_effects < len(TOGETHER) + 1:
        return
    forms = [_usual_and_best(name, pool, run) for name in TOGETHER]
    pinches = [one for name in WITH for one in _usual(name, run)]
    for *losses, pinch in product(*forms, pinches):
        added = rebuilt(given, [*losses, pinch], run)
        if run.must_stop():
            return
        run.say(f"fitting {' and '.join(one.label for one in (*losses, pinch))}")
        yield from fitted(given, added, run)


def _usual_and_best(name: str, pool: Pool, run: Run) -> list[Hypothesis]:
    """An effect in its usual form, and in the one that is best alone."""
    alone = [one for one in pool.plain.values() if len(one.added) == 1 and name in one.names]
    best = [max(alone, key=lambda one: one.evidence.log_evidence).added[0]] if alone else []
    return list({own.symbols: own for own in (*_usual(name, run), *best)}.values())


def _usual(name: str, run: Run) -> list[Hypothesis]:
    """An effect in its usual form, if it is considered."""
    return [one for one in run.considered_first if one.name == name][:1]


def _reshaped(pool: Pool, run: Run) -> list[Explanation]:
    """The best laws with each effect in a form of free shape: what its form leaves must not become another effect.

    Where the best has several effects, the one that is best alone, too; and what might stand in the place of one of
    them: which law lies nearest in the form that it happens to have says little of which it is. Each form is tried on
    each base once. What a specimen's laws leave is never noise: forms are tried there in the first rounds
    alone.
    """
    best, known = pool.laws.best, pool.plain
    if best.is_specimen and len(pool.expanded) > _MOST_RESHAPED:
        return []
    considered = {one.name for one in run.considered_first}
    wanted = [] if best.is_quiet else [(best, one) for one in best.added]
    alone = [known[key_of([one])] for one in best.added if key_of([one]) in known]
    if len(best.added) > 1 and alone:
        first = max(alone, key=lambda one: one.evidence.log_evidence)
        wanted.append((first, first.added[0]))
    found: list[Explanation] = []
    for whole, plain in (*wanted, *_rivals(best, pool)):
        base = known.get(whole.effects_key - key_of([plain]))
        if base is None or run.must_stop():
            continue
        forms = [form for form in plain.free_shapes if form.name in considered]
        every = [replace(form, base=base.model, carried=()) for form in forms]
        every = [one for one in every if base.effects_key | key_of([one]) not in pool.reshaped]
        pool.reshaped.update(base.effects_key | key_of([one]) for one in every)
        if every:
            found += in_forms(base, every, run)
    return found


def _rivals(best: Explanation, pool: Pool) -> list[tuple[Explanation, Hypothesis]]:
    """Other effects with forms of free shape, each where it stands best in the place of one of the best explanation's.

    Where the best leaves nothing of note, those that are not far behind it.
    """
    least = best.evidence.log_evidence - FAR if best.is_quiet else -np.inf
    found: dict[str, tuple[Explanation, Hypothesis]] = {}
    for one in pool.laws.explanations:
        others = [own for own in one.added if not key_of([own]) <= best.effects_key]
        if len(others) != 1 or len(one.added) != len(best.added) or one.evidence.log_evidence <= least:
            continue
        if others[0].free_shapes and others[0].name not in best.names:
            found.setdefault(others[0].name, (one, others[0]))
    return list(found.values())[:_MOST_RIVALS]


def _exchange(pool: Pool, run: Run) -> None:
    """Build upon the best laws without each of their effects: what stands there has been the best beside the others.

    What was found before the others came is what looked most like all that was missing, and may leave noise in the
    place of the right one. Of a specimen every effect is fitted in every round.
    """
    tried: set[Key] = set()
    most = len(pool.expanded) + run.settings.most_rounds
    while (best := pool.ranked()[0]).effects_key not in tried and len(best.added) > 1:
        tried.add(best.effects_key)
        pool.add(left_out(best, pool.plain, run))
        for one in best.added:
            base = pool.plain.get(best.effects_key - key_of([one]))
            if base is None or base.effects_key in pool.expanded or len(pool.expanded) >= most or run.must_stop():
                continue
            _round(base, pool, run)


def _change_forms(pool: Pool, run: Run) -> None:
    """The best laws with each effect in its other forms and places, and what is best then without what it can spare.

    The form and place of an effect are those in which it was best before the others came, and of a free shape the place
    is that of the usual form that led to it: what they err by, some of the others may stand in for.
    """
    best = pool.ranked()[0]
    pool.add(in_other_forms(best, pool.plain, run))
    pool.weigh()
    while pool.ranked()[0].effects_key != best.effects_key:
        best = pool.ranked()[0]
        pool.add(left_out(best, pool.plain, run))
        pool.weigh()


def _draw_closer(pool: Pool, run: Run) -> None:
    """The law that leaves least of a specimen, by which samples are counted, in other forms and without each effect."""
    pool.add(in_other_forms(pool.closest, pool.plain, run))
    pool.add(left_out(pool.closest, pool.plain, run))
    pool.weigh()


def _search_anew(pool: Pool, run: Run) -> None:
    """Look for better optima of the laws that leave noise, from all over their priors, where there are several.

    Which of them is right the evidence tells if each stands at its best: the right one, found from what stood in its
    place, may leave noise at an optimum tens of nats below its own. The nearer to noise, the less a search takes.
    """
    quiet = [one for one in pool.laws.explanations if one.added and one.is_noise][:_MOST_ANEW]
    if len(quiet) < 2 or run.must_stop():
        return
    run.say(f"searching {len(quiet)} laws that leave noise from all over their priors")
    pool.add(run.beside(_anew, list(zip(quiet, run.rng.spawn(len(quiet)), strict=True))))
    pool.weigh()


def _anew(pair: tuple[Explanation, np.random.Generator]) -> Explanation:
    """An explanation with the optima of a search all over its priors beside its own."""
    one, rng = pair
    try:
        anew = find_modes(one.posterior, rng, n_starts=_N_STARTS, reach=FAR)
    except UserError:  # no draw of its prior can be solved: what led to it did without
        return one
    points = [mode.point for mode in (*one.modes, *anew)[:N_CANDIDATES]]
    modes = distinct(*polish(one.posterior, np.array(points), n_iterations=_N_ITERATIONS, reach=FAR))
    return one.with_modes(modes) if modes else one


def _tell(what: str, parent: str, pool: Pool, run: Run) -> None:
    """Keep what a round has done, and what is believed after it."""
    believed = pool.beliefs
    best = believed.best
    sentence = f"{what}: the best so far is {best.label}, with probability {believed.probabilities[0]:.2f}."
    run.steps.append(
        Step(
            number=len(run.steps) + 1,
            parent=parent,
            sentence=sentence,
            explanations=believed.explanations,
            probabilities=tuple(believed.probabilities.tolist()),
            log_joint=tuple(believed.log_joint.tolist()),
            elapsed_s=run.elapsed,
        )
    )
    known = Unfinished(
        name=run.name,
        data=run.data,
        given=pool.plain[frozenset()],
        believed=believed,
        steps=tuple(run.steps),
        notes=(*run.binding, *run.notes),
        binding=run.binding,
        seed=run.settings.seed,
        elapsed_s=run.elapsed,
    )
    run.say(sentence, known)
