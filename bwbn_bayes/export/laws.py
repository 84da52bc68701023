"""The law of a link in OpenSees' uniaxial materials.

Our hysteretic spring is ``alpha k u + (1 - alpha) k z`` with
``dz/du = h [A - nu |z|^n (beta sgn(z v) + gamma)] / eta``, ``nu = 1 + delta_nu epsilon``,
``eta = 1 + delta_eta epsilon`` and ``d epsilon = (1 - alpha) k z du``.

**BoucWen** (Haukaas and Der Kiureghian [1]_) solves, by implicit Euler in the strain [3]_,
``z - z0 = [TA - |z|^n (gamma + beta sgn(z de)) Tnu] de / Teta`` with ``Te = Te0 + (1 - alpha) ko z de``,
``TA = Ao - deltaA Te``, ``Tnu = 1 + deltaNu Te``, ``Teta = 1 + deltaEta Te`` and stress
``alpha ko e + (1 - alpha) ko z``. As the step goes to zero this is our law with ``h = 1`` where strain is drift and
stress is force: ``ko = k``, ``Ao = A``, ``deltaA = 0``, and alpha, n, gamma, beta, deltaNu, deltaEta have our values
unchanged. The energy is the same work on the hysteretic spring [N m], so that deltaNu and deltaEta are per joule; in a
model in other units they must be converted with it.

**BWBN** has Foliente's multiplier [2]_ ``h = 1 - z1 exp(-(z sgn(de) - q zu)^2 / z2^2)`` with
``z1 = zetas (1 - exp(-p Te))``, ``z2 = (Shi + deltaShi Te)(lambda + z1)``, ``zu = (1/(beta + gamma))^(1/n)``, and
neither nu nor eta: our ``foliente_pinching`` with ``Shi = psi_0``, ``deltaShi = delta_psi`` where nothing degrades and
the work is not negative.

Both start Newton's iteration at z = 0.01 and end it at an absolute tolerance on z, 1e-8 by default, which is coarse
where z is measured in metres: the tolerance written here follows the size of z.

A dashpot is ``Viscous`` (``C sgn(v) |v|^a``), a spring by a power of the drift ``ElasticPowerFunc``, a stop
``ElasticMultiLinear``, all exact; a Maxwell branch is ``Maxwell``, exact as the step goes to zero. Dahl's friction
``F q`` with ``dq/dt = (v - |v| q)/x0`` is a Bouc-Wen spring with ``z = x0 q``, ``alpha = 0``, ``k = F/x0``,
``A = n = 1``, ``beta = 1/x0``, ``gamma = 0``. They stand in ``Parallel`` with the hysteretic spring.

References
----------
.. [1] T. Haukaas and A. Der Kiureghian, "Finite Element Reliability and Sensitivity Methods for Performance-Based
   Earthquake Engineering", PEER 2003/14, 2004.
.. [2] G. C. Foliente, "Hysteresis Modeling of Wood Joints and Structural Systems", J. Struct. Eng. 121(6), 1995.
.. [3] OpenSees 3.8, SRC/material/uniaxial: BoucWenMaterial.cpp, BWBN.cpp, ViscousMaterial.cpp, ElasticPowerFunc.cpp.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.export.exportable import Link
from bwbn_bayes.parameters import Floats

NEWTON_ITERATIONS = 200
NEWTON_TOLERANCE = 1e-10
"""Of the iteration for z, as a share of z's size."""

_FIRST = "alpha, ko [N/m], n, gamma, beta [1/m^n], Ao"
BOUC_WEN = f"{_FIRST}, deltaA, deltaNu, deltaEta [1/J], tolerance [m], iterations"
BWBN = f"{_FIRST}, q, zetas, p [1/J], Shi [m], deltaShi [m/J], lambda, tolerance [m], iterations"
"""What the arguments of the two materials are."""

