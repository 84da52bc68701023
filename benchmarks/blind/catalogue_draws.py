"""The catalogue's effects, each with the range its size is drawn from."""

from __future__ import annotations

import math

from benchmarks.blind.draws import Draw, Hidden, Place, at_storey, in_whole


def _stiffness_degradation(here: Place) -> Hidden:
    return at_storey("stiffness_degradation", here.storey, {"delta_eta": here.dice.size(0.08, 2.0) / here.at.energy})


def _strength_degradation(here: Place) -> Hidden:
    return at_storey("strength_degradation", here.storey, {"delta_nu": here.dice.size(0.12, 3.0) / here.at.energy})


def _slip_lock(here: Place) -> Hidden:
    values = {
        "delta_s": here.dice.size(0.02, 0.6) * here.at.drift / here.at.energy,
        "sigma": here.dice.anywhere(0.05, 0.25) * min(here.at.z_bound, here.at.z),
    }
    return at_storey("slip_lock", here.storey, values)


def _foliente_pinching(here: Place) -> Hidden:
    width = here.dice.anywhere(0.3, 0.6) * here.at.z
    values = {
        "zeta_s": here.dice.size(0.3, 0.95),
        "p": here.dice.anywhere(2.0, 10.0) / here.at.energy,
        "q": here.dice.anywhere(0.05, 0.3) * here.at.z / here.at.z_bound,
        "psi_0": width,
        "delta_psi": here.dice.anywhere(0.0, 0.3) * width / here.at.energy,
        "lambda_": here.dice.anywhere(0.1, 0.5),
    }
    return at_storey("foliente_pinching", here.storey, values)


def _asymmetry(here: Place) -> Hidden:
    p = here.own
    return at_storey("asymmetry", here.storey, {"phi": here.dice.signed(0.15, 0.8) * 0.5 * (p.beta + p.gamma)})


def _cubic_stiffness(here: Place) -> Hidden:
    k = here.own.k
    return at_storey("cubic_stiffness", here.storey, {"k3": here.dice.size(0.02, 0.5) * k / here.at.drift**2})


def _quadratic_damping(here: Place) -> Hidden:
    return at_storey(
        "quadratic_damping", here.storey, {"c2": here.dice.size(0.015, 0.4) * here.at.force / here.at.rate**2}
    )


def _coulomb_friction(here: Place) -> Hidden:
    values = {"F_c": here.dice.size(0.008, 0.2) * here.at.force, "v0": here.dice.anywhere(0.01, 0.03) * here.at.rate}
    return at_storey("coulomb_friction", here.storey, values)


def _gap_impact(here: Place) -> Hidden:
    k = here.own.k
    values = {"k_g": here.dice.size(0.1, 3.0) * k, "g": here.dice.anywhere(0.4, 0.75) * here.at.drift}
    return at_storey("gap_impact", here.storey, values)


def _sudden_damage(here: Place) -> Hidden:
    k = here.own.k
    time = round(here.dice.anywhere(here.at.strong_from, here.at.strong_until), 3)
    return at_storey("sudden_damage", here.storey, {"k_jump": -here.dice.size(0.015, 0.5) * k, "k_time": time})


def _maxwell_branch(here: Place) -> Hidden:
    k = here.own.k
    return at_storey(
        "maxwell_branch",
        here.storey,
        {"k_m": here.dice.size(0.03, 0.6) * k, "tau": here.dice.anywhere(0.5, 2.0) / here.at.omegas[0]},
    )


def _base_flexibility(here: Place) -> Hidden:
    compliance = here.dice.size(0.02, 0.5) / here.building.storeys[0].k
    values = {
        "base_compliance": compliance,
        "base_mass": here.dice.anywhere(0.5, 1.5),
        "base_damping": here.dice.anywhere(0.1, 1.0),
    }
    parameters = {"compliance": compliance, "m_b": values["base_mass"], "c_b": values["base_damping"]}
    return in_whole("base_flexibility", values, parameters)


def _appendage(here: Place) -> Hidden:
    tuned = here.at.omegas[int(here.dice.rng.integers(2))]
    values = {
        "appendage_mass": here.dice.size(0.006, 0.12),
        "appendage_omega": here.dice.anywhere(0.7, 1.4) * tuned,
        "appendage_zeta": here.dice.anywhere(0.01, 0.05),
    }
    parameters = {
        "mu_t": values["appendage_mass"],
        "f_t": values["appendage_omega"] / (2.0 * math.pi),
        "zeta_t": values["appendage_zeta"],
    }
    return at_storey("appendage", here.storey, values, parameters)


def _mass_error(here: Place) -> Hidden:
    error = here.dice.signed(0.012, 0.25)
    return at_storey("mass_error", here.storey, {"mass_error": error}, {"e_m": error})


def _sensor_bias(here: Place) -> Hidden:
    bias = here.dice.signed(0.012, 0.4) * here.at.acceleration
    return at_storey("sensor_bias", here.storey, {"bias": bias}, {"bias": bias})


def _sensor_gain(here: Place) -> Hidden:
    error = here.dice.signed(0.012, 0.25)
    return at_storey("sensor_gain", here.storey, {"gain_error": error}, {"gain": 1.0 + error})


def _sensor_lag(here: Place) -> Hidden:
    return at_storey("sensor_lag", here.storey, {"lag": here.dice.size(0.002, 0.05)})


def _input_scale(here: Place) -> Hidden:
    error = here.dice.signed(0.012, 0.25)
    return in_whole("input_scale", {"input_error": error}, {"s_g": 1.0 + error})


def _backlash(here: Place) -> Hidden:
    return at_storey("backlash", here.storey, {"b": here.dice.size(0.008, 0.15) * here.at.drift})


def _storey_parameter(here: Place) -> Hidden:
    p = here.own
    which = str(here.dice.rng.choice(["alpha", "beta", "gamma", "n"]))
    if which == "alpha":
        value = p.alpha + here.dice.size(0.08, 0.4)
    elif which == "beta":
        value = p.beta * (1.0 + here.dice.size(0.6, 4.0))
    elif which == "gamma":
        value = p.gamma + here.dice.size(0.6, 4.0) * (p.beta + p.gamma)
    else:
        value = p.n * (1.0 + here.dice.size(0.3, 1.5))
    return at_storey("storey_parameter", here.storey, {which: value}, {f"{which}_offset": value - getattr(p, which)})


def _mass_damping(here: Place) -> Hidden:
    rate = here.dice.size(0.012, 0.4) * here.at.omegas[0] / 2.0
    return in_whole("mass_damping", {"mass_damping": rate}, {"c_m": rate})


CATALOGUE: dict[str, Draw] = {
    "stiffness_degradation": _stiffness_degradation,
    "strength_degradation": _strength_degradation,
    "slip_lock": _slip_lock,
    "foliente_pinching": _foliente_pinching,
    "asymmetry": _asymmetry,
    "cubic_stiffness": _cubic_stiffness,
    "quadratic_damping": _quadratic_damping,
    "coulomb_friction": _coulomb_friction,
    "gap_impact": _gap_impact,
    "sudden_damage": _sudden_damage,
    "maxwell_branch": _maxwell_branch,
    "base_flexibility": _base_flexibility,
    "appendage": _appendage,
    "mass_error": _mass_error,
    "sensor_bias": _sensor_bias,
    "sensor_gain": _sensor_gain,
    "sensor_lag": _sensor_lag,
    "input_scale": _input_scale,
    "backlash": _backlash,
    "storey_parameter": _storey_parameter,
    "mass_damping": _mass_damping,
}
