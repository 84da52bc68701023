"""Strength that falls with the work done on the hysteretic spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

from bwbn_bayes.elements.law import ENERGY, Effect, Slots, symbol
from bwbn_bayes.elements.loops import strength_lost_per_cycle
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class StrengthDegradation(Effect):
    """``nu = 1 + delta_nu epsilon`` multiplies the shape bracket, so that the loop closes earlier.

    Parameters
    ----------
    delta_nu : float, Prior or PerStorey
        Loss of strength per unit of work. [1/J]

    References
    ----------
    .. [1] T. T. Baber and Y.-K. Wen, "Random Vibration of Hysteretic, Degrading Systems", J. Eng. Mech. Div. 107(6),
       1981.
    """

    delta_nu: Value

    name: ClassVar[str] = "strength_degradation"
    summary: ClassVar[str] = "strength falls with the work done on the hysteretic spring"
    source: ClassVar[str] = "Baber and Wen 1981"
    residual: ClassVar[str] = "peaks are clipped more as work is done"
    confusable: ClassVar[str] = "falling n or beta"
    signature: ClassVar[Signature] = Signature(
        measure="strength lost per cycle",
        plain_name="the height of later loops (Baber and Wen's strength law)",
        reason="a tenth of a per cent of the strength lost per cycle: some three per cent in a test of thirty",
        size=lambda at: at.per_cycle((1.0 + at["delta_nu"] * at.energy) ** (-1.0 / at["n"])),
        least=0.001,
        of_loop=strength_lost_per_cycle,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="delta_nu",
            unit="1/J",
            neutral=0.0,
            lower=0.0,
            description="loss of strength per unit of work",
            source=source,
        ),
    )

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        return (cls(delta_nu=HalfNormal(1.0 / scales.energy)),)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"delta_nu": (0.1 / scales.energy, 0.6 / scales.energy)}

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, nu=slots.nu + symbol("delta_nu") * ENERGY)
