"""Hypotheses: every effect wherever it may act, nothing that is there already, starts that can be solved."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.discovery.build import MOST_LATER, leading
from bwbn_bayes.discovery.candidates import MOST_CARRIED, Hypothesis, hypotheses, scales_of
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects import (
    CubicStiffness,
    PDelta,
    QuadraticDamping,
    SensorGain,
    SlipLock,
    StoreyCoupling,
    StoreyParameter,
)
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.elements.scales import NOMINAL, Scales
from bwbn_bayes.engines.available import engine
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import HalfNormal, Normal, PerStorey, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

STOREY = BoucWen(
    k=PerStorey(Uniform(5, 60)), c=Uniform(0.01, 1), alpha=Uniform(0.01, 0.5), beta=Uniform(0.5, 8), gamma=1.0, n=1.5
)
BASE = ShearBuilding(masses=[1.0, 1.0], storey=STOREY)
SCALES = Scales(
    drift=0.2, path=8.0, drift_rate=1.0, hysteretic_displacement=0.15, energy=8.0, force=4.0, stiffness=25.0,
    damping=0.1, alpha=0.05, beta=2.0, gamma=1.0, n=1.5, mass=1.0, acceleration=1.0,
    ground_acceleration=1.0, period=1.3, onset=1.0, duration=20.0, total_mass=3, time_step=0.02,
)  # fmt: skip
CHANNELS = ("acceleration_1", "acceleration_2")
EVERY = hypotheses(BASE, [SCALES, SCALES], measured=CHANNELS)
POINT = np.full(BASE.space.n_dim, 0.4)


def places(every: tuple[Hypothesis, ...]) -> dict[str, set[tuple[int, ...]]]:
    found: dict[str, set[tuple[int, ...]]] = {}
    for hypothesis in every:
        found.setdefault(hypothesis.name, set()).add(hypothesis.storeys)
    return found


def test_places_follow_the_level() -> None:
    """Storeys one by one and all alike, floors one by one; the ground, the base and the building once."""
    found = places(EVERY)
    # P-Delta is a change of k and alpha, exactly: it is placed by hand.
    kinds = [effect for effect in registered() if effect is not PDelta]
    levels = {effect.name: effect.level for effect in kinds if "bouc_wen" in effect.elements}
    assert found.keys() == levels.keys()
    for name, where in found.items():
        expected = {"link": {(1,), (2,), (1, 2)}, "node": {(1,), (2,)}, "observation": {(1,), (2,)}}.get(
            levels[name], {()}
        )
        # A parameter that the storeys share is the same in all of them already.
        assert where == (expected - {(1, 2)} if name == "storey_parameter" else expected), name


def test_a_form_is_looked_for_where_its_element_is() -> None:
    """Slack stands between springs that a linear brace has not; a play of the other kind it can have."""
    braced = BASE.with_link(Linear(k=Uniform(1, 20), c=0.1), joins=(0, 2))
    every = hypotheses(braced, [SCALES] * 3, measured=CHANNELS)
    forms = {
        form: {h.storeys for h in every if h.name == "backlash" and h.effect.form == form} for form in ("", "slack")
    }
    assert forms == {"": {(1,), (2,), (3,), (1, 2, 3)}, "slack": {(1,), (2,)}}
    free = {one.storeys for h in every if h.name == "backlash" for one in h.free_shapes}
    assert free == {(1,), (2,)}
    assert all(h.model.n_links == 3 for h in every)


def test_a_sensor_that_does_not_exist_cannot_be_wrong() -> None:
    found = places(hypotheses(BASE, [SCALES, SCALES], measured=("acceleration_2", "drift_1")))
    assert found["sensor_gain"] == found["sensor_bias"] == found["sensor_lag"] == {(2,)}
    assert found["cubic_stiffness"] == {(1,), (2,), (1, 2)}


def test_in_every_storey_alike_sizes_are_those_of_the_mean_storey() -> None:
    """One parameter for all, its prior by the mean of the storeys' scales."""
    larger = replace(SCALES, energy=24.0, stiffness=75.0)
    every = hypotheses(BASE, [SCALES, larger], measured=CHANNELS)
    one = next(h for h in every if h.name == "strength_degradation" and h.storeys == (1, 2))
    assert one.label == "strength degradation (linear) in storeys 1, 2"
    assert one.brought == ("delta_nu",)
    assert (one.scales.energy, one.scales.stiffness, one.scales.drift) == (16.0, 50.0, 0.2)
    assert one.effect.values["delta_nu"] == HalfNormal(3.0 / 16.0)


