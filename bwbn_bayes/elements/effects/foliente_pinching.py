"""Foliente's pinching: a multiplier of the Bouc-Wen rate that dips off centre."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.effects.slip_lock import PINCH, FreeSlipSearch
from bwbn_bayes.elements.law import (
    DRIFT_RATE,
    ENERGY,
    HYSTERETIC_DISPLACEMENT,
    Definition,
    Effect,
    Slots,
    off_zero,
    step,
    symbol,
)
from bwbn_bayes.elements.loops import READABLE_INDEX, is_full, pinching_index
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal, Parameter, Uniform, Value

_SOURCE = "Foliente 1995, doi:10.1061/(ASCE)0733-9445(1995)121:6(1013)"


_GENERALISED = "Foliente 1995, generalised"
_OF_FREE_SHAPE = ("zeta_g", "p_g", "q_g", "psi_g", "delta_g", "lambda_g")
"""Symbols of the law in a free shape, in the order of its own."""
_ROUNDING = 0.05
"""Of the width, over which the tip of a power below two is round."""


def _parameter(
    name: str, unit: str, neutral: float, lower: float, description: str, upper: float = math.inf
) -> Parameter:
    return Parameter(
        symbol=name, unit=unit, neutral=neutral, lower=lower, upper=upper, description=description, source=_SOURCE
    )


def _is_open_to_a_pinch(drift: Floats, force: Floats) -> bool:
    """Whether a loop ``(n_times,)`` [m], [N], identified or measured, could be called pinched."""
    return not is_full(drift, force, index=0.25)


def _depth(whole: float, rate: float, energy: float, at_first: float = 0.0) -> float:
    """Depth that a pinch has reached by a work [J]."""
    return whole * (1.0 - (1.0 - at_first) * math.exp(-rate * max(energy, 0.0)))


@dataclass(frozen=True, kw_only=True)
class FolientePinching(Effect):
    """``h = 1 - z1 exp(-(z sgn v - q z_u)^2 / z2^2)`` multiplies the Bouc-Wen rate.

    ``z1 = zeta_s (1 - exp(-p epsilon))``, ``z2 = (psi_0 + delta_psi epsilon)(lambda + z1)`` and
    ``z_u = (1/(beta + gamma))^(1/n)`` (as OpenSees has it: without A and nu); a negative ``epsilon`` counts as none.

    Parameters
    ----------
    zeta_s : float, Prior or PerStorey
        Total slip, the final depth of the pinch; up to 1, so that the multiplier stays positive.
    p : float, Prior or PerStorey
        Rate at which the pinch develops with work. [1/J]
    q : float, Prior or PerStorey
        Position of the pinch as a share of z_u.
    psi_0 : float, Prior or PerStorey
        Width of the pinch. [m]
    delta_psi : float, Prior or PerStorey
        Growth of the width with work. [m/J]
    lambda_ : float, Prior or PerStorey
        Floor of the width's growth with depth.

    References
    ----------
    .. [1] G. C. Foliente, "Hysteresis Modeling of Wood Joints and Structural Systems", J. Struct. Eng. 121(6), 1995.
    """

    zeta_s: Value
    p: Value
    q: Value
    psi_0: Value
    delta_psi: Value
    lambda_: Value

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen",)
    """The pinch lies at a share of the bound of z, which a loop that may harden has not."""
    name: ClassVar[str] = "foliente_pinching"
    title: ClassVar[str] = "pinching after Foliente"
    summary: ClassVar[str] = "loops pinch off centre, depending on direction, and the pinch saturates"
    source: ClassVar[str] = _SOURCE
    residual: ClassVar[str] = "a pinch off centre that depends on the direction and saturates"
    confusable: ClassVar[str] = "slip_lock"
    mechanism: ClassVar[str] = "pinching"
    signature: ClassVar[Signature] = Signature(
        measure="pinching index",
        plain_name="the shape of the reloading branch (Foliente's law)",
        reason="a pinch that takes a tenth of the stiffness, in a loop that is not full: the law bends any branch",
        size=lambda at: _depth(at["zeta_s"], at["p"], at.largest_energy),
        least=0.1,
        of_loop=pinching_index,
        needs="a motion that comes back through zero",
        readable=READABLE_INDEX,
        is_genuine=lambda at: _is_open_to_a_pinch(*at.loop),
        is_shown=_is_open_to_a_pinch,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _parameter("zeta_s", "", 0.0, 0.0, "total slip", 1.0),
        _parameter("p", "1/J", 1.0, 0.0, "rate of the pinch with work"),
        _parameter("q", "", 0.0, -1.0, "position of the pinch"),
        _parameter("psi_0", "m", 1.0, 0.0, "width of the pinch"),
        _parameter("delta_psi", "m/J", 0.0, 0.0, "growth of the width with work"),
        _parameter("lambda_", "", 1.0, 1e-9, "floor of the width"),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        own = tuple(symbol(parameter.symbol) for parameter in self.parameters)
        return _pinched(slots, own, lambda square: sp.exp(-square))


@guides(FolientePinching)
class FolientePinchingSearch(SearchGuide[FolientePinching]):
    """How a search looks for a pinch by Foliente's law."""

    family: ClassVar[str] = PINCH

    @override
    def priors(self, scales: Scales) -> tuple[FolientePinching, ...]:
        z = scales.hysteretic_displacement
        return (
            FolientePinching(
                # A pinch that slips entirely has no stiffness: z would never come out of it again.
                zeta_s=HalfNormal(0.5).truncated(0.0, 0.99),
                # The largest of them: a pinch that is there from the start.
                p=LogNormal(10.0 / scales.energy, 2.3).truncated(0.1 / scales.energy, 1e4 / scales.energy),
                q=Uniform(-0.2, 0.8),
                # A fit that lacks the pinch may have a far smaller z than the right model: the tail is long.
                psi_0=LogNormal(0.3 * z, 1.0).truncated(0.02 * z, 5.0 * z),
                delta_psi=Uniform(0.0, 4.0 * z / scales.energy),
                lambda_=Uniform(0.01, 0.8),
            ),
        )

    @override
    def starts(self, effect: FolientePinching, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "zeta_s": (0.5,),
            "p": tuple(rate / scales.energy for rate in (1.0, 10.0, 1e3)),
            # z_u, which q multiplies, is beyond all bounds where the base's fit ends at beta + gamma = 0.
            "q": (0.0, 0.35),
            "psi_0": (0.15 * scales.hysteretic_displacement, 0.5 * scales.hysteretic_displacement),
            "delta_psi": (0.1 * scales.hysteretic_displacement / scales.energy,),
            "lambda_": (0.25,),
        }

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        # One mechanism: what a pinch by this law leaves, the slip in a free shape may take up.
        return (*FreePinchSearch().priors(scales), *FreeSlipSearch().priors(scales))


