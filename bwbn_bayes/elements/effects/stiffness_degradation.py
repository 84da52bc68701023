"""Stiffness that falls with the work done on the hysteretic spring."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import ENERGY, Effect, Slots, symbol
from bwbn_bayes.parameters import Parameter, Value


@dataclass(frozen=True, kw_only=True)
class StiffnessDegradation(Effect):
    """``eta = 1 + delta_eta epsilon`` divides the rate of the hysteretic displacement.

    Parameters
    ----------
    delta_eta : float, Prior or PerStorey
        Loss of stiffness per unit of work. [1/J]

    References
    ----------
    .. [1] T. T. Baber and Y.-K. Wen, "Random Vibration of Hysteretic, Degrading Systems", J. Eng. Mech. Div. 107(6),
       1981.
    """

    delta_eta: Value

    name: ClassVar[str] = "stiffness_degradation"
    summary: ClassVar[str] = "stiffness falls with the work done on the hysteretic spring"
    source: ClassVar[str] = "Baber and Wen 1981"
    residual: ClassVar[str] = "the period grows with the work done"
    confusable: ClassVar[str] = "slow damage, base flexibility"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="delta_eta",
            unit="1/J",
            neutral=0.0,
            lower=0.0,
            description="loss of stiffness per unit of work",
            source=source,
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, eta=slots.eta + symbol("delta_eta") * ENERGY)