def test_a_specimen_has_storey_effects_only() -> None:
    specimen = Specimen(storey=BoucWen(k=Uniform(5, 60), beta=2.0, gamma=1.0))
    every = hypotheses(specimen, [SCALES], measured=("force",))
    assert {h.effect.level for h in every} == {"link"}
    assert {h.storeys for h in every} == {(1,)}
    damping = next(h for h in every if h.name == "quadratic_damping")
    assert (damping.label, damping.where) == ("quadratic damping", "the specimen")


def test_without_time_nothing_that_depends_on_rate_takes_part() -> None:
    """A digitised loop has no clock: a damper, a relaxation or a moment in time means nothing there."""
    specimen = Specimen(storey=BoucWen(k=Uniform(5, 60), beta=2.0, gamma=1.0))

    def forms(has_time: bool) -> set[tuple[str, str]]:
        every = hypotheses(specimen, [SCALES], measured=("force",), has_time=has_time)
        return {(one.name, one.effect.form) for h in every for one in (h, *h.free_shapes)}

    timed, timeless = forms(has_time=True), forms(has_time=False)
    assert timeless < timed
    names = {name for name, _ in timeless}
    assert {"slip_lock", "foliente_pinching", "strength_degradation", "cubic_stiffness", "gap_impact"} <= names
    assert not {"quadratic_damping", "maxwell_branch", "sudden_damage"} & names
    # Of the frictions the one that turns over a drift stays, those over a drift rate go.
    assert len([form for name, form in timed if name == "coulomb_friction"]) == 6
    assert len([form for name, form in timeless if name == "coulomb_friction"]) == 2


def test_nothing_that_is_there_already() -> None:
    """Slip at storey 2 leaves storey 1; a damper everywhere leaves nothing."""
    base = BASE.with_effect(SlipLock(delta_s=HalfNormal(0.01), sigma=0.01), storeys=[2])
    base = base.with_effect(QuadraticDamping(c2=HalfNormal(0.1)))
    found = places(hypotheses(base, [SCALES, SCALES], measured=CHANNELS))
    assert found["slip_lock"] == {(1,)}
    assert "quadratic_damping" not in found
    assert found["cubic_stiffness"] == {(1,), (2,), (1, 2)}


def test_another_form_may_join_one_that_is_there() -> None:
    base = BASE.with_effect(StoreyParameter(parameter="alpha", offset=Normal(0.0, 0.1)), storeys=[1])
    forms = {(h.effect.form, h.storeys) for h in hypotheses(base, [SCALES, SCALES], measured=CHANNELS)
             if h.name == "storey_parameter"}  # fmt: skip
    assert ("alpha", (1,)) not in forms
    assert {("alpha", (2,)), ("beta", (1,)), ("beta", (2,))} <= forms


def test_a_storey_with_a_parameter_of_its_own_needs_no_offset() -> None:
    own = replace(
        BASE,
        links=(
            replace(
                BASE.links[0], element=replace(STOREY, alpha=PerStorey(Uniform(0.01, 0.5)), n=PerStorey([1.0, 2.0]))
            ),
        ),
    )
    every = hypotheses(own, [SCALES, SCALES], measured=CHANNELS, effects=[StoreyParameter])
    assert {h.effect.form for h in every} == {"beta", "gamma"}
    every = hypotheses(BASE, [SCALES, SCALES], measured=CHANNELS, effects=[StoreyParameter])
    assert {h.effect.form for h in every} == {"alpha", "beta", "gamma", "n"}
    single = ShearBuilding(masses=[1.0], storey=replace(STOREY, alpha=Uniform(0.01, 0.5), n=1.5))
    every = hypotheses(single, [SCALES], measured=CHANNELS[:1], effects=[StoreyParameter])
    assert "alpha" not in {h.effect.form for h in every}
    assert "n" in {h.effect.form for h in every}


