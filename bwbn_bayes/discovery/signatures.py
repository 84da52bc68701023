"""The signature of an effect that was added: measured, identified with its interval, and without the effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.cross_validation import stretches_of
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.outcome import SignatureFacts
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.inference.arrays import measured_storey_force
from bwbn_bayes.inference.likelihood import IntegratedNoise
from bwbn_bayes.inference.refits import refitted
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

N_DRAWS = 32
"""Over which a signature is told."""
_N_STEPS = 8
"""Of the fit that makes a draw."""


def spread_of(present: Explanation, rng: np.random.Generator) -> Floats:
    """Points ``(n, n_dim)`` over which the parameters of an explanation spread: its fits to records with other errors.

    In each record what the explanation leaves has its sign or the other one at random (a wild bootstrap), where it is
    noise by as many samples as count as one, else in whole stretches, over which an error of the law hangs together.
    The fits follow the posterior along its bends; those of a wrong law spread by what its errors move it.

    Parameters
    ----------
    present : Explanation
    rng : numpy.random.Generator

    References
    ----------
    .. [1] C. F. J. Wu, "Jackknife, Bootstrap and Other Resampling Methods in Regression Analysis", Annals of Statistics
       14(4), 1986, doi:10.1214/aos/1176350142 (errors by random factors; cited from memory, not consulted); whole
       stretches in the place of samples are the block bootstrap's.
    """
    posterior = present.evidence.posterior
    slopes, record = Slopes.at(posterior, present.best), posterior.record
    signs = rng.choice([-1.0, 1.0], (N_DRAWS, 1, record.n_times))
    if present.is_noise:
        noise = posterior.noise
        as_one = np.ceil(np.max(noise.as_one)) if isinstance(noise, IntegratedNoise) else 1
        signs = np.repeat(signs, int(as_one), axis=2)[:, :, : record.n_times]
    else:
        for _, own in stretches_of(record):
            signs[:, :, own] = signs[:, :, own[:1]]
    errors = (signs - 1.0) * slopes.residual
    return refitted(posterior, slopes, np.tile(present.best, (N_DRAWS, 1)), _N_STEPS, errors=errors).points


def signature_of(hypothesis: Hypothesis, present: Explanation, spread: Floats) -> SignatureFacts | None:
    """The signature of one of the effects that an explanation adds.

    Parameters
    ----------
    hypothesis : Hypothesis
        The effect.
    present : Explanation
        With it.
    spread : (n, n_dim) array
        Points of the unit cube over which its parameters spread.

    Returns
    -------
    SignatureFacts or None
        None where the effect has no measure.
    """
    signature = hypothesis.effect.signature
    if not signature.measure:
        return None
    values, _ = present.posterior.split(np.concatenate([present.best[None], spread]))
    of_runs = _responses(hypothesis, present, values)
    without_it = _responses(hypothesis, present, _without(hypothesis, present, values[:1]))
    found = [
        _Told(run, responses, signature.of_response(without[0]) if without else np.nan)
        for (run, _), responses, without in zip(present.posterior.record.runs, of_runs, without_it, strict=True)
        if run.channels and _is_measurable(signature, run, responses)
    ]
    if not found:
        is_test = any(_measured_loop(run) is not None for run, _ in present.posterior.record.runs)
        deserved = 0.0 if is_test else max(_of_size(signature, responses) for responses in of_runs)
        return SignatureFacts.of_none(signature.measure, signature.unit, _why_not(signature, of_runs), deserved)
    # Of records that each find the structure virgin the one in which the effect does most.
    told = max(found, key=lambda one: one.difference(signature))
    sizes = np.array([signature.of_response(one) for one in told.responses])
    low, high = np.nanpercentile(sizes, [5.0, 95.0])
    return SignatureFacts(
        measure=signature.measure,
        unit=signature.unit,
        measured=_measured(signature, hypothesis, present.model, told),
        mean=float(np.nanmean(sizes)),
        low=float(low),
        high=float(high),
        without=told.without,
        deserved=_deserved(signature, told),
    )


@dataclass(frozen=True)
class _Told:
    """A record in one go, responses of draws under it, and the measure without the effect at the best fit."""

    record: Record
    responses: list[PlaceResponse]
    without: float

    def difference(self, signature: Signature) -> float:
        """What the effect makes of the measure."""
        change = signature.of_response(self.responses[0]) - self.without
        return abs(change) if np.isfinite(change) else 0.0


def _is_measurable(signature: Signature, record: Record, responses: list[PlaceResponse]) -> bool:
    """Whether the measure can be taken, of the best fit's response and of the loop where a test measured that."""
    if not responses or not np.isfinite(signature.of_response(responses[0])):
        return False
    loop = _measured_loop(record)
    return loop is None or signature.of_loop is None or signature.of_measured(*loop) is not None


