"""A parameter that changes at a time, known or unknown, at once or over a while."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import ClassVar, Self, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import AddedState, Effect, Event, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Normal, Parameter, Uniform, Value

_UNITS = {"k": "N/m", "c": "N s/m", "alpha": "", "delta_nu": "1/J", "delta_eta": "1/J", "delta_s": "m/J"}
_SPACING = 1.0 / 8.0
"""Largest time between starts of a step, in cycles of the drift; of a ramp twice that. To move a step in time adds the
drift that passes meanwhile, so that fits stand still wherever that changes sign."""
_MOST_STARTS = 400


@dataclass(frozen=True, kw_only=True)
class SuddenDamage(Effect):
    """A storey parameter changes by ``jump`` at ``time``; the past work is kept: ``nu = 1 + delta_nu(t) epsilon``.

    With a ``duration`` it changes linearly over that long instead. The parameter stays admissible after the change. A
    jump of k drops the force at once and takes stored energy with it. Engines split the step at the time; an unknown
    time contributes its jump term to the derivatives.

    Parameters
    ----------
    parameter : {"k", "c", "alpha", "delta_nu", "delta_eta", "delta_s"}
        The parameter that changes. The last three need the degradation or slip effect they belong to.
    jump : float, Prior or PerStorey
        Change of the parameter, in its own unit.
    time : float, Prior or PerStorey
        When it happens, or begins. [s]
    duration : float, Prior or PerStorey, optional
        How long it takes; at once where it is left out. [s]

    Raises
    ------
    UserError
        If the parameter is not one that can change.

    References
    ----------
    .. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, tables 1 and 4 (jumps of delta_nu and delta_eta).
    """

    parameter: str
    jump: Value
    time: Value
    duration: Value | None = None

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen", "linear")
    name: ClassVar[str] = "sudden_damage"
    title: ClassVar[str] = "sudden change"
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
    @override
    def form(self) -> str:
        return f"{self.parameter}, {'step' if self.duration is None else 'ramp'}"

    @property
    def _symbols(self) -> tuple[str, ...]:
        """``k_jump, k_time``; of a ramp ``k_ramp, k_ramp_time, k_ramp_duration``."""
        if self.duration is None:
            return f"{self.parameter}_jump", f"{self.parameter}_time"
        ramp = f"{self.parameter}_ramp"
        return ramp, f"{ramp}_time", f"{ramp}_duration"

    @property
    @override
    def mechanism(self) -> str:
        """Each parameter by itself."""
        return f"{self.name} of {self.parameter}"

    @property
    @override
    def signature(self) -> Signature:
        """The change over what was there before."""
        change, parameter = self._symbols[0], self.parameter
        return Signature(
            measure=f"change of {parameter} over what it was",
            plain_name=f"a small change of {parameter} in time",
            reason="half a per cent: daily changes of temperature move a stiffness as much",
            size=lambda at: at[change] / _before(parameter, at),
            least=0.005,
        )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The change, its time and the duration of a ramp, named after the parameter: ``delta_nu_jump``."""
        kind = "sudden" if self.duration is None else "gradual"
        told = (
            (_UNITS[self.parameter], f"{kind} change of {self.parameter}", 0.0, -np.inf),
            ("s", f"time of the {kind} change of {self.parameter}", 0.0, 0.0),
            ("s", f"duration of the change of {self.parameter}", 1.0, 1e-3),
        )
        return tuple(
            Parameter(symbol=s, unit=unit, neutral=neutral, lower=lower, description=text, source=self.source)
            for s, (unit, text, neutral, lower) in zip(self._symbols, told, strict=False)
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        given = (self.jump, self.time, self.duration)
        return {s: value for s, value in zip(self._symbols, given, strict=False) if value is not None}

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        """No change of each parameter that can change, at once and over a second."""
        return tuple(
            cls(parameter=parameter, jump=0.0, time=0.0, duration=duration)
            for duration in (None, 1.0)
            for parameter in _UNITS
        )

    @override
    def fill(self, slots: Slots) -> Slots:
        base, (jump, time, *durations) = symbol(self.parameter), map(symbol, self._symbols)
        started = sp.Symbol(f"{jump.name.removesuffix('_jump')}_happened", nonnegative=True)
        share, states = started, slots.added_states
        for duration in durations:
            # Unbounded, so that its derivatives need no jump where the ramp ends; the share is what saturates.
            progress = symbol(f"{self.parameter}_progress")
            share, states = 1 - sp.Max(1 - progress, 0), (*states, AddedState(state=progress, rate=started / duration))
        after = base + jump
        bounds = (after >= -1, after <= 1) if self.parameter == "alpha" else (after >= 0,)
        return replace(
            slots,
            increments={**slots.increments, base: slots.increments.get(base, sp.Integer(0)) + jump * share},
            added_states=states,
            events=(*slots.events, Event(time=time, indicator=started)),
            constraints=(*slots.constraints, *bounds),
        )


@guides(SuddenDamage)
class SuddenDamageSearch(SearchGuide[SuddenDamage]):
    """How a search looks for a sudden change."""

    @override
    def priors(self, scales: Scales) -> tuple[SuddenDamage, ...]:
        change = Normal(0.0, 0.3 * scales.stiffness)
        time = Uniform(min(scales.onset, 0.9 * scales.duration), scales.duration)
        longest = max(2.0 * scales.period, 0.5 * (scales.duration - scales.onset))
        lasting = Uniform(0.25 * scales.period, longest)
        return (
            SuddenDamage(parameter="k", jump=change, time=time),
            SuddenDamage(parameter="k", jump=change, time=time, duration=lasting),
        )

    @override
    def starts(self, effect: SuddenDamage, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        change, time, *durations = (parameter.symbol for parameter in effect.parameters)
        # The response is nearly linear in the change, whose size the score tells at every time: none is guessed.
        starts = {change: (), time: _times(scales, 1 if not durations else 2)}
        return {**starts, **dict.fromkeys(durations, (1.5 * scales.period,))}


def _times(scales: Scales, spacings: int) -> tuple[float, ...]:
    """Times from the onset of strong motion to the end of the record, at most so many spacings apart, in seconds."""
    start = min(scales.onset, 0.9 * scales.duration)
    cycle = 2.0 * np.pi * scales.drift / scales.drift_rate
    n = min(_MOST_STARTS, ceil((scales.duration - start) / (spacings * _SPACING * cycle)))
    return tuple(float(t) for t in start + (np.arange(n) + 0.5) * (scales.duration - start) / n)


def _before(parameter: str, at: PlaceResponse) -> float:
    """What a change is measured in: the parameter; where it may be zero, what would show by the end of the record."""
    least = {
        "c": 0.02 * at.scales.stiffness / at.omega,  # a hundredth of critical
        "alpha": 0.05,
        "delta_nu": 1.0 / max(at.energy, 1e-12),
        "delta_eta": 1.0 / max(at.energy, 1e-12),
        "delta_s": at.peak("drift") / max(at.energy, 1e-12),
    }
    return max(abs(at[parameter]), least.get(parameter, 1e-300))
