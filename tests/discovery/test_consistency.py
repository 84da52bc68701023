"""Whether stretches of a record agree: against SciPy's tests and densities, on residuals without any dynamics."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm, ttest_rel

from bwbn_bayes.discovery import consistency
from bwbn_bayes.discovery.consistency import of_stretches, probability_of_being_better
from bwbn_bayes.discovery.cross_validation import N_BLOCKS
from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

PER_STRETCH = 50
NOISE = IntegratedNoise(shape=1.0, scale=(1.0,))


@pytest.fixture
def leaving(monkeypatch: pytest.MonkeyPatch) -> Any:
    """An explanation that leaves a residual ``(n_times,)``, its evidence the likelihood where none is given."""
    monkeypatch.setattr(consistency, "residual_of", lambda posterior, _: posterior.residual)

    def made(residual: Floats, log_evidence: float | None = None, correlation: Correlation | None = None) -> Any:
        n = len(residual)
        record = Record(name="drawn", time_step=0.1, excitation=np.ones(n), channels={"acceleration_1": np.ones(n)})
        posterior = SimpleNamespace(noise=NOISE, record=record, residual=residual[None])
        one: Any = SimpleNamespace(posterior=posterior, modes=(SimpleNamespace(point=None),), correlation=correlation)
        one.log_evidence = log_evidence
        if log_evidence is None:
            one.log_evidence = float(np.sum(of_stretches(one)))
        return one

    return made


def test_the_sum_is_measured_by_its_scatter(leaving: Any) -> None:
    """As Student's test of paired values has it, on stretches of different strength."""
    rng = np.random.default_rng(1)
    sizes = np.repeat(rng.uniform(0.5, 2.0, N_BLOCKS), PER_STRETCH)
    left = rng.standard_normal((2, len(sizes))) * [sizes, 1.1 * np.roll(sizes, PER_STRETCH)]
    one, other = map(leaving, left)
    densities = [norm(scale=np.sqrt(np.mean(own**2))).logpdf(own).reshape(N_BLOCKS, -1).sum(axis=1) for own in left]
    expected = 1.0 - ttest_rel(densities[0], densities[1], alternative="greater").pvalue
    assert probability_of_being_better(one, other) == pytest.approx(expected)
    assert probability_of_being_better(other, one) == pytest.approx(1.0 - expected)


def test_stretches_beside_an_unnamed_force_have_the_density_of_all(leaving: Any) -> None:
    rng, n = np.random.default_rng(7), N_BLOCKS * 5
    basis, residual = rng.standard_normal((n, 6)), rng.standard_normal(n)
    correlation = Correlation(shared=SharedFunctions.of(basis))
    level = float(np.mean(np.square(correlation.whitened(residual[None]))))
    expected = multivariate_normal(cov=level * (np.eye(n) + basis @ basis.T)).logpdf(residual)
    assert leaving(residual, correlation=correlation).log_evidence == pytest.approx(expected)


def test_one_stretch_against_all_others_names_nothing(leaving: Any) -> None:
    """A gain of hundreds of nats in one stretch beside losses in the others, and one that is spread evenly."""
    rng = np.random.default_rng(2)
    plain = rng.standard_normal(N_BLOCKS * PER_STRETCH)
    once_bad = np.concatenate([6.0 * plain[:PER_STRETCH], 0.4 * plain[PER_STRETCH:]])
    assert probability_of_being_better(leaving(plain), leaving(once_bad)) < 0.9
    assert probability_of_being_better(leaving(plain), leaving(1.5 * plain)) > 0.999


def test_what_more_parameters_cost_counts(leaving: Any) -> None:
    """The sum is that of evidence, not of likelihood."""
    left = np.random.default_rng(3).standard_normal((2, N_BLOCKS * PER_STRETCH))
    cheap, dear = (leaving(left[0], log_evidence=value) for value in (30.0, -30.0))
    other = leaving(left[1], log_evidence=0.0)
    assert probability_of_being_better(cheap, other) > 0.5 > probability_of_being_better(dear, other)
