"""The loop where there is nothing to weigh: a disagreement and no hypothesis about it, or none that can be solved."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
import pytest
from scipy import signal

from bwbn_bayes.discovery import workflow
from bwbn_bayes.discovery.candidates import MOST_CARRIED, hypotheses, scales_of
from bwbn_bayes.discovery.conclusion import Grown
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, SensorLag
from bwbn_bayes.elements.law import Effect, StoreyLaw
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Linearisation, Posterior, default_noise
from bwbn_bayes.parameters import Floats, HalfNormal, Uniform
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


@pytest.mark.parametrize("effects", [(), (SensorLag,)], ids=["none", "of a sensor that does not exist"])
def test_without_hypotheses_a_disagreement_stays_unexplained(record: Record, effects: tuple[type[Effect], ...]) -> None:
    found = discover(
        MODEL, record, settings=DiscoverySettings(particles=100, effects=effects), assumptions=["The base is rigid."]
    )
    assert found.verdict == "unexplained"
    assert found.added == ()
    assert found.unexplained_share == 1.0
    assert found.improved is found.model
    assert [step.decision for step in found.steps] == [None]
    assert found.result.facts.assumptions[0] == found.assumptions[0] == "The base is rigid."


def test_laws_compiled_ahead_are_those_of_the_run(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is fitted, at sizes that mean nothing; the first law is left to whom needs it at once."""
    ahead: list[dict[StoreyLaw, bool]] = []
    monkeypatch.setattr(workflow, "precompile", lambda laws, **_: ahead.append(dict(laws)))
    run = Run(settings=DiscoverySettings(), rng=np.random.default_rng(1), listener=None)
    workflow._compile_ahead(MODEL, record, run)
    posterior = Posterior(model=MODEL, record=record, engine=Lanes(), noise=default_noise(record))
    scales = scales_of(posterior, np.array([0.5, 0.5]))
    first_round, later = (
        [h.model.law for h in hypotheses(MODEL, scales, measured=("drift_1",), most_carried=most) if h.carried]
        for most in (MOST_CARRIED, np.inf)
    )
    (laws,) = ahead
    assert list(laws.items()) == [
        *((law, True) for law in list(dict.fromkeys(first_round))[:-3:-1]),
        (later[-1], False),
    ]
    assert first_round[0] not in laws


def test_an_effect_without_a_prior_at_nominal_sizes_takes_part(record: Record) -> None:
    class OfSmallDrifts(CubicStiffness):
        @classmethod
        def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
            if scales.drift > 0.9:
                raise UserError("no such drift")
            return (cls(k3=HalfNormal(1e5)),)

    found = discover(MODEL, record, settings=DiscoverySettings(particles=100, effects=(OfSmallDrifts,)))
    assert [added.candidate.hypothesis.name for added in found.added] == ["cubic_stiffness"]


def test_filtered_noise_is_noise() -> None:
    """Behind a filter at 0.4 of half the sampling rate; the model lacks nothing."""
    rng = np.random.default_rng(1)
    ground = filtered_noise(rng, 15.0, 0.01, peak=3.0, ground_frequency_hz=2.0, envelope=Envelope())
    values = MODEL.draws({"k": 60.0, "c": 0.4})
    clean = Reference().simulate(MODEL, values, ground, ("acceleration_1",)).values[0, 0]
    white = rng.standard_normal(len(clean) + 500)
    noise = signal.sosfilt(signal.butter(8, 0.4, output="sos"), white)[500:]
    record = ground.with_channels({"acceleration_1": clean + 0.03 * np.std(clean) * noise / np.std(noise)})
    found = discover(MODEL, record, settings=DiscoverySettings(particles=100, effects=(CubicStiffness,)))
    assert found.verdict == "no_missing_effect"
    assert found.after.residual_to_noise == pytest.approx([1.0], abs=0.15)
    assert found.sentences[-1].startswith("The noise ends at 2")
    assert found.sentences[-1].endswith("samples count as one.")


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

    monkeypatch.setattr("bwbn_bayes.discovery.workflow.race", without_damping)
    settings = DiscoverySettings(particles=100, effects=(QuadraticDamping, CubicStiffness))
    found = discover(MODEL, record, settings=settings)
    assert [added.candidate.hypothesis.name for added in found.added] == ["cubic_stiffness"]
    assert found.sentences[-1] == "Could not be solved for this record and was left out: quadratic damping in storey 1."


