"""Wrong models whose residual passes for noise: a late sensor, hardening, a prior that excludes the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from inference_cases import SDOF, posterior_of, recorded, sdof_model, true_point

from bwbn_bayes import (
    BoucWen,
    CubicStiffness,
    Oscillator,
    SensorLag,
    Settings,
    Uniform,
    as_force,
    identify,
    multisine,
    simulate,
)
from bwbn_bayes.discovery.alternatives import alternatives_check
from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.score import Score
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.inference.doubts import LARGEST_GAIN, doubts
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.parameters import Floats

RECORD_SEED, SNR_DB = 1, 20.0


def fitted(posterior: Posterior, start: Floats) -> Mode:
    return distinct(*polish(posterior, start[None], n_iterations=30))[0]


@pytest.mark.parametrize(
    ("effect", "word"), [(SensorLag(lag=0.005), "sensor lag"), (CubicStiffness(k3=250.0), "cubic stiffness")]
)
def test_what_hides_behind_a_white_residual_is_named(effect: Effect, word: str) -> None:
    """The residual is white and of the noise's level, and the parameters are far off; the verdict said "explains"."""
    assert SDOF.excitation is not None
    hidden = sdof_model().with_effect(effect)
    record = simulate(hidden, SDOF.excitation, SDOF.truth, snr_db=SNR_DB, seed=RECORD_SEED)
    facts = identify(sdof_model(), record, settings=Settings(particles=300)).facts
    checks = {check.name: check for check in facts.checks}
    assert checks["residual level"].passed and checks["residual whiteness"].passed
    assert facts.grade == "doubtful"
    assert not checks["alternatives"].passed
    assert word in checks["alternatives"].sentence.lower()
    assert "yet doubtfully: another mechanism may do so equally" in facts.verdict[0]
    assert checks["alternatives"].sentence in facts.verdict[0]


def test_a_prior_that_excludes_the_truth_is_said() -> None:
    record = recorded(1, snr_db=SNR_DB)
    model = sdof_model().with_values({"c": Uniform(0.26, 1.0)})
    posterior = posterior_of(model, record)
    start = true_point(sdof_model(), record)
    start[1] = 0.05
    _, within = doubts(posterior, fitted(posterior, start))
    assert not within.passed
    assert "lower end of the prior of c, 0.26" in within.sentence


