"""The printed equations: they say what the engines compute, and every effect has one."""

from __future__ import annotations

from dataclasses import replace
from xml.dom.minidom import parseString

import numpy as np
import pytest
import sympy as sp
from laboratory import storey

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import catalogue, registered
from bwbn_bayes.elements.combine import combine, expanded
from bwbn_bayes.elements.effects import (
    Asymmetry,
    Backlash,
    CoulombFriction,
    GapImpact,
    MaxwellBranch,
    SlipLock,
    StoreyParameter,
    StrengthDegradation,
    SuddenDamage,
)
from bwbn_bayes.elements.equations import law_equations
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, FORCE, rate_of
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

PLAIN = BoucWen(k=1.0, beta=1.0, gamma=0.0)
EVERYTHING = tuple(
    form
    for kind in registered()
    if kind.level == "link" and "bouc_wen" in kind.elements
    for form in kind.neutral_forms()
)

DEGRADING = tuple(
    form
    for form in EVERYTHING
    if form.name in {"foliente_pinching", "slip_lock"}
    or form.form in {"linear", "k, step", "delta_nu, step", "delta_s, step"}
)


def test_the_printed_steps_are_the_law_that_is_solved():
    """Named steps, written out, against force and rates at random points (no jump has happened)."""
    law = combine(PLAIN.parameters, PLAIN.constraints, EVERYTHING)
    steps = expanded(law.definitions)
    rng = np.random.default_rng(1)
    symbols = (DRIFT, DRIFT_RATE, *law.states, *law.symbols)
    points = rng.uniform(0.2, 0.9, (len(symbols), 50))
    for subject, solved in zip((FORCE, *map(rate_of, law.states)), (law.force, *law.rates), strict=True):
        raised = steps[subject].subs({base: base + increment for base, increment in law.increments})
        pair = (e.subs({event.indicator: 0 for event in law.events}) for e in (raised, solved))
        printed, computed = (sp.lambdify(symbols, e, "numpy")(*points) for e in pair)
        np.testing.assert_allclose(printed, computed, rtol=1e-12)


def test_the_plain_law_in_text():
    texts = [equation.text for equation in law_equations(combine(PLAIN.parameters, (), ()))]
    assert texts == [
        "f = A − |z|^n (β sgn(z v) + γ)",
        "dz/dt = f v",
        "dε/dt = (1 − α) k z v",
        "F = α k u + (1 − α) k z + c v",
    ]


def test_the_full_law_in_text():
    texts = [equation.text for equation in law_equations(combine(PLAIN.parameters, (), DEGRADING))]
    for expected in (
        "k(t) = k + Δk H(t − t_k)",
        "δ_ν(t) = δ_ν + Δδ_ν H(t − t_(δ_ν))",
        "ν = 1 + δ_ν(t) ε",
        "s = δ_s(t) ε",
        "a = √2 exp(−z² / (2 σ²)) / (√π σ)",
        "z_u = (1 / (β + γ))^(1/n)",
        "h = 1 − z_1 exp(−(z sgn v − q z_u)² / z_2²)",
        "f = h (A − ν |z|^n (β sgn(z v) + γ)) / η",
        "dz/dt = f v / (1 + s a f)",
    ):
        assert expected in texts


