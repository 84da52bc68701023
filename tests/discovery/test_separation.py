"""The experiment that would separate two explanations, on a linear building where each one's difference is known."""

import numpy as np
import pytest

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.discovery.separation import separating_experiment
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, SensorBias, SensorGain
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import guide_of
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.residuals import noise_floors
from bwbn_bayes.parameters import Floats, Normal, PerStorey, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

GROUND = el_centro("chopra", duration=12.0)
CHANNELS = ("acceleration_1", "acceleration_2")
SCALES = Scales(**dict.fromkeys(Scales.__dataclass_fields__, 1.0))
PERIOD = 0.86
"""Of the building below, at its first stiffness of 150 N/m. [s]"""
GAIN = Normal(1.0, 0.1)


def building(damping: float) -> ShearBuilding:
    """With alpha 1 the storey force is ``k u + c v``: a linear building."""
    linear = BoucWen(k=PerStorey([Uniform(100, 200), 120.0]), c=damping, alpha=1.0, beta=1.0, gamma=0.0, n=1.0)
    return ShearBuilding(masses=[1.0, 1.0], storey=linear)


def response(model: ShearBuilding, ground: Floats) -> Floats:
    """Without the effects, by the reference engine, at a first stiffness of 150 N/m."""
    record = Record(name="", time_step=GROUND.time_step, excitation=ground)
    return Reference().simulate(model, np.array([[150.0]]), record, CHANNELS).values[0]


def measured(model: ShearBuilding) -> Record:
    clean = response(model, GROUND.excitation)
    noise = 0.05 * np.random.default_rng(1).standard_normal(clean.shape)
    return GROUND.with_channels(dict(zip(CHANNELS, clean + noise, strict=True)))


def fit(model: Structure, record: Record, effect: Effect, floor: int, value: float) -> Fit:
    """A hypothesis that ended at a first stiffness of 150 N/m and a value of its own."""
    hypothesis = Hypothesis(base=model, effect=effect, storeys=(floor,), scales=SCALES, guide=guide_of(type(effect)))
    engine = Lanes(substeps=2, n_threads=1)
    posterior = Posterior(model=hypothesis.model, record=record, engine=engine, noise=default_noise(record))
    points = posterior.space.to_unit(np.array([[150.0, value]]))
    return Fit(hypothesis=hypothesis, posterior=posterior, points=points, local=posterior.linearise(points))


def distance(record: Record, difference: Floats) -> float:
    """Root mean square of a difference ``(2, n_times)`` over the noise of each channel."""
    noise = noise_floors(record.select(CHANNELS))[:, None]
    return float(np.sqrt(np.mean(np.square(difference / noise))))


def growing_sine(record: Record) -> Floats:
    """At the period given, growing over twelve cycles to half the peak of the ground motion."""
    peak = 0.5 * np.max(np.abs(record.excitation))
    times = record.time_step * np.arange(record.n_times)
    return peak * np.minimum(times / (12.0 * PERIOD), 1.0) * np.sin(2.0 * np.pi * times / PERIOD)


@pytest.mark.parametrize(("damping", "winner"), [(20.0, "The same ground motion at 2 times"), (0.1, "A sine at")])
def test_of_two_gains_the_strongest_motion_tells_most(damping: float, winner: str) -> None:
    """Gains of 1.1 at floor 1 and 0.9 at floor 2 predict a tenth of each floor's motion apart, whatever the motion."""
    model = building(damping)
    record = measured(model)
    first, second = (fit(model, record, SensorGain(gain=GAIN), f, v) for f, v in ((1, 1.1), (2, 0.9)))
    expected = {
        "The same ground motion at 2 times": distance(record, 0.1 * response(model, 2.0 * GROUND.excitation)),
        "A sine at": distance(record, 0.1 * response(model, growing_sine(record))),
    }
    assert max(expected, key=lambda name: expected[name]) == winner
    sentence = separating_experiment(first, second, PERIOD)
    assert sentence.startswith(winner)
    assert "would tell sensor_gain from sensor_gain" in sentence
    assert sentence.endswith(f"predictions lie {expected[winner]:.1f} times the noise apart.")


def test_a_sine_is_told_with_its_period_and_its_peak() -> None:
    model = building(0.1)
    record = measured(model)
    pair = [fit(model, record, SensorGain(gain=GAIN), 1, value) for value in (1.1, 0.9)]
    peak = 0.5 * np.max(np.abs(GROUND.excitation))
    expected = f"A sine at the first period of 0.86 s that grows to {peak:.2g} m/s^2 would tell"
    assert separating_experiment(*pair, PERIOD).startswith(expected)


def test_of_predictions_that_run_away_no_number_is_told() -> None:
    """A reading five times the other under every motion: "145360118722.2 times the noise apart" was said once."""
    model = building(5.0)
    record = measured(model)
    sentence = separating_experiment(
        *(fit(model, record, SensorGain(gain=Uniform(0.0, 10.0)), 1, value) for value in (1.0, 6.0)), PERIOD
    )
    assert sentence.endswith("one of the predictions runs away.")


def test_a_motion_that_a_model_cannot_survive_is_no_experiment() -> None:
    """A spring that softens with the cube of the drift holds the record; under stronger motion it runs away."""
    model = building(5.0)
    record = measured(model)
    drift = Reference().simulate(model, np.array([[150.0]]), GROUND, ("drift_1",)).values[0, 0]
    # Beyond sqrt(k / |k3|) the storey pushes outwards: at 1.4 times the largest drift without the spring.
    k3 = -150.0 / (1.4 * np.max(np.abs(drift))) ** 2
    soft = fit(model, record, CubicStiffness(k3=Normal(0.0, abs(k3))), 1, k3)
    biased = fit(model, record, SensorBias(bias=Normal(0.0, 1.0)), 2, 0.4)
    for strength, survives in ((1.0, True), (1.5, False), (2.0, False)):
        stronger = Record(name="", time_step=GROUND.time_step, excitation=strength * GROUND.excitation)
        values = soft.posterior.engine.simulate(soft.posterior.model, np.array([[150.0, k3]]), stronger, CHANNELS)
        assert bool(np.all(np.isfinite(values.values))) == survives
    sentence = separating_experiment(soft, biased, PERIOD)
    assert "would tell cubic_stiffness from sensor_bias" in sentence
    assert not sentence.startswith(("The same ground motion at 1.5", "The same ground motion at 2"))


def test_equal_predictions_cannot_be_told_apart() -> None:
    model = building(5.0)
    record = measured(model)
    pair = [fit(model, record, SensorGain(gain=GAIN), 1, 1.1) for _ in range(2)]
    assert separating_experiment(*pair, PERIOD) == "No experiment tried would tell sensor_gain from sensor_gain."


def test_a_specimen_is_pushed_further_and_not_shaken() -> None:
    """A cubic spring that the record hardly reached: twice the size tells most."""
    linear = BoucWen(k=Uniform(100, 200), c=0.0, alpha=1.0, beta=1.0, gamma=0.0, n=1.0)
    model = Specimen(storey=linear)
    time = np.arange(400) * 0.02
    pushed = Record(name="", time_step=0.02, excitation=0.1 * np.sin(2 * np.pi * time), excitation_kind="displacement")
    noise = 0.2 * np.random.default_rng(4).standard_normal(400)
    record = pushed.with_channels({"force": 150.0 * pushed.excitation + noise})
    pair = [fit(model, record, CubicStiffness(k3=Normal(0.0, 1000.0)), 1, value) for value in (0.0, 500.0)]
    sentence = separating_experiment(*pair, PERIOD)
    assert sentence.startswith("The same displacement history at 2 times its size would tell")
