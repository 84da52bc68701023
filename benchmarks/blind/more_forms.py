"""More forms of catalogued effects: wear that saturates or follows other powers, path or time; other bells and powers.

A form is the same thing to an engineer by another law. Each says which names of the catalogue are right, and why.
"""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.blind.draws import Draw, Hidden, Place

_STIFFNESS = "the stiffness of the hysteretic spring falls while it works: how fast, and whether it stops, is a detail"
_STRENGTH = "the yield force falls while the spring works: how fast, and whether it stops, is a detail"
_PINCH = "loops slip near the middle after a reversal, more so as work is done: either name of a pinch says so"
_DRY = "a force against the motion that hardly depends on how fast it is: dry friction"


def _form(here: Place, names: tuple[str, ...], form: str, why: str, values: Mapping[str, float]) -> Hidden:
    return Hidden(name=names[0], storeys=(here.storey,), form=form, accepted=names, why=why, storey_values=values)


def _other_power(here: Place) -> float:
    """Well off the first power, on either side."""
    return here.dice.anywhere(0.4, 0.7) if here.dice.rng.random() < 0.5 else here.dice.anywhere(1.5, 2.2)


def stiffness_saturating(here: Place) -> Hidden:
    """``eta = 1 + d (1 - exp(-eps / eps_0))``."""
    values = {
        "eta_wear": here.dice.size(0.15, 2.0),
        "wear_energy": here.dice.anywhere(0.08, 0.35) * here.at.energy,
        "wear_saturates": 1.0,
    }
    return _form(here, ("stiffness_degradation",), "saturates with work", _STIFFNESS, values)


def strength_saturating(here: Place) -> Hidden:
    """``nu = 1 + d (1 - exp(-eps / eps_0))``."""
    values = {
        "nu_wear": here.dice.size(0.25, 3.0),
        "wear_energy": here.dice.anywhere(0.08, 0.35) * here.at.energy,
        "wear_saturates": 1.0,
    }
    return _form(here, ("strength_degradation",), "saturates with work", _STRENGTH, values)


def _stiffness_power(here: Place) -> Hidden:
    values = {"eta_wear": here.dice.size(0.15, 2.0), "wear_energy": here.at.energy, "wear_power": _other_power(here)}
    return _form(here, ("stiffness_degradation",), "a fractional power of work", _STIFFNESS, values)


def _strength_power(here: Place) -> Hidden:
    values = {"nu_wear": here.dice.size(0.25, 3.0), "wear_energy": here.at.energy, "wear_power": _other_power(here)}
    return _form(here, ("strength_degradation",), "a fractional power of work", _STRENGTH, values)


def stiffness_with_cycles(here: Place) -> Hidden:
    """``eta`` grows with the path, as with the number of cycles."""
    values = {"eta_wear": here.dice.size(0.15, 2.0), "wear_path": here.at.path}
    why = "the stiffness falls with every cycle: work and path grow together, and the name says what falls"
    return _form(here, ("stiffness_degradation",), "with the path, as with the number of cycles", why, values)


def strength_with_cycles(here: Place) -> Hidden:
    """``nu`` grows with the path and saturates."""
    values = {
        "nu_wear": here.dice.size(0.25, 3.0),
        "wear_path": here.dice.anywhere(0.15, 0.6) * here.at.path,
        "wear_saturates": 1.0,
    }
    why = "the yield force falls with every cycle: work and path grow together, and the name says what falls"
    return _form(here, ("strength_degradation",), "saturates with the path", why, values)


def _stiffness_in_time(here: Place) -> Hidden:
    values = {
        "k_fade": here.dice.size(0.04, 0.5),
        "k_fade_time": here.dice.anywhere(0.4, 1.5) * here.at.strong_until,
    }
    why = (
        "the stiffness falls in the course of the record: an engineer calls it degradation, and the catalogue's law in "
        "time is a change at a moment or over a ramp"
    )
    return _form(here, ("stiffness_degradation", "sudden_damage"), "drifts with time", why, values)