def _why_not(signature: Signature, of_runs: list[list[PlaceResponse]]) -> str:
    """Why the measure can be taken of no record."""
    if not any(of_runs):
        return "no response of the law can be solved"
    return f"it takes {signature.needs}" if signature.needs else "it is no number in the response of the law"


def _measured_loop(record: Record) -> tuple[Floats, Floats] | None:
    """Displacement [m] and force [N] that a test measured in whole cycles, one after the other, as a measure reads."""
    is_test = record.excitation_kind == "displacement" and "force" in record.channels and record.counted is None
    return (record.excitation, record.channels["force"]) if is_test else None


def _deserved(signature: Signature, told: _Told) -> float:
    """Share of the responses in which an effect has its size, and changes the loop of a test so that it can be read.

    None where the loop that a test measured has it not: a law may take up what is left of a loop, and not shape it.
    """
    loop = _measured_loop(told.record)
    if loop is None:
        return _of_size(signature, told.responses)
    if not signature.is_in_loop(*loop):
        return 0.0
    # Where nothing can be solved without it there is no loop that it could leave as it was.
    shown = [one for one in told.responses if not abs(signature.of_response(one) - told.without) < signature.readable]
    return _of_size(signature, shown) * len(shown) / len(told.responses)


def _of_size(signature: Signature, responses: list[PlaceResponse]) -> float:
    """Share of the responses in which an effect has its size; none where there are none."""
    return float(np.mean([signature.is_engineering(one) for one in responses])) if responses else 0.0


def place_of(hypothesis: Hypothesis, histories: Mapping[str, Floats]) -> int | None:
    """Storey, from 0, at which an effect's signature is read: where the drift is largest; None for the building."""
    if not hypothesis.storeys:
        return None
    return max((s - 1 for s in hypothesis.storeys), key=lambda i: float(np.max(np.abs(histories["drift"][i]))))


def _responses(hypothesis: Hypothesis, present: Explanation, values: Floats) -> list[list[PlaceResponse]]:
    """Responses as they are at the place of an effect, of each run those that can be solved."""
    model, record = present.model, present.posterior.record
    rows = observe(present.posterior.engine, model, values, record)
    local = model.table.local(values)
    result = []
    for _, stretch in record.runs:
        found = []
        for draw in range(len(values)):
            histories = {kind: history[draw][:, stretch] for kind, history in rows.items()}
            if not np.all(np.isfinite(histories["drift"])):
                continue
            place = place_of(hypothesis, histories)
            own = {p.symbol: float(v) for p, v in zip(model.parameters, local[draw, place or 0], strict=True)}
            own |= {name: float(value) for name, value in model.law.derived_from(own).items()}
            at = {kind: h if place is None or len(h) <= place else h[place] for kind, h in histories.items()}
            found.append(PlaceResponse(histories=at, parameters=own, scales=hypothesis.scales, joints=model.joints))
        result.append(found)
    return result


def _without(hypothesis: Hypothesis, present: Explanation, values: Floats) -> Floats:
    """The same parameters with the effect at its neutral values."""
    result, names = values.copy(), present.model.space.names
    for name in hypothesis.amplitudes:
        result[:, names.index(name)] = hypothesis.neutral(name)
    return result


def _measured(signature: Signature, hypothesis: Hypothesis, model: Structure, told: _Told) -> float | None:
    """The measure of the record: of a specimen's loop, or of the measured storey force against the identified drift."""
    record = told.record
    if model.is_driven or record.counted is not None:
        loop = _measured_loop(record)
        return None if loop is None else signature.of_measured(*loop)
    drift = told.responses[0].histories["drift"]
    if drift.ndim > 1 or not hypothesis.storeys:
        return None
    force = measured_storey_force(model, record, hypothesis.storeys[0]) if len(hypothesis.storeys) == 1 else None
    return None if force is None else signature.of_measured(drift, force)