@pytest.mark.parametrize("hypothesis", [h for h in EVERY if h.storeys != (1,)], ids=lambda h: h.label)
def test_starts_are_admissible_and_keep_the_base_point(hypothesis: Hypothesis) -> None:
    """Every point lies inside the cube and has prior density; what the present model identifies stays as it was."""
    space = hypothesis.model.space
    base_points = np.stack([POINT, POINT + 0.1])
    starts = hypothesis.starts(base_points)
    if hypothesis.name == "sudden_damage":  # linear in its size, of which none is guessed
        assert len(starts) == 0
        amplitude = hypothesis.amplitudes[0]
        starts = np.concatenate([hypothesis.neutral_points(one, amplitude, 1e-3) for one in base_points])
    assert len(starts) > 0
    assert np.all((starts > 0.0) & (starts < 1.0))
    assert np.all(np.isfinite(space.log_prior_unit(starts)))
    known = [space.names.index(name) for name in BASE.space.names]
    for start in starts[:, known]:
        assert np.min(np.max(np.abs(start - base_points), axis=1)) < 1e-9
    assert len(np.unique(starts.round(9), axis=0)) == len(starts)
    assert hypothesis.n_brought == space.n_dim - BASE.space.n_dim > 0
    assert set(hypothesis.amplitudes) <= set(hypothesis.brought)


def test_starts_are_every_combination() -> None:
    """Two widths of slip times three, from two base points."""
    slip = next(h for h in EVERY if h.name == "slip_lock" and h.storeys == (1,))
    assert len(slip.starts(np.stack([POINT, POINT + 0.1]))) == 2 * 2 * 3


def test_neutral_points_differ_from_neutral_by_little() -> None:
    """Slip at storey 2: the amplitude a thousandth of the prior above zero, three widths, the base point as it is."""
    slip = next(h for h in EVERY if h.name == "slip_lock" and h.storeys == (2,))
    (amplitude,) = slip.amplitudes
    assert amplitude == "delta_s[2]"
    points = slip.neutral_points(POINT, amplitude, 1e-3)
    space = slip.model.space
    assert len(points) == 3
    np.testing.assert_allclose(points[:, space.names.index(amplitude)], 1e-3)
    widths = space.from_unit(points)[:, space.names.index("sigma[2]")]
    np.testing.assert_allclose(widths, slip.guide.starts(slip.effect, SCALES)["sigma"])
    np.testing.assert_allclose(
        points[:, [space.names.index(name) for name in BASE.space.names]], POINT[None].repeat(3, 0)
    )


def alone(hypothesis: Hypothesis) -> Structure:
    """The model under a law of its own."""
    return hypothesis.base.with_effect(hypothesis.effect, hypothesis.storeys or None)


def test_groups_share_a_law() -> None:
    """Compiling is what takes long: many hypotheses, few laws, and no law with more than nine further parameters."""
    bare = len(BASE.law.parameters)
    laws = Counter(h.model.law for h in EVERY)
    separate = {alone(h).law for h in EVERY}
    assert len(laws) < 0.6 * len(separate)
    for law in laws:
        assert len(law.parameters) - bare <= MOST_CARRIED
    sensors = [h for h in EVERY if h.effect.level == "observation"]
    assert sensors
    assert {h.model.law for h in sensors} == {BASE.law}


def test_one_law_for_all_where_asked() -> None:
    every = hypotheses(BASE, [SCALES, SCALES], measured=CHANNELS, most_carried=np.inf)
    own = [h for h in every if h.effect.level != "observation"]
    assert len({h.model.law for h in own if h.name != "sliding_base"}) == 1
    (sliding,) = {h.model.law for h in own if h.name == "sliding_base"}  # a law has one base
    assert "compliance" not in {p.symbol for p in sliding.parameters}


def test_what_a_law_carries_brings_no_coordinate() -> None:
    for hypothesis in EVERY:
        assert hypothesis.model.space.names == alone(hypothesis).space.names, hypothesis.label


def test_labels_say_effect_form_and_place() -> None:
    labels = {h.label for h in EVERY}
    assert {
        "cubic stiffness in storey 2",
        "deviating parameter (alpha) in storey 1",
        "wrong sensor gain at floor 2",
    } <= labels
    assert "wrong scale of the excitation" in labels