_NO_LAW = {
    "eta_inf": "a loss of stiffness that saturates",
    "nu_inf": "a loss of strength that saturates",
    "theta_eta": "a loss of stiffness with the path",
    "theta_nu": "a loss of strength with the path",
    "delta_s": "slip-lock",
    "b": "a play",
    "b_0": "slack",
    "b_f": "slack",
    "phi": "asymmetry",
    "phi_uv": "asymmetry",
    "phi_u": "asymmetry",
    "F_c": "friction that turns with the drift rate",
    "F_ratio": "friction that turns with the drift rate",
    "F_root": "friction that turns with the drift rate",
    "a_mu": "friction that depends on speed",
    "r_h": "a spring that came to yield where the model had a linear one",
    "eta_e": "a loss of stiffness in a free shape",
    "eta_c": "a loss of stiffness in a free shape, with the path",
    "eta_a": "a loss of stiffness with the amplitude",
    "nu_a": "a loss of strength with the amplitude",
    "nu_e": "a loss of strength in a free shape",
    "nu_c": "a loss of strength in a free shape, with the path",
    "zeta_g": "Foliente's pinching in a free shape",
    "s_w": "slip-lock in a free shape",
    "F_d": "friction in a free shape",
    "F_k": "friction that depends on speed",
    "k_s": "a stop in a free shape",
    "k_sp": "a stop in a free shape",
    "k_sn": "a stop in a free shape",
}
"""Amplitudes of what no uniaxial material of OpenSees does, in words."""
_CHANGES = ("_jump", "_ramp")
"""Endings of the amplitudes of what changes in time."""
_TRANSLATED = (
    *("k", "c", "alpha", "A", "beta", "gamma", "u_y", "rho", "n", "delta_nu", "delta_eta"),
    *("W", "R", "mu_slow", "Y"),
    *("alpha_offset", "beta_offset", "gamma_offset", "n_offset"),
    *("zeta_s", "p", "q", "psi_0", "delta_psi", "lambda_"),
    *("c2", "F_v", "p_v", "v_v", "F_q", "p_q", "v_q", "k3", "F_h", "p_h", "u_h"),
    *("k_geo", "k_g", "g", "k_gp", "g_p", "k_gn", "g_n", "k_m", "tau", "F_dahl", "x_dahl"),
)
_SIZES_OF_NO_LAW = (
    *("mu_fast", "beta_h", "gamma_h", "n_h", "x_h", "sigma", "u_uv", "u_u", "v0", "v_ratio", "v_root"),
    *("w", "w_0", "w_f", "s_f"),
    *("p_eta", "p_nu", "b_eta", "m_eta", "E_eta", "b_nu", "m_nu", "E_nu"),
    *("a_eta", "r_eta", "U_eta", "a_nu", "r_nu", "U_nu"),
    *("s_eta", "q_eta", "N_eta", "u_eta", "s_nu", "q_nu", "N_nu", "u_nu"),
    *("p_g", "q_g", "psi_g", "delta_g", "lambda_g", "m_g", "t_g", "i_g", "sigma_w", "b_w", "m_w", "p_w", "E_w"),
    *("x_d", "r_d", "g_d", "u_d", "c_d", "U_d", "w_k", "s_k", "v_k"),
    *(f"{size}_s{side}" for side in ("", "p", "n") for size in "gpswuE"),
)
_AROUND = ("e_m", "c_m", "mu_t", "f_t", "zeta_t", "compliance", "m_b", "c_b", "s_g", "k_bend")
_SLIDER = ("inv_mu", "R_s", "m_s", "W_s", "Y_s", "n_s", "r_mu", "a_s")
"""Of floors, base and ground: the script has them."""
_SIZES_OF_CHANGES = ("_time", "_ramp_duration")
_KNOWN = {*_NO_LAW, *_TRANSLATED, *_SIZES_OF_NO_LAW, *_AROUND, *_SLIDER}


@dataclass(frozen=True, kw_only=True)
class Material:
    """One ``uniaxialMaterial``: its kind, its arguments after the tag, and what it is, in words with units.

    ``begins`` is its own strain [m] where that of the script is zero, of materials without memory.
    """

    kind: str
    arguments: tuple[float | str, ...]
    says: str
    begins: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Part:
    """A material beside the hysteretic spring and the force ``(n_times,)`` [N] it takes, None where it has a memory."""

    material: Material
    force: Floats | None


def without_law(parameters: Mapping[str, float], *, in_analysis: bool) -> tuple[str, ...]:
    """What of a link no exact combination of materials has, in words; empty where the translation is exact.

    Parameters
    ----------
    parameters : mapping of str to float
        Of the link.
    in_analysis : bool
        Whether it stands in an analysis in time, whose step a ``Maxwell`` branch asks for.
    """
    acting = {symbol for symbol, value in parameters.items() if value != 0.0}
    found = [words for symbol, words in _NO_LAW.items() if symbol in acting]
    found += [f"a change of {one.rpartition('_')[0]} in time" for one in sorted(acting) if one.endswith(_CHANGES)]
    if "zeta_s" in acting and acting & {"delta_nu", "delta_eta"}:
        found.append("Foliente's pinching of a spring that degrades")
    if "k_m" in acting and not in_analysis:
        found.append("a Maxwell branch outside an analysis in time")
    found += [f"a law of the user's own ({symbol})" for symbol in sorted(acting) if not is_known(symbol)]
    return tuple(dict.fromkeys(found))


