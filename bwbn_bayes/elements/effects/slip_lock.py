"""Slip in series with the hysteretic spring: pinching near zero hysteretic displacement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.degradation import BEND, POWER, risen
from bwbn_bayes.elements.law import (
    ENERGY,
    HYSTERETIC_DISPLACEMENT,
    Definition,
    Effect,
    SharpFeature,
    Slots,
    step,
    symbol,
)
from bwbn_bayes.elements.loops import READABLE_INDEX, is_full, pinching_index
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal, Parameter, Uniform, Value

PINCH = "a pinch"
"""What slip-lock and Foliente's law both are."""


def _is_open_to_a_pinch(drift: Floats, force: Floats) -> bool:
    """Whether a loop ``(n_times,)`` [m], [N], identified or measured, could be called pinched."""
    return not is_full(drift, force, index=0.5)


@dataclass(frozen=True, kw_only=True)
class SlipLock(Effect):
    """A slip-lock element in series, ``du2/dt = s a(z) dz/dt``, ``a(z) = sqrt(2/pi)/sigma exp(-z^2/(2 sigma^2))``.

    A full crossing of ``z = 0`` slips by ``2 s`` with ``s = delta_s epsilon``.

    Parameters
    ----------
    delta_s : float, Prior or PerStorey
        Slip magnitude per unit of work. [m/J]
    sigma : float, Prior or PerStorey
        Width of the slip in hysteretic displacement. [m]

    References
    ----------
    .. [1] T. T. Baber and M. N. Noori, "Random Vibration of Degrading, Pinching Systems", J. Eng. Mech. 111(8), 1985.
    """

    delta_s: Value
    sigma: Value

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen")
    name: ClassVar[str] = "slip_lock"
    title: ClassVar[str] = "slip-lock pinching"
    summary: ClassVar[str] = "the joint slips near zero hysteretic displacement: pinched loops"
    source: ClassVar[str] = "Baber and Noori 1985"
    residual: ClassVar[str] = "bursts near z = 0 after each reversal"
    confusable: ClassVar[str] = "a gap, foliente_pinching with q = 0"
    mechanism: ClassVar[str] = "pinching"
    signature: ClassVar[Signature] = Signature(
        measure="pinching index",
        plain_name="the shape of the reloading branch (Baber and Noori's law)",
        reason="a slip of half a per cent of the largest drift per crossing, in a loop that is not full: less is fit",
        size=lambda at: 2.0 * at["delta_s"] * at.largest_energy / at.peak("drift"),
        least=0.005,
        of_loop=pinching_index,
        needs="a motion that comes back through zero",
        readable=READABLE_INDEX,
        is_genuine=lambda at: _is_open_to_a_pinch(*at.loop),
        is_shown=_is_open_to_a_pinch,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="delta_s",
            unit="m/J",
            neutral=0.0,
            lower=0.0,
            description="slip magnitude per unit of work",
            source=source,
        ),
        Parameter(symbol="sigma", unit="m", neutral=1.0, lower=1e-9, description="width of the slip", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        sigma = symbol("sigma")
        s, a = step("s"), step("a")
        density = sp.sqrt(2 / sp.pi) / sigma * sp.exp(-(HYSTERETIC_DISPLACEMENT**2) / (2 * sigma**2))
        return replace(
            slots,
            slip_compliance=slots.slip_compliance + s * a,
            steps=(
                *slots.steps,
                Definition(caption="slip", subject=s, expression=symbol("delta_s") * ENERGY),
                Definition(caption="where the joint slips", subject=a, expression=density),
            ),
            sharp_features=(*slots.sharp_features, SharpFeature(state=HYSTERETIC_DISPLACEMENT, width=sigma)),
        )


@guides(SlipLock)
class SlipLockSearch(SearchGuide[SlipLock]):
    """How a search looks for a slip."""

    family: ClassVar[str] = PINCH

    @override
    def priors(self, scales: Scales) -> tuple[SlipLock, ...]:
        # A wider sigma slips everywhere and imitates stiffness_degradation.
        width = Uniform(0.03 * scales.hysteretic_displacement, 0.5 * scales.hysteretic_displacement)
        return (SlipLock(delta_s=HalfNormal(0.3 * scales.drift / scales.energy), sigma=width),)

    @override
    def starts(self, effect: SlipLock, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "delta_s": (0.03 * scales.drift / scales.energy, 0.2 * scales.drift / scales.energy),
            "sigma": tuple(share * scales.hysteretic_displacement for share in (0.06, 0.15, 0.35)),
        }

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return FreeSlipSearch().priors(scales)


_ROUNDING = 0.05
"""Share of the width within which the bell is rounded: powers below two have a kink or a cusp in the middle."""
_GAMMA = (1.0, -0.5748646, 0.9512363, -0.6998588, 0.4245549, -0.1010678)
"""``Gamma(1 + x)`` as a polynomial, to 5e-5 for x up to 1: Abramowitz and Stegun 1964, 6.1.35."""


def _free_parameter(name: str, unit: str, neutral: float, lower: float, description: str) -> Parameter:
    source = "Baber and Noori 1985, generalised"
    return Parameter(symbol=name, unit=unit, neutral=neutral, lower=lower, description=description, source=source)


@dataclass(frozen=True, kw_only=True)
class FreeSlip(Effect):
    """Slip-lock in a free shape: ``s = s_w W(epsilon)/W(E_w)``, ``a(z) ~ exp(-|z/sigma_w|^p_w)``.

    The slip grows as losses in a free shape do, ``W(x) = 1 - exp(-b_w (x/E_w)^m_w)``: with a small bend by a power of
    the work; with a large one it is there from the start. The bell has the area 2, so that a full crossing slips by
    ``2 s``, as that of :class:`SlipLock`, which it is with ``p_w = 2``, ``m_w = 1``, a vanishing ``b_w``,
    ``sigma_w = sqrt(2) sigma`` and ``s_w = delta_s E_w``. With a power near one the bell resembles a Lorentzian, with a
    large one it has a flat top.

    Parameters
    ----------
    s_w : float, Prior or PerStorey
        Slip magnitude at the work ``E_w``. [m]
    sigma_w : float, Prior or PerStorey
        Half width of the bell in hysteretic displacement. [m]
    b_w : float, Prior or PerStorey
        How far the slip has saturated by the work ``E_w``.
    m_w : float, Prior or PerStorey
        Power of the work.
    p_w : float, Prior or PerStorey
        Power in the bell.
    E_w : float
        Work at which the slip is measured. [J]

    References
    ----------
    .. [1] T. T. Baber and M. N. Noori, "Random Vibration of Degrading, Pinching Systems", J. Eng. Mech. 111(8), 1985
       (the Gaussian bell, the slip in proportion to work); the other shapes are our generalisation.
    .. [2] G. C. Foliente, "Hysteresis Modeling of Wood Joints and Structural Systems", J. Struct. Eng. 121(6), 1995: a
       pinch that saturates with work.
    .. [3] M. Abramowitz and I. A. Stegun, "Handbook of Mathematical Functions", 1964, 6.1.35 (the bell's area).
    """

    s_w: Value
    sigma_w: Value
    b_w: Value
    m_w: Value
    p_w: Value
    E_w: Value

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen")
    name: ClassVar[str] = SlipLock.name
    title: ClassVar[str] = SlipLock.title
    summary: ClassVar[str] = SlipLock.summary
    source: ClassVar[str] = SlipLock.source
    residual: ClassVar[str] = SlipLock.residual
    confusable: ClassVar[str] = SlipLock.confusable
    mechanism: ClassVar[str] = SlipLock.mechanism
    form: ClassVar[str] = "free shape"
    signature: ClassVar[Signature] = replace(
        SlipLock.signature,
        size=lambda at: (
            2.0
            * at["s_w"]
            * float(risen(at.peak("hysteretic_energy") / at["E_w"], at["b_w"], at["m_w"]))
            / at.peak("drift")
        ),
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _free_parameter("s_w", "m", 0.0, 0.0, "slip magnitude at a known work"),
        _free_parameter("sigma_w", "m", 1.0, 1e-9, "half width of the slip"),
        _free_parameter("b_w", "", 1.0, 1e-6, "how far the slip has saturated by a known work"),
        _free_parameter("m_w", "", 1.0, 0.1, "power of the work in the slip"),
        _free_parameter("p_w", "", 2.0, 0.5, "power in the bell of the slip"),
        _free_parameter("E_w", "J", 1.0, 1e-12, "that work, known"),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        s_w, sigma, bend, power, p, work = (symbol(parameter.symbol) for parameter in self.parameters)
        s, a = step("s_e"), step("a_e")
        slip = s_w * risen(sp.Abs(ENERGY) / work, bend, power)
        exponent = _ROUNDING**p - (HYSTERETIC_DISPLACEMENT**2 / sigma**2 + _ROUNDING**2) ** (p / 2)
        area = sum(coefficient * p**-power for power, coefficient in enumerate(_GAMMA))
        return replace(
            slots,
            slip_compliance=slots.slip_compliance + s * a,
            steps=(
                *slots.steps,
                Definition(caption="slip, free shape", subject=s, expression=slip),
                Definition(
                    caption="where the joint slips, free shape", subject=a, expression=sp.exp(exponent) / (sigma * area)
                ),
            ),
            sharp_features=(*slots.sharp_features, SharpFeature(state=HYSTERETIC_DISPLACEMENT, width=sigma / 2)),
        )


@guides(FreeSlip)
class FreeSlipSearch(SearchGuide[FreeSlip]):
    """How a search looks for a slip in a free shape."""

    family: ClassVar[str] = PINCH

    @override
    def priors(self, scales: Scales) -> tuple[FreeSlip, ...]:
        z, energy = scales.hysteretic_displacement, scales.energy
        one = FreeSlip(
            s_w=HalfNormal(0.3 * scales.drift),
            sigma_w=Uniform(0.03 * z, 0.7 * z),
            b_w=BEND,
            m_w=POWER,
            p_w=LogNormal(2.0, 0.6).truncated(0.8, 10.0),
            E_w=energy,
        )
        return (one,)

    @override
    def starts(self, effect: FreeSlip, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "s_w": (0.03 * scales.drift, 0.2 * scales.drift),
            "sigma_w": tuple(share * scales.hysteretic_displacement for share in (0.09, 0.2, 0.45)),
            "b_w": (0.1, 5.0),
            "m_w": (0.9,),
            "p_w": (1.7,),
        }
