"""A loop whose shape depends on the direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.law import (
    DRIFT,
    DRIFT_RATE,
    HYSTERETIC_DISPLACEMENT,
    Effect,
    SharpFeature,
    Slots,
    symbol,
)
from bwbn_bayes.elements.loops import READABLE_ASYMMETRY, peak_asymmetry
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Normal, Parameter, Value

_SONG = "Song and Der Kiureghian 2006"
_SYMBOLS = {"sgn z + sgn v": ("phi",), "sgn u sgn v": ("phi_uv", "u_uv"), "sgn u": ("phi_u", "u_u")}
_WIDTH = 0.03
"""Width of a smoothed sgn u in default priors, as a share of the largest drift."""


@dataclass(frozen=True, kw_only=True)
class Asymmetry(Effect):
    """A term of the shape bracket that breaks its symmetry: ``beta sgn(z v) + gamma + phi (sgn z + sgn v)``.

    Other terms: ``phi_uv sgn u sgn v`` and ``phi_u sgn u``, where ``tanh(u / width)`` stands for ``sgn u``: the rate of
    z would jump at ``u = 0``, and its derivatives with it.

    Parameters
    ----------
    phi : float, Prior or PerStorey
        Size of the term, ``|phi| <= (beta + gamma) / 2``; for the two others ``|phi| <= beta + gamma``, so that z stays
        bounded. [1/m^n]
    term : {"sgn z + sgn v", "sgn u sgn v", "sgn u"}
        Which term. The second is even under a change of direction: it skews the loop about zero drift only.
    width : float, Prior or PerStorey, optional
        Drift over which ``sgn u`` turns; for the terms that hold it. [m]

    Raises
    ------
    UserError
        If the term is not one of the three, or has a width without ``sgn u`` or no width with it.

    References
    ----------
    .. [1] C.-H. Wang and Y.-K. Wen, "Evaluation of Pre-Northridge Low-Rise Steel Buildings. I: Modeling", J. Struct.
       Eng. 126(10), 2000.
    .. [2] J. Song and A. Der Kiureghian, "Generalized Bouc-Wen Model for Highly Asymmetric Hysteresis", J. Eng. Mech.
       132(6), 2006: six terms, of which ours are beta_4 = beta_5, beta_2 and beta_6 (checked against a public
       implementation, not against the print; the smoothing is ours).
    """

    phi: Value
    term: str = "sgn z + sgn v"
    width: Value | None = None

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen",)
    name: ClassVar[str] = "asymmetry"
    summary: ClassVar[str] = "the loop differs between the two directions"
    source: ClassVar[str] = "Wang and Wen 2000; Song and Der Kiureghian 2006"
    residual: ClassVar[str] = "even harmonics, a drift that stays"
    confusable: ClassVar[str] = "sensor_bias in force and drift records, a one-sided gap_impact"

    def __post_init__(self) -> None:
        if self.term not in _SYMBOLS:
            raise UserError(f"Asymmetry: term {self.term!r} is not known: choose one of {', '.join(_SYMBOLS)}")
        if (self.width is not None) != (len(_SYMBOLS[self.term]) == 2):
            raise UserError(f"Asymmetry: give `width` with a term that holds sgn u and only there, not {self.term!r}")

    @property
    @override
    def form(self) -> str:
        return self.term

    @property
    @override
    def signature(self) -> Signature:
        """Asymmetry of the peaks; of ``sgn u sgn v``, which the peaks do not feel, its share of the bracket."""
        size = _SYMBOLS[self.term][0]
        if self.term == "sgn u sgn v":
            return Signature(
                measure="shape on the way out less that on the way back, over beta + gamma",
                plain_name="the shape of the loop about zero drift (Song and Der Kiureghian's law)",
                reason="a twentieth of beta + gamma: less is within what other shapes of the loop take up",
                size=lambda at: at[size] / max(at["beta"] + at["gamma"], 1e-300),
                least=0.05,
            )
        share = 2.0 if self.term == "sgn z + sgn v" else 1.0
        return Signature(
            measure="asymmetry of the peaks",
            plain_name="the shape of the loop by direction (Wang and Wen's law)",
            reason="strengths that differ by a fiftieth: specimens built alike on both sides do",
            size=lambda at: _of_strengths(share * at[size] / max(at["beta"] + at["gamma"], 1e-300), at["n"]),
            least=0.01,
            of_loop=peak_asymmetry,
            needs="a motion to both sides",
            readable=READABLE_ASYMMETRY,
            is_shown=lambda drift, force: abs(peak_asymmetry(drift, force)) >= READABLE_ASYMMETRY,
        )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The size, and the width of a smoothed ``sgn u``; their symbols tell the terms apart."""
        size, *widths = _SYMBOLS[self.term]
        source = _SONG if widths else "Wang and Wen 2000"
        return (
            Parameter(
                symbol=size, unit="1/m^n", neutral=0.0, description=f"asymmetry, times {self.term}", source=source
            ),
            *(
                Parameter(
                    symbol=width,
                    unit="m",
                    neutral=1.0,
                    lower=1e-9,
                    description="drift over which sgn u turns",
                    source=source,
                )
                for width in widths
            ),
        )

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        given = (self.phi, self.width)
        return {s: value for s, value in zip(_SYMBOLS[self.term], given, strict=False) if value is not None}

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return tuple(cls(phi=0.0, term=term, width=1.0 if len(s) == 2 else None) for term, s in _SYMBOLS.items())

    @override
    def fill(self, slots: Slots) -> Slots:
        phi, *widths = (symbol(s) for s in _SYMBOLS[self.term])
        bound = symbol("beta") + symbol("gamma")
        if not widths:
            term, reach = phi * (sp.sign(HYSTERETIC_DISPLACEMENT) + sp.sign(DRIFT_RATE)), 2 * phi
        else:
            direction = sp.sign(DRIFT_RATE) if self.term == "sgn u sgn v" else sp.S.One
            term, reach = phi * direction * sp.tanh(DRIFT / widths[0]), phi
        return replace(
            slots,
            shape_bracket=slots.shape_bracket + term,
            sharp_features=(*slots.sharp_features, *(SharpFeature(state=DRIFT, width=w) for w in widths)),
            constraints=(*slots.constraints, bound >= reach, bound >= -reach),
        )


@guides(Asymmetry)
class AsymmetrySearch(SearchGuide[Asymmetry]):
    """How a search looks for asymmetry."""

    @override
    def priors(self, scales: Scales) -> tuple[Asymmetry, ...]:
        bound = scales.beta + scales.gamma
        if bound <= 0.0:  # no room for the term
            return ()
        width = _WIDTH * scales.drift
        return (
            Asymmetry(phi=Normal(0.0, 0.25 * bound)),
            Asymmetry(phi=Normal(0.0, 0.5 * bound), term="sgn u sgn v", width=width),
            Asymmetry(phi=Normal(0.0, 0.5 * bound), term="sgn u", width=width),
        )

    @override
    def starts(self, effect: Asymmetry, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        size = _SYMBOLS[effect.term][0]
        start = (scales.beta + scales.gamma) * (0.15 if size == "phi" else 0.3)
        return {size: (-start, start)}


def _of_strengths(term: float, n: float) -> float:
    """``(F+ - F-) / (F+ + F-)`` of the bounds of z where a term, over beta + gamma, joins the bracket with its sign."""
    positive, negative = (max(1.0 + side * term, 1e-12) ** (-1.0 / n) for side in (1.0, -1.0))
    return float((positive - negative) / (positive + negative))
