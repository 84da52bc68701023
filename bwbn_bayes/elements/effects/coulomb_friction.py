"""Dry friction beside the storey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.law import DRIFT_RATE, Effect, SharpFeature, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Value

_MOSTAGHEL = "Mostaghel and Davis 1997"
_SYMBOLS = {"tanh": ("F_c", "v0"), "ratio": ("F_ratio", "v_ratio"), "root": ("F_root", "v_root")}
_WIDEST = 0.125
"""Share of the largest drift rate over which dry friction may turn: what turns more slowly is another damping."""
_FORMS = {"tanh": "tanh(v/v0)", "ratio": "v/(|v| + v0)", "root": "v/sqrt(v^2 + v0^2)"}


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    """The force ``F_c tanh(v / v0)``, or with another smooth sign of the drift rate.

    ``ratio`` is ``v / (|v| + v0)``, which like an arctangent approaches one slowly; ``root`` is
    ``v / sqrt(v^2 + v0^2)``.

    Parameters
    ----------
    F_c : float, Prior or PerStorey
        Friction force. [N]
    v0 : float, Prior or PerStorey
        Drift rate over which the force turns. [m/s]
    smoothing : {"tanh", "ratio", "root"}
        The smooth sign.

    Raises
    ------
    UserError
        If the smoothing is not one of the three.

    References
    ----------
    .. [1] N. Mostaghel and T. Davis, "Representations of Coulomb Friction for Dynamic Analysis", Earthquake Eng.
       Struct. Dyn. 26(5), 1997 (tanh and ratio among its functions; cited from memory, not consulted). ``root`` is a
       usual third.
    """

    F_c: Value
    v0: Value
    smoothing: str = "tanh"

    name: ClassVar[str] = "coulomb_friction"
    summary: ClassVar[str] = "dry friction between the floors"
    source: ClassVar[str] = _MOSTAGHEL
    residual: ClassVar[str] = "a square wave in phase with the drift rate, sticking"
    confusable: ClassVar[str] = "a stiff Bouc-Wen spring with alpha near 0, quadratic_damping at one amplitude"
    one_law: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.smoothing not in _SYMBOLS:
            raise UserError(
                f"CoulombFriction: smoothing {self.smoothing!r} is not known: choose one of {', '.join(_SYMBOLS)}"
            )

    @property
    @override
    def form(self) -> str:
        return _FORMS[self.smoothing]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The force and the width; their symbols tell the smoothings apart."""
        force, width = _SYMBOLS[self.smoothing]
        return (
            Parameter(symbol=force, unit="N", neutral=0.0, lower=0.0, description="friction force", source=self.source),
            Parameter(
                symbol=width,
                unit="m/s",
                neutral=1.0,
                lower=1e-9,
                description="drift rate over which friction turns",
                source=self.source,
            ),
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return dict(zip(_SYMBOLS[self.smoothing], (self.F_c, self.v0), strict=True))

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return tuple(cls(F_c=0.0, v0=1.0, smoothing=smoothing) for smoothing in _SYMBOLS)

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        v0 = LogNormal(0.03 * scales.drift_rate, 0.8).truncated(0.004 * scales.drift_rate, 0.3 * scales.drift_rate)
        return tuple(cls(F_c=HalfNormal(0.3 * scales.force), v0=v0, smoothing=smoothing) for smoothing in _SYMBOLS)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        force, width = _SYMBOLS[self.smoothing]
        return {
            force: (0.03 * scales.force, 0.15 * scales.force),
            width: (0.015 * scales.drift_rate, 0.08 * scales.drift_rate),
        }

    @override
    def doubt(self, values: Mapping[str, float], scales: Scales) -> str:
        _, width = _SYMBOLS[self.smoothing]
        share = values[width] / scales.drift_rate
        return (
            f"it turns over {100 * share:.0f} % of the largest drift rate: not dry friction" if share > _WIDEST else ""
        )

    @override
    def fill(self, slots: Slots) -> Slots:
        force, v0 = (symbol(s) for s in _SYMBOLS[self.smoothing])
        v = DRIFT_RATE
        smooth_sign = {"tanh": sp.tanh(v / v0), "ratio": v / (sp.Abs(v) + v0), "root": v / sp.sqrt(v**2 + v0**2)}
        return replace(
            slots,
            added_force=slots.added_force + force * smooth_sign[self.smoothing],
            sharp_features=(*slots.sharp_features, SharpFeature(state=v, width=v0)),
        )
