"""Explanations out of others: with every further effect at every place, with other forms, without one of theirs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bwbn_bayes.discovery.candidates import MOST_CARRIED, Hypothesis, is_present, sharing_laws
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation, Key, key_of
from bwbn_bayes.discovery.probability import cost_of_another
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import Run, all_but, hypotheses_of, on_one_thread, on_threads, score_all
from bwbn_bayes.discovery.second_look import crossed, rescanned, searched, widened
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.modes import N_CANDIDATES, distinct, find_modes, polish
from bwbn_bayes.parameters import Floats

MOST_LATER = 12
"""Effects at a place, those with the largest scores, that are fitted in a later round, each in all its forms."""
N_KEPT = 40
"""Fits of a round that become explanations."""
TOGETHER = ("strength_degradation", "stiffness_degradation")
WITH = ("slip_lock", "foliente_pinching")
"""What occurs together in measured loops: a pinch with a loss of strength and stiffness."""
N_TOGETHER = 512
"""Draws of the whole prior from which such a combination starts."""
_NEAR = 50.0
"""Candidates further below the best do not keep it waiting. [nat]"""


def built_upon(parent: Explanation, run: Run) -> list[Explanation]:
    """The parent with every effect at every place that could improve it."""
    fits = _fits(parent, run, first=not parent.added)
    if not parent.added:
        run.first_fits = fits
    return [explained(parent, fit, run) for fit in fits[:N_KEPT]]


def explained(parent: Explanation, fit: Fit, run: Run) -> Explanation:
    """What an explanation becomes by a further effect, as it was fitted."""
    posterior = on_threads(fit.posterior, run.settings.n_workers)
    return Explanation(
        added=(*parent.added, fit.hypothesis),
        posterior=posterior,
        modes=fit.modes,
        evidence=laplace(posterior, fit.modes),
        unnamed=parent.unnamed,
        n_places=parent.n_places,
    )


def _fits(parent: Explanation, run: Run, *, first: bool) -> tuple[Fit, ...]:
    """Every further effect fitted, best first; where a score tells what an effect can gain, those that can alone.

    A specimen's solves are short beside the compilation of a law: it is fitted under the law that scores, and what its
    laws leave is no noise that a score could be judged by.
    """
    # Later models differ from run to run: one law for all of them, compiled once, scores them.
    every = run.considered_first if first else hypotheses_of(parent, run, np.inf)
    if parent.is_quiet or not (first or parent.is_specimen):
        run.say(f"scoring {len(every)} hypotheses")
        run.scored = (parent, score_all(parent, every, run))
        ranked = sorted(run.scored[1], key=lambda pair: -pair[1].nats)
        variants = run.variants
        every = tuple(h for h, score in ranked if score.nats > cost_of_another(h.name, variants))
        every = every if first else leading(every)
    if not every:
        return ()
    if not (first or parent.is_specimen):
        every = _under_smaller_laws(parent, every)
    run.say(f"fitting {len(every)} hypotheses")
    posterior = on_one_thread(parent.posterior)
    n_workers, pace = run.settings.n_workers, run.pace
    guess = first or parent.is_specimen or not parent.is_quiet
    fits = race(posterior, every, parent.fits, guess=guess, progress=run.say, pace=pace)
    fits = solvable(fits, run)
    if not fits:
        return ()
    fits = widened(fits, n_threads=n_workers, pace=pace)
    run.say("looking closer at the leading hypotheses")
    if not parent.is_quiet:
        fits = crossed(posterior, rescanned(fits, n_threads=n_workers, pace=pace), pace=pace)
    if parent.is_specimen:  # a law is bent by all that it lacks
        fits = searched(fits, run.rng, n_threads=n_workers, pace=pace, leading_too=first)
    return fits


def leading(ranked: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Those of the first effects at a place, each in all its forms.

    Forms of an effect score alike: one by one, those of a change in time at four places left room for little else.
    """
    places = list(dict.fromkeys((one.name, one.storeys) for one in ranked))[:MOST_LATER]
    return tuple(one for one in ranked if (one.name, one.storeys) in places)


