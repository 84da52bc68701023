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
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import StiffnessDegradation
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Normal
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

GROUND = el_centro("chopra", duration=10.0)
SPRING = {"k": 60.0, "c": 0.4, "alpha": 0.15, "beta": 12.0, "gamma": 2.0, "n": 1.3}
MASS, SD = 2.0, 0.05
LOSS, POWER, WORK = 1.5, 2.0, 0.35
"""``eta = 1 + LOSS (epsilon/WORK)^POWER``: no form of the catalogue. [1], [1], [J]"""


def worn_response(ground: Floats, dt: float, n_steps: int = 16) -> Floats:
    """Total acceleration [m/s^2] of one storey whose stiffness falls by a power of the work, by Runge and Kutta."""
    k, c, alpha, beta, gamma, n = SPRING.values()

    def rates(y: Floats, a_g: float) -> tuple[Floats, float]:
        u, v, z, eps = y
        eta = 1.0 + LOSS * (abs(eps) / WORK) ** POWER
        total = -(alpha * k * u + (1.0 - alpha) * k * z + c * v) / MASS
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
    clean = worn_response(GROUND.excitation, GROUND.time_step)
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
    usual = pool.laws_alone.best
    assert usual.names == {"stiffness_degradation"}
    assert not usual.is_noise
    found = searching._reshaped(pool, pool.run)
    assert [one.added[0].effect.form for one in found] == ["free shape"]
    pool.add(found)
    best = pool.laws_alone.best
    assert best is found[0]
    assert best.is_noise
    assert best.evidence.log_evidence > usual.evidence.log_evidence + 10.0
    assert pool.beliefs.names["stiffness_degradation"] > 0.99


def test_a_form_is_tried_on_a_base_once(pool: Pool) -> None:
    searching._reshaped(pool, pool.run)
    assert searching._reshaped(pool, pool.run) == []


def test_a_name_shares_its_prior_over_its_forms_of_free_shape_too(pool: Pool) -> None:
    """Each usual form and the free one, once at every place: what is tried later is no gift."""
    assert pool.run.variants["stiffness_degradation"] == 3  # linear, saturating and free, in the only storey
    usual = {h.symbols for h in pool.run.considered_first}
    assert len(usual) == 2
