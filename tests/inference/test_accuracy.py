"""The claimed discretisation error against the reference engine and against a refit."""

from dataclasses import fields, replace
from typing import Any, override

import numpy as np
import pytest
from inference_cases import climbed, posterior_of, recorded, sdof_model, true_point, with_slip

from bwbn_bayes import BoucWen, PerStorey, Record, ShearBuilding, Specimen, Uniform, el_centro, simulate
from bwbn_bayes.engines.base import Response
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.accuracy import LADDER, LIMIT, Judge, choose_scheme, coarsest_stable, left_out, rung_of
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode, find_modes
from bwbn_bayes.parameters import Floats

FINEST = Lanes(substeps=16, resolution=0.015)
EXACT = Lanes(substeps=64, resolution=0.01)
"""Four times finer than the ladder's last rung; checked against the reference engine below."""


@pytest.fixture(scope="module")
def pinching() -> Posterior:
    """A narrow slip under little noise: a hard case, in which only the fourth step size or so is fine enough."""
    return posterior_of(with_slip(sdof_model()), recorded(1, slip=True, snr_db=52.0, sigma=0.0012))


@pytest.fixture(scope="module")
def fitted(pinching: Posterior) -> Mode:
    """The optimum under the exact scheme."""
    return climbed(pinching.with_engine(EXACT), true_point(with_slip(sdof_model()), pinching.record))


@pytest.fixture(scope="module")
def reference_response(pinching: Posterior, fitted: Mode) -> Floats:
    values = pinching.space.from_unit(fitted.point[None])
    return Reference().simulate(pinching.model, values, pinching.record).values[0, 0]


def relative_error(posterior: Posterior, point: Floats, engine: Lanes, truth: Floats) -> float:
    response = engine.simulate(posterior.model, posterior.space.from_unit(point[None]), posterior.record).values[0, 0]
    return float(np.sqrt(np.mean((response - truth) ** 2) / np.mean(posterior.record.channels["acceleration_1"] ** 2)))


def test_the_exact_scheme_is_exact(pinching: Posterior, fitted: Mode, reference_response: Floats) -> None:
    assert relative_error(pinching, fitted.point, EXACT, reference_response) < 1e-5


def test_steep_slopes_are_judged_like_others(pinching: Posterior, fitted: Mode) -> None:
    """Squared, they left a matrix that could not be solved, and a traceback, on a record that no model fits."""
    judge = Judge.at(pinching, fitted.point, FINEST)
    steep = np.where(np.arange(len(judge.jacobian)) == 0, 1e12, 1.0)
    steeper = replace(judge, jacobian=judge.jacobian * steep[:, None])
    shift, other = (each(LADDER[0]).joint_shift_sd for each in (judge, steeper))
    assert other == pytest.approx(shift, rel=0.05)


@pytest.mark.parametrize("rung", range(len(LADDER) - 1))
def test_claims_are_true_within_a_factor_of_two(
    pinching: Posterior, fitted: Mode, reference_response: Floats, rung: int
) -> None:
    """The response error against the reference; the shift of the estimate against the refit by that scheme."""
    scheme = LADDER[rung]
    claimed = Judge.at(pinching, fitted.point, FINEST)(scheme)
    true_error = relative_error(pinching, fitted.point, scheme, reference_response)
    assert claimed.nrmse == pytest.approx(true_error, rel=0.5, abs=2e-6)
    refit = climbed(pinching.with_engine(scheme), fitted.point)
    step = refit.point - fitted.point
    shift = float(np.sqrt(step @ fitted.information @ step))
    # The finest rung stands for the truth in a claim, and is itself off by 0.01 sd and 0.01 nat here.
    assert 0.5 * shift - 0.02 < claimed.joint_shift_sd < 2.0 * shift + 0.02
    gain = refit.log_likelihood - fitted.log_likelihood
    assert abs(claimed.log_likelihood_shift - gain) < 0.5 * abs(gain) + 0.05


def test_the_chosen_scheme_is_the_cheapest_acceptable_one(pinching: Posterior, fitted: Mode) -> None:
    coarse = LADDER[0]
    chosen, facts = choose_scheme(pinching.with_engine(coarse), fitted.point, coarse)
    assert facts.acceptable
    assert facts.joint_shift_sd < LIMIT
    assert facts.scheme == chosen.scheme
    number = LADDER.index(chosen)
    assert 0 < number < len(LADDER) - 1
    judge = Judge.at(pinching, fitted.point, FINEST)
    assert not any(judge(rung).acceptable for rung in LADDER[:number])
    refit = climbed(pinching.with_engine(chosen), fitted.point)
    step = refit.point - fitted.point
    assert np.sqrt(step @ fitted.information @ step) < 2.0 * LIMIT


def test_the_finest_scheme_is_returned_where_none_will_do(pinching: Posterior, fitted: Mode) -> None:
    """With noise a thousandth of the true one nothing on the ladder is fine enough."""
    noise = replace(pinching.noise, shape=1e9, scale=(1e-4,))  # type: ignore[type-var]
    chosen, facts = choose_scheme(replace(pinching, noise=noise), fitted.point, FINEST)
    assert chosen == LADDER[-1]
    assert not facts.acceptable
    assert facts.scheme == f"{chosen.scheme}; the figures are those of the next coarser one"


STIFF = {"k[1]": 5e4, "k[2]": 4e4, "k[3]": 3e4}