def test_an_amount_has_its_sign_and_counts_from_where_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sensor that shows 3 % too little was told as one with a gain near 0.03."""

    def scores(_: Posterior, every: Sequence[Hypothesis], *__: object, **___: object) -> list[Score]:
        nats = {"sensor_gain": 50.0}
        return [
            Score(nats=nats.get(h.name, 0.0), amplitude=h.amplitudes[0], unit="", smallest=1e-3, size=-0.0312)
            for h in every
        ]

    monkeypatch.setattr("bwbn_bayes.discovery.alternatives.scores", scores)
    monkeypatch.setattr("bwbn_bayes.discovery.alternatives.heard_rests", lambda *_: True)
    record = recorded(1, snr_db=SNR_DB)
    (check,) = alternatives_check(posterior_of(sdof_model(), record), true_point(sdof_model(), record))
    assert check.sentence.startswith("Wrong sensor gain")
    assert "(gain near 0.969) would explain more: worth 50 nats" in check.sentence


@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 9))])
def test_a_right_model_is_not_doubted(seed: int) -> None:
    """Over eight data seeds no check of the three fails, and the best effect stays below its limit."""
    record = recorded(seed, snr_db=SNR_DB)
    posterior = posterior_of(sdof_model(), record)
    mode = fitted(posterior, true_point(sdof_model(), record))
    found = (*doubts(posterior, mode), *alternatives_check(posterior, mode.point))
    assert all(check.passed for check in found), [check.sentence for check in found if not check.passed]


def test_of_many_channels_one_may_look_coloured(monkeypatch: pytest.MonkeyPatch) -> None:
    """White noise in thirty channels: the smallest of sixty probabilities is below a thousandth in six cases of 100."""
    record = recorded(1, snr_db=SNR_DB)
    posterior = posterior_of(sdof_model(), record)
    mode = fitted(posterior, true_point(sdof_model(), record))
    rng, found = np.random.default_rng(3), []
    for _ in range(200):
        rests = {str(channel): rng.standard_normal(400) for channel in range(30)}
        monkeypatch.setattr("bwbn_bayes.inference.doubts.heard_rests", lambda *_, rests=rests: rests)
        found.append(doubts(posterior, mode)[0].value)
    # Both tests are of the same residual: their probabilities are not independent, nor exact in so few samples.
    assert 0.4 < np.median(found) < 0.6
    assert np.mean(np.array(found) < 0.1) < 0.2


def test_the_catalogue_is_asked_whatever_the_engine() -> None:
    """A model that another engine than the lanes had solved ended in a TypeError."""
    record = recorded(1, snr_db=SNR_DB)
    posterior = posterior_of(sdof_model(), record)
    mode = fitted(posterior, true_point(sdof_model(), record))
    (asked,) = alternatives_check(posterior, mode.point)
    (other,) = alternatives_check(posterior.with_engine(ScalarRk4(substeps=4)), mode.point)
    assert other.value == pytest.approx(asked.value, abs=1.0)
    assert (other.limit, other.passed) == (asked.limit, asked.passed)


def test_the_catalogue_answers_the_same_on_any_number_of_threads() -> None:
    record = recorded(1, snr_db=SNR_DB)
    posterior = posterior_of(sdof_model(), record)
    point = true_point(sdof_model(), record)
    one, three = (
        alternatives_check(posterior.with_engine(replace(posterior.engine, n_threads=n)), point) for n in (1, 3)
    )
    assert one == three


def test_a_bound_is_worth_what_the_likelihood_gains_beyond_it() -> None:
    """Against a wider prior that holds the optimum, refitted: the expansion is of second order, to within a third."""
    record = recorded(1, snr_db=SNR_DB)
    wide = posterior_of(sdof_model(), record)
    best = fitted(wide, true_point(sdof_model(), record))
    c = float(wide.space.from_unit(best.point[None])[0, 1])
    model = sdof_model().with_values({"c": Uniform(c + 0.06, c + 0.5)})
    narrow = posterior_of(model, record)
    start = best.point.copy()
    start[1] = 1e-3
    held = fitted(narrow, start)
    _, within = doubts(narrow, held)
    gained = best.log_likelihood - held.log_likelihood
    assert gained > LARGEST_GAIN
    assert within.value == pytest.approx(gained, rel=0.34)
    assert np.isfinite(within.value)


def test_priors_that_exclude_loops_that_harden_are_said() -> None:
    """No draw of the proposal was admissible: the fit ended in a traceback, or its draws were worth "inf"."""
    shape = {"k": 80.0, "c": 0.5, "alpha": 0.5, "beta": 8.0, "gamma": -11.0}
    force = as_force(multisine(np.random.default_rng(1), (0.3, 4.0), 600, 0.01, rms=20.0))
    truth = Oscillator(mass=2.0, spring=BoucWen(**shape, hardens=True))
    record = simulate(truth, force, {}, channels=["displacement_1"], snr_db=50.0)
    spring = BoucWen(
        k=Uniform(20, 200), c=Uniform(0, 5), alpha=Uniform(0, 1), beta=Uniform(-20, 60), gamma=Uniform(-80, 60)
    )
    facts = identify(
        Oscillator(mass=2.0, spring=spring), record, settings=Settings(particles=200, alternatives=False)
    ).facts
    checks = {check.name: check for check in facts.checks}
    assert not checks["within the prior"].passed
    told = "The best fit lies at the edge of what beta + gamma >= 0 admits (hardens=True is without it): beyond it lies"
    assert told in " ".join(facts.verdict)
    assert 0.0 < facts.effective_sample_size < np.inf