def test_scales_are_what_the_response_reaches() -> None:
    """Against the reference engine's own response; the period against the closed form of two equal storeys."""
    record = el_centro("chopra", duration=8.0)
    one = replace(BASE, links=(replace(BASE.links[0], element=replace(STOREY, k=Uniform(20, 60))),))
    point = np.full(one.space.n_dim, 0.5)
    reference = engine("reference")
    values = one.space.from_unit(point[None])
    names = ("acceleration_2", "drift_1", "drift_2")
    rows = dict(zip(names, reference.simulate(one, values, record, names).values[0], strict=True))
    measured = record.with_channels({"acceleration_2": rows["acceleration_2"]})
    posterior = Posterior(model=one, record=measured, engine=reference, noise=default_noise(measured))
    first, second = scales_of(posterior, point)
    assert first.drift == pytest.approx(np.max(np.abs(rows["drift_1"])), rel=1e-6)
    assert second.drift == pytest.approx(np.max(np.abs(rows["drift_2"])), rel=1e-6)
    assert second.acceleration == pytest.approx(np.std(rows["acceleration_2"]), rel=1e-6)
    assert first.stiffness == second.stiffness == pytest.approx(40.0)
    # omega_1 = 2 sqrt(k / m) sin(pi / 10) for two storeys, clamped below.
    assert first.period == pytest.approx(np.pi / (np.sqrt(40.0) * np.sin(np.pi / 10.0)), rel=1e-9)
    assert (first.duration, first.time_step) == (record.duration, record.time_step)
    energy = np.cumsum(record.excitation**2) / np.sum(record.excitation**2)
    assert energy[round(first.onset / record.time_step)] == pytest.approx(0.02, abs=0.01)


def test_the_period_is_that_of_the_spring_at_rest() -> None:
    """A Bouc-Wen spring of amplitude A starts with the stiffness ``alpha k + (1 - alpha) k A``."""
    model = ShearBuilding(masses=[2.0], storey=BoucWen(k=50.0, c=0.1, alpha=0.2, A=2.5, beta=2.0, gamma=1.0, n=1.5))
    ground = el_centro("chopra", duration=2.0).with_channels({"acceleration_1": np.ones(101)})
    posterior = Posterior(model=model, record=ground, engine=engine("lanes"), noise=default_noise(ground))
    (scales,) = scales_of(posterior, np.zeros(posterior.space.n_dim))
    assert scales.period == pytest.approx(2 * np.pi * np.sqrt(2.0 / (50.0 * (0.2 + 0.8 * 2.5))))


@pytest.mark.parametrize(("k_bend", "k_geo"), [(30.0, 0.0), (0.0, 12.0), (30.0, 12.0)])
def test_the_period_has_bending_and_p_delta(k_bend: float, k_geo: float) -> None:
    """Both were left out, so that starts of branches and appendages stood around another building's period.

    Matrices written out: drifts are ``x_1`` and ``x_2 - x_1``, and bending resists their difference ``x_2 - 2 x_1``.
    """
    model = ShearBuilding(masses=[2.0, 1.5], storey=BoucWen(k=PerStorey([50.0, 40.0]), beta=2.0, gamma=1.0, n=1.5))
    model = model.with_effect(StoreyCoupling(k_bend=k_bend)).with_effect(PDelta(k_geo=k_geo), storeys=[1])
    ground = el_centro("chopra", duration=2.0).with_channels({"acceleration_1": np.ones(101)})
    posterior = Posterior(model=model, record=ground, engine=engine("lanes"), noise=default_noise(ground))
    first = scales_of(posterior, np.zeros(posterior.space.n_dim))[0]
    stiffness = np.array([[90.0 - k_geo, -40.0], [-40.0, 40.0]]) + k_bend * np.array([[4.0, -2.0], [-2.0, 1.0]])
    squares = np.linalg.eigvals(stiffness / np.array([[2.0], [1.5]]))
    assert first.period == pytest.approx(2.0 * np.pi / np.sqrt(np.min(squares)), rel=1e-9)


def test_a_building_that_nothing_holds_up_has_a_period_to_search_by() -> None:
    model = ShearBuilding(masses=[2.0], storey=BoucWen(k=50.0, beta=0.0, gamma=0.0, n=1.0))
    model = model.with_effect(PDelta(k_geo=51.0))
    ground = el_centro("chopra", duration=2.0).with_channels({"acceleration_1": np.ones(101)})
    posterior = Posterior(model=model, record=ground, engine=engine("lanes"), noise=default_noise(ground))
    (scales,) = scales_of(posterior, np.zeros(posterior.space.n_dim))
    assert scales.period == ground.duration


