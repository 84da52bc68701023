"""A parameter that the storeys share, but for one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.law import Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Normal, Parameter, Value

_UNITS = {"alpha": "", "beta": "1/m^n", "gamma": "1/m^n", "n": ""}


@dataclass(frozen=True, kw_only=True)
class StoreyParameter(Effect):
    """At the storeys where it acts, a parameter is larger by ``offset``; it stays admissible.

    It says something where the model shares that parameter over storeys.

    Parameters
    ----------
    parameter : {"alpha", "beta", "gamma", "n"}
        The parameter that differs.
    offset : float, Prior or PerStorey
        By how much, in its own unit.

    Raises
    ------
    UserError
        If the parameter is not one of the four.

    References
    ----------
    .. [1] Y.-K. Wen, "Method for Random Vibration of Hysteretic Systems", J. Eng. Mech. Div. 102(2), 1976 (the
       parameters; that storeys may differ is no more than a question to the data).
    """

    parameter: str
    offset: Value

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen")
    name: ClassVar[str] = "storey_parameter"
    title: ClassVar[str] = "deviating parameter"
    summary: ClassVar[str] = "a parameter that storeys share differs at one of them"
    source: ClassVar[str] = "Wen 1976"
    residual: ClassVar[str] = "a misfit of that storey's loops only, throughout"
    confusable: ClassVar[str] = "strength_degradation, asymmetry, cubic_stiffness"

    def __post_init__(self) -> None:
        if self.parameter not in _UNITS:
            raise UserError(
                f"StoreyParameter: parameter {self.parameter!r} is not one that storeys share: "
                f"choose one of {', '.join(_UNITS)}"
            )

    @property
    @override
    def form(self) -> str:
        return self.parameter

    @property
    @override
    def mechanism(self) -> str:
        """Each parameter by itself."""
        return f"{self.name} of {self.parameter}"

    @property
    @override
    def signature(self) -> Signature:
        """The offset over what the other storeys have."""
        offset = f"{self.parameter}_offset"
        return Signature(
            measure=f"offset of {self.parameter} over what the other storeys have",
            plain_name="a small difference between storeys",
            reason="a twentieth: storeys that were built alike differ by as much",
            size=lambda at: at[offset] / _own(self.parameter, at.parameters),
            least=0.05,
        )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The offset, named after the parameter: ``alpha_offset``."""
        return (
            Parameter(
                symbol=f"{self.parameter}_offset",
                unit=_UNITS[self.parameter],
                neutral=0.0,
                description=f"what sets {self.parameter} apart at this storey",
                source=self.source,
            ),
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return {f"{self.parameter}_offset": self.offset}

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return tuple(cls(parameter=parameter, offset=0.0) for parameter in _UNITS)

    @override
    def fill(self, slots: Slots) -> Slots:
        base, offset = symbol(self.parameter), symbol(f"{self.parameter}_offset")
        # The offset joins every condition in which the parameter stands; these are its own bounds.
        bounds = {"alpha": (base >= -1, base <= 1), "n": (base >= 1,)}.get(self.parameter, ())
        increments = {**slots.increments, base: slots.increments.get(base, sp.Integer(0)) + offset}
        return replace(slots, increments=increments, constraints=(*slots.constraints, *bounds))


@guides(StoreyParameter)
class StoreyParameterSearch(SearchGuide[StoreyParameter]):
    """How a search looks for a deviating parameter."""

    @override
    def priors(self, scales: Scales) -> tuple[StoreyParameter, ...]:
        sizes = _sizes(scales)
        return tuple(StoreyParameter(parameter=parameter, offset=Normal(0.0, sizes[parameter])) for parameter in _UNITS)

    @override
    def starts(self, effect: StoreyParameter, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        start = 0.4 * _sizes(scales)[effect.parameter]
        return {f"{effect.parameter}_offset": (-start, start)}


def _sizes(scales: Scales) -> dict[str, float]:
    """Offsets to expect; of a linear storey's shape, what would bound z where it went."""
    own = abs(scales.beta) + abs(scales.gamma)
    shape = 0.5 * (own if own > 0.0 else scales.hysteretic_displacement**-scales.n)
    return {"alpha": max(scales.alpha, 0.05), "beta": shape, "gamma": shape, "n": 0.5 * scales.n}


def _own(parameter: str, values: Mapping[str, float]) -> float:
    """What an offset is measured in: the parameter itself, of the loop's shape both; of alpha a twentieth at least."""
    if parameter in ("beta", "gamma"):
        return max(abs(values["beta"]) + abs(values["gamma"]), 1e-300)
    return max(abs(values[parameter]), 0.05)