@pytest.mark.parametrize(
    ("effect", "texts"),
    [
        (Asymmetry(phi=0.0), ["f = A − |z|^n (β sgn(z v) + φ (sgn z + sgn v) + γ)"]),
        (
            Backlash(b=0.0, w=1.0),
            ["u_p = d", "ξ = (b − d sgn v) / w", "dz/dt = f χ v", "F = α k (u − u_p) + (1 − α) k z + c v"],
        ),
        (
            CoulombFriction(F_c=0.0, v0=1.0, smoothing="root"),
            ["F = α k u + (1 − α) k z + F_root v / (√(v_root² + v²)) + c v"],
        ),
        (GapImpact(k_g=0.0, g=1.0, side="positive"), ["F = α k u + k_gp max(u − g_p, 0) + (1 − α) k z + c v"]),
        (MaxwellBranch(k_m=0.0, tau=1.0), ["dq_m/dt = k_m v − q_m/τ", "F = q_m + α k u + (1 − α) k z + c v"]),
        (
            StrengthDegradation(nu_a=0.0, s_nu=1.0, q_nu=1.0, N_nu=1.0, u_nu=1.0),
            ["ν = 1 + ν_a (|x_ν|/N_ν)^(s_ν / (1 + q_ν))", "dx_ν/dt = (1 + q_ν) (|u|/u_ν)^q_ν |v| / u_ν"],
        ),
        (
            StrengthDegradation(nu_c=0.0, a_nu=1.0, r_nu=1.0, U_nu=1.0),
            ["ν = 1 + ν_c (1 − exp(−a_ν (|u_c|/U_ν)^r_ν)) / (1 − exp(−a_ν))"],
        ),
        (StoreyParameter(parameter="alpha", offset=0.0), ["α_i = α + α_offset", "dε/dt = (1 − α_i) k z v"]),
        (
            SuddenDamage(parameter="k", jump=0.0, time=0.0, duration=1.0),
            [
                "k(t) = k + (1 − max(1 − k_progress, 0)) k_ramp",
                "dk_progress/dt = H(t − t_(k_ramp)) / T_(k_ramp)",
                "F = α k(t) u + (1 − α) k(t) z + c v",
            ],
        ),
    ],
    ids=lambda case: getattr(case, "name", ""),
)
def test_the_law_with_one_effect_in_text(effect, texts):
    written = [equation.text for equation in law_equations(combine(PLAIN.parameters, (), (effect,)))]
    assert [text for text in texts if text not in written] == [], written


def test_a_small_number_that_is_no_offset_is_written():
    class Faint:
        name, level, parameters = "faint", "link", ()

        def fill(self, slots):
            return replace(slots, added_force=slots.added_force + 2e-5 * DRIFT**3)

    texts = [equation.text for equation in law_equations(combine(PLAIN.parameters, (), (Faint(),)))]
    assert any("2e-05" in text for text in texts), texts


def test_mathml_is_well_formed_and_sets_symbols():
    equations = law_equations(combine(PLAIN.parameters, (), EVERYTHING))
    for equation in equations:
        parseString(equation.mathml)
        assert "_" not in equation.mathml and "lambda" not in equation.mathml
    joined = "".join(equation.mathml for equation in equations)
    assert "<msub><mi>δ</mi><mi>ν</mi></msub>" in joined
    assert "<mi>λ</mi>" in joined


@pytest.mark.parametrize("facts", catalogue(), ids=lambda facts: facts.name)
def test_every_effect_has_its_equation(facts):
    assert facts.equations
    for equation in facts.equations:
        assert equation.caption and "=" in equation.text
        parseString(equation.mathml)


@pytest.mark.parametrize("n_storeys", [1, 3])
def test_the_equation_of_motion(n_storeys):
    equations = structure_equations(ShearBuilding(masses=[1.0] * n_storeys, storey=storey()))
    motion = {1: "m (ẍ + a_g) = −F", 3: "m_i (ẍ_i + a_g) = −F_i + F_(i+1), F_4 = 0"}
    assert equations[0].text == motion[n_storeys]
    assert equations[3:] == law_equations(ShearBuilding(masses=[1.0], storey=storey()).law)
    for equation in equations:
        parseString(equation.mathml)


def test_a_specimen_is_driven_by_its_displacement():
    assert structure_equations(Specimen(storey=storey()))[0].text == "du/dt = v"


def test_of_what_a_law_merely_carries_nothing_is_written():
    """The report of a discovered model showed the law by which all effects had been searched."""
    slip = SlipLock(delta_s=0.1, sigma=0.05)
    model = ShearBuilding(masses=[1.0], storey=storey()).with_effect(slip)
    carrying = replace(model, carried=(Backlash(b=0.1, w=0.01), GapImpact(k_g=1.0, g=0.1)))
    assert len(law_equations(carrying.law)) > len(law_equations(model.law))
    assert structure_equations(carrying) == structure_equations(model)
