"""Strength that falls with the work done on the hysteretic spring."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import ENERGY, Effect, Slots, symbol
from bwbn_bayes.parameters import Parameter, Value


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

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, nu=slots.nu + symbol("delta_nu") * ENERGY)
