"""The missing force: learned where it is a function of the state, not learned where it is not."""

from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.evidence import Evidence
from bwbn_bayes.discovery.name import Candidate
from bwbn_bayes.discovery.unexplained import unexplained
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness
from bwbn_bayes.engines.available import engine
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import Normal, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

MASSES = (2.0, 1.0)
MODEL = ShearBuilding(masses=MASSES, storey=BoucWen(k=Uniform(20, 100), c=0.3, alpha=0.1, beta=8.0, gamma=2.0, n=1.3))
POINT = np.array([0.5])
NOISE = 0.02
ENGINE = engine("reference")


def simulated(duration=20.0):
    """What the model at POINT measures, drifts and drift rates included, on one ground motion."""
    ground = el_centro("chopra", duration=duration)
    names = ("acceleration_1", "acceleration_2", "drift_1", "drift_2")
    values = ENGINE.simulate(MODEL, MODEL.space.from_unit(POINT[None]), ground, names).values[0]
    return ground, dict(zip(names, values, strict=True))


def posterior_with(ground, histories, missing, rng, floors=(1, 2)):
    """Accelerations with a further force ``missing (n_times,)`` in the second storey that the drifts do not feel.

    The sum ``m_2 a_2`` is the force of storey 2, and ``m_1 a_1 + m_2 a_2`` that of storey 1, which stays as it is.
    """
    shifts = {1: missing / MASSES[0], 2: -missing / MASSES[1]}
    channels = {
        f"acceleration_{i}": histories[f"acceleration_{i}"] + shifts[i] + NOISE * rng.standard_normal(len(missing))
        for i in floors
    }
    record = replace(ground, channels=channels)
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))


def test_a_force_of_the_state_is_learned_and_its_map_is_right():
    ground, histories = simulated()
    drift = histories["drift_2"]
    peak = float(np.max(np.abs(drift)))
    missing = 1.5 * (drift / peak) ** 3
    rng = np.random.default_rng(3)
    found = unexplained(posterior_with(ground, histories, missing, rng), POINT, (), rng)
    one, two = found.forces
    assert (one.storey, two.storey) == (1, 2)
    assert two.share > 0.8
    assert one.share < 0.2
    # Over the whole record the noise has 1 % of the missing force's energy.
    assert 0.0 < two.noise_share < 0.02
    seen = np.isfinite(two.force)
    truth = np.broadcast_to(1.5 * (two.drift[:, None] / peak) ** 3, two.force.shape)
    assert np.corrcoef(two.force[seen], truth[seen])[0, 1] > 0.9
    # The penalty flattens the rarely visited ends, where the force is largest.
    slope = np.mean(two.force[seen] * truth[seen]) / np.mean(truth[seen] ** 2)
    assert slope == pytest.approx(0.8, abs=0.25)


def test_a_force_that_is_no_function_of_the_state_is_not():
    ground, histories = simulated()
    rng = np.random.default_rng(4)
    missing = np.convolve(rng.standard_normal(ground.n_times), np.ones(12), mode="same") * 0.1
    found = unexplained(posterior_with(ground, histories, missing, rng), POINT, (), rng)
    assert found.forces[1].share < 0.2


def test_a_storey_below_a_floor_without_sensor_is_left_out():
    ground, histories = simulated(6.0)
    rng = np.random.default_rng(5)
    missing = histories["drift_2"] ** 2
    only_roof = unexplained(posterior_with(ground, histories, missing, rng, floors=(2,)), POINT, (), rng)
    assert [force.storey for force in only_roof.forces] == [2]
    only_first = unexplained(posterior_with(ground, histories, missing, rng, floors=(1,)), POINT, (), rng)
    assert only_first.forces == ()


def test_a_near_miss_is_told_with_its_share_and_colour():
    """At its neutral value an effect explains nothing, and leaves the residual as it is."""
    ground, histories = simulated(8.0)
    rng = np.random.default_rng(6)
    posterior = posterior_with(ground, histories, 20.0 * histories["drift_2"], rng)
    hypothesis = Hypothesis(base=MODEL, effect=CubicStiffness(k3=Normal(0.0, 10.0)), storeys=(2,), scales=None)
    means = dict(zip(hypothesis.model.space.names, [60.0, 0.0], strict=True))
    evidence = Evidence(
        log_likelihood=0.0, log_evidence=0.0, log_evidence_se=0.1, pareto_k=None, coloured_gain=0.0,
        means=means, sds={}, prior_shifts={},
    )  # fmt: skip
    candidate = Candidate(
        hypothesis=hypothesis, evidence=evidence, log_prior_odds=-3.0, log_bayes_factor=4.0, log_bayes_factor_se=0.1
    )
    (near,) = unexplained(posterior, POINT, (candidate, candidate), rng).nearest
    assert near.share == 0.0
    assert near.correlation > 0.5
    assert near.log_odds == 1.0
    assert "cubic_stiffness, storey 2 explains 0 %" in near.sentence
    assert "coloured" in near.sentence
    assert "do not reach 8" in near.sentence
