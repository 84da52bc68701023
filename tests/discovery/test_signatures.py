"""The signature of what was added: off the record, off the identified response with its interval, and without it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import signatures
from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.signatures import place_of, signature_of
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.signature import NO_SIGNATURE
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.importance import laplace_mixture
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import Mode, distinct
from bwbn_bayes.parameters import Floats, HalfNormal, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

STOREY = BoucWen(k=Uniform(5, 20), alpha=0.05, beta=4.0, gamma=4.0, n=1.5)
EFFECT = SlipLock(delta_s=HalfNormal(0.2), sigma=0.05)
TRUTH = {"k": 10.0, "delta_s": 0.06}
ENGINE = Lanes(substeps=2, n_threads=1)
PATH = np.interp(np.arange(801) / 100, np.arange(9), [0.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 0.0])


def by_hand(force: Floats) -> float:
    """Force at zero displacement over the peak before it.

    The path is straight between turning points a hundred samples apart: zeros lie half way between them,
    but for the last branch, which ends at zero.
    """
    zeros = np.arange(150, 700, 100)
    peaks = [np.max(np.abs(force[max(zero - 100, 0) : zero + 1])) for zero in zeros]
    return float(np.median(np.abs(force[zeros]) / peaks))


@pytest.fixture(scope="module")
def present() -> Explanation:
    hypothesis = Hypothesis(base=Specimen(storey=STOREY), effect=EFFECT, storeys=(1,), scales=NOMINAL)
    model = hypothesis.model
    point = model.space.to_unit(np.array([[TRUTH[name] for name in model.space.names]]))
    record = Record(name="cycles", time_step=0.01, excitation=PATH, channels={}, excitation_kind="displacement")
    force = ENGINE.simulate(model, model.space.from_unit(point), record, ("force",)).values[0, 0]
    record = record.with_channels({"force": force + 0.02 * np.random.default_rng(1).standard_normal(len(force))})
    posterior = Posterior(model=model, record=record, engine=ENGINE, noise=KnownNoise(sd=(0.02,)))
    modes = distinct(point, posterior.linearise(point))
    return Explanation(added=(hypothesis,), posterior=posterior, modes=modes, evidence=cast(Any, None))


def test_a_pinch_is_measured_identified_and_told_without_it(
    present: Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signatures, "N_DRAWS", 8)
    (hypothesis,) = present.added
    found = signature_of(hypothesis, present, np.random.default_rng(2))
    assert found is not None
    assert (found.measure, found.unit) == ("pinching index", "")
    measured = by_hand(present.posterior.record.channels["force"])
    assert found.measured == pytest.approx(measured, abs=0.02)
    assert found.low <= found.mean <= found.high
    assert found.mean == pytest.approx(measured, abs=0.03)
    # Far more data than unknowns: the interval is narrow, but not a point.
    assert 0.0 < found.high - found.low < 0.05
    plain = Specimen(storey=STOREY)
    own = present.posterior.record
    full = ENGINE.simulate(plain, np.array([[TRUTH["k"]]]), own, ("force",)).values[0, 0]
    assert found.without == pytest.approx(by_hand(full), abs=0.02)
    assert found.without > 0.7 > 0.4 > found.mean
    assert found.deserved == 1.0
    assert found.as_json()["identified"] == {"mean": found.mean, "low": found.low, "high": found.high}


def test_a_law_that_hardly_slips_does_not_deserve_the_name(
    present: Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slip of a thousandth of the drift may help a fit; the loop is not pinched."""
    monkeypatch.setattr(signatures, "N_DRAWS", 8)
    (hypothesis,) = present.added
    space = present.model.space
    values = np.array([[{**TRUTH, "delta_s": 1e-5}[name] for name in space.names]])
    mode = replace(present.modes[0], point=space.to_unit(values)[0], information=1e12 * np.eye(2))
    found = signature_of(hypothesis, replace(present, modes=(mode,)), np.random.default_rng(3))
    assert found is not None
    assert found.deserved == 0.0
    assert found.mean == pytest.approx(found.without, abs=0.01)


def test_a_name_is_not_deserved_where_the_measured_loop_does_not_show_it(present: Explanation) -> None:
    """The law pinches as before, and the record is that of a fat loop: the name would be the law's, not the loop's."""
    (hypothesis,) = present.added
    record = present.posterior.record
    fat = ENGINE.simulate(Specimen(storey=STOREY), np.array([[10.0]]), record, ("force",)).values[0, 0]
    assert signature_of(hypothesis, present, np.random.default_rng(2)).deserved == 1.0  # type: ignore[union-attr]
    other = replace(present, posterior=replace(present.posterior, record=record.with_channels({"force": fat})))
    assert signature_of(hypothesis, other, np.random.default_rng(2)).deserved == 0.0  # type: ignore[union-attr]


def test_an_effect_that_measures_nothing_has_no_signature(present: Explanation) -> None:
    nameless: Any = SimpleNamespace(effect=SimpleNamespace(signature=NO_SIGNATURE))
    assert signature_of(nameless, present, np.random.default_rng(4)) is None


def test_of_several_storeys_the_one_that_drifts_most_is_read() -> None:
    histories = {"drift": np.array([[0.1, -0.2], [0.3, 0.1], [0.0, -0.9]])}
    several, one, whole = (cast(Any, SimpleNamespace(storeys=storeys)) for storeys in ((1, 2), (3,), ()))
    assert place_of(several, histories) == 1
    assert place_of(one, histories) == 2
    assert place_of(whole, histories) is None


def test_draws_are_as_likely_as_those_of_a_normal_posterior() -> None:
    """In a normal one they are Laplace's; where it is bent, none is lost, and none is where the posterior is not."""
    mode = Mode(point=np.full(2, 0.5), log_likelihood=7.0, gradient=np.zeros(2), information=np.diag([1e2, 1e4]))

    def posterior(bend: float) -> Any:
        def log_likelihood(points: Floats) -> Floats:
            first, second = (points - 0.5).T
            return np.asarray(7.0 - 50.0 * first**2 - 5e3 * (second - bend * first**2) ** 2)

        return SimpleNamespace(log_likelihood=log_likelihood, log_prior=lambda points: np.zeros(len(points)))

    drawn = {
        bend: signatures._draws(
            cast(Any, SimpleNamespace(modes=(mode,), posterior=posterior(bend))), np.random.default_rng(1)
        )
        for bend in (0.0, 20.0)
    }
    expected = laplace_mixture((mode,)).sample(np.random.default_rng(1), signatures.N_DRAWS)
    np.testing.assert_allclose(drawn[0.0], expected)
    lost = 7.0 - posterior(20.0).log_likelihood(expected)
    assert np.median(lost) > 10.0
    assert len(drawn[20.0]) == len(expected)
    spread = (expected - 0.5) / [0.1, 0.01]
    allowed = 0.5 * np.sum(np.square(spread), axis=1) + 1.0
    assert np.all(7.0 - posterior(20.0).log_likelihood(drawn[20.0]) <= allowed)
    assert np.std(drawn[20.0][:, 0]) > 0.1 * np.std(expected[:, 0])
