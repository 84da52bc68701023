"""A floor's mass differs from the one the model was given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Normal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class MassError(Effect):
    """The mass of a floor is ``m_i (1 + e_m)``.

    An error shared by all floors cannot be told from all stiffnesses and dampers scaled together.

    Parameters
    ----------
    e_m : float, Prior or PerStorey
        Relative error of the mass.
    """

    e_m: Value

    name: ClassVar[str] = "mass_error"
    title: ClassVar[str] = "wrong mass"
    level: ClassVar[str] = "node"
    summary: ClassVar[str] = "a floor is heavier or lighter than stated"
    source: ClassVar[str] = "Newton's second law"
    residual: ClassVar[str] = "proportional to that floor's acceleration"
    confusable: ClassVar[str] = "sensor_gain; all masses together: all k and c"
    signature: ClassVar[Signature] = Signature(
        measure="error of the mass",
        plain_name="a small correction of the floor's inertia",
        reason="half a per cent of the floor's mass: no drawing tells it better",
        size=lambda at: at["e_m"],
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="e_m", unit="", neutral=0.0, lower=-0.9, description="relative error of the mass", source=source
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, mass_factor=slots.mass_factor * (1 + symbol("e_m")))


@guides(MassError)
class MassErrorSearch(SearchGuide[MassError]):
    """How a search looks for a wrong mass."""

    @override
    def priors(self, scales: Scales) -> tuple[MassError, ...]:
        return (MassError(e_m=Normal(0.0, 0.2)),)

    @override
    def starts(self, effect: MassError, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"e_m": (-0.1, 0.1)}
