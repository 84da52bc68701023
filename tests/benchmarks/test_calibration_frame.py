"""The simulator of the calibration against the reference engine: every stock model, every effect that it knows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.calibrating.framing import frame_of
from benchmarks.calibrating.records import CONDITIONS, Condition, clean, replicate
from bwbn_bayes import (
    Appendage,
    Asymmetry,
    Backlash,
    BoucWen,
    CoulombFriction,
    CubicStiffness,
    FolientePinching,
    FrictionPendulum,
    GapImpact,
    InputScale,
    MassDamping,
    MassError,
    MaxwellBranch,
    Oscillator,
    QuadraticDamping,
    Record,
    SensorBias,
    SensorGain,
    ShearBuilding,
    SlipLock,
    Specimen,
    StiffnessDegradation,
    StrengthDegradation,
    SuddenDamage,
    el_centro,
    join_records,
)
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_file import ModelFile, load_model_file
from bwbn_bayes.structures.structure import Structure

MODELS = sorted((Path(__file__).parents[2] / "models").glob("*.py"))
PAST_AN_EVENT = {"three_storey_el_centro": 1100, "three_storey_sine": 1600, "aftershocks": 1000}
"""Samples until a number has jumped, or a second record has begun."""
GROUND = el_centro("chopra", duration=6.0)
TWO_STOREYS = ShearBuilding(
    masses=[1.0, 0.8],
    storey=BoucWen(k=40.0, c=0.3, alpha=0.1, A=1.0, beta=60.0, gamma=20.0, n=1.6),
)


def filed(path: Path) -> ModelFile:
    """A stock model with a ground motion."""
    found = load_model_file(path)
    return found if found.excitation is not None else replace(found, excitation=GROUND)


def missed(model: Structure, drive: Record, values: Floats) -> float:
    """The largest error of any channel over its rms."""
    file = ModelFile(name="model", model=model)
    found = clean(file, model, frame_of(model, values), drive)
    expected = Reference().simulate(model, values[None], drive, list(found)).values[0]
    error = np.array(list(found.values())) - expected
    return float(np.max(np.sqrt(np.mean(error**2, axis=1) / np.mean(expected**2, axis=1))))


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_stock_model_is_recorded_as_the_reference_engine_solves_it(path: Path) -> None:
    """At a truth of its prior; noise at 60 dB is ten times what is allowed here."""
    file = filed(path)
    drive = Condition(n_samples=PAST_AN_EVENT.get(path.stem, 250)).drive(file)
    point = file.model.space.sample_unit(np.random.default_rng(3), 1)
    assert missed(file.model, drive, file.model.space.from_unit(point)[0]) < 1e-4


EFFECTS: tuple[Effect, ...] = (
    StiffnessDegradation(delta_eta=0.3),
    StrengthDegradation(delta_nu=0.4),
    SlipLock(delta_s=0.02, sigma=0.01),
    FolientePinching(zeta_s=0.7, p=1.0, q=0.1, psi_0=0.02, delta_psi=0.004, lambda_=0.3),
    Asymmetry(phi=4.0),
    CubicStiffness(k3=300.0),
    QuadraticDamping(c2=0.4),
    CoulombFriction(F_c=0.2, v0=0.02),
    GapImpact(k_g=30.0, g=0.02),
    MaxwellBranch(k_m=8.0, tau=0.3),
    SuddenDamage(parameter="k", jump=-8.0, time=2.0),
    SuddenDamage(parameter="c", jump=0.5, time=2.0),
    MassError(e_m=0.1),
    MassDamping(c_m=0.2),
    InputScale(s_g=1.1),
    SensorBias(bias=0.3),
    SensorGain(gain=0.9),
)


@pytest.mark.parametrize("a", [1.0, 0.8])
@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: f"{effect.name} {effect.form}")
def test_every_known_effect_is_that_of_the_reference_engine(effect: Effect, a: float) -> None:
    """Also where A is not one, which the simulator does not know: it is taken into the other numbers."""
    plain, none = TWO_STOREYS.with_values({"A": a}), np.zeros(0)
    model = plain.with_effect(effect)
    assert missed(model, GROUND, none) < 2e-5
    without, found = (clean(ModelFile(name="x", model=one), one, frame_of(one, none), GROUND) for one in (plain, model))
    assert all(np.mean((found[name] - y) ** 2) > 1e-6 * np.mean(y**2) for name, y in without.items())


@pytest.mark.parametrize("parameter", ["delta_nu", "delta_eta", "delta_s"])
def test_a_rate_of_loss_jumps(parameter: str) -> None:
    losing = TWO_STOREYS.with_effect(StiffnessDegradation(delta_eta=0.05)).with_effect(
        StrengthDegradation(delta_nu=0.05)
    )
    losing = losing.with_effect(SlipLock(delta_s=0.01, sigma=0.01))
    model = losing.with_effect(SuddenDamage(parameter=parameter, jump=0.04, time=2.5), storeys=[2])
    assert missed(model, GROUND, np.zeros(0)) < 2e-5


@pytest.mark.parametrize("effect", [Appendage(mu_t=0.05, f_t=1.0, zeta_t=0.05), Backlash(b=0.01, w=0.001)])
def test_an_unknown_effect_is_refused(effect: Effect) -> None:
    with pytest.raises(UserError, match="does not know"):
        frame_of(TWO_STOREYS.with_effect(effect), np.zeros(0))


def test_a_slider_whose_friction_does_not_depend_on_speed() -> None:
    model = Oscillator(mass=2.0, spring=FrictionPendulum(W=19.6, R=1.5, mu_slow=0.05, Y=0.002))
    assert missed(model, GROUND, np.zeros(0)) < 1e-4


def test_records_of_a_virgin_building_are_solved_each_by_itself() -> None:
    """Each with its own time step; in a sequence of two time steps nothing can be drawn."""
    coarser = replace(GROUND, name="slow", time_step=0.025)
    assert missed(TWO_STOREYS, join_records([GROUND, coarser]), np.zeros(0)) < 1e-5
    with pytest.raises(UserError, match="one time step"):
        missed(TWO_STOREYS, join_records([GROUND, coarser], in_sequence=True), np.zeros(0))


def test_what_a_specimen_cannot_be_is_refused() -> None:
    """Points half a second apart, and a number that jumps, which would be left out without a word."""
    model = Specimen(storey=BoucWen(k=1.0, u_y=0.01, rho=0.6))
    drive = Record(name="slow", time_step=0.5, excitation=np.linspace(0.0, 0.1, 50), excitation_kind="displacement")
    with pytest.raises(UserError, match="one second apart"):
        missed(model, drive, np.zeros(0))
    jumping = model.with_effect(StrengthDegradation(delta_nu=0.0))
    jumping = jumping.with_effect(SuddenDamage(parameter="delta_nu", jump=1.0, time=5.0))
    with pytest.raises(UserError, match="no specimen whose numbers jump"):
        missed(jumping, replace(drive, time_step=1.0), np.zeros(0))


def test_a_sequence_keeps_its_records_apart() -> None:
    """Each measures, with noise of its own level: a sequence once came out without any channel that counts."""
    file = filed(next(path for path in MODELS if path.stem == "aftershocks"))
    made, condition = replicate(file, CONDITIONS["10 dB"], 1, 0), CONDITIONS["10 dB"]
    blocks = made.record.blocks
    assert [(block.part, block.channel) for block in blocks] == [(i, j) for i in range(3) for j in range(2)]
    exact = clean(file, made.model, made.frame, condition.drive(file))
    for block in blocks:
        true = exact[f"acceleration_{block.channel + 1}"][block.samples]
        noise = made.record.measured[block.channel, block.samples] - true
        # Of some 850 samples the standard error is 2.4 %.
        assert abs(np.std(noise) / np.sqrt(0.1 * np.mean(true**2)) - 1.0) < 0.1
    short = replicate(file, CONDITIONS["100 samples"], 1, 0).record
    assert short.n_times == 100 and len(short.parts) == 1
