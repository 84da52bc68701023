"""How large things are at one place of a structure: what default priors and first guesses are measured in."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Sizes reached during the training record at one storey or floor, under the model as given.

    They depend on the training record and the present model alone, so that every compared hypothesis uses the same.

    Attributes
    ----------
    drift, drift_rate, hysteretic_displacement : float
        Largest magnitudes. [m], [m/s], [m]
    path : float
        Drift that has been gone through in all; of records that each find the structure virgin, in the longest. [m]
    energy : float
        Largest work on the hysteretic spring, what it stores included: a fit that lacks an effect may have a loop that
        gives back what it took, so that nothing is left at the end. [J]
    force : float
        Largest storey force. [N]
    stiffness, damping : float
        Initial stiffness and viscous damping of the storey. [N/m], [N s/m]
    alpha, beta, gamma, n : float
        The storey's ratio of stiffnesses and loop shape. [1], [1/m^n], [1/m^n], [1]
    mass : float
        Of the floor above the storey. [kg]
    total_mass : float
        Of all floors. [kg]
    acceleration : float
        Root mean square of the floor's total acceleration. [m/s^2]
    ground_acceleration : float
        Root mean square of the ground acceleration. [m/s^2]
    period : float
        First period at the start. [s]
    onset, duration, time_step : float
        Time at which strong motion begins, length of the record, time between samples. [s]
    """

    drift: float
    drift_rate: float
    hysteretic_displacement: float
    path: float
    energy: float
    force: float
    stiffness: float
    damping: float
    alpha: float
    beta: float
    gamma: float
    n: float
    mass: float
    total_mass: float
    acceleration: float
    ground_acceleration: float
    period: float
    onset: float
    duration: float
    time_step: float


NOMINAL = Scales(**{one.name: 1.0 for one in fields(Scales)})
"""One of each unit, where sizes do not matter."""
