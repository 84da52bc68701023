"""Other forms of catalogued effects, and effects that the catalogue does not hold."""

from __future__ import annotations

import math

from benchmarks.blind.draws import Draw, Hidden, Place, at_storey, other_form


def _friction_root(here: Place) -> Hidden:
    values = {"F_root": here.dice.size(0.015, 0.2) * here.at.force, "v0": here.dice.anywhere(0.02, 0.1) * here.at.rate}
    return other_form("coulomb_friction", "v / sqrt(v^2 + v0^2)", here.storey, values)


def _friction_stick_slip(here: Place) -> Hidden:
    values = {
        "F_bristle": here.dice.size(0.015, 0.2) * here.at.force,
        "bristle": here.dice.anywhere(0.006, 0.02) * here.at.drift,
    }
    return other_form("coulomb_friction", "stick-slip bristle", here.storey, values)


def _asymmetry_drift_rate(here: Place) -> Hidden:
    p = here.own
    values = {"phi_drift_rate": here.dice.signed(0.15, 0.8) * (p.beta + p.gamma)}
    return other_form("asymmetry", "phi sgn(u) sgn(v)", here.storey, values)


def _asymmetry_drift(here: Place) -> Hidden:
    p = here.own
    return other_form(
        "asymmetry", "phi sgn(u)", here.storey, {"phi_drift": here.dice.signed(0.15, 0.8) * (p.beta + p.gamma)}
    )


def _damage_ramp(here: Place) -> Hidden:
    values = {
        "k_jump": -here.dice.size(0.02, 0.5) * here.own.k,
        "k_time": here.dice.anywhere(here.at.strong_from, here.at.strong_until),
        "k_ramp": here.dice.anywhere(0.5, 3.0),
    }
    return other_form("sudden_damage", "ramp", here.storey, values)


def _gap_one_sided(here: Place) -> Hidden:
    k = here.own.k
    values = {"k_g_side": here.dice.size(0.3, 3.0) * k, "g": here.dice.anywhere(0.3, 0.65) * here.at.drift}
    return other_form("gap_impact", "one-sided", here.storey, values)


def _gap_softened(here: Place) -> Hidden:
    values = {
        "k_g_soft": here.dice.size(0.3, 3.0) * here.own.k,
        "g": here.dice.anywhere(0.4, 0.75) * here.at.drift,
        "gap_width": here.dice.anywhere(0.02, 0.06) * here.at.drift,
    }
    return other_form("gap_impact", "softened onset", here.storey, values)


def _slip_sech(here: Place) -> Hidden:
    values = {
        "delta_s": here.dice.size(0.03, 0.6) * here.at.drift / here.at.energy,
        "sigma": here.dice.anywhere(0.05, 0.25) * min(here.at.z_bound, here.at.z),
        "slip_bell": 1.0,
    }
    return other_form("slip_lock", "sech^2 in place of the Gaussian", here.storey, values, ("foliente_pinching",))


def _pinching_lorentz(here: Place) -> Hidden:
    values = {"pinch": here.dice.size(0.4, 0.9), "pinch_width": here.dice.anywhere(0.1, 0.3) * here.at.z}
    return other_form("foliente_pinching", "Lorentzian, without memory", here.storey, values, ("slip_lock",))


def _softening_damping(here: Place) -> Hidden:
    speed = here.dice.anywhere(0.15, 0.4) * here.at.rate
    return at_storey(
        "softening_damping",
        here.storey,
        {"c_soft": here.dice.size(0.1, 0.6) * here.at.force / speed, "v_soft": speed},
        {},
    )


def _root_damping(here: Place) -> Hidden:
    """A law that the catalogue, which later came to hold dampers of a power below one, has its name for."""
    return Hidden(
        name="root_damping",
        storeys=(here.storey,),
        accepted=("root_damping", "viscous_damper"),
        storey_values={"c_root": here.dice.size(0.1, 0.5) * here.at.force / math.sqrt(here.at.rate)},
    )


def _snap_window(here: Place) -> Hidden:
    values = {
        "snap": here.dice.size(0.2, 1.5) * here.own.k,
        "snap_centre": here.dice.anywhere(0.2, 0.5) * here.at.drift,
        "snap_width": here.dice.anywhere(0.05, 0.12) * here.at.drift,
    }
    return at_storey("snap_window", here.storey, values, {})


def _breathing_stiffness(here: Place) -> Hidden:
    values = {
        "modulation": here.dice.size(0.04, 0.3),
        "modulation_period": here.dice.anywhere(2.0, 8.0),
        "modulation_phase": here.dice.anywhere(0.0, 2.0 * math.pi),
    }
    return at_storey("breathing_stiffness", here.storey, values, {})


def _sensor_drift(here: Place) -> Hidden:
    values = {
        "drift_amplitude": here.dice.size(0.08, 0.5) * here.at.acceleration,
        "drift_period": here.dice.anywhere(8.0, 40.0),
    }
    return at_storey("sensor_drift", here.storey, values, {})


def _sensor_saturation(here: Place) -> Hidden:
    return at_storey(
        "sensor_saturation", here.storey, {"saturation": here.at.acceleration / here.dice.size(0.1, 0.5)}, {}
    )


def _bending_coupling(here: Place) -> Hidden:
    """At one floor; the catalogue, which later came to hold bending at all of them, has its name."""
    k = here.building.storeys[0].k
    return Hidden(
        name="bending_coupling",
        storeys=(min(here.storey, len(here.building.storeys) - 1),),
        accepted=("bending_coupling", "storey_coupling"),
        storey_values={"coupling": here.dice.size(0.05, 0.4) * k},
    )


FORMS: dict[str, Draw] = {
    "friction_root": _friction_root,
    "friction_stick_slip": _friction_stick_slip,
    "asymmetry_drift_rate": _asymmetry_drift_rate,
    "asymmetry_drift": _asymmetry_drift,
    "damage_ramp": _damage_ramp,
    "gap_one_sided": _gap_one_sided,
    "gap_softened": _gap_softened,
    "slip_sech": _slip_sech,
    "pinching_lorentz": _pinching_lorentz,
}

OUTSIDE: dict[str, Draw] = {
    "softening_damping": _softening_damping,
    "root_damping": _root_damping,
    "snap_window": _snap_window,
    "breathing_stiffness": _breathing_stiffness,
    "sensor_drift": _sensor_drift,
    "sensor_saturation": _sensor_saturation,
    "bending_coupling": _bending_coupling,
}
