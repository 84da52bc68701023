"""Transitional MCMC from two starts: their agreement is a check that holds for a good run and fails for a bad one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymc_cases import small_mode, small_model, small_posterior, small_record

from bwbn_bayes import Result, Settings, identify
from bwbn_bayes.inference import by_tmcmc as module
from bwbn_bayes.inference.by_importance import weighted_draws
from bwbn_bayes.inference.by_tmcmc import FIRST, SECOND, two_starts
from bwbn_bayes.inference.history import History
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.sampled import Given, Sampled
from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult, sample
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import StageFacts

CHECKS = [
    "independent particles",
    "length of chains",
    "starts agree on the evidence",
    "starts agree on the means",
    "starts agree on the spreads",
]


class Half:
    """An approximation that has nothing above the mode's first coordinate, as one that overlooks a bend has not."""

    def __init__(self, mode: Mode) -> None:
        self.mode = mode
        self.whole = TruncatedStudent.at(mode.point, mode.gradient, mode.information, inflation=4.0)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        drawn = self.whole.sample(rng, 8 * n)
        return drawn[drawn[:, 0] < self.mode.point[0]][:n]

    def log_density(self, points: Floats) -> Floats:
        return np.where(points[:, 0] < self.mode.point[0], self.whole.log_density(points) + np.log(2.0), -np.inf)


def run(posterior: Posterior, mode: Mode, told: list[str]) -> Sampled:
    history = History(lambda text, _: told.append(text), 0.0, [])
    settings = Settings(method="tmcmc", particles=400)
    rng, seeds = np.random.default_rng(1), np.random.SeedSequence(1)
    return two_starts(Given(posterior, (mode,), settings, rng, seeds, history, True))


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    """Three parameters: what is asked of the starts does not hang on how many there are."""
    return small_posterior()


@pytest.fixture(scope="module")
def mode(posterior: Posterior) -> Mode:
    return small_mode(posterior)


def test_two_starts_agree_where_all_is_well(posterior: Posterior, mode: Mode) -> None:
    told: list[str] = []
    found = run(posterior, mode, told)
    assert [check.name for check in found.checks] == CHECKS
    assert all(check.passed for check in found.checks), found.checks
    assert set(found.evidences) == {FIRST, SECOND}
    assert not any("sending out more" in text for text in told)


