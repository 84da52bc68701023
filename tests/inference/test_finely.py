"""A scheme that is fine enough at the optimum may run away beside it: of a large damper, one step per sample does."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bwbn_bayes import BoucWen, ShearBuilding, Uniform, el_centro, identify, simulate
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.scheme import finely_solved
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.accuracy import LADDER, choose_scheme, rung_of
from bwbn_bayes.inference.finely import solve_finely
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode, find_modes
from bwbn_bayes.inference.pymc.model import observations, to_pymc
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.parameters import Floats

COARSE = replace(LADDER[0], n_threads=1)
LARGE = np.array([[0.99]])
"""Of 142 N s/m, where steps of 0.02 s of a unit mass run away from 139 on."""


@pytest.fixture(scope="module")
def hardly_seen() -> Posterior:
    """A record at -20 dB, which tells hardly anything of its damper."""
    storey = BoucWen(k=40.0, c=Uniform(110.0, 142.5), alpha=0.1, A=1.0, beta=1e-3, gamma=1e-3, n=1.2)
    model = ShearBuilding(masses=[1.0], storey=storey)
    truth = {"c": 130.0}
    record = simulate(model, el_centro("chopra", duration=6.0), truth, snr_db=-20.0, engine=Reference(), seed=3)
    return Posterior(model=model, record=record, engine=COARSE, noise=default_noise(record))


@pytest.fixture(scope="module")
def modes(hardly_seen: Posterior) -> list[Mode]:
    return list(find_modes(hardly_seen, np.random.default_rng(1)))


def solves_what_is_near(posterior: Posterior, engine: Engine) -> bool:
    near, exact = (posterior.with_engine(one).log_likelihood(LARGE)[0] for one in (engine, LADDER[-1]))
    return bool(abs(near - exact) < 0.5)


def test_at_the_optimum_one_step_per_sample_is_enough(hardly_seen: Posterior, modes: list[Mode]) -> None:
    chosen, facts = choose_scheme(hardly_seen, modes[0].point, COARSE)
    assert facts.acceptable
    assert not solves_what_is_near(hardly_seen, chosen)


def test_what_is_as_likely_beside_it_asks_for_more(hardly_seen: Posterior, modes: list[Mode]) -> None:
    solved = solve_finely(hardly_seen, np.array([mode.point for mode in modes]))
    assert solves_what_is_near(hardly_seen, solved.posterior.engine)
    assert solved.modes[0].log_likelihood == pytest.approx(modes[0].log_likelihood, abs=0.5)


@pytest.mark.parametrize("substeps", [1, 2, 4, 8, 16, 32])
def test_where_none_solves_what_is_near_the_finest_ends_it(
    hardly_seen: Posterior, modes: list[Mode], monkeypatch: pytest.MonkeyPatch, substeps: int
) -> None:
    """With short steps a scheme is several rungs of the ladder: taken for the first of them it was chosen for ever."""
    engines = []

    def every(view: Posterior, points: Floats, _: float) -> tuple[NDArray[np.bool_], Floats]:
        engines.append(view.engine)
        assert len(engines) == len(set(engines))
        return np.ones(len(points), dtype=np.bool_), np.zeros(len(points))

    monkeypatch.setattr("bwbn_bayes.inference.finely.left_out", every)
    coarse = hardly_seen.with_engine(replace(LADDER[0], n_threads=1, substeps=substeps))
    solved = solve_finely(coarse, modes[0].point[None], first=rung_of(COARSE), substeps=substeps)
    assert solved.posterior.engine == replace(LADDER[-1], n_threads=1, substeps=max(LADDER[-1].substeps, substeps))


def test_an_engine_with_a_tolerance_of_its_own_stays(hardly_seen: Posterior, modes: list[Mode]) -> None:
    exact = hardly_seen.with_engine(Reference())
    solved = solve_finely(exact, modes[0].point[None])
    assert solved.posterior is exact
    assert solved.discretisation is None


@pytest.mark.parametrize("share", [0.05, 0.6, 0.9, 1.0])
def test_a_search_solves_what_its_evidence_feels(
    hardly_seen: Posterior, modes: list[Mode], monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """A share that is left out takes its log of the evidence, and two nats of that are not felt."""

    def some(view: Posterior, points: Floats, _: float) -> tuple[NDArray[np.bool_], Floats]:
        return np.arange(len(points)) < share * len(points), view.with_engine(LADDER[-1]).log_likelihood(points)

    monkeypatch.setattr("bwbn_bayes.inference.finely.left_out", some)
    one = Explanation(added=(), posterior=hardly_seen, modes=tuple(modes), evidence=laplace(hardly_seen, tuple(modes)))
    assert (finely_solved(one) is one) == (share < 1.0 - np.exp(-2.0))


def test_a_twin_in_pymc_solves_what_is_near(hardly_seen: Posterior) -> None:
    twin = to_pymc(hardly_seen.model, hardly_seen.record)
    (observation,) = observations(twin).values()
    assert solves_what_is_near(hardly_seen, observation.problem.engine)


def test_draws_are_solved_where_they_lie(hardly_seen: Posterior) -> None:
    """Nearly nothing is known: draws have to come from all of the prior, its last tenth not left out."""
    result = identify(hardly_seen.model, hardly_seen.record, settings=Settings(particles=1000))
    assert 0.04 < np.mean(result.tree["posterior"]["c"].values > 139.25) < 0.2


def test_where_nothing_near_lies_inside_the_prior_nothing_is_left_out(
    hardly_seen: Posterior, modes: list[Mode], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bwbn_bayes.inference.finely._near", lambda *_: (np.empty((0, 1)), np.empty(0)))
    solved = solve_finely(hardly_seen, modes[0].point[None])
    assert len(solved.modes) == 1
