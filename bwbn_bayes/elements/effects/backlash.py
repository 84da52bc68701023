"""Play in series with the storey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, AddedState, Definition, Effect, SharpFeature, Slots, step, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Value

PLAY = symbol("d")
"""Position within the play, from -b to b. [m]"""


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
    summary: ClassVar[str] = "play in series with the storey, crossed after every reversal"
    source: ClassVar[str] = "Tao and Kokotovic 1996"
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
        Parameter(symbol="b", unit="m", neutral=0.0, lower=0.0, description="half width of the play", source=source),
        Parameter(
            symbol="w",
            unit="m",
            neutral=1.0,
            lower=1e-9,
            description="distance over which the play closes",
            source=source,
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        room = step("xi")
        free = sp.Max(room, 0) - sp.Max(room - 1, 0)
        ahead = (symbol("b") - PLAY * sp.sign(DRIFT_RATE)) / symbol("w")
        return replace(
            slots,
            drift_taken_up=slots.drift_taken_up + PLAY,
            drift_rate_share=slots.drift_rate_share - free,
            added_states=(*slots.added_states, AddedState(state=PLAY, rate=DRIFT_RATE * free)),
            # While the play closes, d follows the drift within a few w: a step of a stable scheme must be shorter.
            sharp_features=(*slots.sharp_features, SharpFeature(state=DRIFT, width=4 * symbol("w"), everywhere=True)),
            steps=(*slots.steps, Definition(caption="room ahead in the play, in w", subject=room, expression=ahead)),
        )


@guides(Backlash)
class BacklashSearch(SearchGuide[Backlash]):
    """How a search looks for play."""

    @override
    def priors(self, scales: Scales) -> tuple[Backlash, ...]:
        return (Backlash(b=HalfNormal(0.15 * scales.drift), w=0.004 * scales.drift),)

    @override
    def starts(self, effect: Backlash, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"b": tuple(share * scales.drift for share in (0.01, 0.04, 0.12, 0.25))}
