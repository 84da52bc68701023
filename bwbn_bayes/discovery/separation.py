"""Which experiment would tell effects apart that this record cannot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.discovery.runaway import runaway_sample
from bwbn_bayes.inference.residuals import noise_floors
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import mean_squares
from bwbn_bayes.records.record import Record

STRENGTHS = (0.3, 1.5, 2.0)
LEAST_RATIO = 0.3
"""Root mean square difference of two predictions, in noise levels, below which an experiment tells nothing."""
N_CYCLES = 12


def separating_experiment(first: Fit, second: Fit, period: float) -> str:
    """The experiment under which two fits predict most differently, in a sentence.

    Parameters
    ----------
    first, second : Fit
        Hypotheses that explain the record about equally well.
    period : float
        First period of a building. [s]
    """
    record = first.posterior.record
    names = first.hypothesis.name, second.hypothesis.name
    found = [(0.0, True, "")]
    for description, experiment in _experiments(record, period).items():
        one, other = _predict(first, experiment), _predict(second, experiment)
        difference = mean_squares(experiment, one - other)
        size = float(np.sqrt(np.mean(difference / np.square(noise_floors(experiment)))))
        if np.isfinite(size):
            runs_away = any(runaway_sample(*pair) is not None for pair in ((one, other), (other, one)))
            found.append((size, runs_away, description))
    # What both predict within reason is the better test.
    ratio, runs_away, best = max(found, key=lambda one: (one[0] >= LEAST_RATIO, not one[1], one[0]))
    if ratio < LEAST_RATIO:
        return f"No experiment tried would tell {names[0]} from {names[1]}."
    apart = "one of the predictions runs away" if runs_away else f"predictions lie {ratio:.1f} times the noise apart"
    return f"{best} would tell {names[0]} from {names[1]}: {apart}."


def _experiments(record: Record, period: float) -> Mapping[str, Record]:
    """The same motion weaker and stronger; for a building a sine at the first period that grows to its peak too.

    Of several records all are made weaker or stronger, and the longest is taken for the sine.
    """
    of_building = record.excitation_kind == "ground_acceleration"
    motion = "The same ground motion" if of_building else "The same displacement history"
    motion = "The same forces" if record.forces else motion
    scaled = {
        f"{motion} at {strength:g} times its {'strength' if of_building else 'size'}": record.driven_by(
            strength * record.excitation, {name: strength * force for name, force in record.forces.items()}
        )
        for strength in STRENGTHS
    }
    if not of_building or record.forces:
        return scaled
    longest = max((part for part in record.parts if part.channels), key=lambda part: part.duration)
    time = longest.times
    growth = np.minimum(time / (N_CYCLES * period), 1.0)
    peak = 0.5 * float(np.max(np.abs(record.excitation)))
    sine = longest.driven_by(peak * growth * np.sin(2.0 * np.pi * time / period), {})
    return {**scaled, f"A sine at the first period of {period:.2f} s that grows to {peak:.2g} m/s^2": sine}


def _predict(fit: Fit, record: Record) -> Floats:
    values, _ = fit.posterior.split(fit.modes[0].point[None])
    response: Floats = fit.posterior.engine.simulate(fit.posterior.model, values, record).values[0]
    return response
