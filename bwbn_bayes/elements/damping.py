"""Dampers whose force follows a power of the drift rate: what their laws share."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.elements.signature import Measure, Signature
from bwbn_bayes.parameters import Floats, Parameter

SOURCE = "Soong and Constantinou 1994"


def equivalent(rate: Floats, power: float) -> float:
    """Viscous coefficient that dissipates as much as ``|v|^(power - 1) v`` along a history ``(n_times,)`` [m/s]."""
    return float(np.sum(np.abs(rate) ** (power + 1.0)) / max(float(np.sum(np.square(rate))), 1e-300))


def added_damping(law: str, size: Measure) -> Signature:
    """The signature of a damper, by the damping ratio that it adds; ``law`` is what its law is called in words."""
    return Signature(
        measure="damping ratio added at the first mode",
        plain_name=f"the shape of the force over drift rate ({law})",
        reason="a thousandth of critical damping: no structure's own is known better",
        size=size,
        least=0.001,
    )


def of_power(force: str, power: str, rate: str) -> Measure:
    """The damping ratio that ``force sgn v (|v|/rate)^power`` adds, of parameters with these symbols."""
    return lambda at: at.damping_ratio(
        at[force] * at[rate] ** -at[power] * equivalent(at.histories["drift_rate"], at[power])
    )


def power_parameters(force: str, power: str, rate: str, *, neutral: float, lower: float) -> tuple[Parameter, ...]:
    """Parameters of such symbols: a force [N] at a known drift rate [m/s], and the power, from ``lower`` on."""
    told = (
        (force, "N", 0.0, 0.0, "damper's force at a known rate"),
        (power, "", neutral, lower, "power of the drift rate"),
        (rate, "m/s", 1.0, 1e-12, "that drift rate, known"),
    )
    return tuple(
        Parameter(symbol=symbol, unit=unit, neutral=at_rest, lower=least, description=text, source=SOURCE)
        for symbol, unit, at_rest, least, text in told
    )
