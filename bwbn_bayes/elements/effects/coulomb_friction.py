"""Dry friction beside the storey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.effects.free_friction import (
    WIDEST,
    FreeFrictionSearch,
    SpeedFrictionSearch,
    width_prior,
    width_starts,
)
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, AddedState, Effect, SharpFeature, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, Parameter, Value

_MOSTAGHEL, _DAHL = "Mostaghel and Davis 1997", "Dahl 1968"
_SYMBOLS = {
    "tanh": ("F_c", "v0"),
    "ratio": ("F_ratio", "v_ratio"),
    "root": ("F_root", "v_root"),
    "dahl": ("F_dahl", "x_dahl"),
}
_FORMS = {"tanh": "tanh(v/v0)", "ratio": "v/(|v| + v0)", "root": "v/sqrt(v^2 + v0^2)", "dahl": "sticking (Dahl)"}

MOBILISED = symbol("q_f")
"""Share of the friction force that a sticking contact has reached, from -1 to 1."""


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    """The force ``F_c tanh(v / v0)``, or with another smooth sign of the drift rate, or a contact that sticks.

    ``ratio`` is ``v / (|v| + v0)``, which like an arctangent approaches one slowly; ``root`` is
    ``v / sqrt(v^2 + v0^2)``. These creep under any force; with ``dahl`` the force is ``F_c q_f`` with
    ``dq_f/dt = (v - |v| q_f) / x0``: after a reversal it grows with the drift, as that of a spring ``F_c / x0``, and
    holds while the storey stands still.

    Parameters
    ----------
    F_c : float, Prior or PerStorey
        Friction force. [N]
    v0 : float, Prior or PerStorey, optional
        Drift rate over which the force turns; not with ``dahl``. [m/s]
    smoothing : {"tanh", "ratio", "root", "dahl"}
        How the force turns.
    x0 : float, Prior or PerStorey, optional
        Drift over which the force turns with ``dahl``. [m]

    Raises
    ------
    UserError
        If the smoothing is not one of the four, or the width is not the one it has.

    References
    ----------
    .. [1] N. Mostaghel and T. Davis, "Representations of Coulomb Friction for Dynamic Analysis", Earthquake Eng.
       Struct. Dyn. 26(5), 1997 (tanh and ratio among its functions; cited from memory, not consulted). ``root`` is a
       usual third.
    .. [2] P. R. Dahl, "A Solid Friction Model", Aerospace Corporation TOR-0158(3107-18)-1, 1968 (with exponent one;
       cited from memory, not consulted).
    """

    F_c: Value
    v0: Value | None = None
    smoothing: str = "tanh"
    x0: Value | None = None

    name: ClassVar[str] = "coulomb_friction"
    title: ClassVar[str] = "dry friction"
    summary: ClassVar[str] = "dry friction that resists every drift"
    source: ClassVar[str] = f"{_MOSTAGHEL}; {_DAHL}"
    residual: ClassVar[str] = "a square wave in phase with the drift rate, sticking"
    confusable: ClassVar[str] = "a stiff Bouc-Wen spring with alpha near 0, quadratic_damping at one amplitude"

    def __post_init__(self) -> None:
        if self.smoothing not in _SYMBOLS:
            raise UserError(
                f"CoulombFriction: smoothing {self.smoothing!r} is not known: choose one of {', '.join(_SYMBOLS)}"
            )
        needed, other = ("x0", "v0") if self._sticks else ("v0", "x0")
        if getattr(self, needed) is None or getattr(self, other) is not None:
            raise UserError(f"CoulombFriction: smoothing {self.smoothing!r} has a width {needed}: give it, not {other}")

    @property
    @override
    def form(self) -> str:
        return _FORMS[self.smoothing]

    @property
    def _sticks(self) -> bool:
        return self.smoothing == "dahl"

    @property
    @override
    def signature(self) -> Signature:
        """Friction over peak force; what turns slowly is viscous, not dry."""
        force, width = _SYMBOLS[self.smoothing]
        turned_in, where = ("drift", "after reversals") if self._sticks else ("drift_rate", "over drift rate")
        return Signature(
            measure="friction force over the peak force",
            plain_name=f"the shape of the force {where} (a smoothed friction)",
            reason="0.4 % of the peak force, turned within an eighth of the largest drift rate, or drift where it "
            "sticks: what turns more slowly is viscous, not dry",
            size=lambda at: at[force] / at.peak("restoring_force"),
            least=0.004,
            is_genuine=lambda at: at[width] <= WIDEST * at.peak(turned_in),
        )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The force and the width; their symbols tell the smoothings apart."""
        force, width = _SYMBOLS[self.smoothing]
        unit, kind, source = ("m", "drift", _DAHL) if self._sticks else ("m/s", "drift rate", _MOSTAGHEL)
        return (
            Parameter(symbol=force, unit="N", neutral=0.0, lower=0.0, description="friction force", source=source),
            Parameter(
                symbol=width,
                unit=unit,
                neutral=1.0,
                lower=1e-9,
                description=f"{kind} over which friction turns",
                source=source,
            ),
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        width = self.x0 if self._sticks else self.v0
        assert width is not None
        return dict(zip(_SYMBOLS[self.smoothing], (self.F_c, width), strict=True))

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return cls.every_form(0.0, v0=1.0, x0=1.0)

    @classmethod
    def every_form(cls, force: Value, *, v0: Value, x0: Value) -> tuple[Self, ...]:
        """One of each smoothing, with the same force [N] and the width that it has [m/s], [m]."""
        rates = tuple(cls(F_c=force, v0=v0, smoothing=smoothing) for smoothing in ("tanh", "ratio", "root"))
        return (*rates, cls(F_c=force, x0=x0, smoothing="dahl"))

    @override
    def fill(self, slots: Slots) -> Slots:
        force, width = (symbol(s) for s in _SYMBOLS[self.smoothing])
        v = DRIFT_RATE
        turn = {
            "tanh": sp.tanh(v / width),
            "ratio": v / (sp.Abs(v) + width),
            "root": v / sp.sqrt(v**2 + width**2),
            "dahl": MOBILISED,
        }
        filled = replace(slots, added_force=slots.added_force + force * turn[self.smoothing])
        if not self._sticks:
            return replace(filled, sharp_features=(*slots.sharp_features, SharpFeature(state=v, width=width)))
        return replace(
            filled,
            added_states=(*slots.added_states, AddedState(state=MOBILISED, rate=(v - sp.Abs(v) * MOBILISED) / width)),
            # q_f follows the drift within x0: a step of a stable scheme must be shorter than a few.
            sharp_features=(*slots.sharp_features, SharpFeature(state=DRIFT, width=4 * width, everywhere=True)),
        )


@guides(CoulombFriction)
class CoulombFrictionSearch(SearchGuide[CoulombFriction]):
    """How a search looks for dry friction."""

    @override
    def priors(self, scales: Scales) -> tuple[CoulombFriction, ...]:
        v0, x0 = width_prior(scales.drift_rate), width_prior(scales.drift)
        return CoulombFriction.every_form(HalfNormal(0.3 * scales.force), v0=v0, x0=x0)

    @override
    def starts(self, effect: CoulombFriction, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        force, width = _SYMBOLS[effect.smoothing]
        largest = scales.drift if effect.smoothing == "dahl" else scales.drift_rate
        return {
            force: (0.03 * scales.force, 0.15 * scales.force),
            width: width_starts(largest),
        }

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return (*FreeFrictionSearch().priors(scales), *SpeedFrictionSearch().priors(scales))
