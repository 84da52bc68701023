"""Priors against SciPy and quadrature, and the map of the joint prior to the unit cube."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import integrate, stats

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import (
    Constraint,
    FreeParameter,
    HalfNormal,
    LogNormal,
    Normal,
    ParameterSpace,
    PerStorey,
    Prior,
    Truncated,
    Uniform,
)

PAIRS = [
    (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    (Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
    (HalfNormal(0.7), stats.halfnorm(scale=0.7)),
    (LogNormal(3.0, 0.4), stats.lognorm(0.4, scale=3.0)),
    (Truncated(Normal(1.0, 2.0), 0.5, np.inf), stats.truncnorm(-0.25, np.inf, 1.0, 2.0)),
    (Truncated(Normal(1.0, 2.0), -1.0, 1.5), stats.truncnorm(-1.0, 0.25, 1.0, 2.0)),
]
IDENTIFIERS = [str(prior) for prior, _ in PAIRS]


@pytest.mark.parametrize(("prior", "known"), PAIRS, ids=IDENTIFIERS)
def test_density_probability_and_quantile_are_scipys(prior, known):
    shares = np.array([0.001, 0.1, 0.5, 0.9, 0.999])
    values = known.ppf(shares)
    np.testing.assert_allclose(prior.quantile(shares), values, rtol=1e-9)
    np.testing.assert_allclose(prior.probability(values), shares, rtol=1e-9)
    np.testing.assert_allclose(prior.log_density(values), known.logpdf(values), rtol=1e-9, atol=1e-12)
    assert prior.support == pytest.approx(known.support())


@pytest.mark.parametrize(("prior", "known"), PAIRS, ids=IDENTIFIERS)
def test_mean_and_sd(prior, known):
    # A truncated prior averages 4096 mid-quantiles: good to 1e-3 of the sd where a tail is infinite.
    assert prior.mean == pytest.approx(known.mean(), abs=1e-3 * known.std())
    assert prior.sd == pytest.approx(known.std(), rel=2e-3)


@pytest.mark.parametrize(
    "parent", [Normal(0.3, 1.0), LogNormal(1.0, 0.8), HalfNormal(2.0), Uniform(-3.0, 2.0)], ids=str
)
def test_a_truncated_prior_is_normalised(parent):
    prior = parent.truncated(0.2, 1.7)
    mass, error = integrate.quad(lambda x: float(np.exp(prior.log_density(x))), 0.2, 1.7, epsabs=1e-12)
    assert mass == pytest.approx(1.0, abs=1e-9 + error)
    assert np.all(np.isneginf(prior.log_density(np.array([0.1999, 1.7001]))))
    assert prior.probability(0.2) == 0.0 and prior.probability(1.7) == 1.0


@pytest.mark.parametrize(("prior", "known"), PAIRS, ids=IDENTIFIERS)
def test_density_is_the_slope_of_probability(prior, known):
    values = known.ppf(np.array([0.15, 0.5, 0.85]))
    step = 1e-6 * known.std()
    slope = (prior.probability(values + step) - prior.probability(values - step)) / (2 * step)
    np.testing.assert_allclose(np.exp(prior.log_density(values)), slope, rtol=1e-6)


SHARES = np.array([1e-300, 1e-20, 1e-9, 1e-3, 0.3, 0.5, 0.9, 1.0 - 1e-9, 1.0 - 2.0**-53])
STANDARD = np.array([-37.0, -20.0, -8.0, -1.0, -1e-9, 0.0, 1e-9, 0.7, 5.0, 8.0, 30.0])
EXACT = {"rtol": 1e-12, "atol": 1e-300}


def test_the_written_out_normal_is_scipys_far_into_its_tails():
    prior, known = Normal(2.0, 0.5), stats.norm(2.0, 0.5)
    values = 2.0 + 0.5 * STANDARD
    np.testing.assert_allclose(prior.quantile(SHARES), known.ppf(SHARES), **EXACT)
    np.testing.assert_allclose(prior.probability(values), known.cdf(values), **EXACT)
    np.testing.assert_allclose(prior.log_density(values), known.logpdf(values), **EXACT)


def test_the_written_out_half_normal_is_scipys_far_into_its_tails():
    prior, known = HalfNormal(0.7), stats.halfnorm(scale=0.7)
    values = 0.7 * STANDARD
    np.testing.assert_allclose(prior.probability(values), known.cdf(values), **EXACT)
    np.testing.assert_allclose(prior.log_density(values), known.logpdf(values), **EXACT)
    # SciPy's ppf is good in the middle only: 1 + p loses the digits of a small p, and p near 1 is told by its distance.
    middle = SHARES[3:7]
    np.testing.assert_allclose(prior.quantile(middle), known.ppf(middle), **EXACT)
    np.testing.assert_allclose(prior.quantile(SHARES[5:]), known.isf(1.0 - SHARES[5:]), **EXACT)
    # Near zero the distribution function is a straight line, with a relative error of pi p^2 / 12.
    np.testing.assert_allclose(prior.quantile(SHARES[:3]), 0.7 * np.sqrt(np.pi / 2.0) * SHARES[:3], **EXACT)


def test_the_written_out_log_normal_is_scipys_far_into_its_tails():
    prior, known = LogNormal(3.0, 0.4), stats.lognorm(0.4, scale=3.0)
    values = np.array([0.0, *(3.0 * np.exp(0.4 * STANDARD))])
    np.testing.assert_allclose(prior.quantile(SHARES), known.ppf(SHARES), **EXACT)
    np.testing.assert_allclose(prior.probability(values), known.cdf(values), **EXACT)
    np.testing.assert_allclose(prior.log_density(values), known.logpdf(values), **EXACT)
    np.testing.assert_array_equal(prior.log_density(np.array([-1.0, np.nan])), [-np.inf, -np.inf])
    np.testing.assert_array_equal(prior.probability(np.array([-1.0])), [0.0])


def test_the_written_out_priors_end_where_they_should():
    np.testing.assert_array_equal(LogNormal(3.0, 0.4).quantile(np.array([0.0, 1.0])), [0.0, np.inf])
    np.testing.assert_array_equal(Normal(2.0, 0.5).quantile(np.array([0.0, 1.0])), [-np.inf, np.inf])
    np.testing.assert_array_equal(HalfNormal(0.7).quantile(np.array([0.0, 1.0])), [0.0, np.inf])


def test_outside_the_support_there_is_no_density():
    assert np.isneginf(Uniform(0.0, 1.0).log_density(1.5))
    assert np.isneginf(HalfNormal(1.0).log_density(-0.1))


def space_of(*priors: Prior, constraints: tuple[Constraint, ...] = ()) -> ParameterSpace:
    parameters = tuple(FreeParameter(name=f"p{i}", symbol="p", unit="", prior=p) for i, p in enumerate(priors))
    return ParameterSpace(parameters=parameters, constraints=constraints)


def test_the_unit_cube_and_back():
    space = space_of(Uniform(-1.0, 3.0), LogNormal(3.0, 0.4), Truncated(Normal(1.0, 2.0), 0.5, np.inf))
    points = np.random.default_rng(0).uniform(0.01, 0.99, (50, 3))
    values = space.from_unit(points)
    np.testing.assert_allclose(space.to_unit(values), points, rtol=1e-9)
    step = 1e-6
    for i in range(3):
        shift = np.eye(3)[i] * step
        slope = (space.from_unit(points + shift) - space.from_unit(points - shift))[:, i] / (2 * step)
        np.testing.assert_allclose(space.unit_scale(values)[:, i], slope, rtol=1e-6)


def test_the_joint_prior_is_normalised_over_what_is_admissible():
    """A half plane through a normal: x > y for two equal normals holds half the mass, whatever their scale."""
    half = Constraint(text="x > y", holds=lambda draws: draws[:, 0] > draws[:, 1], columns=(0, 1))
    space = space_of(Normal(1.0, 2.0), Normal(1.0, 2.0), constraints=(half,))
    assert np.exp(space.log_admissible_mass) == pytest.approx(0.5, abs=1e-3)
    inside = np.array([[0.9, 0.2], [0.2, 0.9], [1.1, 0.2]])
    np.testing.assert_allclose(space.log_prior_unit(inside), [np.log(2.0), -np.inf, -np.inf], atol=2e-3)


def test_the_admissible_mass_does_not_depend_on_further_parameters():
    """A model and a larger one share the normalisation to the last digit, wherever the columns stand."""

    def admissible(*columns: int) -> Constraint:
        one, two = columns
        return Constraint(text="x > y", holds=lambda draws: draws[:, one] > draws[:, two], columns=columns)

    small = space_of(Normal(1.0, 2.0), Uniform(0.0, 3.0), constraints=(admissible(0, 1),))
    further = (LogNormal(1.0, 2.0), HalfNormal(3.0), Uniform(-5.0, 5.0))
    after = space_of(Normal(1.0, 2.0), Uniform(0.0, 3.0), *further, constraints=(admissible(0, 1),))
    between = space_of(Normal(1.0, 2.0), *further, Uniform(0.0, 3.0), constraints=(admissible(0, 4),))
    assert small.log_admissible_mass == after.log_admissible_mass == between.log_admissible_mass
    # P(x > y) = integral of the normal's upper tail over the uniform's interval.
    share, _ = integrate.quad(lambda y: stats.norm.sf(y, 1.0, 2.0) / 3.0, 0.0, 3.0)
    assert np.exp(small.log_admissible_mass) == pytest.approx(share, abs=1e-3)


def test_without_constraints_the_mass_is_one():
    assert space_of(Uniform(0, 1)).log_admissible_mass == 0.0


def test_samples_follow_the_prior():
    """Kolmogorov-Smirnov of 4,000 draws at a fixed seed: p above 1e-3."""
    space = space_of(LogNormal(3.0, 0.4))
    values = space.from_unit(space.sample_unit(np.random.default_rng(5), 4000))[:, 0]
    assert stats.kstest(values, stats.lognorm(0.4, scale=3.0).cdf).pvalue > 1e-3


def test_per_storey_keeps_a_tuple():
    values = [1.0, 2.0]
    each = PerStorey(values)
    values[0] = 9.0
    assert each.value == (1.0, 2.0)
    assert each == PerStorey((1.0, 2.0)) and hash(each) == hash(PerStorey((1.0, 2.0)))


@pytest.mark.parametrize("location", [np.nan, np.inf])
def test_a_normal_prior_lies_somewhere(location: float) -> None:
    with pytest.raises(UserError, match="location must be a finite number"):
        Normal(location, 1.0)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Uniform("5", "20"), "Uniform: lower is '5': give a number"),
        (lambda: Uniform(None, 2), "Uniform: lower is None: give a number"),
        (lambda: Uniform(False, True), "Uniform: lower is False: give a number"),
        (lambda: Uniform(0, 10**400), "Uniform: upper is larger than any number of double precision"),
        (lambda: Normal("1", 2.0), "Normal: location is '1': give a number"),
        (lambda: HalfNormal([1.0]), r"HalfNormal: scale is \[1.0\]: give a number"),
        (lambda: LogNormal(1.0, Uniform(1, 2)), "LogNormal: log_sd is Uniform.*: give a number"),
        (lambda: Normal(1, 2).truncated(20, 5), r"Normal\(1, 2\) truncated to \[20, 5\]: the lower bound comes first"),
        (lambda: Normal(1, 2).truncated("0", 5), r"prior Normal\(1, 2\) truncated: lower is '0': give a number"),
    ],
)
def test_what_is_no_number_is_one_sentence(make: Callable[[], object], sentence: str) -> None:
    """NumPy spoke of ufuncs, and bounds exchanged were told to have no mass."""
    with pytest.raises(UserError, match=sentence):
        make()
