"""Models and records shared by the tests of the storey law.

Every model carries the effects that degrade a storey, or those of :data:`OTHER_FORMS`, at their neutral values unless
said otherwise: few compiled kernels serve all tests, and contract 1 (neutral values change nothing) is tested beside
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects import (
    Asymmetry,
    Backlash,
    CoulombFriction,
    CubicStiffness,
    FolientePinching,
    GapImpact,
    MaxwellBranch,
    PDelta,
    QuadraticDamping,
    SlipLock,
    StiffnessDegradation,
    StoreyParameter,
    StrengthDegradation,
    SuddenDamage,
    ViscousDamper,
)
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.search_guide import guide_of, is_sought
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.parameters import Prior, Value
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

NO_DRAW = np.zeros((1, 0))

SEARCHED: tuple[type[Effect], ...] = tuple(filter(is_sought, registered()))
"""Effects that discovery looks for."""

FURTHER_LOSSES: tuple[Effect, ...] = tuple(
    form for effect_class in (StiffnessDegradation, StrengthDegradation) for form in effect_class.neutral_forms()[1:]
)

OTHER_FORMS: tuple[Effect, ...] = (
    *(
        form
        for effect_class in (
            Asymmetry,
            Backlash,
            CoulombFriction,
            CubicStiffness,
            GapImpact,
            MaxwellBranch,
            PDelta,
            QuadraticDamping,
            StoreyParameter,
            ViscousDamper,
        )
        for form in effect_class.neutral_forms()
    ),
    *FURTHER_LOSSES,
    SuddenDamage(parameter="k", jump=0.0, time=0.0, duration=1.0),
)
"""Every form of the storey's effects that :func:`with_everything` leaves out."""


def having(form: Effect, values: Mapping[str, Value]) -> Effect:
    """The form with ``values`` by symbol, neutral elsewhere."""
    sizes = [f.name for f in fields(form) if isinstance(getattr(form, f.name), float)]
    pairs = zip(sizes, form.parameters, strict=True)
    return replace(form, **{name: values.get(p.symbol, p.neutral) for name, p in pairs})


def neutral(form: Effect) -> Effect:
    """A form with priors at its neutral values, whatever sizes are known."""
    sizes = [f.name for f in fields(form) if isinstance(getattr(form, f.name), (float, Prior))]
    held = {name: p.neutral for name, p in zip(sizes, form.parameters, strict=True)}
    return replace(form, **held)


FREE: tuple[Effect, ...] = tuple(
    {
        tuple(p.symbol for p in form.parameters): neutral(form)
        for effect_class in SEARCHED
        for form in guide_of(effect_class).free_shapes(NOMINAL)
    }.values()
)
"""Every form of free shape at its neutral values, once: two pinches share one."""


def with_others(model: Structure, values: Mapping[str, Value], storeys: list[int] | None = None) -> Structure:
    """The model with every effect of :data:`OTHER_FORMS`."""
    for form in OTHER_FORMS:
        model = model.with_effect(having(form, values), storeys=storeys)
    return model


def with_degradation(model: Structure, values: dict[str, float], storeys: list[int] | None = None) -> Structure:
    """The model with the effects that degrade; ``values`` by symbol at ``storeys``, neutral elsewhere."""
    for effect_class in (StiffnessDegradation, StrengthDegradation, SlipLock, FolientePinching):
        model = model.with_effect(having(effect_class.neutral_forms()[0], values), storeys=storeys)
    return model


def with_everything(model: Structure, values: dict[str, float], storeys: list[int] | None = None) -> Structure:
    """The model with every effect, jumps of k and of delta_nu included."""
    model = with_degradation(model, values, storeys)
    for parameter in ("k", "delta_nu"):
        jump = SuddenDamage(
            parameter=parameter, jump=values.get(f"{parameter}_jump", 0.0), time=values.get(f"{parameter}_time", 0.0)
        )
        model = model.with_effect(jump, storeys=storeys)
    return model


def storey(**values: float) -> BoucWen:
    """A Bouc-Wen storey; parameters left out take the values of the paper's sine case."""
    return BoucWen(**{"k": 10.0, "c": 0.05, "alpha": 0.01, "beta": 2.0, "gamma": 2.0, "n": 1.5, **values})


def building(n_storeys: int, values: dict[str, float], storeys: list[int] | None = None, **element: float) -> Structure:
    """A building of unit masses with every effect."""
    plain = ShearBuilding(masses=[1.0] * n_storeys, storey=storey(**element))
    return with_everything(plain, values, storeys)


def specimen(values: dict[str, float], **element: float) -> Structure:
    """A specimen with the effects that degrade, in every form, and no damper."""
    model = with_degradation(Specimen(storey=storey(**{"c": 0.0, **element})), values)
    for form in FURTHER_LOSSES:
        model = model.with_effect(having(form, values))
    return model


def shaking(duration: float = 6.0, time_step: float = 0.04, amplitude: float = 2.0) -> Record:
    """Three sines: a few yielding cycles of the paper's storey."""
    t = np.arange(round(duration / time_step) + 1) * time_step
    motion = amplitude * (np.sin(2.6 * t) + 0.6 * np.sin(1.7 * t + 0.4) + 0.3 * np.sin(7.1 * t + 1.1) - 0.27)
    return Record(name="three sines", time_step=time_step, excitation=motion)


def finer(record: Record, factor: int) -> Record:
    """The same piecewise straight excitation on a finer grid."""
    t = np.arange((record.n_times - 1) * factor + 1) / factor
    return Record(
        name=record.name,
        time_step=record.time_step / factor,
        excitation=np.interp(t, np.arange(record.n_times), record.excitation),
        excitation_kind=record.excitation_kind,
    )


def cyclic_test(turning_points: list[float], per_segment: int, time_step: float = 0.01) -> Record:
    """A displacement history, straight between turning points, from zero."""
    ends = np.concatenate([[0.0], turning_points])
    path = np.interp(np.arange(per_segment * len(turning_points) + 1) / per_segment, np.arange(len(ends)), ends)
    return Record(name="cyclic test", time_step=time_step, excitation=path, excitation_kind="displacement")


def solve(model: Structure, record: Record, channels: list[str], substeps: int) -> dict[str, np.ndarray]:
    """Channels of the one model whose parameters are all known, by the lanes engine."""
    response = Lanes(substeps=substeps, n_threads=1).simulate(model, NO_DRAW, record, channels)
    assert response.status.tolist() == [0]
    return dict(zip(channels, response.values[0], strict=True))


def nrmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Root-mean-square error over root-mean-square truth."""
    return float(np.sqrt(np.mean((estimate - truth) ** 2) / np.mean(truth**2)))
