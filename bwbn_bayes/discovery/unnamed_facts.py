"""What is known of what has no name at the end: where, how likely, its share, its shape, what is left beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.held_out import HeldOut, predict
from bwbn_bayes.discovery.outcome import Gap, UnnamedForce, UnnamedReading
from bwbn_bayes.discovery.probability import POSSIBLE, Beliefs
from bwbn_bayes.inference.residuals import level
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.further_link import FurtherLink, Span
from bwbn_bayes.inference.unnamed.reading import ReadingError
from bwbn_bayes.inference.unnamed.specimen import expected_force
from bwbn_bayes.inference.unnamed.state_function import StateForce
from bwbn_bayes.inference.unnamed.storey import Estimate, Neighbourhood, over_time


def nameless(believed: Beliefs) -> Explanation | None:
    """The most probable explanation that has something unnamed; None where that is less likely than not."""
    chosen = next((one for one in believed.explanations if one.has_unnamed), None)
    return chosen if believed.unnamed >= POSSIBLE else None


def unnamed_facts(believed: Beliefs, present: Explanation) -> UnnamedForce | UnnamedReading | None:
    """What is unnamed in :func:`nameless`, if there is one; of a specimen what the law that is delivered leaves."""
    if present.is_specimen:
        return _of_specimen(present, believed.beyond) if believed.beyond >= POSSIBLE else None
    chosen = nameless(believed)
    if chosen is None:
        return None
    assert chosen.unnamed is not None
    sure = _Sure(believed.of_unnamed(chosen.unnamed), believed.unnamed)
    if isinstance(chosen.estimate, ReadingError):
        return _of_sensor(chosen, chosen.estimate, sure)
    if isinstance(chosen.estimate, FurtherLink):
        return _of_link(chosen, chosen.estimate.span, sure)
    return _of_storey(chosen, sure)


class _Sure(NamedTuple):
    """Probability that something unnamed is where it is shown, and anywhere."""

    there: float
    anywhere: float


def beside_it(believed: Beliefs, held_out: HeldOut | None, gap: Gap, rng: np.random.Generator) -> Gap:
    """The gap with what is left beside what has no name; on held-out data where that is the same function there.

    Such are a link, a force of one state, and an error of what a sensor shows; what changes in time is known of one
    record.
    """
    chosen = nameless(believed)
    if chosen is None:
        return gap
    posterior, point = chosen.whole
    if isinstance(chosen.estimate, Estimate) and posterior is chosen.posterior:  # nothing acts beside the laws
        return gap
    beside = predict(posterior, point, posterior.record, rng, counted=posterior.record.kept)
    if not beside.nrmse < gap.after.nrmse:
        return gap
    gap = replace(gap, nameless=beside)
    if held_out is None or gap.held_out is None:
        return gap
    record, found = held_out.record, chosen.estimate
    if isinstance(found, ReadingError) and found.is_of_shown and found.channel in record.channels:
        row = list(record.channels).index(found.channel)
        shown = predict(posterior, point, record, rng).values[row]
        own = {**record.channels, found.channel: record.channels[found.channel] - found.error_at(shown)}
        record = record.with_channels(own)
    elif not isinstance(found, StateForce | FurtherLink):
        return gap
    unseen = predict(posterior, point, record, rng, counted=held_out.counted)
    return replace(gap, held_out=replace(gap.held_out, nameless=unseen))


def _of_sensor(one: Explanation, found: ReadingError, sure: _Sure) -> UnnamedReading:
    """Its expectation, over what the model has the sensor show."""
    kept = one.posterior.record.kept
    measured = one.posterior.record.channels[found.channel][kept]
    return UnnamedReading(
        channel=found.channel,
        probability=sure.there,
        any_probability=sure.anywhere,
        share=level(found.error[kept]) / level(measured),
        function=found.kind,
        shown=found.shown[kept],
        error=found.error[kept],
    )


def _of_specimen(law: Explanation, probability: float) -> UnnamedForce | None:
    """Its expectation given what a law leaves; of several tests it is not known."""
    record = law.posterior.record
    if len(record.parts) > 1 or "force" not in record.channels:
        return None
    force = expected_force(record, law.residual[0])[record.kept]
    measured = record.channels["force"][record.kept]
    return UnnamedForce(
        storey=1,
        place=law.model.link_in_words(1),
        probability=probability,
        any_probability=probability,
        share=level(force) / level(measured),
        state=record.excitation[record.kept],
        force=force,
    )


def _of_link(one: Explanation, span: Span, sure: _Sure) -> UnnamedForce:
    """Its force over the drift between its nodes; the share is that of the largest force in a storey, both rms."""
    kept, values = one.posterior.record.kept, one.posterior.split(one.best[None])[0]
    rows = observe(one.posterior.engine, one.model, values, one.posterior.record)
    *storeys, own = rows["restoring_force"][0]
    return UnnamedForce(
        storey=span.upper,
        place=f"a link between {span.in_words}",
        probability=sure.there,
        any_probability=sure.anywhere,
        share=level(own) / max(level(force) for force in storeys),
        function="of the drift between the two and its rate",
        nodes=span,
        state=rows["drift"][0][-1][kept],
        force=own[kept],
    )


def _of_storey(one: Explanation, sure: _Sure) -> UnnamedForce:
    """What is expected of it, in the storey where it is the largest share of the force."""
    found, record = one.estimate, one.posterior.record
    assert isinstance(found, Estimate | StateForce)
    if isinstance(found, StateForce):
        values = one.posterior.split(one.best[None])[0]
        rows = {kind: own[0] for kind, own in observe(one.posterior.engine, one.model, values, record).items()}
        forces = {found.storey: found.effect.force(found.weights, rows[found.effect.state][found.storey - 1])}
    else:
        posterior = one.evidence.posterior
        here = Neighbourhood(posterior=posterior, point=found.point, share=UNNAMED_SCALE, forces=found.forces)
        if not np.isfinite(here.log_likelihood):  # what is right to first order need not be solvable as a whole
            here = replace(here, point=one.evidence.modes[0].point, forces={})
        rows = here.rows
        forces = {at: over_time(force, record, one.model) for at, force in found.forces.items()}
    whole = np.sqrt(np.mean(np.square(rows["restoring_force"]), axis=1))
    shares = {at: level(force) / whole[at - 1] for at, force in forces.items()}
    storey = max(shares, key=lambda at: shares[at])
    over = found.effect.state if isinstance(found, StateForce) else ""
    return UnnamedForce(
        storey=storey,
        place=one.model.link_in_words(storey) if len(shares) == 1 else "every storey",
        probability=sure.there,
        any_probability=sure.anywhere,
        share=shares[storey],
        function=found.kind,
        over=over,
        state=rows[over or "drift"][storey - 1][record.kept],
        force=forces[storey][record.kept],
    )