def test_an_approximation_with_a_hole_is_told(
    posterior: Posterior, mode: Mode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fallback used to start from the proposal that had just failed, and nothing looked beyond it."""

    def blind(target: Posterior, modes: Any, _: Any, **options: Any) -> TmcmcResult:
        return sample(target, reference=Half(modes[0]), **options)

    monkeypatch.setattr(module, "bridge", blind)
    monkeypatch.setattr(module, "_N_ATTEMPTS", 2)
    told: list[str] = []
    found = run(posterior, mode, told)
    failed = {check.name for check in found.checks if not check.passed}
    assert failed >= {"starts agree on the evidence", "starts agree on the means"}
    assert sum("sending out more" in text for text in told) == 1


def cloud(rng: np.random.Generator, sd: float = 1.0, n: int = 2000, correlation_times: float = 9.0) -> TmcmcResult:
    """Independent normal draws, of an evidence that is known."""
    last = StageFacts(
        stage=1, tempering_parameter=1.0, acceptance=0.3, effective_sample_size=n, n_solves=n, log_evidence=0.0,
        elapsed_s=0.0,
    )  # fmt: skip
    return TmcmcResult(
        particles=0.5 + 0.01 * sd * rng.standard_normal((n, 3)), log_likelihood=np.zeros(n), log_evidence=0.0,
        log_evidence_se=0.1, stages=(last,), n_solves=n, correlation_times=correlation_times,
    )  # fmt: skip


def failed_of(first: TmcmcResult, second: TmcmcResult) -> set[str]:
    return {check.name for check in module._Starts(first, second).checks if not check.passed}


def test_starts_of_one_mean_and_two_spreads_do_not_agree() -> None:
    """Evidence and means alone were compared. Of 2,000 draws each a log sd has standard error 1 / 63, a gap 1 / 45."""
    rng = np.random.default_rng(1)
    assert not failed_of(cloud(rng), cloud(rng))
    assert failed_of(cloud(rng), cloud(rng, sd=0.85)) == {"starts agree on the spreads"}


def test_chains_that_the_cap_stopped_are_a_failed_check() -> None:
    """It stood in the label of a stage alone."""
    rng = np.random.default_rng(2)
    assert failed_of(cloud(rng, correlation_times=7.2), cloud(rng)) == {"length of chains"}
    assert failed_of(cloud(rng), cloud(rng, correlation_times=2.0)) == set()


def test_few_independent_particles_are_a_failed_check_of_either_variant() -> None:
    """The plain variant, which does not know how long its chains are, was asked for neither."""
    rng = np.random.default_rng(2)
    plain = cloud(rng, correlation_times=np.nan)
    assert "length of chains" not in {check.name for check in module._Starts(plain, cloud(rng)).checks}
    assert failed_of(plain, cloud(rng)) == set()
    few = replace(plain, stages=(replace(plain.stages[-1], effective_sample_size=20.0),))
    assert "independent particles" in failed_of(few, cloud(rng))


@pytest.mark.parametrize(("explains", "sizes"), [(True, [500, 1000, 2000]), (False, [500])])
def test_more_particles_are_sent_out_for_a_model_that_leaves_noise(
    monkeypatch: pytest.MonkeyPatch, explains: bool, sizes: list[int]
) -> None:
    """Six clouds for a model with a hidden cubic stiffness, which is refused whatever they say, took ten minutes."""
    sent, rng, seeds = [], np.random.default_rng(1), np.random.SeedSequence(1)
    settings, history = Settings(particles=500), History(None, 0.0, [])

    def attempt(*given: Any) -> module._Starts:
        sent.append(given[3])
        return module._Starts(cloud(rng), cloud(rng, sd=0.5))

    monkeypatch.setattr(module, "_attempt", attempt)
    monkeypatch.setattr(module, "sheet_through", lambda *_: None)
    target: Any = None
    sampled = two_starts(Given(target, (), settings, rng, seeds, history, explains))
    assert sent == sizes
    assert "starts agree on the spreads" in {check.name for check in sampled.checks if not check.passed}


@pytest.fixture(scope="module")
def taken_over() -> Result:
    """A run whose importance sampling is said to have failed."""

    def failing(*arguments: Any, **options: Any) -> Any:
        found, nested = weighted_draws(*arguments, **options)
        return replace(found, pareto_k=0.95), nested

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bwbn_bayes.inference.by_importance.weighted_draws", failing)
        return identify(small_model(), small_record(), settings=Settings(particles=500))


def test_the_verdict_says_what_ran_why_and_how_good_it_is(taken_over: Result) -> None:
    facts = taken_over.facts
    assert facts.method == "tmcmc"
    assert [check.name for check in facts.checks][-5:] == CHECKS
    said = facts.verdict[1]
    assert "Pareto shape 0.95, 0.7 at most" in said
    assert "transitional MCMC took over; it passed its own checks" in said
    assert "worth" in said
    assert "nats apart" in said


def test_where_nothing_takes_over_draws_without_weight_are_those_of_the_normal_approximation() -> None:
    """A search that ends with a model which is refused must end: a column's took ten minutes of transitional MCMC."""

    def failing(*arguments: Any, **options: Any) -> Any:
        found, nested = weighted_draws(*arguments, **options)
        return replace(found, pareto_k=np.inf), nested

    settings = Settings(particles=500, fallback=False)
    plain = identify(small_model(), small_record(), settings=settings)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bwbn_bayes.inference.by_importance.weighted_draws", failing)
        result = identify(small_model(), small_record(), settings=settings)
    assert result.facts.method == "importance"
    assert "Pareto k" in {check.name for check in result.facts.checks if not check.passed}
    for own, other in zip(result.facts.parameters, plain.facts.parameters, strict=True):
        assert abs(own.mean - other.mean) < 0.5 * other.sd
        assert own.sd == pytest.approx(other.sd, rel=0.3)
