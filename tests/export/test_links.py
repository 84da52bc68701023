"""Every law claimed to be exact, written, run in OpenSees and compared with the reference engine."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import error, in_the_limit

from bwbn_bayes import (
    BoucWen,
    CoulombFriction,
    CubicStiffness,
    FolientePinching,
    FrictionPendulum,
    GapImpact,
    MaxwellBranch,
    QuadraticDamping,
    Record,
    ShearBuilding,
    Specimen,
    StiffnessDegradation,
    StoreyParameter,
    StrengthDegradation,
    ViscousDamper,
    el_centro,
    simulate,
)
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects.cubic_stiffness import PowerSpring
from bwbn_bayes.elements.effects.quadratic_damping import PowerDamper
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.search_guide import guide_of, is_sought
from bwbn_bayes.export import of_model, script_of
from bwbn_bayes.export.laws import Link, hysteretic_spring, is_known, shape
from bwbn_bayes.structures.structure import Structure

YIELD = 0.008
SPRING = {"k": 8e7, "alpha": 0.05, "u_y": YIELD, "rho": 0.6, "n": 1.7}
PINCH = FolientePinching(zeta_s=0.8, p=3e-5, q=0.2, psi_0=0.2 * YIELD, delta_psi=1e-9, lambda_=0.3)
DEGRADING = (StrengthDegradation(delta_nu=4e-6), StiffnessDegradation(delta_eta=3e-6))

QUASI_STATIC: dict[str, tuple[dict[str, float], tuple[Effect, ...]]] = {
    "BoucWen": (SPRING, ()),
    "BoucWen, A and beta, gamma": ({"k": 4e7, "alpha": 0.1, "A": 2.0, "beta": 300.0, "gamma": -100.0, "n": 1.2}, ()),
    "BoucWen, hardening back": ({**SPRING, "alpha": -0.03}, ()),
    "BoucWen, degrading": (SPRING, DEGRADING),
    "BoucWen, offsets": (
        SPRING,
        (StoreyParameter(parameter="n", offset=0.4), StoreyParameter(parameter="beta", offset=500.0)),
    ),
    "BWBN": (SPRING, (PINCH,)),
    "ElasticPowerFunc": (SPRING, (CubicStiffness(k3=2e10),)),
    "ElasticPowerFunc, free shape": (SPRING, (PowerSpring(F_h=1e5, p_h=2.3, u_h=0.03),)),
    "ElasticMultiLinear": (SPRING, (GapImpact(k_g=5e7, g=0.01),)),
    "ElasticMultiLinear, one side": (SPRING, (GapImpact(k_g=5e7, g=0.0, side="negative"),)),
    "BoucWen, Dahl's friction": (SPRING, (CoulombFriction(F_c=1e5, x0=1e-3, smoothing="dahl"),)),
}
IN_TIME: dict[str, tuple[Effect, ...]] = {
    "Viscous": (QuadraticDamping(c2=2e6),),
    "Viscous, below one": (ViscousDamper(F_v=1.2e5, p_v=0.6, v_v=0.04),),
    "Viscous, free shape": (PowerDamper(F_q=2e4, p_q=1.6, v_q=0.1),),
    "Maxwell": (MaxwellBranch(k_m=2e7, tau=0.08),),
}


CARRIED = tuple(effect for _, effects in QUASI_STATIC.values() for effect in effects) + sum(IN_TIME.values(), ())
"""Kinds of effects that every law has, neutral where they are not placed: few compiled kernels serve all."""


def with_effects(model: Structure, effects: tuple[Effect, ...]) -> Structure:
    for effect in effects:
        model = model.with_effect(effect)
    return replace(model, carried=CARRIED)


def growing(reach: float, n_cycles: int = 5, per_cycle: int = 80) -> Record:
    """A cyclic test of growing amplitude up to ``reach`` [m]."""
    cycles = np.linspace(0.0, n_cycles, n_cycles * per_cycle + 1)
    path = reach * np.sin(2.0 * np.pi * cycles) * cycles / n_cycles
    return Record(name="cycles", time_step=0.05, excitation=path, excitation_kind="displacement")


@pytest.mark.parametrize("name", QUASI_STATIC)
def test_a_specimen_follows_the_reference_engine(name: str, tmp_path: Path) -> None:
    """First order in the step: within half a per cent, half of that with twice the substeps, and 1e-4 in the limit."""
    element, effects = QUASI_STATIC[name]
    model = with_effects(Specimen(storey=BoucWen(**element)), effects)
    record = growing(4.0 * YIELD)
    script = script_of(of_model(model, record, {}, name="specimen"))
    assert f'"{name.split(",")[0]}"' in script.text
    assert [link.error for link in script.links] == [None]
    truth = {"force": np.array(simulate(model, record, {}).channels["force"])}
    coarse, fine, limit = in_the_limit(script, tmp_path, substeps=10)
    assert error(coarse, truth) < 5e-3
    assert error(limit, truth) < 1e-4
    assert error(coarse, truth) / error(fine, truth) == pytest.approx(2.0, abs=0.2)


def test_a_friction_pendulum_of_one_coefficient_is_a_bouc_wen_material(tmp_path: Path) -> None:
    model, record = Specimen(storey=FrictionPendulum(W=2e5, R=1.5, mu_slow=0.05, Y=0.001)), growing(0.01)
    script = script_of(of_model(model, record, {}, name="slider"))
    assert '"BoucWen"' in script.text
    assert [link.error for link in script.links] == [None]
    truth = {"force": np.array(simulate(model, record, {}).channels["force"])}
    coarse, _, limit = in_the_limit(script, tmp_path, substeps=20)
    assert error(coarse, truth) < 5e-3
    assert error(limit, truth) < 2e-4


def test_of_friction_that_depends_on_speed_a_fit_says_what_it_misses() -> None:
    slider = FrictionPendulum(W=2e5, R=1.5, mu_slow=0.05, mu_fast=0.1, a_mu=20.0, Y=0.002)
    (link,) = script_of(of_model(Specimen(storey=slider), growing(0.02), {}, name="slider")).links
    assert link.error is not None
    assert 0.01 < link.error < 0.3
    assert "friction that depends on speed" in " ".join(link.says)


def test_links_beside_storeys_of_given_yield_displacement_are_exported_alike() -> None:
    """A slider took the storeys' boundless shape for its own, and a linear link was a Bouc-Wen material."""
    boundless, motion = {"u_y": 1e15, "rho": 1.0}, np.linspace(-0.01, 0.01, 5)
    slider = {"W": 2e5, "R": 1.5, "mu_slow": 0.05, "Y": 0.001, "k": 0.0, "alpha": 0.0, "A": 1.0, "n": 2.0}
    by_shape = shape({**slider, "beta": 0.0, "gamma": 0.0})
    assert {symbol: shape({**slider, **boundless})[symbol] for symbol in by_shape} == by_shape
    linear = {"k": 3e7, "alpha": 1.0, "A": 1.0, "n": 1.0, **boundless}
    link = Link(
        number=1,
        place="storey 1",
        joins=(0, 1),
        parameters=linear,
        drift=motion,
        drift_rate=motion,
        force=3e7 * motion,
    )
    assert (hysteretic_spring(link).kind, hysteretic_spring(link).arguments) == ("Elastic", (3e7,))