def solvable(fits: tuple[Fit, ...], run: Run) -> tuple[Fit, ...]:
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
    engine, driven = parent.posterior.engine, parent.model.excitation_kind == "displacement"
    single = isinstance(engine, Lanes) and engine.single
    precompile(dict.fromkeys(laws[len(laws) // 2 :], True), driven=driven, single=single)
    return grouped


def in_other_forms(best: Explanation, known: Mapping[Key, Explanation], run: Run) -> Iterator[Explanation]:
    """An explanation with each of its effects in its other forms, or at other places, where it is known without it.

    An effect in a free shape is tried at other places in this one, and in all of its usual forms, which it stands for.

    Parameters
    ----------
    best : Explanation
    known : mapping of Key to Explanation
        Those that were fitted alike; what is among them is not fitted again.
    run : Run
    """
    for one in best.added:
        base = known.get(best.effects_key - key_of([one]))
        if base is None or run.must_stop():
            continue
        own = [h for h in run.considered_first if h.name == one.name]
        usual = {h.symbols for h in own}
        elsewhere = {one.symbols} if one.symbols in usual else usual
        # Of the model as given, the first round has fitted the usual forms everywhere.
        alike = [h for h in own if base.added and (h.storeys == one.storeys or h.symbols in elsewhere)]
        alike += {h.storeys: form for h in own for form in h.free_shapes if form.symbols == one.symbols}.values()
        alike = [h for h in alike if not is_present(base.model, h.effect, h.storeys)]
        every = [replace(h, base=base.model, carried=()) for h in alike]
        every = [h for h in every if base.effects_key | key_of([h]) not in known]
        if every:
            yield from in_forms(base, every, run)


def in_forms(base: Explanation, every: Sequence[Hypothesis], run: Run) -> list[Explanation]:
    """An explanation with an effect in each of some forms."""
    n_workers, pace = run.settings.n_workers, run.pace
    run.say(f"fitting {' and '.join(one.label for one in every)}")
    posterior = on_one_thread(base.posterior)
    fits = solvable(race(posterior, every, base.fits, pace=pace), run)
    if not fits:
        return []
    fits = widened(fits, n_threads=n_workers, pace=pace)
    # One form that leaves noise says nothing of another, which a race may leave hundreds of nats from its best.
    short = tuple(fit for fit in fits if not fit.leaves_noise)
    if short:
        again = searched(short, run.rng, n_threads=n_workers, pace=pace)
        fits = (*(fit for fit in fits if fit.leaves_noise), *again)
    return [explained(base, fit, run) for fit in fits]


def left_out(best: Explanation, known: Mapping[Key, Explanation], run: Run) -> Iterator[Explanation]:
    """An explanation without each of its effects in turn.

    Parameters
    ----------
    best : Explanation
    known : mapping of Key to Explanation
        Those that were fitted alike, the model as given among them; what is among them is not fitted again.
    run : Run
    """
    if len(best.added) < 2:
        return
    for spare in best.added:
        kept = [one for one in best.added if one is not spare]
        if key_of(kept) in known or run.must_stop():
            continue
        given = known[frozenset()]
        try:
            added = rebuilt(given, kept, run)
            own = added[-1].model.space.names
        except UserError:  # what is kept acts on what the other one makes of a link
            continue
        names = best.posterior.space.names
        columns = [names.index(name) for name in own]
        points = np.array([mode.point[columns] for mode in best.modes[:N_CANDIDATES]])
        yield from fitted(given, added, run, points=points)


def rebuilt(given: Explanation, added: Sequence[Hypothesis], run: Run) -> tuple[Hypothesis, ...]:
    """The same hypotheses one upon the other, from the model as given on; a specimen's under the law of all effects."""
    carried = all_but(added, run) if given.is_specimen else ()
    result: list[Hypothesis] = []
    for number, one in enumerate(added, start=1):
        base = result[-1].model if result else given.model
        result.append(replace(one, base=base, carried=carried if number == len(added) else ()))
    return tuple(result)


def fitted(
    given: Explanation,
    added: tuple[Hypothesis, ...],
    run: Run,
    *,
    points: Floats | None = None,
) -> Iterator[Explanation]:
    """An explanation from points of its own, or from all over its priors; nothing where it cannot be solved."""
    posterior = given.posterior.with_model(added[-1].model)
    if points is None:
        try:
            found = find_modes(posterior, run.rng, n_starts=N_TOGETHER, n_first=32)
        except UserError:  # none of its draws can be solved
            return
        points = np.array([mode.point for mode in found[:N_CANDIDATES]])
    modes = distinct(*polish(posterior, points, n_iterations=30, reach=_NEAR))
    if modes:
        yield replace(
            given, added=added, posterior=posterior, modes=modes, evidence=laplace(posterior, modes), starts=None
        )
