"""What OpenSees has no law for: a material fitted to the loop, with the error that the script then shows."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import run_script

from bwbn_bayes import (
    Asymmetry,
    BoucWen,
    CubicStiffness,
    FolientePinching,
    FrictionPendulum,
    Record,
    ShearBuilding,
    SlipLock,
    Specimen,
    StrengthDegradation,
    UserError,
    el_centro,
    simulate,
)
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.export import fitted, of_model, script_of
from bwbn_bayes.export.exportable import Link
from bwbn_bayes.export.laws import Material

STOREY = BoucWen(k=1e3, alpha=0.05, u_y=0.012, rho=0.6, n=1.5)
PINCH = FolientePinching(zeta_s=0.8, p=0.5, q=0.2, psi_0=0.005, delta_psi=0.0, lambda_=0.3)
LOSS = StrengthDegradation(delta_nu=0.05)


def cycles() -> Record:
    at = np.linspace(0.0, 6.0, 481)
    path = 0.05 * np.sin(2.0 * np.pi * at) * np.minimum(1.0, 0.3 + at / 6.0)
    return Record(name="cycles", time_step=0.02, excitation=path, excitation_kind="displacement")


@pytest.mark.parametrize(
    ("effects", "words", "largest"),
    [
        ((SlipLock(delta_s=0.004, sigma=0.004), CubicStiffness(k3=2e5)), "slip-lock: BWBN", 0.02),
        ((PINCH, LOSS), "Foliente's pinching of a spring that degrades: BWBN", 0.05),
        ((Asymmetry(phi=150.0),), "asymmetry: Pinching4", 0.12),
    ],
)
def test_the_fit_is_near_and_the_script_has_the_error_it_states(
    effects: tuple[Effect, ...], words: str, largest: float, tmp_path: Path
) -> None:
    """OpenSees, in a process of its own, misses what the script says it misses."""
    model = Specimen(storey=STOREY)
    for effect in effects:
        model = model.with_effect(effect)
    script = script_of(of_model(model, cycles(), {}, name="specimen"))
    (link,) = script.links
    assert link.error is not None
    assert link.error < largest
    assert words in script.notes[0]
    assert f"misses {100.0 * link.error:.2g} % of the loop's force" in script.notes[0]
    path = tmp_path / "fitted.py"
    path.write_text(script.text, encoding="utf-8")
    assert f"{100.0 * link.error:.2g} %" in script.text
    found = run_script(path)["force"]
    truth = np.array(simulate(model, cycles(), {}).channels["force"])
    # A spring that is told exactly stands beside the fit, which is measured on the rest of the force.
    k3 = next((effect.k3 for effect in effects if isinstance(effect, CubicStiffness)), 0.0)
    rest = truth - k3 * cycles().excitation ** 3
    missed = np.sqrt(np.mean((found - truth) ** 2) / np.mean(rest**2))
    assert missed == pytest.approx(link.error, rel=0.1)  # the script's steps are not quite those of the fit


def test_a_building_with_a_fitted_storey_runs(tmp_path: Path) -> None:
    """A fit within one per cent of the loop's force leaves the floors within one in ten here."""
    storey = BoucWen(k=900.0, c=2.0, alpha=0.05, u_y=0.012, rho=0.6, n=1.5)
    model = ShearBuilding(masses=[4.0, 4.0], storey=storey).with_effect(SlipLock(delta_s=0.003, sigma=0.004), [1])
    record = el_centro("chopra", duration=8.0)
    script = script_of(of_model(model, record, {}, name="two"))
    assert [link.error is None for link in script.links] == [False, True]
    path = tmp_path / "two.py"
    path.write_text(script.text, encoding="utf-8")
    found, truth = run_script(path), simulate(model, record, {}).channels
    for name in ("acceleration_1", "acceleration_2"):
        assert np.sqrt(np.mean((found[name] - truth[name]) ** 2) / np.mean(truth[name] ** 2)) < 0.1


def test_a_loop_that_does_not_move_cannot_be_fitted() -> None:
    still = Record(name="still", time_step=0.02, excitation=np.zeros(20), excitation_kind="displacement")
    model = Specimen(storey=STOREY).with_effect(SlipLock(delta_s=0.004, sigma=0.004))
    with pytest.raises(UserError, match="The specimen does not move"):
        script_of(of_model(model, still, {}, name="still"))


def test_without_openseespy_one_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openseespy.opensees", None)
    model = Specimen(storey=STOREY).with_effect(SlipLock(delta_s=0.004, sigma=0.004))
    with pytest.raises(UserError, match="install openseespy"):
        script_of(of_model(model, cycles(), {}, name="x"))


def test_a_fit_follows_a_path_of_bounded_length_however_small_z_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an isolated building, whose contact yields at half a millimetre, a fit followed more than 100,000 steps."""
    lengths = []

    def smooth(_ops: object, _link: Link, path: fitted._Path) -> tuple[Material]:
        lengths.append(len(path.strains))
        return (Material(kind="Elastic", arguments=(1.0,), says=""),)

    monkeypatch.setattr(fitted, "_smooth", smooth)
    monkeypatch.setattr(fitted, "_pinching4", lambda *_: Material(kind="Elastic", arguments=(1.0,), says=""))
    slider = FrictionPendulum(W=2e5, R=1.5, mu_slow=0.05, mu_fast=0.1, a_mu=20.0, Y=0.0005)
    record = replace(cycles(), excitation=5.0 * cycles().excitation)
    script_of(of_model(Specimen(storey=slider), record, {}, name="slider"))
    assert lengths[0] < 11_000
