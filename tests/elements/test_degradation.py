"""Degradation in its forms: limits of one another, what they lose, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from laboratory import NO_DRAW, cyclic_test, nrmse, storey

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import StiffnessDegradation, StrengthDegradation
from bwbn_bayes.elements.equations import slot_equations
from bwbn_bayes.elements.law import DRIFT_RATE, ENERGY, HYSTERETIC_DISPLACEMENT, PATH, Effect, Slots
from bwbn_bayes.elements.loops import large_half_cycles
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.signature import PlaceResponse
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.specimen import Specimen

CYCLES = [0.8, -0.8] * 4


def force(effect: Effect | None = None, cycles: list[float] = CYCLES, **element: float) -> np.ndarray:
    model = Specimen(storey=storey(c=0.0, **element))
    model = model if effect is None else model.with_effect(effect)
    return Reference(rtol=1e-10).simulate(model, NO_DRAW, cyclic_test(cycles, 60), ["force"]).values[0, 0]


@pytest.mark.parametrize(
    ("linear", "slow"),
    [
        (StiffnessDegradation(delta_eta=0.2), StiffnessDegradation(eta_inf=2e4, p_eta=1e-5)),
        (StrengthDegradation(delta_nu=0.2), StrengthDegradation(nu_inf=2e4, p_nu=1e-5)),
    ],
    ids=lambda effect: effect.name,
)
def test_a_slow_loss_is_the_linear_one(linear, slow):
    """Of the first order in ``p epsilon``, which reaches 1e-3 here at most."""
    assert nrmse(force(slow), force(linear)) < 1e-3
    assert nrmse(force(linear), force()) > 0.05


def test_a_loss_that_comes_at_once_is_another_storey():
    """``nu`` multiplies the shape bracket: with nu = 1.5 throughout, beta and gamma are half as large again."""
    at_once = force(StrengthDegradation(nu_inf=0.5, p_nu=1e5))
    assert nrmse(at_once, force(beta=3.0, gamma=3.0)) < 1e-3


def test_peaks_fall_to_a_limit():
    """The plateau's force is that of ``z_u`` at ``nu = 1 + nu_inf``; with the linear form peaks fall on and on."""
    saturating, linear = force(StrengthDegradation(nu_inf=1.0, p_nu=0.8)), force(StrengthDegradation(delta_nu=0.1))
    plateau = 0.01 * 10.0 * 0.8 + 0.99 * 10.0 * (1.0 / (2.0 * 4.0)) ** (1.0 / 1.5)
    peaks = saturating[60::120]
    assert peaks[-1] == pytest.approx(plateau, rel=2e-3)
    assert peaks[0] > 1.1 * plateau
    assert linear[60::120][-1] < 0.97 * linear[60::120][-2]


@pytest.mark.parametrize("effect_class", [StiffnessDegradation, StrengthDegradation])
def test_the_form_follows_from_what_is_given(effect_class):
    forms = effect_class.neutral_forms()
    (delta,), (limit, rate), (path,), _ = (tuple(p.symbol for p in form.parameters) for form in forms)
    assert [form.form for form in forms] == ["linear", "saturating", "linear, with the path", "with the amplitude"]
    sentence = f"{effect_class.__name__}: the form follows from what is given: give {delta}, or {limit} and {rate}"
    pair = {delta: 0.1, limit: 0.1}
    for given in ({}, {delta: 0.1, path: 0.1}, pair, {limit: 0.1}, {rate: 0.1}, {**pair, rate: 1.0}):
        with pytest.raises(UserError, match=sentence):
            effect_class(**given)


@pytest.mark.parametrize(
    ("form_name", "equations"),
    [
        ("saturating", {"η = 1 + η_∞ (1 − exp(−p_η ε))", "ν = 1 + ν_∞ (1 − exp(−p_ν ε))"}),
        ("linear, with the path", {"η = 1 + θ_η u_c", "ν = 1 + θ_ν u_c"}),
    ],
)
def test_the_equations_say_so(form_name, equations):
    written = {
        form.name: slot_equations(form.fill(Slots()), form.parameters)[0].text
        for kind in registered()
        for form in kind.neutral_forms()
        if form.form == form_name
    }
    assert set(written.values()) == equations


