"""Whether stretches of a record agree: against Student's distribution by SciPy, on models without any dynamics."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_rel

from bwbn_bayes.discovery import consistency
from bwbn_bayes.discovery.consistency import probability_of_being_better
from bwbn_bayes.discovery.cross_validation import N_BLOCKS
from bwbn_bayes.inference.likelihood import IntegratedNoise
from bwbn_bayes.parameters import Floats

PER_BLOCK = 50
NOISE = IntegratedNoise(shape=1.0, scale=(1.0,))


def leaving(residual: Floats, monkeypatch: pytest.MonkeyPatch, log_evidence: float | None = None) -> Any:
    """An explanation that leaves a residual ``(n_times,)``, its evidence the likelihood where none is given."""
    posterior = SimpleNamespace(noise=NOISE, record=SimpleNamespace(kept=slice(None)), residual=residual[None])
    monkeypatch.setattr(consistency, "residual_of", lambda posterior, _: posterior.residual)
    one = SimpleNamespace(posterior=posterior, modes=(SimpleNamespace(point=None),), log_evidence=log_evidence)
    if log_evidence is None:
        one.log_evidence = float(np.sum(consistency._of_blocks(one)))  # type: ignore[arg-type]
    return one


def test_the_sum_is_measured_by_its_scatter(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Student's test of paired values has it, on blocks whose sizes differ from stretch to stretch."""
    rng = np.random.default_rng(1)
    sizes = np.repeat(rng.uniform(0.5, 2.0, N_BLOCKS), PER_BLOCK)
    left = rng.standard_normal((2, len(sizes))) * [sizes, 1.1 * np.roll(sizes, PER_BLOCK)]
    one, other = (leaving(own, monkeypatch) for own in left)
    by_block = [
        np.sum(-0.5 * own.reshape(N_BLOCKS, -1) ** 2 / np.mean(own**2), axis=1)
        - 0.5 * PER_BLOCK * np.log(np.mean(own**2))
        for own in left
    ]
    expected = 1.0 - ttest_rel(by_block[0], by_block[1], alternative="greater").pvalue
    assert probability_of_being_better(one, other) == pytest.approx(expected)
    assert probability_of_being_better(other, one) == pytest.approx(1.0 - expected)


def test_one_stretch_against_all_others_names_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A gain of hundreds of nats in one block beside losses in the others, and one that is spread evenly."""
    rng = np.random.default_rng(2)
    plain = rng.standard_normal(N_BLOCKS * PER_BLOCK)
    once_bad = np.concatenate([6.0 * plain[:PER_BLOCK], 0.4 * plain[PER_BLOCK:]])
    once = probability_of_being_better(leaving(plain, monkeypatch), leaving(once_bad, monkeypatch))
    evenly = probability_of_being_better(leaving(plain, monkeypatch), leaving(1.5 * plain, monkeypatch))
    assert once < 0.9
    assert evenly > 0.999


def test_what_more_parameters_cost_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sum is that of evidence, not of likelihood."""
    rng = np.random.default_rng(3)
    left = rng.standard_normal((2, N_BLOCKS * PER_BLOCK))
    cheap, dear = (leaving(left[0], monkeypatch, log_evidence=value) for value in (30.0, -30.0))
    other = leaving(left[1], monkeypatch, log_evidence=0.0)
    assert probability_of_being_better(cheap, other) > 0.5 > probability_of_being_better(dear, other)
