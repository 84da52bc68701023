"""What the usual form of an effect leaves is taken up by its form of free shape, not by a second effect."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.discovery import search as searching
from bwbn_bayes.discovery.candidates import hypotheses, scales_of
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, GapImpact, StiffnessDegradation
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Normal, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

GROUND = el_centro("chopra", duration=10.0)
SPRING = {"k": 60.0, "c": 0.4, "alpha": 0.15, "beta": 12.0, "gamma": 2.0, "n": 1.3}
MASS, SD = 2.0, 0.05
LOSS, POWER, WORK = 1.5, 2.0, 0.35
"""``eta = 1 + LOSS (epsilon/WORK)^POWER``: no form of the catalogue. [1], [1], [J]"""
FORCE, HARDENING, DRIFT = 2.0, 5.0, 0.1
"""``FORCE (u/DRIFT)^HARDENING``: neither is this; a stop comes nearer to it than a cubic spring. [N], [1], [m]"""


def response(ground: Floats, dt: float, *, loss: float = 0.0, spring: float = 0.0, n_steps: int = 16) -> Floats:
    """Total acceleration [m/s^2] of one storey by Runge and Kutta.

    Its stiffness falls by a power of the work, or a spring stands beside it that hardens by a power of the drift.
    """
    k, c, alpha, beta, gamma, n = SPRING.values()

    def rates(y: Floats, a_g: float) -> tuple[Floats, float]:
        u, v, z, eps = y
        eta = 1.0 + loss * (abs(eps) / WORK) ** POWER
        hardening = spring * np.sign(u) * (abs(u) / DRIFT) ** HARDENING
        total = -(alpha * k * u + (1.0 - alpha) * k * z + c * v + hardening) / MASS
        slope = (1.0 - abs(z) ** n * (beta * np.sign(z * v) + gamma)) / eta
        return np.array([v, total - a_g, slope * v, (1.0 - alpha) * k * z * v]), total

    y, h = np.zeros(4), dt / n_steps
    shown = [rates(y, ground[0])[1]]
    for left, right in pairwise(ground):
        for i in range(n_steps):
            at = [float(left + (right - left) * (i + share) / n_steps) for share in (0.0, 0.5, 1.0)]
            k1 = rates(y, at[0])[0]
            k2 = rates(y + 0.5 * h * k1, at[1])[0]
            k3 = rates(y + 0.5 * h * k2, at[1])[0]
            k4 = rates(y + h * k3, at[2])[0]
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        shown.append(rates(y, float(right))[1])
    return np.array(shown)


@pytest.fixture(scope="module")
def pool() -> Pool:
    """The model as given, and with the best usual form of the effect that is hidden."""
    clean = response(GROUND.excitation, GROUND.time_step, loss=LOSS)
    measured = clean + SD * np.random.default_rng(5).standard_normal(len(clean))
    record = GROUND.with_channels({"acceleration_1": measured})
    plain = ShearBuilding(masses=[MASS], storey=BoucWen(**{**SPRING, "k": Normal(60.0, 6.0)}))
    present = Posterior(model=plain, record=record, engine=Lanes(substeps=4, n_threads=1), noise=KnownNoise(sd=(SD,)))
    run = Run(DiscoverySettings(effects=(StiffnessDegradation,), n_workers=1), np.random.default_rng(1), None)
    given = fitted(present, np.full((1, 1), 0.5))
    scales = scales_of(present, given.best)
    run.consider(hypotheses(plain, scales, measured=("acceleration_1",), effects=run.settings.effects))
    made = Pool(run=run)
    made.add([given])
    for one in run.considered_first:
        added = searching.rebuilt(SimpleNamespace(is_specimen=False, model=plain), (one,), run)  # type: ignore[arg-type]
        made.add([fitted(present.with_model(added[-1].model), added[-1].starts(given.points), added)])
    return made


def fitted(posterior: Posterior, points: Floats, added: Any = ()) -> Explanation:
    modes = distinct(*polish(posterior, points, n_iterations=30))
    return Explanation(added=added, posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


def test_a_loss_by_a_power_of_work_is_named_alone(pool: Pool) -> None:
    usual = pool.laws.best
    assert usual.names == {"stiffness_degradation"}
    assert not usual.is_quiet
    found = searching._reshaped(pool, pool.run)
    assert [one.added[0].effect.form for one in found] == ["free shape", "free shape, with the path"]
    pool.add(found)
    best = pool.laws.best
    assert best is found[0]
    assert best.is_quiet
    assert best.evidence.log_evidence > usual.evidence.log_evidence + 10.0
    assert pool.beliefs.names["stiffness_degradation"] > 0.99


def test_a_form_is_tried_on_a_base_once(pool: Pool) -> None:
    searching._reshaped(pool, pool.run)
    assert searching._reshaped(pool, pool.run) == []


def test_a_name_shares_its_prior_over_its_forms_of_free_shape_too(pool: Pool) -> None:
    """Each usual form and the free one, once at every place: what is tried later is no gift."""
    # Linear, saturating, with the amplitude; free with the work and with the path.
    assert pool.run.variants["stiffness_degradation"] == 5
    usual = {h.symbols for h in pool.run.considered_first}
    assert len(usual) == 3


def test_what_lies_nearest_in_its_usual_form_is_not_named_for_that() -> None:
    """A spring of the fifth power: a stop comes nearer to it than a cubic one, until both may take a free shape."""
    clean = response(GROUND.excitation, GROUND.time_step, spring=FORCE)
    measured = clean + SD * np.random.default_rng(6).standard_normal(len(clean))
    storey = BoucWen(**{**SPRING, "k": Uniform(30.0, 90.0), "beta": Uniform(4.0, 30.0)})
    plain = ShearBuilding(masses=[MASS], storey=storey)
    settings = DiscoverySettings(effects=(CubicStiffness, GapImpact), n_workers=1, particles=100, most_effects=1)
    found = discover(plain, GROUND.with_channels({"acceleration_1": measured}), settings=settings)
    usual = {
        one.added[0].name: one.evidence.log_evidence
        for one in found.steps[-1].explanations
        if one.unnamed is None and [own.effect.form for own in one.added] in ([""], ["two-sided"])
    }
    assert usual["gap_impact"] > usual["cubic_stiffness"]
    assert [one.hypothesis.name for one in found.added] == ["cubic_stiffness"]
    assert found.probabilities["cubic_stiffness"] > 0.9
