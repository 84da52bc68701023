"""The search: the most probable explanation that was not yet built upon is given every further effect, again and again.

Several partial answers stay in the running (a best-first beam): a step that gains nothing ends nothing. Effects that
occur together are tried together from the start, and each effect of the best answers is left out once, so that what
later ones made superfluous is seen to be so. How far the search goes is a matter of budget alone; what it found is
judged in :mod:`~bwbn_bayes.discovery.probability`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from bwbn_bayes.discovery.candidates import MOST_CARRIED, Hypothesis, scales_of, sharing_laws
from bwbn_bayes.discovery.evidence import autoregressive, laplace
from bwbn_bayes.discovery.explanation import Explanation, key_of
from bwbn_bayes.discovery.outcome import Step
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.probability import UNNAMED_SCALE
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import Run, hypotheses_of, on_one_thread, on_threads, score_all
from bwbn_bayes.discovery.second_look import rescanned, searched, widened
from bwbn_bayes.discovery.unnamed_storey import first_order_gain, unnamed_hypothesis
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.modes import N_CANDIDATES, distinct, find_modes, polish, settled
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

MOST_LATER = 24
"""Hypotheses with the largest scores that are fitted in a later round."""
REACH = 6.0
"""Explanations this far below the best are built upon. [nat]"""
BEAM = 2
"""Explanations of one number of effects that are built upon at most."""
_LEAST_SCORE = 3.0
"""A further effect must gain as much to first order to be worth a fit. [nat]"""
_N_KEPT = 40
"""Fits of a round that become explanations."""
_N_UNNAMED = 1
"""Explanations of a building that get an unnamed force, beside the model as given."""
_TOGETHER = ("strength_degradation", "stiffness_degradation")
_WITH = ("slip_lock", "foliente_pinching")
"""What occurs together in measured loops: a pinch with a loss of strength and stiffness."""
_N_TOGETHER = 512
"""Draws of the whole prior from which such a combination starts."""


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
    run.considered = run.considered_first = hypotheses_of(given, run, MOST_CARRIED)
    for number in range(1, run.settings.most_rounds + 1):
        parent = _next(pool, run)
        if parent is None:
            break
        pool.expanded.add(parent.effects_key)
        pool.add(_built_upon(parent, run))
        if number == 1:
            pool.add(_together(given, run))
        pool.weigh()
        pool.add(_left_out(pool, run))
        pool.weigh()
        if not given.is_specimen and not pool.ranked()[0].is_noise:
            _unnamed_at_storeys(pool, run)
        _tell(f"Built upon {parent.label}", parent.label, pool, run)
    if not given.is_specimen and pool.ranked()[0].is_noise:
        _unnamed_to_first_order(pool)
    return pool


def _next(pool: Pool, run: Run) -> Explanation | None:
    """The most probable explanation that was not built upon, near the best; its modes looked around first."""
    believed, done = pool.beliefs, Counter(len(key) for key in pool.expanded)
    for one, log_joint in zip(believed.explanations, believed.log_joint, strict=True):
        if log_joint < believed.log_joint[0] - REACH:
            return None
        key = one.effects_key
        if key in pool.expanded or done[len(key)] >= BEAM or len(key) >= run.settings.most_effects:
            continue
        plain = pool.plain[key]
        modes = settled(plain.posterior, plain.modes[:N_CANDIDATES], run.rng) if one.added else plain.modes
        if modes[0].log_likelihood > plain.modes[0].log_likelihood + 0.5:
            pool.add([replace(plain, modes=modes, evidence=laplace(plain.posterior, modes))])
        return pool.plain[key]
    return None


def _built_upon(parent: Explanation, run: Run) -> list[Explanation]:
    """The parent with every effect at every place that could improve it."""
    fits = _fits(parent, run, first=not parent.added)
    if not parent.added:
        run.first_fits = fits
    return [_explained(parent, fit, run) for fit in fits[:_N_KEPT]]


def _explained(parent: Explanation, fit: Fit, run: Run) -> Explanation:
    posterior = on_threads(fit.posterior, run.settings.n_workers)
    return Explanation(
        added=(*parent.added, fit.hypothesis),
        posterior=posterior,
        modes=fit.modes,
        evidence=laplace(posterior, fit.modes),
        n_places=parent.n_places,
    )


def _fits(parent: Explanation, run: Run, *, first: bool) -> tuple[Fit, ...]:
    """Every further effect fitted, best first; where a score tells what an effect can gain, those that can alone."""
    if not first:  # Later models differ from run to run: one law for all of them, compiled once, scores them.
        run.considered = hypotheses_of(parent, run, np.inf)
    every = run.considered
    if parent.is_quiet or not first:
        run.say(f"scoring {len(every)} hypotheses")
        run.scored = (parent.model, score_all(parent, every, run))
        ranked = sorted(run.scored[1], key=lambda pair: -pair[1].nats)
        every = tuple(hypothesis for hypothesis, score in ranked if score.nats > _LEAST_SCORE)
        every = every[: len(every) if first else MOST_LATER]
    if not every:
        return ()
    if not first:
        every = _under_smaller_laws(parent, every)
    run.say(f"fitting {len(every)} hypotheses")
    posterior = on_one_thread(parent.posterior)
    fits = race(posterior, every, parent.points, n_workers=run.settings.n_workers, guess=first, progress=run.say)
    fits = _solvable(fits, run)
    if not fits:
        return ()
    fits = widened(fits, n_threads=run.settings.n_workers)
    run.say("looking closer at the leading hypotheses")
    if not parent.is_quiet:
        fits = rescanned(fits, n_threads=run.settings.n_workers)
    if first and parent.is_specimen:
        fits = searched(fits, run.rng, n_threads=run.settings.n_workers)
    return fits


def _solvable(fits: tuple[Fit, ...], run: Run) -> tuple[Fit, ...]:
    """Those that could be solved from some start; the others are told once."""
    lost = [fit.hypothesis.label for fit in fits if not np.isfinite(fit.log_likelihood)]
    if lost:
        sentence = f"Could not be solved for this record and was left out: {', '.join(lost)}."
        if sentence not in run.notes:
            run.note(sentence)
    return tuple(fit for fit in fits if np.isfinite(fit.log_likelihood))


def _under_smaller_laws(parent: Explanation, every: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The same hypotheses in groups of few effects: derivatives take a tenth of the time, which pays for compiling."""
    grouped = sharing_laws(every, MOST_CARRIED)
    laws = tuple(dict.fromkeys(hypothesis.model.law for hypothesis in grouped))
    precompile(dict.fromkeys(laws[len(laws) // 2 :], True), driven=parent.model.excitation_kind == "displacement")
    return grouped


def _together(given: Explanation, run: Run) -> Iterator[Explanation]:
    """What occurs together, at a specimen, from all over its priors and from where its last effect alone was best."""
    if not given.is_specimen or run.settings.most_effects < len(_TOGETHER) + 1:
        return
    every = {h.name: h for h in reversed(run.considered_first)}
    if not {*_TOGETHER} <= {*every}:
        return
    for pinch in (every[name] for name in _WITH if name in every):
        added = rebuilt(given.model, [*(every[name] for name in _TOGETHER), pinch])
        run.say(f"fitting {pinch.label} with a loss of strength and stiffness")
        yield from _fitted(given, added, run, whole=True)


def _left_out(pool: Pool, run: Run) -> Iterator[Explanation]:
    """The best explanation without each of its effects in turn."""
    best = pool.ranked()[0]
    if len(best.added) < 2:
        return
    for left_out in best.added:
        kept = [one for one in best.added if one is not left_out]
        if key_of(kept) in pool.plain:
            continue
        added = rebuilt(pool.plain[frozenset()].model, kept)
        names = best.posterior.space.names
        columns = [names.index(name) for name in added[-1].model.space.names]
        points = np.array([mode.point[columns] for mode in best.modes[:N_CANDIDATES]])
        yield from _fitted(pool.plain[frozenset()], added, run, points=points)


def rebuilt(model: Structure, added: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The same hypotheses one upon the other, from a model on."""
    result = []
    for one in added:
        again = replace(one, base=model, carried=())
        result.append(again)
        model = again.model
    return tuple(result)


def _fitted(
    given: Explanation,
    added: tuple[Hypothesis, ...],
    run: Run,
    *,
    points: Floats | None = None,
    whole: bool = False,
) -> Iterator[Explanation]:
    """An explanation from points of its own, or from all over its priors; nothing where it cannot be solved."""
    posterior = given.posterior.with_model(added[-1].model)
    if whole:
        try:
            modes = find_modes(posterior, run.rng, n_starts=_N_TOGETHER, n_first=32)
        except UserError:  # none of its draws can be solved
            return
    else:
        assert points is not None
        modes = distinct(*polish(posterior, points, n_iterations=30))
    if modes:
        yield Explanation(
            added=added, posterior=posterior, modes=modes, evidence=laplace(posterior, modes), n_places=given.n_places
        )


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
    run.say(sentence)


def _unnamed_to_first_order(pool: Pool) -> None:
    """Where what the best leaves is noise: what an unnamed force at each storey could add to it, to first order."""
    best = pool.ranked()[0]
    for storey, hypothesis in _unnamed_hypotheses(best):
        gain = first_order_gain(best.posterior, hypothesis, best.best)
        evidence = replace(best.evidence, log_evidence=best.evidence.log_evidence + gain, method="Laplace")
        pool.unnamed[best.effects_key, (storey,)] = replace(best, unnamed=(storey,), evidence=evidence)


def _unnamed_at_storeys(pool: Pool, run: Run) -> None:
    """The model as given and the best explanations with an unnamed force at each storey, fitted."""
    wanted = {one.effects_key: one for one in (*pool.ranked()[:_N_UNNAMED], pool.plain[frozenset()])}
    for one in wanted.values():
        if any((one.effects_key, (storey,)) in pool.unnamed for storey in range(1, one.model.n_storeys + 1)):
            continue
        run.say(f"fitting {one.label} with a force of no known law at each storey")
        for storey, hypothesis in _unnamed_hypotheses(one):
            fits = race(on_one_thread(one.posterior), [hypothesis], one.points, n_workers=1, guess=False)
            if not np.isfinite(fits[0].log_likelihood):
                continue
            posterior = on_threads(fits[0].posterior, run.settings.n_workers)
            white, coloured = laplace(posterior, fits[0].modes), autoregressive(posterior, fits[0].modes)
            better = max(white, coloured, key=lambda found: found.log_evidence)
            pool.unnamed[one.effects_key, (storey,)] = replace(one, unnamed=(storey,), evidence=better)


def _unnamed_hypotheses(one: Explanation) -> Iterator[tuple[int, Hypothesis]]:
    for number, scales in enumerate(scales_of(one.posterior, one.best), start=1):
        yield number, unnamed_hypothesis(one.model, number, scales, UNNAMED_SCALE)