def is_known(symbol: str) -> bool:
    """Whether the export knows what a parameter does."""
    return symbol in _KNOWN or symbol.endswith((*_CHANGES, *_SIZES_OF_CHANGES))


def hysteretic_spring(link: Link) -> Material:
    """The spring ``alpha k u + (1 - alpha) k z`` of a link whose law OpenSees has.

    Raises
    ------
    UserError
        If z has no bound in Foliente's pinch, which its bound is part of.
    """
    p = shape(link.parameters)
    k, alpha, A, beta, gamma, n = (p[symbol] for symbol in ("k", "alpha", "A", "beta", "gamma", "n"))
    first = (alpha, k, n, gamma, beta, A)
    newton = (NEWTON_TOLERANCE * size_of_z(link), NEWTON_ITERATIONS)
    if p.get("zeta_s", 0.0) != 0.0:
        if not beta + gamma > 0.0:
            raise UserError(f"{link.place}: beta + gamma = {beta + gamma:g} bounds no z, which BWBN asks for")
        pinch = tuple(p[symbol] for symbol in ("q", "zeta_s", "p", "psi_0", "delta_psi", "lambda_"))
        return Material(kind="BWBN", arguments=(*first, *pinch, *newton), says=BWBN)
    loss = (p.get("delta_nu", 0.0), p.get("delta_eta", 0.0))
    if alpha == 1.0 or beta == gamma == loss[1] == 0.0:
        return Material(kind="Elastic", arguments=(k * (alpha + (1.0 - alpha) * A),), says="stiffness [N/m]")
    return Material(kind="BoucWen", arguments=(*first, 0.0, *loss, *newton), says=BOUC_WEN)


