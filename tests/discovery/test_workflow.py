"""A discovery from end to end: the verdict is the evidence's, whatever there is to weigh."""

from typing import Any, override

import numpy as np
import pytest
from scipy import signal

from bwbn_bayes.discovery import unnamed, workflow
from bwbn_bayes.discovery.candidates import MOST_CARRIED, hypotheses, scales_of
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, StoreyCoupling
from bwbn_bayes.elements.effects.cubic_stiffness import CubicStiffnessSearch
from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import guides
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.unnamed.pulses import with_pulse
from bwbn_bayes.inference.unnamed.storey import Estimate
from bwbn_bayes.parameters import HalfNormal, Uniform
from bwbn_bayes.records.excitation import Envelope, el_centro, filtered_noise
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

GROUND = el_centro("chopra", duration=8.0)
MODEL = ShearBuilding(
    masses=[1.0], storey=BoucWen(k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=0.2, beta=12.0, gamma=2.0, n=1.3)
)


@pytest.fixture(scope="module")
def record() -> Record:
    """A drift under a strong cubic spring that the model lacks."""
    hidden = MODEL.with_effect(CubicStiffness(k3=4e4))
    drift = Reference().simulate(hidden, hidden.draws({"k": 60.0, "c": 0.4}), GROUND, ("drift_1",)).values[0, 0]
    noise = 0.01 * np.std(drift) * np.random.default_rng(1).standard_normal(len(drift))
    return GROUND.with_channels({"drift_1": drift + noise})


@pytest.fixture
def without_unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is asked of an unnamed force: its pulses take a law of their own."""

    def nothing(*_: Any, **__: Any) -> dict[tuple[int, ...], Estimate]:
        return {}

    monkeypatch.setattr(unnamed, "unnamed_forces", nothing)


def test_without_hypotheses_a_smooth_disagreement_is_an_unnamed_force(record: Record) -> None:
    """A cubic spring is a smooth force of the drift; the one effect that is asked for cannot act on one storey."""
    settings = DiscoverySettings(particles=100, effects=(StoreyCoupling,))
    found = discover(MODEL, record, settings=settings, assumptions=["The base is rigid."])
    assert found.verdict == "unexplained"
    assert found.verdict_probabilities["unexplained"] > 0.99
    assert found.added == ()
    assert found.probabilities == {}
    assert found.unexplained_share == 1.0
    assert found.improved is found.model
    assert found.unnamed is not None
    assert (found.unnamed.storey, found.unnamed.probability > 0.99) == (1, True)
    assert found.unnamed.share > 0.02
    assert {step.parent for step in found.steps} == {"the model as given"}
    assert found.result.facts.assumptions[0] == found.assumptions[0] == "The base is rigid."


def test_laws_compiled_ahead_are_those_of_the_run(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is fitted, at sizes that mean nothing; the first law is left to whom needs it at once.

    Those that are fitted are compiled in single precision, those by which small differences are taken in doubles.
    """
    ahead: list[tuple[dict[StoreyLaw, bool], bool]] = []
    monkeypatch.setattr(
        workflow, "precompile", lambda laws, *, driven, single=False: ahead.append((dict(laws), single or driven))
    )
    run = Run(settings=DiscoverySettings(), rng=np.random.default_rng(1), listener=None)
    workflow._compile_ahead(MODEL, record, run)
    posterior = Posterior(model=MODEL, record=record, engine=Lanes(), noise=default_noise(record))
    scales = scales_of(posterior, np.array([0.5, 0.5]))
    first_round, later = (
        [h.model.law for h in hypotheses(MODEL, scales, measured=("drift_1",), most_carried=most) if h.carried]
        for most in (MOST_CARRIED, np.inf)
    )
    (fitted, is_single), (differentiated, is_single_too) = ahead
    assert is_single and not is_single_too
    assert list(fitted.items()) == [(law, True) for law in list(dict.fromkeys(first_round))[:-3:-1]]
    assert list(differentiated.items()) == [
        (later[-1], False),
        (with_pulse(MODEL, 1, 1.0).law, False),
    ]
    assert first_round[0] not in fitted


@pytest.mark.usefixtures("without_unnamed")
def test_an_effect_without_a_prior_at_nominal_sizes_takes_part(record: Record) -> None:
    class OfSmallDrifts(CubicStiffness): ...

    @guides(OfSmallDrifts)
    class _OfSmallDriftsSearch(CubicStiffnessSearch):
        @override
        def priors(self, scales: Scales) -> tuple[CubicStiffness, ...]:
            if scales.drift > 0.9:
                raise UserError("no such drift")
            return (OfSmallDrifts(k3=HalfNormal(1e5)),)

    found = discover(MODEL, record, settings=DiscoverySettings(particles=100, effects=(OfSmallDrifts,)))
    assert [added.hypothesis.name for added in found.added] == ["cubic_stiffness"]


def test_filtered_noise_is_noise() -> None:
    """Behind a filter at 0.4 of half the sampling rate; the model lacks nothing, and no unnamed force is made of it."""
    rng = np.random.default_rng(1)
    ground = filtered_noise(rng, 15.0, 0.01, peak=3.0, ground_frequency_hz=2.0, envelope=Envelope())
    values = MODEL.draws({"k": 60.0, "c": 0.4})
    clean = Reference().simulate(MODEL, values, ground, ("acceleration_1",)).values[0, 0]
    white = rng.standard_normal(len(clean) + 500)
    noise = signal.sosfilt(signal.butter(8, 0.4, output="sos"), white)[500:]
    record = ground.with_channels({"acceleration_1": clean + 0.03 * np.std(clean) * noise / np.std(noise)})
    found = discover(MODEL, record, settings=DiscoverySettings(particles=100, effects=(CubicStiffness,)))
    assert found.verdict == "no_missing_effect"
    assert found.verdict_probabilities["no_missing_effect"] > 0.9
    assert found.unnamed is None
    assert found.after.residual_to_noise == pytest.approx([1.0], abs=0.15)
    (told,) = [sentence for sentence in found.sentences if sentence.startswith("The noise ends at 2")]
    assert told.endswith("samples count as one.")


@pytest.mark.usefixtures("without_unnamed")
def test_a_hypothesis_that_cannot_be_solved_is_left_out_and_told(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a Maxwell branch under a cyclic test whose points lie a second apart."""

    def without_damping(*given: object, **options: object) -> tuple[Fit, ...]:
        fits = race(*given, **options)  # type: ignore[arg-type]
        for fit in fits:
            if fit.hypothesis.name == "quadratic_damping":
                fit.local.log_likelihood[:] = -np.inf
        return fits

    monkeypatch.setattr("bwbn_bayes.discovery.build.race", without_damping)
    settings = DiscoverySettings(particles=100, effects=(QuadraticDamping, CubicStiffness))
    found = discover(MODEL, record, settings=settings)
    assert [added.hypothesis.name for added in found.added] == ["cubic_stiffness"]
    assert "Could not be solved for this record and was left out: quadratic damping in storey 1." in found.sentences
    assert found.verdict == "effects_found"
