"""A structure that does not start from rest: what its links begin with, identified or known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, Effect, Slots, symbol
from bwbn_bayes.parameters import Parameter, Value


@dataclass(frozen=True, kw_only=True)
class InitialState(Effect):
    """The state in which storeys are at the first sample; what the catalogue lacks, since no record lacks it.

    Of several records in sequence it is that of the first. The drift of a link that carries no node follows from those
    of the storeys; of a test whose displacement is given, only ``z_0`` says anything.

    Parameters
    ----------
    u_0 : float, Prior or PerStorey
        Drift. [m]
    v_0 : float, Prior or PerStorey
        Drift rate. [m/s]
    z_0 : float, Prior or PerStorey
        Hysteretic displacement. [m]
    """

    u_0: Value = 0.0
    v_0: Value = 0.0
    z_0: Value = 0.0

    name: ClassVar[str] = "initial_state"
    title: ClassVar[str] = "state at the first sample"
    summary: ClassVar[str] = "the structure does not start from rest"
    source: ClassVar[str] = "initial conditions of the equations of motion"
    residual: ClassVar[str] = "a free vibration that dies away"
    confusable: ClassVar[str] = "an input before the first sample"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="u_0", unit="m", neutral=0.0, description="drift at the first sample", source=source),
        Parameter(symbol="v_0", unit="m/s", neutral=0.0, description="drift rate at the first sample", source=source),
        Parameter(
            symbol="z_0",
            unit="m",
            neutral=0.0,
            description="hysteretic displacement at the first sample",
            source=source,
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        states = (DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT)
        own = zip(states, (symbol(p.symbol) for p in self.parameters), strict=True)
        return replace(slots, initial=(*slots.initial, *own))