def _pinched(
    slots: Slots,
    own: tuple[sp.Symbol, ...],
    dip: Callable[[sp.Expr], sp.Expr],
    at_first: sp.Expr = sp.S.Zero,
    mark: str = "",
) -> Slots:
    """The rate multiplied by one less the dip, a function of the squared distance from its middle over its width.

    The share ``at_first`` of its depth is there from the start.
    """
    zeta_s, p, q, psi_0, delta_psi, floor = own
    closes = symbol("beta") + symbol("gamma")
    depth, width, z_u = (step(f"{name}{mark}") for name in ("z_1", "z_2", "z_u"))
    offset = HYSTERETIC_DISPLACEMENT * sp.sign(DRIFT_RATE) - q * z_u
    bound = (1 / off_zero(closes)) ** (1 / symbol("n"))
    # A pinch that deepens while the spring is bent lets out more work than went in; below none the law means nothing.
    work = sp.Max(ENERGY, 0)
    steps = (
        ("depth of the pinch", depth, zeta_s * (1 - (1 - at_first) * sp.exp(-p * work))),
        ("width of the pinch", width, (psi_0 + delta_psi * work) * (floor + depth)),
        ("bound of the hysteretic displacement", z_u, bound),
    )
    return replace(
        slots,
        rate_multiplier=slots.rate_multiplier * (1 - depth * dip(offset**2 / width**2)),
        constraints=(*slots.constraints, sp.Or(closes > 0, sp.Eq(q, 0))),
        steps=(*slots.steps, *(Definition(caption=c, subject=x, expression=e) for c, x, e in steps)),
    )


