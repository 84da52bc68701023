"""The signature of what was added: off the record, off the identified response with its interval, and without it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import signatures
from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.sentences import signature_in_words
from bwbn_bayes.discovery.signatures import place_of, signature_of, spread_of
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.search_guide import guide_of
from bwbn_bayes.elements.signature import NO_SIGNATURE, Signature
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, Posterior
from bwbn_bayes.inference.modes import distinct
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.inference.slopes import Slopes
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
    hypothesis = Hypothesis(
        base=Specimen(storey=STOREY), effect=EFFECT, storeys=(1,), scales=NOMINAL, guide=guide_of(SlipLock)
    )
    model = hypothesis.model
    point = model.space.to_unit(np.array([[TRUTH[name] for name in model.space.names]]))
    record = Record(name="cycles", time_step=0.01, excitation=PATH, channels={}, excitation_kind="displacement")
    force = ENGINE.simulate(model, model.space.from_unit(point), record, ("force",)).values[0, 0]
    record = record.with_channels({"force": force + 0.02 * np.random.default_rng(1).standard_normal(len(force))})
    posterior = Posterior(model=model, record=record, engine=ENGINE, noise=KnownNoise(sd=(0.02,)))
    modes = distinct(point, posterior.linearise(point))
    return Explanation(added=(hypothesis,), posterior=posterior, modes=modes, evidence=cast(Any, None))


def spread(present: Explanation) -> Floats:
    """Points about the best one, in steps of a ten thousandth of the priors."""
    return np.asarray(present.best + 1e-4 * np.random.default_rng(2).standard_normal((8, 2)))


def having(hypothesis: Hypothesis, signature: Signature) -> Any:
    """The same effect with another signature."""
    return SimpleNamespace(
        effect=SimpleNamespace(signature=signature),
        storeys=(1,),
        scales=NOMINAL,
        amplitudes=hypothesis.amplitudes,
        neutral=hypothesis.neutral,
    )


def test_a_pinch_is_measured_identified_and_told_without_it(present: Explanation) -> None:
    (hypothesis,) = present.added
    found = signature_of(hypothesis, present, spread(present))
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


def test_a_law_that_hardly_slips_does_not_deserve_the_name(present: Explanation) -> None:
    """A slip of a thousandth of the drift may help a fit; the loop is not pinched."""
    (hypothesis,) = present.added
    space = present.model.space
    values = np.array([[{**TRUTH, "delta_s": 1e-5}[name] for name in space.names]])
    bare = replace(present, modes=(replace(present.modes[0], point=space.to_unit(values)[0]),))
    found = signature_of(hypothesis, bare, spread(bare))
    assert found is not None
    assert found.deserved == 0.0
    assert found.mean == pytest.approx(found.without, abs=0.01)


def test_a_name_is_not_deserved_where_the_measured_loop_does_not_show_it(present: Explanation) -> None:
    """The law pinches as before, and the record is that of a fat loop: the name would be the law's, not the loop's."""
    (hypothesis,) = present.added
    record = present.posterior.record
    fat = ENGINE.simulate(Specimen(storey=STOREY), np.array([[10.0]]), record, ("force",)).values[0, 0]
    assert signature_of(hypothesis, present, spread(present)).deserved == 1.0  # type: ignore[union-attr]
    other = replace(present, posterior=replace(present.posterior, record=record.with_channels({"force": fat})))
    assert signature_of(hypothesis, other, spread(present)).deserved == 0.0  # type: ignore[union-attr]


def test_a_law_that_leaves_the_loop_as_it_was_does_not_deserve_the_name(present: Explanation) -> None:
    """A blind test's stop had "pinching" named beside it, index 0.442 with that law and 0.442 without."""
    (hypothesis,) = present.added
    told = signature_of(hypothesis, present, spread(present))
    assert told is not None
    changed = told.without - told.mean
    for readable, deserved in ((0.9 * changed, 1.0), (1.1 * changed, 0.0)):
        signature = replace(SlipLock.signature, readable=readable)
        own = having(hypothesis, signature)
        assert signature_of(own, present, spread(present)).deserved == deserved  # type: ignore[union-attr]


def test_an_effect_that_measures_nothing_has_no_signature(present: Explanation) -> None:
    nameless: Any = SimpleNamespace(effect=SimpleNamespace(signature=NO_SIGNATURE))
    assert signature_of(nameless, present, np.empty((0, 2))) is None


def test_of_several_storeys_the_one_that_drifts_most_is_read() -> None:
    histories = {"drift": np.array([[0.1, -0.2], [0.3, 0.1], [0.0, -0.9]])}
    several, one, whole = (cast(Any, SimpleNamespace(storeys=storeys)) for storeys in ((1, 2), (3,), ()))
    assert place_of(several, histories) == 1
    assert place_of(one, histories) == 2
    assert place_of(whole, histories) is None