def test_the_period_of_a_specimen_is_that_of_its_cycles() -> None:
    """Whatever unit the stiffness has: a specimen has no mass."""
    times = 0.01 * np.arange(1001)
    for stiffness in (50.0, 5e7):
        specimen = Specimen(storey=BoucWen(k=stiffness, beta=2.0, gamma=1.0, n=1.5))
        pushed = Record(
            name="cycles", time_step=0.01, excitation=0.1 * np.sin(np.pi * times), excitation_kind="displacement"
        ).with_channels({"force": np.ones(1001)})
        posterior = Posterior(model=specimen, record=pushed, engine=engine("lanes"), noise=default_noise(pushed))
        (scales,) = scales_of(posterior, np.zeros(posterior.space.n_dim))
        assert scales.period == pytest.approx(2.0, rel=0.01)


def test_a_loop_that_gives_back_what_it_took_has_a_scale_of_work() -> None:
    """A linear spring, pushed to and fro, ends with nothing; at most it stored ``(1 - alpha) k U^2 / 2``."""
    times = 0.01 * np.arange(1001)
    specimen = Specimen(storey=BoucWen(k=50.0, alpha=0.2, beta=0.0, gamma=0.0, n=1.0))
    pushed = Record(
        name="cycles", time_step=0.01, excitation=0.1 * np.sin(np.pi * times), excitation_kind="displacement"
    ).with_channels({"force": np.ones(1001)})
    posterior = Posterior(model=specimen, record=pushed, engine=engine("reference"), noise=default_noise(pushed))
    (scales,) = scales_of(posterior, np.zeros(posterior.space.n_dim))
    assert scales.energy == pytest.approx(0.8 * 50.0 * 0.1**2 / 2.0, rel=1e-6)


def test_a_linear_storey_has_hypotheses_too() -> None:
    """No room for an asymmetric term where beta and gamma are zero; an offset of either is measured by the motion."""
    linear = replace(STOREY, beta=0.0, gamma=0.0)
    scales = [replace(SCALES, beta=0.0, gamma=0.0)] * 2
    every = hypotheses(replace(BASE, links=(replace(BASE.links[0], element=linear),)), scales, measured=CHANNELS)
    assert "asymmetry" not in {h.name for h in every}
    offset = next(h for h in every if h.label == "deviating parameter (beta) in storey 1")
    assert offset.effect.values["beta_offset"].sd == pytest.approx(  # type: ignore[union-attr]
        0.5 * SCALES.hysteretic_displacement**-SCALES.n
    )


def test_a_sensors_hypothesis_uses_the_scale_of_its_floor() -> None:
    scales = [SCALES, replace(SCALES, acceleration=5.0)]
    biases = {h.storeys: h for h in hypotheses(BASE, scales, measured=CHANNELS) if h.name == "sensor_bias"}
    ratio = biases[(2,)].effect.values["bias"].sd / biases[(1,)].effect.values["bias"].sd  # type: ignore[union-attr]
    assert ratio == pytest.approx(5.0)


def test_only_the_effects_asked_for() -> None:
    every = hypotheses(BASE, [SCALES, SCALES], measured=CHANNELS, effects=[CubicStiffness, SensorGain])
    assert {h.name for h in every} == {"cubic_stiffness", "sensor_gain"}


def test_an_effect_that_others_refer_to_stays_where_it_is() -> None:
    """Sudden damage of delta_nu needs strength degradation; taking that out for a look raised an error."""
    model = load_model_file(Path(__file__).parents[2] / "models" / "three_storey_el_centro.py").model
    found = hypotheses(model, [NOMINAL] * 3, measured=("acceleration_1", "acceleration_2", "acceleration_3"))
    names = {one.name for one in found}
    assert "sensor_lag" in names
    assert "strength_degradation" not in names


def test_forms_of_one_effect_leave_room_for_others() -> None:
    """Eight of the twelve that were fitted on a measured frame were two forms of a change in time at four places."""
    ranked = sorted(EVERY, key=lambda one: one.name != "sudden_damage")
    chosen = leading(ranked)
    assert list(chosen) == ranked[: len(chosen)]
    assert len({(one.name, one.storeys) for one in chosen}) == MOST_LATER < len(chosen)
