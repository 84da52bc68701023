"""A spring and a damper in series, beside the storey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import DRIFT_RATE, AddedState, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Value

BRANCH_FORCE = symbol("q_m")
"""Force in the branch. [N]"""


@dataclass(frozen=True, kw_only=True)
class MaxwellBranch(Effect):
    """The force ``q_m`` with ``dq_m/dt = k_m v - q_m / tau``.

    Parameters
    ----------
    k_m : float, Prior or PerStorey
        Stiffness of the branch's spring. [N/m]
    tau : float, Prior or PerStorey
        Relaxation time: the damper's coefficient over k_m. [s]

    References
    ----------
    .. [1] J. C. Maxwell, "On the Dynamical Theory of Gases", Phil. Trans. R. Soc. 157, 1867 (relaxation time).
    """

    k_m: Value
    tau: Value

    name: ClassVar[str] = "maxwell_branch"
    title: ClassVar[str] = "rate-dependent stiffness (Maxwell branch)"
    summary: ClassVar[str] = "a spring and a damper in series beside the others: stiffness depends on the rate"
    source: ClassVar[str] = "Maxwell 1867"
    residual: ClassVar[str] = "stiffness and damping that depend on the rate"
    confusable: ClassVar[str] = "c where tau is short against the period, k where it is long"
    signature: ClassVar[Signature] = Signature(
        measure="damping ratio added at the first mode",
        plain_name="the dependence of the force on rate (Maxwell's law)",
        reason="a thousandth of critical damping: no structure's own is known better",
        size=lambda at: at.damping_ratio(at["k_m"] * at["tau"] / (1.0 + (at.omega * at["tau"]) ** 2)),
        least=0.001,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="k_m", unit="N/m", neutral=0.0, lower=0.0, description="stiffness of the branch", source=source
        ),
        Parameter(symbol="tau", unit="s", neutral=1.0, lower=1e-6, description="relaxation time", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        rate = symbol("k_m") * DRIFT_RATE - BRANCH_FORCE / symbol("tau")
        return replace(
            slots,
            added_force=slots.added_force + BRANCH_FORCE,
            added_states=(*slots.added_states, AddedState(state=BRANCH_FORCE, rate=rate)),
        )


@guides(MaxwellBranch)
class MaxwellBranchSearch(SearchGuide[MaxwellBranch]):
    """How a search looks for a Maxwell branch."""

    @override
    def priors(self, scales: Scales) -> tuple[MaxwellBranch, ...]:
        tau = LogNormal(0.2 * scales.period, 1.3).truncated(0.02 * scales.period, 5.0 * scales.period)
        return (MaxwellBranch(k_m=HalfNormal(0.5 * scales.stiffness), tau=tau),)

    @override
    def starts(self, effect: MaxwellBranch, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "k_m": (0.05 * scales.stiffness, 0.3 * scales.stiffness),
            "tau": tuple(share * scales.period for share in (0.03, 0.15, 0.7)),
        }