@dataclass(frozen=True, kw_only=True)
class FreePinch(Effect):
    """Foliente's multiplier of the Bouc-Wen rate, ``1 - z1 (1 + t_g |(z sgn v - q_g z_u)/z2|^m_g)^(-1/t_g)``.

    With ``z1 = zeta_g (1 - (1 - i_g) exp(-p_g max(epsilon, 0)))``; ``z2`` and ``z_u`` are those of
    :class:`FolientePinching`, which it is with ``i_g = 0``, ``m_g = 2`` and a vanishing ``t_g``. With a power near 1.4
    the dip resembles a hyperbolic secant, with a large one it has a flat bottom; the larger ``t_g``, the heavier its
    tails: one and the power two are a Lorentzian.

    Parameters
    ----------
    zeta_g : float, Prior or PerStorey
        Total slip, the final depth of the pinch; up to 1.
    p_g : float, Prior or PerStorey
        Rate at which the pinch develops with work. [1/J]
    q_g : float, Prior or PerStorey
        Position of the pinch as a share of z_u.
    psi_g : float, Prior or PerStorey
        Width of the pinch. [m]
    delta_g : float, Prior or PerStorey
        Growth of the width with work. [m/J]
    lambda_g : float, Prior or PerStorey
        Floor of the width's growth with depth.
    m_g : float, Prior or PerStorey
        Power in the dip.
    t_g : float, Prior or PerStorey
        Weight of its tails.
    i_g : float, Prior or PerStorey
        Share of the depth that is there from the start.

    References
    ----------
    .. [1] G. C. Foliente, "Hysteresis Modeling of Wood Joints and Structural Systems", J. Struct. Eng. 121(6), 1995
       (the Gaussian dip); the other shapes are our generalisation.
    """

    zeta_g: Value
    p_g: Value
    q_g: Value
    psi_g: Value
    delta_g: Value
    lambda_g: Value
    m_g: Value
    t_g: Value
    i_g: Value

    elements: ClassVar[tuple[str, ...]] = FolientePinching.elements
    name: ClassVar[str] = FolientePinching.name
    title: ClassVar[str] = FolientePinching.title
    summary: ClassVar[str] = FolientePinching.summary
    source: ClassVar[str] = FolientePinching.source
    residual: ClassVar[str] = FolientePinching.residual
    confusable: ClassVar[str] = FolientePinching.confusable
    mechanism: ClassVar[str] = FolientePinching.mechanism
    form: ClassVar[str] = "free shape"
    signature: ClassVar[Signature] = replace(
        FolientePinching.signature,
        size=lambda at: _depth(at["zeta_g"], at["p_g"], at.largest_energy, at["i_g"]),
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        *(
            replace(usual, symbol=name, source=_GENERALISED)
            for usual, name in zip(FolientePinching.parameters, _OF_FREE_SHAPE, strict=True)
        ),
        replace(_parameter("m_g", "", 2.0, 0.5, "power in the dip of the pinch"), source=_GENERALISED),
        replace(_parameter("t_g", "", 0.01, 1e-6, "weight of the dip's tails"), source=_GENERALISED),
        replace(_parameter("i_g", "", 0.0, 0.0, "share of the pinch from the start", 1.0), source=_GENERALISED),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        *own, power, tails, at_first = (symbol(parameter.symbol) for parameter in self.parameters)

        def dip(square: sp.Expr) -> sp.Expr:
            # A power of the square, not of the magnitude, and as deep at its tip as without the rounding.
            away = (square + _ROUNDING**2) ** (power / 2) - _ROUNDING**power
            return sp.exp(-sp.log(1 + tails * away) / tails)

        return _pinched(slots, tuple(own), dip, at_first, mark="_g")


@guides(FreePinch)
class FreePinchSearch(SearchGuide[FreePinch]):
    """How a search looks for a pinch in a free shape."""

    family: ClassVar[str] = PINCH

    @override
    def priors(self, scales: Scales) -> tuple[FreePinch, ...]:
        (usual,) = FolientePinchingSearch().priors(scales)
        priors = dict(zip(_OF_FREE_SHAPE, usual.values.values(), strict=True))
        tails = HalfNormal(0.5).truncated(0.01, 3.0)
        return (FreePinch(**priors, m_g=LogNormal(2.0, 0.4).truncated(0.8, 8.0), t_g=tails, i_g=Uniform(0.0, 1.0)),)

    @override
    def starts(self, effect: FreePinch, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        guide = FolientePinchingSearch()
        (usual,) = guide.priors(scales)
        grid = guide.starts(usual, scales)
        of_usual = (grid[parameter.symbol] for parameter in usual.parameters)
        own = {"p_g": (3.0 / scales.energy,), "m_g": (1.7,), "t_g": (0.2,), "i_g": (0.1, 0.9)}
        return {**dict(zip(_OF_FREE_SHAPE, of_usual, strict=True)), **own}