def test_a_linear_link_is_elastic() -> None:
    model = Specimen(storey=BoucWen(k=3e7, alpha=0.2, A=1.5, beta=0.0, gamma=0.0))
    text = script_of(of_model(model, growing(0.01), {}, name="specimen")).text
    (stiffness,) = re.findall(r'"Elastic", 100, (.*)\)', text)
    assert float(stiffness) == pytest.approx(3e7 * (0.2 + 0.8 * 1.5), rel=1e-12)


@pytest.mark.parametrize("name", IN_TIME)
def test_what_depends_on_time_follows_it_in_a_building(name: str, tmp_path: Path) -> None:
    model = with_effects(ShearBuilding(masses=[2e5], storey=BoucWen(**SPRING, c=2e5)), IN_TIME[name])
    record = el_centro("chopra", duration=8.0)
    script = script_of(of_model(model, record, {}, name="oscillator"))
    assert f'"{name.split(",")[0]}"' in script.text
    channels = ["acceleration_1", "drift_1", "force_1"]
    truth = {n: np.array(v) for n, v in simulate(model, record, {}, channels=channels).channels.items()}
    coarse, _, limit = in_the_limit(script, tmp_path, substeps=20)
    assert error(coarse, truth) < 1e-2
    assert error(limit, truth) < 1e-3


def test_a_dashpot_of_a_specimen_feels_the_rate(tmp_path: Path) -> None:
    """The displacement is straight between samples: away from kinks the rate is the slope on either side."""
    path = np.concatenate([np.arange(20) * 1e-3, 19e-3 - np.arange(1, 39) * 1e-3])
    record = Record(name="ramps", time_step=0.1, excitation=path, excitation_kind="displacement")
    model = with_effects(Specimen(storey=BoucWen(**SPRING, c=4e7)), (QuadraticDamping(c2=1e9),))
    script = script_of(of_model(model, record, {}, name="specimen"))
    _, _, limit = in_the_limit(script, tmp_path, substeps=20)
    truth = np.array(simulate(model, record, {}).channels["force"])
    straight = np.r_[1:18, 21:56]
    np.testing.assert_allclose(limit["force"][straight], truth[straight], rtol=1e-4)


def test_units_are_stated_beside_every_material() -> None:
    model = with_effects(Specimen(storey=BoucWen(**SPRING, c=1.0)), (PINCH,))
    text = script_of(of_model(model, growing(0.01), {}, name="specimen")).text
    assert "Units: N, m, s, kg, J." in text
    assert "# BWBN: alpha, ko [N/m], n, gamma, beta [1/m^n], Ao, q, zetas, p [1/J], Shi [m], deltaShi [m/J]" in text
    assert "# Viscous: C [N s/m]" in text


@pytest.mark.parametrize("effect", registered(), ids=lambda effect: effect.name)
def test_every_catalogued_parameter_is_known_to_the_export(effect: type[Effect]) -> None:
    """Otherwise it would be called a law of the user's own."""
    freer = guide_of(effect).free_shapes(NOMINAL) if is_sought(effect) else ()
    forms = (*effect.neutral_forms(), *freer)
    symbols = {p.symbol for form in forms for p in form.parameters}
    if effect.level != "observation":  # sensors are no part of a structure
        assert {symbol for symbol in symbols if not is_known(symbol)} == set()
