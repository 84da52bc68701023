"""The independent simulator: closed forms, the reference engine for the plain law, convergence, neutral effects."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from benchmarks.blind import make_hidden_effect
from benchmarks.blind.catalogue_draws import CATALOGUE
from benchmarks.blind.draws import Dice, Hidden, Place, reached
from benchmarks.blind.more_forms import MORE_FORMS
from benchmarks.blind.other_draws import FORMS, OUTSIDE
from benchmarks.blind.simulator import STEPS_PER_SAMPLE, Building, Floats, Whole, respond
from benchmarks.blind.storey import Storey
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects.backlash import Backlash
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.records import el_centro, filtered_noise, read_csv
from bwbn_bayes.structures.model_file import load_model_file

ROOT = Path(__file__).parents[2]
GROUND = el_centro("chopra", scale=2.0, duration=6.0)
K, C = (34.0, 22.0, 28.0), (0.3, 0.15, 0.2)
SHARED = {"alpha": 0.12, "beta": 3.0, "gamma": 1.0, "n": 1.7}
BASE = Building(storeys=tuple(Storey(k=k, c=c, **SHARED) for k, c in zip(K, C, strict=True)))
EVERY = {**CATALOGUE, **FORMS, **MORE_FORMS, **OUTSIDE}


def nrmse(found: Floats, expected: Floats) -> float:
    return float(np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2)))


def drawn(name: str) -> Hidden:
    motion = respond(BASE, GROUND.excitation, GROUND.time_step, 8)
    at = reached(BASE, motion, GROUND.excitation, GROUND.time_step, 2)
    return EVERY[name](Place(dice=Dice(rng=np.random.default_rng(3)), at=at, building=BASE, storey=2))


def test_no_equation_comes_from_the_package() -> None:
    for path in (ROOT / "benchmarks" / "blind").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            own = [name for name in names if name.startswith("bwbn_bayes")]
            assert all(name == "bwbn_bayes.records" for name in own), (path.name, own)


def test_the_linear_building_follows_the_matrix_exponential() -> None:
    shared = {"alpha": 0.3, "beta": 0.0, "gamma": 0.0, "n": 1.0}
    linear = Building(storeys=tuple(Storey(k=k, c=c, **shared) for k, c in zip(K, C, strict=True)))
    dt, ground = GROUND.time_step, GROUND.excitation

    def tridiagonal(values: tuple[float, ...]) -> Floats:
        v = np.array(values)
        return np.diag(v + np.append(v[1:], 0.0)) - np.diag(v[1:], 1) - np.diag(v[1:], -1)

    stiffness, damping = tridiagonal(K), tridiagonal(C)
    # x, x', ground acceleration and its slope: exact for an input that is linear between samples.
    system = np.zeros((8, 8))
    system[:3, 3:6] = np.eye(3)
    system[3:6, :3], system[3:6, 3:6], system[3:6, 6], system[6, 7] = -stiffness, -damping, -1.0, 1.0
    step, state, totals = expm(system * dt), np.zeros(8), []
    for j, a in enumerate(ground):
        state[6] = a
        state[7] = (ground[j + 1] - a) / dt if j + 1 < len(ground) else 0.0
        totals.append(-stiffness @ state[:3] - damping @ state[3:6])
        state = step @ state
    assert nrmse(respond(linear, ground, dt).measured, np.array(totals).T) < 1e-9


def test_the_plain_law_is_that_of_the_reference_engine() -> None:
    model = load_model_file(ROOT / "models" / "plain_three_storey.py").model
    truth = {f"{name}[{i}]": v for name, values in (("k", K), ("c", C)) for i, v in enumerate(values, start=1)} | SHARED
    channels = [f"acceleration_{i}" for i in (1, 2, 3)]
    expected = Reference().simulate(model, model.draws(truth), GROUND, channels).values[0]
    assert nrmse(respond(BASE, GROUND.excitation, GROUND.time_step).measured, expected) < 1e-6


def test_the_play_is_that_of_the_reference_engine() -> None:
    """Under many small cycles: a play that creeps at its sides is far off after half a minute."""
    b = 0.004
    ground = filtered_noise(np.random.default_rng(4), 30.0, 0.02, peak=3.0)
    storeys = (BASE.storeys[0], replace(BASE.storeys[1], b=b), BASE.storeys[2])
    measured = respond(Building(storeys=storeys), ground.excitation, ground.time_step).measured
    model = load_model_file(ROOT / "models" / "plain_three_storey.py").model
    model = model.with_effect(Backlash(b=b, w=b / 40.0), storeys=(2,))
    truth = {f"{name}[{i}]": v for name, values in (("k", K), ("c", C)) for i, v in enumerate(values, start=1)} | SHARED
    channels = [f"acceleration_{i}" for i in (1, 2, 3)]
    expected = Reference().simulate(model, model.draws(truth), ground, channels).values[0]
    assert nrmse(measured, expected) < 0.05


def test_names_and_parameters_are_those_of_the_catalogue() -> None:
    known: dict[str, set[str]] = {}
    for effect in registered():
        for form in effect.neutral_forms():
            known.setdefault(effect.name, set()).update(p.symbol for p in form.parameters)
    assert set(CATALOGUE) <= set(known)
    for name in CATALOGUE:
        hidden = drawn(name)
        assert (hidden.name, hidden.accepted) == (name, (name,))
        assert set(hidden.parameters) <= known[name]
        assert hidden.parameters
    assert all(set(drawn(name).accepted) <= set(CATALOGUE) for name in (*FORMS, *MORE_FORMS))
    assert all(drawn(name).why for name in MORE_FORMS)
    assert not any(set(drawn(name).accepted) & set(CATALOGUE) for name in OUTSIDE)


@pytest.mark.parametrize("name", EVERY)
def test_the_step_is_fine_enough_for_every_effect(name: str) -> None:
    building = drawn(name).inside(BASE)
    coarse, fine = (
        respond(building, GROUND.excitation, GROUND.time_step, steps).measured
        for steps in (STEPS_PER_SAMPLE, 4 * STEPS_PER_SAMPLE)
    )
    assert np.isfinite(fine).all()
    # The sides of the play are met between steps: first order, and far below any noise drawn.
    assert nrmse(coarse, fine) < (2e-4 if name == "backlash" else 1e-5)


@pytest.mark.parametrize("name", EVERY)
def test_an_effect_of_its_size_changes_the_response_and_of_size_zero_does_not(name: str) -> None:
    hidden = drawn(name)
    plain = respond(BASE, GROUND.excitation, GROUND.time_step, 8).measured
    assert nrmse(respond(hidden.inside(BASE), GROUND.excitation, GROUND.time_step, 8).measured, plain) > 1e-4
    neutral = {item.name: item.default for item in fields(Storey)} | {item.name: item.default for item in fields(Whole)}
    # What an effect brings besides its size (a width, a time, a gap) stays as drawn.
    size = next(iter({**hidden.storey_values, **hidden.whole_values}))
    values = {size: getattr(BASE.storeys[1], size)} if size in SHARED else {size: neutral[size]}
    absent = replace(
        hidden,
        storey_values={**hidden.storey_values, **(values if hidden.storeys else {})},
        whole_values={**hidden.whole_values, **({} if hidden.storeys else values)},
    )
    np.testing.assert_array_equal(respond(absent.inside(BASE), GROUND.excitation, GROUND.time_step, 8).measured, plain)


def test_the_shipped_records_are_what_their_script_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make_hidden_effect, "FOLDER", tmp_path)
    make_hidden_effect.main()
    for name in ("hidden_effect", "hidden_effect_held_out"):
        shipped, made = read_csv(ROOT / "models" / f"{name}.csv"), read_csv(tmp_path / f"{name}.csv")
        assert shipped.provenance == made.provenance
        assert list(shipped.channels) == list(made.channels)
        np.testing.assert_allclose(shipped.excitation, made.excitation, atol=2e-5)
        for channel, values in made.channels.items():
            # Another processor may round the last digit written another way.
            np.testing.assert_allclose(shipped.channels[channel], values, atol=2e-5)
        text = (ROOT / "models" / f"{name}.csv").read_text(encoding="utf-8")
        assert not shipped.truth
        assert not any(word in text.partition("time [s]")[0] for word in ("slip", "sigma", "delta_s", "true "))
