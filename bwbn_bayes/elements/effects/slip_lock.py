"""Slip in series with the hysteretic spring: pinching near zero hysteretic displacement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

import sympy as sp

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
from bwbn_bayes.elements.loops import is_full, pinching_index
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Uniform, Value


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
        size=lambda at: 2.0 * at["delta_s"] * at.energy / at.peak("drift"),
        least=0.005,
        of_loop=pinching_index,
        is_genuine=lambda at: not is_full(*at.loop, index=0.5),
        is_shown=lambda drift, force: not is_full(drift, force, index=0.5),
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

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        # A wider sigma slips everywhere and imitates stiffness_degradation.
        width = Uniform(0.03 * scales.hysteretic_displacement, 0.5 * scales.hysteretic_displacement)
        return (cls(delta_s=HalfNormal(0.3 * scales.drift / scales.energy), sigma=width),)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "delta_s": (0.03 * scales.drift / scales.energy, 0.2 * scales.drift / scales.energy),
            "sigma": tuple(share * scales.hysteretic_displacement for share in (0.06, 0.15, 0.35)),
        }

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
