"""Models with every effect on floors, base, ground and sensors, beside those of the storeys: one compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from laboratory import having, storey, with_everything

from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.parameters import Value
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import WHOLE_BUILDING, Structure

KINDS: dict[str, Effect] = {
    effect_class.name: effect_class.neutral_forms()[0] for effect_class in registered() if effect_class.level != "link"
}
"""Every effect that does not act on a storey, at its neutral values."""

SIZES: dict[str, dict[str, float]] = {
    "mass_error": {"e_m": 0.25},
    "mass_damping": {"c_m": 0.3},
    "appendage": {"mu_t": 0.08, "f_t": 0.7, "zeta_t": 0.03},
    "base_flexibility": {"compliance": 0.02, "m_b": 1.3, "c_b": 0.4},
    "input_scale": {"s_g": 1.2},
    "sensor_gain": {"gain": 0.8},
    "sensor_bias": {"bias": 0.3},
    "sensor_lag": {"lag": 0.113},
}
"""Sizes that change the response by much more than the tolerances."""

OTHERS = {"delta_nu": 0.2, "delta_eta": 0.2, "delta_s": 0.05, "sigma": 0.1}
"""Sizes of the storeys' effects that act beside them."""


def building(masses: Sequence[float], others: dict[str, float], **element: Value) -> Structure:
    """A building that degrades, slips and may jump, with every kind of :data:`KINDS` carried."""
    plain = ShearBuilding(masses=masses, storey=storey(**element))
    return replace(with_everything(plain, others), carried=tuple(KINDS.values()))


def placed(model: Structure, name: str, values: Mapping[str, Value], floors: list[int] | None) -> Structure:
    """The model with an effect of :data:`KINDS`; ``floors`` are left out where it acts on the whole building."""
    kind = KINDS[name]
    return model.with_effect(having(kind, values), storeys=None if kind.level in WHOLE_BUILDING else floors)