@pytest.mark.parametrize("is_noise", [True, False])
def test_parameters_spread_as_what_is_left_moves_them(
    is_noise: bool, present: Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Least squares to records whose residual is turned over: the covariance of the closed form for each."""
    monkeypatch.setattr(signatures, "N_DRAWS", 600)
    one = cast(Any, SimpleNamespace(
        evidence=SimpleNamespace(posterior=present.posterior), best=present.best, is_noise=is_noise,
    ))  # fmt: skip
    slopes = Slopes.at(present.posterior, present.best)
    inverse, left = np.linalg.inv(slopes.base.T @ slopes.base), slopes.residual.ravel()
    parts = np.arange(801) if is_noise else np.repeat(np.arange(16), [51, *[50] * 15])
    pulls = np.array([slopes.base[parts == part].T @ left[parts == part] for part in range(parts.max() + 1)])
    expected = inverse @ (pulls.T @ pulls) @ inverse
    found = np.cov(spread_of(one, np.random.default_rng(6)).T)
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=0.2)


def test_parameters_spread_as_filtered_noise_moves_them(present: Explanation, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of noise whose samples count by fours the spread is twice that of as much noise that is white: sd by sd."""
    monkeypatch.setattr(signatures, "N_DRAWS", 600)
    rng, sds = np.random.default_rng(8), {}
    for as_one in (1, 4):
        record = present.posterior.record
        clean = record.channels["force"] - residual_of(present.posterior, present.best)[0]
        coarse = rng.standard_normal(len(clean) // as_one + 1)
        record = record.with_channels({"force": clean + 0.02 * np.repeat(coarse, as_one)[: len(clean)]})
        noise = IntegratedNoise(shape=1.0, scale=(0.02**2,), correlation_samples=float(as_one))
        posterior = replace(present.posterior, record=record, noise=noise)
        one = cast(Any, SimpleNamespace(
            evidence=SimpleNamespace(posterior=posterior), best=present.best, is_noise=True,
        ))  # fmt: skip
        sds[as_one] = np.std(spread_of(one, np.random.default_rng(6)), axis=0)
    np.testing.assert_allclose(sds[4] / sds[1], 2.0, rtol=0.25)


def test_what_cannot_be_solved_without_the_effect_is_judged_all_the_same(
    present: Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A steel damper's full loop was called pinched: without the pinch the rest of the law ran away."""
    (hypothesis,) = present.added
    told = signature_of(hypothesis, present, spread(present))
    monkeypatch.setattr(signatures, "_without", lambda _hypothesis, _present, values: np.full_like(values, np.nan))
    found = signature_of(hypothesis, present, spread(present))
    assert told is not None
    assert found is not None
    assert np.isnan(found.without)
    assert (found.mean, found.measured, found.deserved) == (told.mean, told.measured, told.deserved)
    assert "without it" in signature_in_words(told)
    assert "nan" not in signature_in_words(found)


def beside_zero(present: Explanation) -> Explanation:
    """The same test with a zero of displacement that the machine's stroke has, beyond all that the specimen does."""
    record = present.posterior.record
    return replace(present, posterior=replace(present.posterior, record=replace(record, excitation=PATH + 1.5)))


def test_a_signature_that_cannot_be_measured_gives_no_name(present: Explanation) -> None:
    """A steel damper's test, 10 mm beside zero, was called pinched for certain: nothing could be measured of it."""
    (hypothesis,) = present.added
    beside = beside_zero(present)
    found = signature_of(hypothesis, beside, spread(present))
    assert found is not None
    assert (found.deserved, found.measured) == (0.0, None)
    assert np.isnan([found.mean, found.low, found.high, found.without]).all()
    assert found.unmeasured == "it takes a motion that comes back through zero"
    assert signature_of(hypothesis, beside, np.empty((0, 2))).deserved == 0.0  # type: ignore[union-attr]
    assert found.as_json()["unmeasured"] == found.unmeasured


def test_of_what_cannot_be_solved_nothing_is_measured(present: Explanation, monkeypatch: pytest.MonkeyPatch) -> None:
    (hypothesis,) = present.added
    monkeypatch.setattr(signatures, "_responses", lambda *_: [[]])
    found = signature_of(hypothesis, present, spread(present))
    assert found is not None
    assert (found.deserved, found.unmeasured) == (0.0, "no response of the law can be solved")


def test_a_measured_loop_off_which_nothing_can_be_read_gives_no_name(present: Explanation) -> None:
    """What the law makes of it is not what the test measured."""
    (hypothesis,) = present.added
    record = present.posterior.record
    signature = replace(SlipLock.signature, of_loop=lambda _drift, force: np.nan if force[7] == 7.0 else 0.3)
    own = having(hypothesis, signature)
    force = record.channels["force"].copy()
    assert signature_of(own, present, spread(present)).unmeasured == ""  # type: ignore[union-attr]
    force[7] = 7.0
    other = replace(present, posterior=replace(present.posterior, record=record.with_channels({"force": force})))
    found = signature_of(own, other, spread(present))
    assert found is not None
    assert found.deserved == 0.0
    assert found.unmeasured


def test_what_no_test_measured_deserves_its_name_by_its_size(present: Explanation) -> None:
    """An earthquake has one large half cycle, of which no loss per cycle is told: the loss is there all the same."""
    (hypothesis,) = present.added
    record = present.posterior.record
    signature = replace(
        SlipLock.signature, size=lambda _: 0.1, of_loop=lambda *_: np.nan, is_genuine=None, needs="cycles"
    )
    own = having(hypothesis, signature)
    unread = replace(record, counted=np.arange(record.n_times) > 5)
    found = signature_of(own, replace(present, posterior=replace(present.posterior, record=unread)), spread(present))
    assert found is not None
    assert (found.deserved, found.unmeasured) == (1.0, "it takes cycles")
    small = having(hypothesis, replace(signature, least=1e9))
    other = signature_of(small, replace(present, posterior=replace(present.posterior, record=unread)), spread(present))
    assert other is not None
    assert other.deserved == 0.0
