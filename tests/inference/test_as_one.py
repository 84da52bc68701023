"""Samples that count as one: what they are counted for is borne out by simulated errors of known memory."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from bwbn_bayes import Settings, identify
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.as_one import samples_as_one, variance_ratio
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.joined import join_records
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

N = 2000
TIME = np.linspace(0.0, 1.0, N)
DIRECTIONS = np.stack([np.sin(np.pi * k * TIME) for k in range(1, 7)], axis=1)
"""All slower than the errors."""


def errors(rng: np.random.Generator, memory: float) -> Floats:
    """Autoregressive, of unit variance."""
    return np.asarray(lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.standard_normal(N + 500)))[500:]


@pytest.mark.parametrize("memory", [0.0, 0.7, 0.9])
def test_directions_in_which_there_is_nothing_gain_what_they_gain_of_independent_samples(memory: float) -> None:
    """Half a nat each in the mean; samples counted one by one gain 19 times as much at a memory of 0.9.

    What is left once the directions are taken out hangs together less than the errors did: a third may be missed.
    """
    rng, gains = np.random.default_rng(1), []
    for _ in range(200):
        left = errors(rng, memory)
        rest = left - DIRECTIONS @ np.linalg.lstsq(DIRECTIONS, left)[0]
        gained = 0.5 * N * np.log(np.sum(np.square(left)) / np.sum(np.square(rest)))
        gains.append(gained / variance_ratio(rest, DIRECTIONS))
    assert np.mean(gains) == pytest.approx(0.5 * DIRECTIONS.shape[1], rel=0.33)


def test_it_is_the_mean_of_the_slopes_variances_in_independent_directions() -> None:
    """By dense matrices, of correlations that end where they are first below zero; twice the same changes nothing."""
    left = errors(np.random.default_rng(2), 0.9)
    power = np.array([left[lag:] @ left[: N - lag] for lag in range(N)]) / (left @ left)
    power[np.argmax(power <= 0.0) :] = 0.0
    over = np.linalg.qr(DIRECTIONS)[0]
    expected = np.trace(over.T @ toeplitz(power) @ over) / DIRECTIONS.shape[1]
    assert expected > 5.0
    assert variance_ratio(left, DIRECTIONS) == pytest.approx(expected)
    assert variance_ratio(left, np.hstack([DIRECTIONS, DIRECTIONS @ np.ones((6, 2))])) == pytest.approx(expected)
    assert variance_ratio(np.zeros(N), DIRECTIONS) == variance_ratio(left, np.zeros((N, 1))) == 1.0


def test_each_block_has_its_own_count() -> None:
    """Two tests of a spring, one with errors that hang together."""
    rng, travel = np.random.default_rng(3), 0.01 * np.sin(40.0 * TIME)
    records = [
        Record(
            name=f"test {memory}",
            time_step=0.01,
            excitation=travel,
            excitation_kind="displacement",
            channels={"force": 2000.0 * travel + errors(rng, memory)},
        )
        for memory in (0.0, 0.9)
    ]
    record = join_records(records)
    model = Specimen(storey=Linear(k=Uniform(1000.0, 3000.0), c=0.0))
    posterior = Posterior(model=model, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    (mode, *_) = distinct(*polish(posterior, np.array([[0.4]]), n_iterations=10))
    white, red = samples_as_one(posterior, mode.point)
    assert white < 1.5
    assert red == pytest.approx(19.0, rel=0.4)


@pytest.mark.parametrize(("memory", "counts"), [(0.0, 1.0), (0.9, 19.0)])
def test_identify_counts_what_a_specimens_law_leaves_as_discover_does(memory: float, counts: float) -> None:
    """Of errors that hang together an interval is as much wider; a noise that was asked for stays what it is."""
    travel = 0.01 * np.sin(40.0 * TIME)
    force = 2000.0 * travel + errors(np.random.default_rng(3), memory)
    record = Record(
        name="pulled without time",
        time_step=0.01,
        has_time=False,
        excitation=travel,
        excitation_kind="displacement",
        channels={"force": force},
    )
    model = Specimen(storey=Linear(k=Uniform(1000.0, 3000.0), c=0.0))
    settings = Settings(particles=500, seed=1)
    found = identify(model, record, settings=settings)
    asked = identify(model, record, settings=settings, noise=default_noise(record))
    (own,), (plain,) = found.facts.parameters, asked.facts.parameters
    assert own.mean == pytest.approx(plain.mean, abs=0.5 * own.sd)
    assert (own.sd / plain.sd) ** 2 == pytest.approx(counts, rel=0.4)