def worn_strength(drift: np.ndarray, **sizes: float) -> float:
    """Share of the strength that is left at the end of a drift history, by the size that names are judged by."""
    at = PlaceResponse(histories={"drift": drift}, parameters={**sizes, "n": 1.0}, scales=NOMINAL)
    size = StrengthDegradation.neutral_forms()[3].signature.size
    assert size is not None
    return (1.0 - size(at)) ** max(0.5 * len(large_half_cycles(drift)), 1.0)


@pytest.mark.parametrize("exponent", [0.3, 1.0, 6.0])
def test_excursions_count_by_a_power_of_their_size(exponent):
    """Fifteen ways to the largest drift or back count as fifteen; those to half of it have half the loss to a power."""
    drift = cyclic_test(CYCLES, 60).excitation
    sizes = {"nu_a": 0.5, "s_nu": 3.0, "q_nu": exponent, "N_nu": 15.0, "u_nu": 0.8}
    assert worn_strength(drift, **sizes) == pytest.approx(1.0 / 1.5)
    assert worn_strength(0.5 * drift, **sizes) == pytest.approx(1.0 / (1.0 + 0.5 * 0.5**3.0))


def test_a_new_drift_wears_more_than_one_that_is_repeated():
    """With a large exponent the loss follows the largest drift, as no law of path does."""
    sizes = {"nu_a": 0.5, "q_nu": 9.0, "s_nu": 1.0, "N_nu": 15.0, "u_nu": 0.8}
    once, thrice, larger = ([0.4, -0.4], [0.4, -0.4] * 3, [0.4, -0.4, 0.8, -0.8])
    left = [force(StrengthDegradation(**sizes), cycles=cycles)[-1] for cycles in (once, thrice, larger)]
    whole = [force(cycles=cycles)[-1] for cycles in (once, thrice, larger)]
    lost = [1.0 - own / other for own, other in zip(left, whole, strict=True)]
    assert lost[0] < lost[1] < 1.25 * lost[0]
    assert lost[2] > 1.5 * lost[0]


def test_all_that_goes_with_the_path_shares_one_state():
    effects = (StiffnessDegradation(theta_eta=0.1), StrengthDegradation(nu_c=0.2, a_nu=1.0, r_nu=0.8, U_nu=3.0))
    law = combine(BoucWen(k=10.0, beta=2.0, gamma=2.0).parameters, (), effects)
    assert law.states == (HYSTERETIC_DISPLACEMENT, ENERGY, PATH)
    assert law.rates[2] == sp.Abs(DRIFT_RATE)


def test_sizes_by_hand():
    """What is left of stiffness and strength in the end, shared among four cycles."""
    path = cyclic_test(CYCLES, 60).excitation
    histories = {"drift": path, "hysteretic_energy": np.linspace(0.0, 5.0, len(path))}
    values = {"eta_inf": 0.6, "p_eta": 0.3, "nu_inf": 0.9, "p_nu": 0.2, "n": 1.5, "theta_eta": 0.05, "theta_nu": 0.04}
    at = PlaceResponse(histories=histories, parameters=values, scales=NOMINAL)
    kept = {
        StiffnessDegradation: 1.0 / (1.0 + 0.6 * (1.0 - math.exp(-0.3 * 5.0))),
        StrengthDegradation: (1.0 + 0.9 * (1.0 - math.exp(-0.2 * 5.0))) ** (-1.0 / 1.5),
    }
    gone_through = 15 * 0.8  # out, and back to the other side seven times
    by_path = {
        StiffnessDegradation: 1.0 / (1.0 + 0.05 * gone_through),
        StrengthDegradation: (1.0 + 0.04 * gone_through) ** (-1.0 / 1.5),
    }
    for number, shares in ((1, kept), (2, by_path)):
        for effect_class, share in shares.items():
            size = effect_class.neutral_forms()[number].signature.size
            assert size is not None
            assert size(at) == pytest.approx(1.0 - share**0.25)


@pytest.mark.parametrize("negative", [-1.25, -1.5])
def test_a_gain_without_bound_is_a_size(negative):
    """A loss so negative that its factor is gone is no complex number, and no error: it was, in a blind case."""
    at = PlaceResponse(
        histories={"drift": cyclic_test(CYCLES, 60).excitation, "hysteretic_energy": np.array([0.0, 0.8])},
        parameters={"delta_eta": negative, "delta_nu": negative, "n": 1.3},
        scales=NOMINAL,
    )
    for effect_class in (StiffnessDegradation, StrengthDegradation):
        signature = effect_class.neutral_forms()[0].signature
        assert signature.size is not None
        assert signature.size(at) == -np.inf
        assert signature.is_engineering(at)
