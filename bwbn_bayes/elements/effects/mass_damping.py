"""Damping in proportion to the masses: the first term of Rayleigh's damping."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np

from bwbn_bayes.elements.law import FLOOR_VELOCITY, MASS, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class MassDamping(Effect):
    """Every floor is braked by ``c_m m_i`` times its velocity relative to the ground.

    A mode of circular frequency omega gains the damping ratio ``c_m / (2 omega)``.

    Parameters
    ----------
    c_m : float or Prior
        Damping per unit of mass, one for the building. [1/s]

    References
    ----------
    .. [1] A. K. Chopra, "Dynamics of Structures", 4th ed., 2012, section 11.4.
    """

    c_m: Value

    name: ClassVar[str] = "mass_damping"
    title: ClassVar[str] = "mass-proportional damping"
    level: ClassVar[str] = "structure"
    summary: ClassVar[str] = "damping in proportion to the masses: low frequencies decay faster"
    source: ClassVar[str] = "Chopra 2012, section 11.4"
    residual: ClassVar[str] = "low frequencies decay faster than high ones"
    confusable: ClassVar[str] = "c"
    signature: ClassVar[Signature] = Signature(
        measure="damping ratio added at the first mode",
        plain_name="the damping of the slow motion (Rayleigh's mass term)",
        reason="a thousandth of critical damping: no building's own is known better",
        size=lambda at: 0.5 * at["c_m"] / at.omega,
        least=0.001,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="c_m", unit="1/s", neutral=0.0, lower=0.0, description="damping per unit of mass", source=source
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, floor_force=slots.floor_force - symbol("c_m") * MASS * FLOOR_VELOCITY)


@guides(MassDamping)
class MassDampingSearch(SearchGuide[MassDamping]):
    """How a search looks for damping against the ground."""

    @override
    def priors(self, scales: Scales) -> tuple[MassDamping, ...]:
        return (MassDamping(c_m=HalfNormal(_largest(scales))),)

    @override
    def starts(self, effect: MassDamping, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"c_m": (0.1 * _largest(scales), 0.5 * _largest(scales))}


def _largest(scales: Scales) -> float:
    """Damping per mass [1/s] that is a tenth of critical in the first mode."""
    return 0.2 * 2.0 * np.pi / scales.period