@pytest.fixture(scope="module")
def stiff_building() -> Posterior:
    """Three storeys for which a step of 50 Hz is too long."""
    storey = BoucWen(k=PerStorey(Uniform(2e4, 8e4)), c=20.0, alpha=0.1, A=1.0, beta=400.0, gamma=100.0, n=1.2)
    model = ShearBuilding(masses=[1.0] * 3, storey=storey)
    record = simulate(model, el_centro("chopra", duration=6.0), STIFF, snr_db=30.0)
    engine = replace(LADDER[0], n_threads=1)
    return Posterior(model=model, record=record, engine=engine, noise=default_noise(record))


def test_a_stiff_building_is_searched_by_steps_that_do_not_run_away(stiff_building: Posterior) -> None:
    """Of thirty storeys sampled at 50 Hz not one draw of the prior could be solved; three that are as stiff do here."""
    points = stiff_building.sample_prior(np.random.default_rng(3), 32)
    assert not np.any(np.isfinite(stiff_building.misfit(points)))
    stable = coarsest_stable(stiff_building)
    assert np.all(np.isfinite(stable.misfit(points)))
    (best, *_) = find_modes(stable, np.random.default_rng(4), n_starts=256)
    found = stable.space.from_unit(best.point[None])[0]
    assert found == pytest.approx(list(STIFF.values()), rel=0.02)
    assert coarsest_stable(stable.with_engine(replace(LADDER[-1], n_threads=1))).engine == stable.engine


def test_from_the_finest_rung_on_there_is_nothing_to_choose(pinching: Posterior, fitted: Mode) -> None:
    """Where a search has solved so finely already."""
    chosen, facts = choose_scheme(pinching, fitted.point, FINEST, first=len(LADDER) - 1)
    assert chosen == FINEST
    assert facts.acceptable


def test_steps_that_run_away_are_shortened_and_what_is_sharp_is_not_refined_for_it(stiff_building: Posterior) -> None:
    """Of column 380 each solve took four times as long for the slip, which nothing had asked for."""
    points = stiff_building.sample_prior(np.random.default_rng(3), 64)
    assert np.mean(np.isfinite(stiff_building.misfit(points))) < 0.9
    stable = coarsest_stable(stiff_building)
    assert isinstance(stable.engine, Lanes)
    assert np.mean(np.isfinite(stable.misfit(points))) >= 0.9
    assert stable.engine.substeps > 1
    assert stable.engine.resolution == LADDER[0].resolution
    rung, substeps = rung_of(stable.engine), stable.engine.substeps
    assert LADDER[rung].resolution == stable.engine.resolution
    for accepts in (lambda _: True, lambda _: False):
        chosen, _ = choose_scheme(stable, points[0], stable.engine, first=rung, substeps=substeps, accepts=accepts)
        assert chosen.substeps >= substeps


def test_what_a_scheme_leaves_out_is_told() -> None:
    """A loop of 2 m in strides of a quarter, in equal steps: of stiff ones these run away, of soft ones they do not."""
    model = Specimen(storey=BoucWen(k=5e4, alpha=0.05, u_y=Uniform(0.002, 0.1), rho=0.9, n=3.0))
    path = np.interp(np.arange(0.0, 24.0, 0.25), np.arange(25.0), [0.0, 1.0, -1.0] * 8 + [0.0])
    loop = Record(name="loop", time_step=0.25, excitation=path, excitation_kind="displacement")
    record = simulate(model, loop, {"u_y": 0.012}, channels=["force"], snr_db=0.0, engine=LADDER[-1])
    posterior = Posterior(model=model, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    points = np.linspace(0.005, 0.995, 64)[:, None]
    exact = posterior.with_engine(replace(LADDER[-1], n_threads=1)).log_likelihood(points)
    solved = np.isfinite(posterior.log_likelihood(points))
    found, finer_log_likelihood = left_out(posterior, points, float(np.max(exact)) - 4.0)
    # By steps half as long, not by the finest.
    assert finer_log_likelihood[found] == pytest.approx(exact[found], abs=3.0)
    assert np.any(found)
    assert not np.any(found & solved)
    assert np.all(exact[found] >= np.max(exact) - 4.5)
    finer = posterior.with_engine(replace(LADDER[-1], n_threads=1))
    assert not np.any(left_out(finer, points, float(np.max(exact)) - 4.0)[0])


class RunsAway(Lanes):
    """Lanes of which the slopes run away by one step per sample, where the response does not."""

    @override
    def sensitivities(self, *args: Any, **kwargs: Any) -> tuple[Response, Floats]:
        response, slopes = super().sensitivities(*args, **kwargs)
        return response, slopes if self.substeps > 1 else np.full_like(slopes, np.nan)


def test_slopes_that_run_away_are_asked_of_shorter_steps(pinching: Posterior, fitted: Mode) -> None:
    """Every scheme but the finest was refused for them, on column 380, and that one cost five times as much."""
    coarse = RunsAway(**{one.name: getattr(LADDER[0], one.name) for one in fields(LADDER[0])})
    view = pinching.with_engine(coarse)
    chosen, facts = choose_scheme(view, fitted.point, coarse, accepts=lambda facts: facts.joint_shift_sd < np.inf)
    assert (chosen.substeps, chosen.resolution) == (2, 0.5)
    assert np.isfinite(facts.joint_shift_sd)