def test_the_second_search_weighs_against_the_first_rounds_hypotheses(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last round's lack what was added since, and so its prior."""
    fit = SimpleNamespace(log_likelihood=0.0)
    first, last = (SimpleNamespace(name="slip_lock"),), (SimpleNamespace(name="backlash"),)
    run = Run(DiscoverySettings(), np.random.default_rng(1), None)
    run.first_fits, run.first_considered, run.considered = (fit,), first, last  # type: ignore[assignment]
    weighed: list[tuple[Any, ...]] = []

    monkeypatch.setattr(workflow, "is_explained", lambda *_: False)
    monkeypatch.setattr(workflow, "searched", lambda *_, **__: (SimpleNamespace(log_likelihood=99.0),))
    monkeypatch.setattr(workflow, "unexplained_share", lambda *_: 1.0)

    def grow(so_far: Any, again: Run, **_: object) -> Any:
        weighed.append(again.considered)
        return so_far

    monkeypatch.setattr(workflow, "_grow", grow)
    present: Any = SimpleNamespace()
    grown = Grown(present, (), None, True)
    assert workflow._look_again(present, grown, run) == (grown, run)
    assert weighed == [first]


def with_two(record: Record) -> tuple[Grown, Run]:
    """A run that added a damper and a cubic spring, at two draws of their prior; each decision is its number."""
    effects = (QuadraticDamping(c2=Uniform(0, 1)), CubicStiffness(k3=Uniform(0, 1e5)))
    model = MODEL.with_effect(effects[0]).with_effect(effects[1])
    posterior = Posterior(model=model, record=record, engine=Lanes(), noise=default_noise(record))
    modes = tuple(SimpleNamespace(point=point) for point in posterior.sample_prior(np.random.default_rng(1), 2))
    present: Any = SimpleNamespace(posterior=posterior, modes=modes)
    added: Any = tuple(
        SimpleNamespace(
            candidate=SimpleNamespace(hypothesis=SimpleNamespace(effect=effect, storeys=(), label=effect.name)),
            decision=number,
        )
        for number, effect in enumerate(effects)
    )
    run = Run(DiscoverySettings(), np.random.default_rng(1), None)
    steps: Any = [SimpleNamespace(model=MODEL, decision=None)]
    run.steps = steps
    return Grown(present, added, None, False), run


def test_an_effect_without_which_nothing_can_be_solved_is_needed(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a damper that holds a storey which snaps through."""
    grown, run = with_two(record)

    def fail(view: Posterior, points: Floats, **_: object) -> tuple[Floats, Linearisation]:
        local = view.linearise(points)
        return points, replace(local, log_likelihood=np.full(len(points), -np.inf))

    monkeypatch.setattr(workflow, "polish", fail)
    monkeypatch.setattr(workflow, "present_evidence", lambda *_: SimpleNamespace(total=0.0))
    assert workflow._prune(grown, run) == grown


@pytest.mark.parametrize(
    ("needed", "why"),
    [
        (0, "the fit that it led to is as good without it"),
        (1, "a later effect makes it superfluous"),
    ],
)
def test_an_effect_is_dropped_without_which_the_last_fit_is_as_good(
    record: Record, monkeypatch: pytest.MonkeyPatch, needed: int, why: str
) -> None:
    grown, run = with_two(record)
    told: list[tuple[str, int]] = []

    def evidence(posterior: Posterior, *_: object) -> SimpleNamespace:
        here = {placed.effect.name for placed in posterior.model.effects}
        return SimpleNamespace(total=0.0 if grown.added[needed].candidate.hypothesis.label in here else -50.0)

    monkeypatch.setattr(workflow, "polish", lambda view, points, **_: (points, view.linearise(points)))
    monkeypatch.setattr(workflow, "present_evidence", evidence)
    monkeypatch.setattr(run, "withdraw", lambda reason, decision: told.append((reason, decision)))
    found = workflow._prune(grown, run)
    assert found.added == (grown.added[needed],)
    assert told == [(why, 1 - needed)]
    assert found.first is (found.present if needed == 0 else None)