def _strength_in_time(here: Place) -> Hidden:
    values = {
        "nu_wear": here.dice.size(0.25, 3.0),
        "wear_time": here.dice.anywhere(0.4, 1.5) * here.at.strong_until,
        "wear_saturates": 1.0,
    }
    why = (
        "the yield force falls in the course of the record: an engineer calls it degradation, and the catalogue's law "
        "in time is a change at a moment or over a ramp"
    )
    return _form(here, ("strength_degradation", "sudden_damage"), "drifts with time", why, values)


def _slip(here: Place, form: str, bell: float) -> Hidden:
    values = {
        "delta_s": here.dice.size(0.04, 0.6) * here.at.drift / here.at.energy,
        "sigma": here.dice.anywhere(0.06, 0.25) * min(here.at.z_bound, here.at.z),
        "slip_bell": bell,
    }
    return _form(here, ("slip_lock", "foliente_pinching"), form, _PINCH, values)


def _slip_lorentz(here: Place) -> Hidden:
    return _slip(here, "Lorentzian in place of the Gaussian", 2.0)


def _slip_flat(here: Place) -> Hidden:
    return _slip(here, "a flat top in place of the Gaussian", 3.0)


def slip_saturating(here: Place) -> Hidden:
    """``s = s_0 (1 - exp(-eps / eps_0))``."""
    values = {
        "slip_wear": here.dice.size(0.04, 0.6) * here.at.drift,
        "sigma": here.dice.anywhere(0.06, 0.25) * min(here.at.z_bound, here.at.z),
        "wear_energy": here.dice.anywhere(0.08, 0.35) * here.at.energy,
        "wear_saturates": 1.0,
    }
    return _form(here, ("slip_lock", "foliente_pinching"), "saturates with work", _PINCH, values)


def _pinch(here: Place, form: str, bell: float, widened: float) -> Hidden:
    values = {
        "zeta_s": here.dice.size(0.35, 0.95),
        "p": here.dice.anywhere(2.0, 10.0) / here.at.energy,
        "q": here.dice.anywhere(0.05, 0.3) * here.at.z / here.at.z_bound,
        "psi_0": widened * here.dice.anywhere(0.3, 0.6) * here.at.z,
        "lambda_": here.dice.anywhere(0.1, 0.5),
        "pinch_bell": bell,
    }
    return _form(here, ("foliente_pinching", "slip_lock"), form, _PINCH, values)


def _pinch_sech(here: Place) -> Hidden:
    return _pinch(here, "a hyperbolic secant in place of the Gaussian", 1.0, 0.8)


def _pinch_triangle(here: Place) -> Hidden:
    return _pinch(here, "a triangle in place of the Gaussian", 2.0, 1.5)


def _friction_arctan(here: Place) -> Hidden:
    values = {
        "F_arctan": here.dice.size(0.015, 0.2) * here.at.force,
        "v0": here.dice.anywhere(0.005, 0.03) * here.at.rate,
    }
    return _form(here, ("coulomb_friction",), "(2 / pi) arctan(v / v0)", _DRY, values)


def _friction_stribeck(here: Place) -> Hidden:
    values = {
        "F_stribeck": here.dice.size(0.015, 0.2) * here.at.force,
        "stribeck": here.dice.anywhere(0.2, 0.6),
        "v_stribeck": here.dice.anywhere(0.05, 0.15) * here.at.rate,
        "v0": here.dice.anywhere(0.005, 0.02) * here.at.rate,
    }
    why = f"{_DRY}, larger at rest than in motion (Stribeck)"
    return _form(here, ("coulomb_friction",), "falls from its force at rest (Stribeck)", why, values)


def _friction_pressed(here: Place) -> Hidden:
    values = {
        "F_pressed": here.dice.size(0.015, 0.15) * here.at.force,
        "u_pressed": here.dice.anywhere(1.0, 4.0) * here.at.drift,
        "v0": here.dice.anywhere(0.01, 0.03) * here.at.rate,
    }
    why = f"{_DRY}, whose pressure grows with the drift"
    return _form(here, ("coulomb_friction",), "pressure grows with drift", why, values)


