"""Storeys hang together by bending: columns and walls that run on through the floors resist a change of drift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np

from bwbn_bayes.elements.law import BENDING_DRIFT, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class StoreyCoupling(Effect):
    """The force ``k_bend [(u_i - u_{i-1}) + (u_i - u_{i+1})]`` in storey i; terms without a storey are left out.

    It is that of the energy ``k_bend (u_{i+1} - u_i)^2 / 2`` at every floor, where one storey runs on into the next:
    for equal heights h the curvature of a beam over the building, ``k_bend = E I / h^3``. Floors that drift alike are
    as free as before.

    Parameters
    ----------
    k_bend : float or Prior
        Stiffness against a difference between the drifts of neighbouring storeys. [N/m]

    References
    ----------
    .. [1] E. Miranda and S. Taghavi, "Approximate Floor Acceleration Demands in Multistory Buildings. I: Formulation",
       J. Struct. Eng. 131(2), 2005, doi:10.1061/(ASCE)0733-9445(2005)131:2(203) (a flexural beam beside a shear beam).
    """

    k_bend: Value

    name: ClassVar[str] = "storey_coupling"
    title: ClassVar[str] = "storeys coupled by bending"
    level: ClassVar[str] = "structure"
    summary: ClassVar[str] = "columns that run on through the floors resist differences of drift"
    source: ClassVar[str] = "Miranda and Taghavi 2005"
    residual: ClassVar[str] = "higher modes too slow beside the first"
    confusable: ClassVar[str] = "k of the storeys, mass_error"
    signature: ClassVar[Signature] = Signature(
        measure="force by bending over the largest storey force",
        plain_name="a small stiffness against differences of drift (bending of columns)",
        reason="1 % of the peak force; the first period hardly tells of it, since drifts are alike in that mode",
        size=lambda at: _share_of_force(at),
        least=0.01,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="k_bend",
            unit="N/m",
            neutral=0.0,
            lower=0.0,
            description="stiffness against differences of drift",
            source=source,
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("k_bend") * BENDING_DRIFT)


@guides(StoreyCoupling)
class StoreyCouplingSearch(SearchGuide[StoreyCoupling]):
    """How a search looks for bending between storeys."""

    @override
    def priors(self, scales: Scales) -> tuple[StoreyCoupling, ...]:
        return (StoreyCoupling(k_bend=HalfNormal(0.5 * scales.stiffness)),)

    @override
    def starts(self, effect: StoreyCoupling, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"k_bend": (0.05 * scales.stiffness, 0.3 * scales.stiffness)}


def _share_of_force(at: PlaceResponse) -> float:
    """``k_bend`` times the largest sum of differences from the drifts above and below, over the peak storey force."""
    return at["k_bend"] * float(np.max(np.abs(at.bending_drifts), initial=0.0)) / at.peak("restoring_force")
