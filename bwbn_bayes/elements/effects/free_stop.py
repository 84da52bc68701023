"""A stop in a free shape: by another power than the first, met bit by bit, behind a gap that widens with work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import DRIFT, ENERGY, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Measure, PlaceResponse, Signature
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, Parameter, Uniform, Value

_SIGNS = {"both": (1, -1), "positive": (1,), "negative": (-1,)}
_TAILS = {"both": "", "positive": "p", "negative": "n"}
_AT_ONCE = 0.01
"""Half width, over ``u``, of a stop whose parts are met all but together; less is lost in single precision."""
_FIELDS = {
    "k_h": ("k_s", "N/m", 0.0, 0.0, "stiffness of the stop, secant at a known closure"),
    "g": ("g_s", "m", 1.0, 0.0, "drift at the stop at the start"),
    "p": ("p_s", "", 1.0, 1.0, "power of the closure"),
    "s": (
        "s_s",
        "",
        _AT_ONCE,
        1e-6,
        "half width of the drifts at which parts of the stop are met, over a known closure",
    ),
    "w": ("w_s", "", 0.0, 0.0, "growth of the gap by a known work"),
    "u": ("u_s", "m", 1.0, 1e-12, "closure at which the stiffness is measured, known"),
    "E": ("E_s", "J", 1.0, 1e-12, "work at which the growth is measured, known"),
}
"""By field: symbol, unit, neutral value, lower end and description."""
_OPEN = 1e-9
"""Closure of a stop that is not met, over ``u``: a power of zero has no logarithm."""
_CONE = 2.0
"""Largest power of a contact: bodies rounded as ``r^m`` push by the power ``1 + 1/m`` of the closure: flat ones by the
first, spheres by 3/2, cones by the second."""
FREE_TRAVEL = 0.1
"""Share of the largest drift that a stop leaves free at least: a spring that is met at once is a stiffening."""


def stop_signature(contact: Measure, first: Measure, side: str) -> Signature:
    """What a stop of any law is judged by: its largest force over the storey's, and that there is a gap before it.

    Parameters
    ----------
    contact : callable
        Its largest force over the storey's.
    first : callable
        The drift at which it is first met. [m]
    side : {"both", "positive", "negative"}
        Where it stands.
    """

    def has_gap(at: PlaceResponse) -> bool:
        reach = max(float(np.max(sign * at.histories["drift"])) for sign in _SIGNS[side])
        return first(at) >= FREE_TRAVEL * reach

    return Signature(
        measure="force of the stop over the peak force",
        plain_name="a stiffening at large drift (a spring behind a gap)",
        reason="a hundredth of the peak force, since less moves nothing, met beyond a tenth of the largest drift",
        size=contact,
        least=0.01,
        is_genuine=has_gap,
    )


@dataclass(frozen=True, kw_only=True)
class FreeStop(Effect):
    """The force ``k_h u mean(((|u_drift| - g (1 + w epsilon/E))/u + s q)_+^p)``, on both sides or on one.

    The mean is over ``q`` from -1 to 1: the stop's parts are met one after another, at drifts that are spread evenly
    about the gap. With ``p = 1``, ``w = 0`` and a vanishing ``s`` it is
    :class:`~bwbn_bayes.elements.effects.gap_impact.GapImpact`.

    Parameters
    ----------
    k_h : float, Prior or PerStorey
        Secant stiffness of the stop at the closure ``u``. [N/m]
    g : float, Prior or PerStorey
        Drift at which it is met at the start. [m]
    p : float, Prior or PerStorey
        Power of the closure; 3/2 of two curved bodies.
    s : float, Prior or PerStorey
        Half width of the drifts at which its parts are met, over ``u``; none is met at rest.
    w : float, Prior or PerStorey
        Share by which the gap has grown by the work ``E``.
    u : float
        Closure at which the stiffness is measured, the largest drift. [m]
    E : float
        Work at which the growth is measured. [J]
    side : {"both", "positive", "negative"}
        Where the stop stands.

    Raises
    ------
    UserError
        If the side is not one of the three.

    References
    ----------
    .. [1] H. Hertz, "Über die Berührung fester elastischer Körper", J. reine angew. Math. 92, 1882 (the power 3/2;
       cited from memory, not consulted); that the gap widens, and the parts met one by one, are our generalisation.
    .. [2] I. N. Sneddon, "The relation between load and penetration in the axisymmetric Boussinesq problem for a punch
       of arbitrary profile", Int. J. Eng. Sci. 3(1), 1965 (the other powers; cited from memory, not consulted).
    """

    k_h: Value
    g: Value
    p: Value
    s: Value
    w: Value
    u: Value
    E: Value
    side: str = "both"

    name: ClassVar[str] = "gap_impact"
    summary: ClassVar[str] = "a stop that is met beyond a drift"
    source: ClassVar[str] = "Hertz 1882"
    residual: ClassVar[str] = "spikes beyond a drift"
    confusable: ClassVar[str] = "cubic_stiffness; one-sided: asymmetry"

    def __post_init__(self) -> None:
        if self.side not in _SIGNS:
            raise UserError(f"FreeStop: side {self.side!r} is not known: choose one of {', '.join(_SIGNS)}")

    @property
    @override
    def form(self) -> str:
        sided = "two-sided" if self.side == "both" else f"one-sided, {self.side}"
        return f"free shape, {sided}"

    @property
    @override
    def signature(self) -> Signature:
        """Force of the stop, on its side."""
        k, g, p, s, w, u, work = self._symbols

        def contact(at: PlaceResponse) -> float:
            drift, energy = at.histories["drift"], at.histories["hysteretic_energy"]
            gap = at[g] * (1.0 + at[w] * np.abs(energy) / at[work])
            closure = np.max([sign * drift - gap for sign in _SIGNS[self.side]]) / at[u]
            return float(at[k] * at[u] * _pushed(closure, at[s], at[p]) / at.peak("restoring_force"))

        return stop_signature(contact, lambda at: at[g] - at[s] * at[u], self.side)

    @property
    def _symbols(self) -> tuple[str, ...]:
        return tuple(name + _TAILS[self.side] for name, *_ in _FIELDS.values())

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each field; their symbols tell the sides apart."""
        return tuple(
            Parameter(symbol=s, unit=unit, neutral=neutral, lower=lower, description=text, source=self.source)
            for s, (_, unit, neutral, lower, text) in zip(self._symbols, _FIELDS.values(), strict=True)
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return dict(zip(self._symbols, (self.k_h, self.g, self.p, self.s, self.w, self.u, self.E), strict=True))

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return tuple(cls(k_h=0.0, g=1.0, p=1.0, s=_AT_ONCE, w=0.0, u=1.0, E=1.0, side=side) for side in _SIGNS)

    @override
    def fill(self, slots: Slots) -> Slots:
        k, g, p, s, w, u, work = (symbol(name) for name in self._symbols)
        gap = g * (1 + w * sp.Abs(ENERGY) / work)
        pushed = [sign * _pushed((sign * DRIFT - gap) / u, s, p) for sign in _SIGNS[self.side]]
        # Met at rest, a stop on one side would push the storey before anything moves.
        met_later = g >= s * u
        return replace(
            slots,
            added_force=slots.added_force + k * u * sp.Add(*pushed),
            constraints=(*slots.constraints, met_later),
        )


def _pushed(closure: Any, s: Any, p: Any) -> Any:
    """``mean((closure + s q)_+^p)`` over ``q`` from -1 to 1, of numbers or symbols."""

    def until(end: Any) -> Any:
        return sp.Max(end, _OPEN) ** (p + 1)

    return (until(closure + s) - until(closure - s)) / (2 * s * (p + 1))


@guides(FreeStop)
class FreeStopSearch(SearchGuide[FreeStop]):
    """How a search looks for a stop in a free shape."""

    @override
    def priors(self, scales: Scales) -> tuple[FreeStop, ...]:
        return tuple(
            FreeStop(
                k_h=HalfNormal(3.0 * scales.stiffness),
                g=Uniform(FREE_TRAVEL * scales.drift, 1.5 * scales.drift),
                p=Uniform(1.0, _CONE),
                s=HalfNormal(0.1).truncated(_AT_ONCE, 0.5),
                w=HalfNormal(0.5).truncated(0.0, 5.0),
                u=scales.drift,
                E=scales.energy,
                side=side,
            )
            for side in _SIGNS
        )

    @override
    def starts(self, effect: FreeStop, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        k, g, p, s, w, *_ = (parameter.symbol for parameter in effect.parameters)
        return {
            k: (0.3 * scales.stiffness, 2.0 * scales.stiffness),
            g: tuple(share * scales.drift for share in (0.3, 0.5, 0.7)),
            p: (1.2, 1.7),
            s: (0.05,),
            w: (0.1,),
        }
