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
    "sliding_base": {
        "inv_mu": 12.0, "R_s": 1.8, "m_s": 1.3, "W_s": 24.0, "Y_s": 0.02, "n_s": 3.5, "r_mu": 0.4, "a_s": 3.0
    },
    "storey_coupling": {"k_bend": 3.0},
    "input_scale": {"s_g": 1.2},
    "sensor_gain": {"gain": 0.8},
    "sensor_bias": {"bias": 0.3},
    "sensor_lag": {"lag": 0.113},
}  # fmt: skip
"""Sizes that change the response by much more than the tolerances."""

OTHERS = {"delta_nu": 0.2, "delta_eta": 0.2, "delta_s": 0.05, "sigma": 0.1}
"""Sizes of the storeys' effects that act beside them."""


BASES = tuple(name for name, kind in KINDS.items() if kind.moves_base)
"""Those that put the building on something that moves: a law has one of them."""


def together(name: str = "base_flexibility") -> list[str]:
    """Every kind that a law can have beside the named one; where that moves no base, beside a flexible base."""
    base = name if name in BASES else "base_flexibility"
    return [other for other in KINDS if other == base or other not in BASES]


def building(
    masses: Sequence[float], others: dict[str, float], beside: str = "base_flexibility", **element: Value
) -> Structure:
    """A building that degrades, slips and may jump, and carries every kind of :func:`together`."""
    plain = ShearBuilding(masses=masses, storey=storey(**element))
    return replace(with_everything(plain, others), carried=tuple(KINDS[name] for name in together(beside)))


def placed(model: Structure, name: str, values: Mapping[str, Value], floors: list[int] | None) -> Structure:
    """The model with an effect of :data:`KINDS`; ``floors`` are left out where it acts on the whole building."""
    kind = KINDS[name]
    return model.with_effect(having(kind, values), storeys=None if kind.level in WHOLE_BUILDING else floors)
