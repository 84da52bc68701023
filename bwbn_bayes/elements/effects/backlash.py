"""Play in series with the storey: of a held kind, or slack that carries little force or none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.law import (
    DRIFT,
    DRIFT_RATE,
    HYSTERETIC_DISPLACEMENT,
    AddedState,
    Definition,
    Effect,
    SharpFeature,
    Slots,
    step,
    symbol,
)
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Uniform, Value

_SOURCE = "Tao and Kokotovic 1996"
PLAY = symbol("d")
"""Position within the play, from -b to b. [m]"""
SLACK = symbol("d_0")
"""Position within the slack, from -b_0 to b_0. [m]"""
FREE_SLACK = symbol("d_f")
"""Position within the slack of a free shape, from -b_f to b_f. [m]"""


def _length(name: str, neutral: float, lower: float, description: str) -> Parameter:
    return Parameter(symbol=name, unit="m", neutral=neutral, lower=lower, description=description, source=_SOURCE)


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """A play of width ``2 b`` that the drift must cross after every reversal before it moves the storey's springs.

    The springs see ``u - d`` and its rate ``v - dd/dt``, with ``dd/dt = v clip((b - d sgn v)/w, 0, 1)``; they hold
    their place, and so their force, while the play is crossed. As ``w -> 0`` this is the play operator; ``w`` is the
    distance over which the play closes. The damper and added forces stand beside both.

    Parameters
    ----------
    b : float, Prior or PerStorey
        Half of the width of the play. [m]
    w : float, Prior or PerStorey
        Distance over which it closes. [m]

    References
    ----------
    .. [1] G. Tao and P. V. Kokotovic, "Adaptive Control of Systems with Actuator and Sensor Nonlinearities", Wiley,
       1996 (backlash). Cited from memory, not consulted; the ramp over ``w`` is ours, so that the response can be
       differentiated, and is tested against the exact operator.
    """

    b: Value
    w: Value

    name: ClassVar[str] = "backlash"
    summary: ClassVar[str] = "play in series with the springs, crossed after every reversal"
    source: ClassVar[str] = _SOURCE
    residual: ClassVar[str] = "a flat stretch after every reversal, whatever z"
    confusable: ClassVar[str] = "slip_lock, gap_impact"
    signature: ClassVar[Signature] = Signature(
        measure="play over the largest drift",
        plain_name="the shape of the loop after reversals (a play operator)",
        reason="a play of half a per cent of the largest drift: less is rounding of the turn",
        size=lambda at: 2.0 * at["b"] / at.peak("drift"),
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _length("b", 0.0, 0.0, "half width of the play"),
        _length("w", 1.0, 1e-9, "distance over which the play closes"),
    )

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Effect, ...]:
        return (*super().neutral_forms(), *Slack.neutral_forms())

    @override
    def fill(self, slots: Slots) -> Slots:
        room = step("xi")
        ahead = (symbol("b") - PLAY * sp.sign(DRIFT_RATE)) / symbol("w")
        steps = (Definition(caption="room ahead in the play, in w", subject=room, expression=ahead),)
        return _crossed(slots, PLAY, _ramp(room), symbol("w"), steps)


@dataclass(frozen=True, kw_only=True)
class Slack(Effect):
    """Backlash that carries no force while it is crossed: a dead zone of width ``2 b_0`` in series with both springs.

    As :class:`Backlash`, but that the play is crossed once the springs are unloaded:
    ``dd/dt = v clip((b_0 - d sgn v)/w_0, 0, 1) clip(1 + f sgn v/w_0, 0, 1)`` with the springs' force over their
    stiffness, ``f = alpha (u - d) + (1 - alpha) z``.

    Parameters
    ----------
    b_0 : float, Prior or PerStorey
        Half of the width of the slack. [m]
    w_0 : float, Prior or PerStorey
        Distance over which it opens and closes. [m]

    References
    ----------
    .. [1] G. Tao and P. V. Kokotovic, "Adaptive Control of Systems with Actuator and Sensor Nonlinearities", Wiley,
       1996 (dead zone). Cited from memory, not consulted; the ramps over ``w_0`` are ours, as those of the play are.
    """

    b_0: Value
    w_0: Value

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen")
    name: ClassVar[str] = Backlash.name
    summary: ClassVar[str] = Backlash.summary
    source: ClassVar[str] = Backlash.source
    residual: ClassVar[str] = Backlash.residual
    confusable: ClassVar[str] = Backlash.confusable
    form: ClassVar[str] = "slack"
    signature: ClassVar[Signature] = replace(
        Backlash.signature,
        plain_name="the shape of the loop near zero force (a dead zone)",
        size=lambda at: 2.0 * at["b_0"] / at.peak("drift"),
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _length("b_0", 0.0, 0.0, "half width of the slack"),
        _length("w_0", 1.0, 1e-9, "distance over which it opens and closes"),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return _loose(slots, SLACK, symbol("b_0"), symbol("w_0"))


@dataclass(frozen=True, kw_only=True)
class FreeSlack(Effect):
    """A slack that opens and closes over any distance, in which the springs carry some of the drift.

    As :class:`Slack`, but that the springs follow the share ``s_f`` of the drift while the slack is crossed:
    ``dd/dt = (1 - s_f) v clip((b_f - d sgn v)/w_f, 0, 1) clip(1 + f sgn v/w_f, 0, 1)``.

    Parameters
    ----------
    b_f : float, Prior or PerStorey
        Half of the width of the slack. [m]
    w_f : float, Prior or PerStorey
        Distance over which it opens and closes. [m]
    s_f : float, Prior or PerStorey
        Stiffness while it is crossed, over that of the springs.

    References
    ----------
    .. [1] G. Tao and P. V. Kokotovic, "Adaptive Control of Systems with Actuator and Sensor Nonlinearities", Wiley,
       1996 (dead zone). Cited from memory, not consulted; what is carried within it is our generalisation.
    """

    b_f: Value
    w_f: Value
    s_f: Value

    elements: ClassVar[tuple[str, ...]] = Slack.elements
    name: ClassVar[str] = Slack.name
    summary: ClassVar[str] = Slack.summary
    source: ClassVar[str] = Slack.source
    residual: ClassVar[str] = Slack.residual
    confusable: ClassVar[str] = Slack.confusable
    form: ClassVar[str] = "free shape"
    signature: ClassVar[Signature] = replace(
        Slack.signature,
        size=lambda at: 2.0 * at["b_f"] * (1.0 - at["s_f"]) / at.peak("drift"),
        is_genuine=lambda at: at["w_f"] <= 2.0 * at["b_f"],  # else it never opens
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _length("b_f", 0.0, 0.0, "half width of the slack"),
        _length("w_f", 1.0, 1e-9, "distance over which it opens and closes"),
        Parameter(
            symbol="s_f",
            unit="",
            neutral=0.0,
            lower=0.0,
            upper=1.0,
            description="stiffness while it is crossed, over that of the springs",
            source=source,
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return _loose(slots, FREE_SLACK, symbol("b_f"), symbol("w_f"), carried=symbol("s_f"), mark="_e")


def _loose(
    slots: Slots, place: sp.Symbol, half: sp.Expr, width: sp.Expr, carried: sp.Expr = sp.S.Zero, mark: str = "_0"
) -> Slots:
    """A slack that is crossed once the springs are unloaded."""
    alpha, forward = symbol("alpha"), sp.sign(DRIFT_RATE)
    room, loose = step(f"xi{mark}"), step(f"xi_f{mark}")
    force = alpha * (DRIFT - place) + (1 - alpha) * HYSTERETIC_DISPLACEMENT
    steps = (
        ("room ahead in the slack, in its width", room, (half - place * forward) / width),
        ("how far the springs are unloaded", loose, 1 + force * forward / width),
    )
    named = tuple(Definition(caption=c, subject=x, expression=e) for c, x, e in steps)
    return _crossed(slots, place, (1 - carried) * _ramp(room) * _ramp(loose), width, named)


def _ramp(x: sp.Expr) -> sp.Expr:
    """From 0 to 1 as x does, and no further."""
    return sp.Max(x, 0) - sp.Max(x - 1, 0)


def _crossed(slots: Slots, place: sp.Symbol, free: sp.Expr, width: sp.Symbol, steps: tuple[Definition, ...]) -> Slots:
    """What a play at a place takes up of the drift, of whose rate it follows the share ``free``."""
    return replace(
        slots,
        drift_taken_up=slots.drift_taken_up + place,
        drift_rate_share=slots.drift_rate_share - free,
        added_states=(*slots.added_states, AddedState(state=place, rate=DRIFT_RATE * free)),
        # While the play closes, its place follows the drift within a few w: a step of a stable scheme must be shorter.
        sharp_features=(*slots.sharp_features, SharpFeature(state=DRIFT, width=4 * width, everywhere=True)),
        steps=(*slots.steps, *steps),
    )


@guides(FreeSlack)
class FreeSlackSearch(SearchGuide[FreeSlack]):
    """How a search looks for slack in a free shape."""

    @override
    def priors(self, scales: Scales) -> tuple[FreeSlack, ...]:
        drift = scales.drift
        width = LogNormal(0.02 * drift, 1.0).truncated(0.002 * drift, 0.2 * drift)
        return (FreeSlack(b_f=HalfNormal(0.15 * drift), w_f=width, s_f=Uniform(0.0, 0.5)),)

    @override
    def starts(self, effect: FreeSlack, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        drift = scales.drift
        return {"b_f": (0.02 * drift, 0.1 * drift), "w_f": (0.01 * drift, 0.05 * drift), "s_f": (0.05,)}


@guides(Slack)
@guides(Backlash)
class BacklashSearch(SearchGuide[Backlash | Slack]):
    """How a search looks for play."""

    @override
    def priors(self, scales: Scales) -> tuple[Backlash | Slack, ...]:
        half, width = HalfNormal(0.15 * scales.drift), 0.004 * scales.drift
        return (Backlash(b=half, w=width), Slack(b_0=half, w_0=width))

    @override
    def starts(self, effect: Backlash | Slack, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        half = "b_0" if isinstance(effect, Slack) else "b"
        return {half: tuple(share * scales.drift for share in (0.01, 0.04, 0.12, 0.25))}

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return FreeSlackSearch().priors(scales)
