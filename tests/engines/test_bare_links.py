"""Where nothing acts on a link but its element, it is solved as if the law had nothing else."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from engine_cases import TIME_STEP, record_of

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import (
    Appendage,
    CoulombFriction,
    CubicStiffness,
    MassError,
    StoreyCoupling,
    SuddenDamage,
)
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.search_guide import guide_of, is_sought
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.parameters import PerStorey, Uniform
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

STOREY = BoucWen(k=PerStorey(Uniform(30, 50)), c=0.1, alpha=0.05, beta=2.0, gamma=1.0, n=Uniform(1, 2))
LINK_EFFECTS = [
    effect
    for kind in registered()
    if kind.level == "link" and "bouc_wen" in kind.elements
    for effect in (*kind.neutral_forms(), *(guide_of(kind).free_shapes(NOMINAL) if is_sought(kind) else ()))
    if not (isinstance(effect, SuddenDamage) and effect.parameter not in {p.symbol for p in STOREY.parameters})
]


def _building(*effects: tuple[Effect, tuple[int, ...]]) -> Structure:
    model: Structure = ShearBuilding(masses=[1.0, 1.0, 1.0], storey=STOREY)
    for effect, storeys in effects:
        model = model.with_effect(effect, storeys=list(storeys) or None)
    return model


@pytest.mark.parametrize("effect", LINK_EFFECTS, ids=lambda one: f"{one.name}-{one.form}")
def test_a_bare_link_has_the_law_of_its_element(effect: Effect) -> None:
    """By the law that is made without the effect, at states and parameters drawn at random."""
    element = combine(STOREY.parameters, (), (), STOREY.derived)
    law = combine(STOREY.parameters, (), (effect,), STOREY.derived)
    assert element.bare is None
    assert law.bare is not None
    symbols = sorted({one for own in (element.force, *element.rates) for one in own.free_symbols}, key=str)
    assert {one for own in law.bare for one in own.free_symbols} <= set(symbols)
    rng = np.random.default_rng(1)
    for expected, found in zip((element.force, *element.rates), law.bare, strict=True):
        at = rng.uniform(0.1, 2.0, (len(symbols), 8))
        np.testing.assert_allclose(
            sp.lambdify(symbols, found)(*at), sp.lambdify(symbols, expected)(*at), rtol=1e-12, atol=0.0
        )


def test_which_links_are_bare() -> None:
    cubic = CubicStiffness(k3=5.0)
    assert _building((cubic, (2,))).bare == (True, False, True)
    assert _building((CubicStiffness(k3=Uniform(0, 9)), (2, 3))).bare == (True, False, False)
    assert _building((MassError(e_m=0.1), (2,)), (Appendage(mu_t=0.1, f_t=1.0, zeta_t=0.05), (3,))).bare == (True,) * 3
    (coupling, *_) = guide_of(StoreyCoupling).priors(NOMINAL)
    assert _building((coupling, ()), (cubic, (1,))).bare == (False,) * 3


@pytest.mark.parametrize("single", [False, True])
def test_a_bare_link_moves_as_one_whose_effects_are_neutral(single: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Response and derivatives, beside the same law with all that it has on every link."""
    model = _building(
        (CubicStiffness(k3=Uniform(1, 9)), (2,)), (CoulombFriction(F_c=2.0, x0=0.01, smoothing="dahl"), (3,))
    )
    record = record_of(model, 4.0)
    assert record.time_step == TIME_STEP
    draws = model.space.from_unit(model.space.sample_unit(np.random.default_rng(2), 3))
    engine = Lanes(substeps=4, n_threads=1, single=single)
    bare, slopes = engine.sensitivities(model, draws, record)
    monkeypatch.setattr(Structure, "bare", (False, False, False))
    whole, slopes_of_whole = engine.sensitivities(
        _building(*((p.effect, p.storeys) for p in model.effects)), draws, record
    )
    tolerance = 2e-4 if single else 1e-9
    np.testing.assert_allclose(bare.values, whole.values, rtol=0.0, atol=tolerance * np.max(np.abs(whole.values)))
    most = np.max(np.abs(slopes_of_whole), axis=(0, 2, 3), keepdims=True)
    assert np.max(np.abs(slopes - slopes_of_whole) / np.where(most > 0.0, most, 1.0)) < tolerance
