"""How far the spread of a force of no known law is believed: as far as fitted half cycles bear it out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.discovery.evidence import beside_force
from bwbn_bayes.discovery.predictive import PredictiveInterval, _Draws, _draws, _stretched
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.inference.unnamed.specimen import fitted_basis, unnamed_basis
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

MODEL = Specimen(storey=BoucWen(k=Uniform(5.0, 20.0), alpha=0.2, beta=0.8, gamma=0.2, n=1.0))
PATH = np.concatenate([a * np.sin(np.linspace(0.0, 2.0 * np.pi, 60)) for a in np.repeat([0.5, 1.0, 1.5, 2.0], 3)])
ENGINE = Lanes(substeps=8, n_threads=1)
SD = 0.1


def stretched(error: Floats) -> float:
    """Of a cyclic test with such an error beside the law."""
    cyclic = Record(name="cyclic", time_step=0.1, excitation=PATH, excitation_kind="displacement", has_time=False)
    force = ENGINE.simulate(MODEL, np.array([[10.0]]), cyclic, ("force",)).values[0, 0]
    record = cyclic.with_channels({"force": force + error})
    posterior = Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))
    modes = distinct(*polish(posterior, np.array([[0.4], [0.6]]), n_iterations=20))
    shared = SharedFunctions.of(fitted_basis(record))
    one: Any = SimpleNamespace(evidence=beside_force(posterior, modes, shared, 0.1 * float(np.max(np.abs(force)))))
    return _stretched(one)


def basis() -> Floats:
    cyclic = Record(name="cyclic", time_step=0.1, excitation=PATH, excitation_kind="displacement", has_time=False)
    force = ENGINE.simulate(MODEL, np.array([[10.0]]), cyclic, ("force",)).values[0, 0]
    return unnamed_basis(cyclic.with_channels({"force": force}))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_force_that_is_as_the_prior_says_spreads_as_it_says(seed: int) -> None:
    """Drawn from the very process: of 720 samples nine of ten lie inside, but for half cycles that hang together."""
    rng, functions = np.random.default_rng(seed), basis()
    error = functions @ rng.standard_normal(functions.shape[1]) + SD * rng.standard_normal(len(PATH))
    assert stretched(error) == pytest.approx(1.0, abs=0.25)


def test_half_cycles_that_err_each_by_itself_stretch_the_spread() -> None:
    """A departure that changes its sign with each half cycle: what the others say of one is wrong each time."""
    rng = np.random.default_rng(4)
    turns = np.cumsum(np.diff(np.sign(np.gradient(PATH)), prepend=1.0) != 0)
    error = 0.6 * rng.choice([-1.0, 1.0], turns[-1] + 1)[turns] + SD * rng.standard_normal(len(PATH))
    assert stretched(error) > 1.5


class Bent:
    """Eight coordinates: the first is normal, the others follow its square within a small share of its spread."""

    n_dim = 8

    def log_prior(self, points: Floats) -> Floats:
        return np.where(np.all((points >= 0.0) & (points <= 1.0), axis=1), 0.0, -np.inf)

    def log_likelihood(self, points: Floats) -> Floats:
        along = (points[:, :1] - 0.5) / 0.05
        beside = (points[:, 1:] - 0.5 - 0.001 * along**2) / 0.003
        return -0.5 * np.asarray(along[:, 0] ** 2 + np.sum(np.square(beside), axis=1))


def draws_of_a_bent_posterior(seed: int) -> _Draws:
    information = np.diag([0.05**-2, *[0.003**-2] * 7])
    mode = Mode(point=np.full(8, 0.5), log_likelihood=0.0, gradient=np.zeros(8), information=information)
    one: Any = SimpleNamespace(evidence=SimpleNamespace(posterior=Bent(), modes=(mode,)))
    return _draws(one, 400, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_draws_of_a_bent_posterior_are_to_be_had(seed: int) -> None:
    """By the approximation at the optimum alone 160 to 430 draws counted, with a tail of up to 0.96."""
    assert draws_of_a_bent_posterior(seed).covers


@pytest.mark.xfail(strict=True, reason="the ends of the bend are reached late: 0.88 of the standard deviation")
def test_draws_follow_a_bent_posterior() -> None:
    """400 draws know a standard deviation to 3.5 %, twelve times as many to 1 %."""
    every = [draws_of_a_bent_posterior(seed).points[:, 0] for seed in range(1, 13)]
    assert np.mean(np.std(every, axis=1)) == pytest.approx(0.05, rel=0.05)


def test_draws_that_leave_out_a_part_are_told() -> None:
    interval = PredictiveInterval(low=np.zeros((1, 2)), high=np.ones((1, 2)), coverage=0.5, covered=0.75)
    assert interval.in_words.endswith("Of their draws 25 % may leave out a part of the posterior.")
    assert "leave out" not in replace(interval, covered=1.0).in_words
