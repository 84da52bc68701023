"""Stiffness that falls with the work done on the hysteretic spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

from bwbn_bayes.elements.law import ENERGY, Effect, Slots, symbol
from bwbn_bayes.elements.loops import stiffness_lost_per_cycle
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import Signature
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
    signature: ClassVar[Signature] = Signature(
        measure="stiffness lost per cycle",
        plain_name="the slope of later loops (Baber and Wen's stiffness law)",
        reason="a tenth of a per cent of the stiffness lost per cycle: some three per cent in a test of thirty",
        size=lambda at: at.per_cycle(1.0 / (1.0 + at["delta_eta"] * at.energy)),
        least=0.001,
        of_loop=stiffness_lost_per_cycle,
    )
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
