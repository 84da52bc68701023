"""A stop beside the storey that closes beyond a drift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.effects.free_stop import FREE_TRAVEL, FreeStopSearch, stop_signature
from bwbn_bayes.elements.law import DRIFT, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, Parameter, Uniform, Value

_SYMBOLS = {"both": ("k_g", "g"), "positive": ("k_gp", "g_p"), "negative": ("k_gn", "g_n")}
_FORMS = {"both": "two-sided", "positive": "one-sided, positive", "negative": "one-sided, negative"}


@dataclass(frozen=True, kw_only=True)
class GapImpact(Effect):
    """A linear spring that is met beyond the gap: ``k_g max(|u| - g, 0) sgn u``, or on one side only.

    Parameters
    ----------
    k_g : float, Prior or PerStorey
        Stiffness of the stop. [N/m]
    g : float, Prior or PerStorey
        Drift at which it is met. [m]
    side : {"both", "positive", "negative"}
        Where the stop stands.

    Raises
    ------
    UserError
        If the side is not one of the three.

    References
    ----------
    .. [1] S. A. Anagnostopoulos, "Pounding of Buildings in Series during Earthquakes", Earthquake Eng. Struct. Dyn.
       16(3), 1988 (a spring behind a gap, there with a dashpot beside it; cited from memory, not consulted).
    """

    k_g: Value
    g: Value
    side: str = "both"

    name: ClassVar[str] = "gap_impact"
    summary: ClassVar[str] = "a stop that is met beyond a drift"
    source: ClassVar[str] = "Anagnostopoulos 1988"
    residual: ClassVar[str] = "spikes beyond a drift"
    confusable: ClassVar[str] = "cubic_stiffness; one-sided: asymmetry"

    def __post_init__(self) -> None:
        if self.side not in _SYMBOLS:
            raise UserError(f"GapImpact: side {self.side!r} is not known: choose one of {', '.join(_SYMBOLS)}")

    @property
    @override
    def form(self) -> str:
        return _FORMS[self.side]

    @property
    @override
    def signature(self) -> Signature:
        """Force of the stop, on its side."""
        stiffness, gap = _SYMBOLS[self.side]
        sign = {"both": 0.0, "positive": 1.0, "negative": -1.0}[self.side]

        def contact(at: PlaceResponse) -> float:
            drift = at.histories["drift"]
            reach = float(np.max(sign * drift if sign else np.abs(drift)))
            return at[stiffness] * max(reach - at[gap], 0.0) / at.peak("restoring_force")

        return stop_signature(contact, lambda at: at[gap], self.side)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The stiffness and the gap; their symbols tell the sides apart."""
        stiffness, gap = _SYMBOLS[self.side]
        return (
            Parameter(
                symbol=stiffness,
                unit="N/m",
                neutral=0.0,
                lower=0.0,
                description="stiffness of the stop",
                source=self.source,
            ),
            Parameter(
                symbol=gap, unit="m", neutral=1.0, lower=0.0, description="drift at the stop", source=self.source
            ),
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return dict(zip(_SYMBOLS[self.side], (self.k_g, self.g), strict=True))

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return tuple(cls(k_g=0.0, g=1.0, side=side) for side in _SYMBOLS)

    @override
    def fill(self, slots: Slots) -> Slots:
        stiffness, gap = (symbol(s) for s in _SYMBOLS[self.side])
        above, below = (sp.Max(side * DRIFT - gap, 0) for side in (1, -1))
        closed = {"both": above - below, "positive": above, "negative": -below}[self.side]
        return replace(slots, added_force=slots.added_force + stiffness * closed)


@guides(GapImpact)
class GapImpactSearch(SearchGuide[GapImpact]):
    """How a search looks for a stop."""

    @override
    def priors(self, scales: Scales) -> tuple[GapImpact, ...]:
        gap = Uniform(FREE_TRAVEL * scales.drift, 1.5 * scales.drift)
        return tuple(GapImpact(k_g=HalfNormal(3.0 * scales.stiffness), g=gap, side=side) for side in _SYMBOLS)

    @override
    def starts(self, effect: GapImpact, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        stiffness, gap = _SYMBOLS[effect.side]
        return {
            stiffness: (0.3 * scales.stiffness, 2.0 * scales.stiffness),
            gap: tuple(share * scales.drift for share in (0.25, 0.45, 0.65, 0.85)),
        }

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return FreeStopSearch().priors(scales)
