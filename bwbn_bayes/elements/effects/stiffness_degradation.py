"""Stiffness that falls with the work done on the hysteretic spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

from bwbn_bayes.elements.law import ENERGY, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.parameters import HalfNormal, Parameter, Value


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

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        return (cls(delta_eta=HalfNormal(1.0 / scales.energy)),)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"delta_eta": (0.1 / scales.energy, 0.6 / scales.energy)}

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, eta=slots.eta + symbol("delta_eta") * ENERGY)
