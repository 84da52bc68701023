"""A parameter that jumps at a time, known or unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.law import Effect, Event, Slots, symbol
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter, Value

_UNITS = {"k": "N/m", "c": "N s/m", "alpha": "", "delta_nu": "1/J", "delta_eta": "1/J", "delta_s": "m/J"}


@dataclass(frozen=True, kw_only=True)
class SuddenDamage(Effect):
    """A storey parameter changes by ``jump`` at ``time``; the past work is kept: ``nu = 1 + delta_nu(t) epsilon``.

    The parameter stays admissible after the jump. A jump of k drops the force at once and takes stored energy with it.
    Engines split the step at the time; an unknown time contributes its jump term to the derivatives.

    Parameters
    ----------
    parameter : {"k", "c", "alpha", "delta_nu", "delta_eta", "delta_s"}
        The parameter that jumps. The last three need the degradation or slip effect they belong to.
    jump : float, Prior or PerStorey
        Change of the parameter, in its own unit.
    time : float, Prior or PerStorey
        When it happens. [s]

    Raises
    ------
    UserError
        If the parameter is not one that can jump.

    References
    ----------
    .. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, tables 1 and 4 (jumps of delta_nu and delta_eta).
    """

    parameter: str
    jump: Value
    time: Value

    name: ClassVar[str] = "sudden_damage"
    summary: ClassVar[str] = "a parameter changes at a time: a brace breaks, degradation sets in"
    source: ClassVar[str] = "Zhao et al. 2019, doi:10.3389/fbuil.2018.00080"
    residual: ClassVar[str] = "an onset at one time"
    confusable: ClassVar[str] = "degradation"

    def __post_init__(self) -> None:
        if self.parameter not in _UNITS:
            raise UserError(
                f"SuddenDamage: parameter {self.parameter!r} cannot jump: choose one of {', '.join(sorted(_UNITS))}"
            )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The jump and its time, named after the parameter: ``delta_nu_jump``, ``delta_nu_time``."""
        jump = Parameter(
            symbol=f"{self.parameter}_jump",
            unit=_UNITS[self.parameter],
            neutral=0.0,
            description=f"sudden change of {self.parameter}",
            source=self.source,
        )
        time = Parameter(
            symbol=f"{self.parameter}_time",
            unit="s",
            neutral=0.0,
            lower=0.0,
            description=f"time of the change of {self.parameter}",
            source=self.source,
        )
        return jump, time

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return {f"{self.parameter}_jump": self.jump, f"{self.parameter}_time": self.time}

    @classmethod
    def neutral_forms(cls) -> tuple[Self, ...]:
        """No jump of each parameter that can jump."""
        return tuple(cls(parameter=parameter, jump=0.0, time=0.0) for parameter in _UNITS)

    @override
    def fill(self, slots: Slots) -> Slots:
        base, jump, time = (symbol(self.parameter + suffix) for suffix in ("", "_jump", "_time"))
        happened = sp.Symbol(f"{self.parameter}_happened", nonnegative=True)
        increments = {**slots.increments, base: slots.increments.get(base, sp.Integer(0)) + jump * happened}
        after = base + jump
        bounds = (after >= -1, after <= 1) if self.parameter == "alpha" else (after >= 0,)
        return replace(
            slots,
            increments=increments,
            events=(*slots.events, Event(time=time, indicator=happened)),
            constraints=(*slots.constraints, *bounds),
        )