def _spring_power(here: Place) -> Hidden:
    power = here.dice.anywhere(2.0, 2.5) if here.dice.rng.random() < 0.5 else here.dice.anywhere(3.6, 5.0)
    share = here.dice.size(0.04, 0.5)
    values = {"k_power": share * here.own.k * here.at.drift ** (1.0 - power), "drift_power": power}
    why = "a spring beside the storey that hardens with drift, by another power than the third"
    return _form(here, ("cubic_stiffness",), "a fractional power of drift", why, values)


def _damper_power(here: Place) -> Hidden:
    power = here.dice.anywhere(1.5, 1.75) if here.dice.rng.random() < 0.5 else here.dice.anywhere(2.3, 3.0)
    values = {"c_power": here.dice.size(0.03, 0.4) * here.at.force * here.at.rate**-power, "rate_power": power}
    why = "a damper that grows faster than the drift rate, by another power than the second"
    return _form(here, ("quadratic_damping",), "a fractional power of drift rate", why, values)


def _stop_hertz(here: Place) -> Hidden:
    gap = here.dice.anywhere(0.4, 0.7) * here.at.drift
    values = {
        "k_hertz": here.dice.size(0.3, 3.0) * here.own.k / (here.at.drift - gap) ** 0.5,
        "g": gap,
    }
    why = "a stop that is met beyond a gap, as two curved bodies touch"
    return _form(here, ("gap_impact",), "Hertz's power three halves", why, values)


def _stop_wearing(here: Place) -> Hidden:
    gap = here.dice.anywhere(0.3, 0.5) * here.at.drift
    values = {
        "k_g": here.dice.size(0.2, 3.0) * here.own.k,
        "g": gap,
        "g_wear": here.dice.anywhere(0.3, 0.8) * gap,
        "wear_path": here.at.path,
    }
    why = "a stop that is met beyond a gap; that the gap widens with every cycle is a detail of it"
    return _form(here, ("gap_impact",), "a gap that widens with the path", why, values)


def _asymmetry_growing(here: Place) -> Hidden:
    p = here.own
    values = {
        "phi_wear": here.dice.signed(0.2, 0.8) * 0.5 * (p.beta + p.gamma),
        "wear_energy": here.dice.anywhere(0.08, 0.3) * here.at.energy,
        "wear_saturates": 1.0,
    }
    why = "one direction becomes stronger than the other in the course of the record"
    return _form(here, ("asymmetry",), "grows with work and saturates", why, values)


def _play_slack(here: Place) -> Hidden:
    values = {"b": here.dice.size(0.008, 0.15) * here.at.drift, "slack": 1.0}
    why = "play in series, crossed after every reversal; this one carries no force meanwhile"
    return _form(here, ("backlash",), "slack that carries no force", why, values)


MORE_FORMS: dict[str, Draw] = {
    "stiffness_saturating": stiffness_saturating,
    "strength_saturating": strength_saturating,
    "stiffness_power": _stiffness_power,
    "strength_power": _strength_power,
    "stiffness_with_cycles": stiffness_with_cycles,
    "strength_with_cycles": strength_with_cycles,
    "stiffness_in_time": _stiffness_in_time,
    "strength_in_time": _strength_in_time,
    "slip_lorentz": _slip_lorentz,
    "slip_flat": _slip_flat,
    "slip_saturating": slip_saturating,
    "pinch_sech": _pinch_sech,
    "pinch_triangle": _pinch_triangle,
    "friction_arctan": _friction_arctan,
    "friction_stribeck": _friction_stribeck,
    "friction_pressed": _friction_pressed,
    "spring_power": _spring_power,
    "damper_power": _damper_power,
    "stop_hertz": _stop_hertz,
    "stop_wearing": _stop_wearing,
    "asymmetry_growing": _asymmetry_growing,
    "play_slack": _play_slack,
}