def shape(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters with beta and gamma in the place of u_y and rho, and with what differs at the storey added.

    A friction pendulum is the spring that it is at rest: k is that of dish and contact, alpha the share of the dish.
    """
    p = dict(parameters)
    slides = p.get("W", 0.0) > 0.0
    if slides:
        p |= _slider(p["W"], p["R"], p["mu_slow"], p["Y"], p["n"])
    for symbol in ("alpha", "n"):
        p[symbol] += p.get(f"{symbol}_offset", 0.0)
    if "u_y" in p and not slides:
        bound = p["A"] * (p["A"] * p["u_y"]) ** -p["n"]
        p |= {"beta": p["rho"] * bound, "gamma": (1.0 - p["rho"]) * bound}
    for symbol in ("beta", "gamma"):
        p[symbol] += p.get(f"{symbol}_offset", 0.0)
    return p


def _slider(weight: float, radius: float, friction: float, drift: float, n: float) -> dict[str, float]:
    """A friction pendulum as a Bouc-Wen spring of that n, whose A is 1."""
    dish, contact = weight / radius, friction * weight / drift
    return {
        "k": dish + contact,
        "alpha": dish / (dish + contact),
        "beta": 0.5 * drift**-n,
        "gamma": 0.5 * drift**-n,
    }


def force_at(link: Link, drift: float) -> float:
    """Force [N] of the hysteretic spring at a drift [m] where z is zero."""
    p = shape(link.parameters)
    return p["alpha"] * p["k"] * drift


def sliding_base(parameters: Mapping[str, float]) -> Material:
    """The sliders below a building, with their friction at speed at every speed."""
    n = parameters["n_s"]
    p = _slider(parameters["W_s"], parameters["R_s"], 1.0 / parameters["inv_mu"], parameters["Y_s"], n)
    newton = (NEWTON_TOLERANCE * parameters["Y_s"], NEWTON_ITERATIONS)
    arguments = (p["alpha"], p["k"], n, p["gamma"], p["beta"], 1.0, 0.0, 0.0, 0.0, *newton)
    return Material(kind="BoucWen", arguments=arguments, says=BOUC_WEN)


def size_of_z(link: Link) -> float:
    """The largest hysteretic displacement [m] to expect: its bound, or what the drift makes of it."""
    p = shape(link.parameters)
    reached = p["A"] * float(np.max(np.abs(link.drift)))
    bounding = p["beta"] + p["gamma"]
    bound = (p["A"] / bounding) ** (1.0 / p["n"]) if bounding > 0.0 else np.inf
    return float(min(size for size in (reached, bound, 1.0) if size > 0.0))


def beside(link: Link) -> tuple[Part, ...]:
    """Dashpots, elastic springs, stops and branches that act beside the hysteretic spring."""
    p, u, v = link.parameters, link.drift, link.drift_rate
    parts = []

    def add(symbol: str, kind: str, arguments: tuple[float | str, ...], says: str, force: Floats | None) -> None:
        if p.get(symbol, 0.0) != 0.0:
            parts.append(Part(material=Material(kind=kind, arguments=arguments, says=says), force=force))

    c, c2, k3, geometric = (p.get(symbol, 0.0) for symbol in ("c", "c2", "k3", "k_geo"))
    add("c", "Viscous", (c, 1.0), "C [N s/m], exponent of the drift rate", c * v)
    add("c2", "Viscous", (c2, 2.0), "C [N s^2/m^2], exponent of the drift rate", c2 * v * np.abs(v))
    for symbol, power, rate in _DAMPERS:
        if p.get(symbol, 0.0) != 0.0:
            exponent, coefficient = p[power], p[symbol] * p[rate] ** -p[power]
            says = "C [N (s/m)^a], exponent a of the drift rate"
            add(symbol, "Viscous", (coefficient, exponent), says, coefficient * np.sign(v) * np.abs(v) ** exponent)
    add("k_geo", "Elastic", (-geometric,), "stiffness [N/m]: P-Delta", -geometric * u)
    add("k3", "ElasticPowerFunc", ("-coeff", k3, "-exp", 3.0), "coefficient [N/m^3], exponent of the drift", k3 * u**3)
    if p.get("F_h", 0.0) != 0.0:
        exponent, coefficient = p["p_h"], p["F_h"] * p["u_h"] ** -p["p_h"]
        says = "coefficient [N/m^a], exponent a of the drift"
        pushed = coefficient * np.sign(u) * np.abs(u) ** exponent
        add("F_h", "ElasticPowerFunc", ("-coeff", coefficient, "-exp", exponent), says, pushed)
    for stiffness, gap, sides in _STOPS:
        if p.get(stiffness, 0.0) != 0.0:
            says = "drifts [m], forces [N] of its corners"
            pushed = p[stiffness] * np.sum([side * np.maximum(side * u - p[gap], 0.0) for side in sides], axis=0)
            add(stiffness, "ElasticMultiLinear", _corners(p[stiffness], p[gap], sides), says, pushed)
    if p.get("k_m", 0.0) != 0.0:
        branch = (p["k_m"], p["k_m"] * p["tau"], 1.0, 1.0)
        add("k_m", "Maxwell", branch, "K [N/m], C [N s/m], exponent, length", None)
    if p.get("F_dahl", 0.0) != 0.0:
        force, width = p["F_dahl"], p["x_dahl"]
        dahl = (
            0.0,
            force / width,
            1.0,
            0.0,
            1.0 / width,
            1.0,
            0.0,
            0.0,
            0.0,
            NEWTON_TOLERANCE * width,
            NEWTON_ITERATIONS,
        )
        add("F_dahl", "BoucWen", dahl, "Dahl's friction: alpha, ko [N/m], n, gamma, beta [1/m], Ao, ...", None)
    return tuple(parts)


_DAMPERS = (("F_v", "p_v", "v_v"), ("F_q", "p_q", "v_q"))
"""Force, power and the drift rate at which the force is measured, of each damper that follows a power of the rate."""
_STOPS = (("k_g", "g", (-1, 1)), ("k_gp", "g_p", (1,)), ("k_gn", "g_n", (-1,)))
"""Stiffness, gap and sides of each form of a stop."""


def _corners(stiffness: float, gap: float, sides: tuple[int, ...]) -> tuple[float | str, ...]:
    """A stop at ``gap`` [m] on one side or both, up to a metre beyond; OpenSees goes on with the last slope."""
    reach, push = gap + 1.0, stiffness
    below = {-reach: -push, -gap: 0.0} if -1 in sides else {-reach: 0.0}
    above = {gap: 0.0, reach: push} if 1 in sides else {reach: 0.0}
    corners = below | above  # one at zero where there is no gap
    return "-strain", *corners, "-stress", *corners.values()
