"""A model from a record alone: what is true lies well inside its priors, whatever the units and the sampling."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, PerStorey
from bwbn_bayes.records import Record, el_centro, read_record
from bwbn_bayes.records.joined import join_records
from bwbn_bayes.structures.quantities import modes
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.starting_model import first_frequency, initial_stiffness, starting_model
from bwbn_bayes.structures.structure import Structure

DATA = Path(__file__).parents[3] / "shared" / "data"
LANES = Lanes(substeps=16)
STEEL = {"k": 2e7, "alpha": 0.03, "u_y": 0.004, "rho": 0.8, "n": 2.0}


def protocol(*amplitudes: float, per_cycle: int = 80) -> np.ndarray:
    """Two sine cycles at each amplitude."""
    cycle = np.sin(2.0 * np.pi * np.arange(2 * per_cycle) / per_cycle)
    return np.concatenate([amplitude * cycle for amplitude in amplitudes])


def cyclic(element: dict[str, float], *amplitudes: float, noise: float = 0.005, per_cycle: int = 80) -> Record:
    """What a specimen shows, its force with noise of a share of the peak."""
    path = Record(
        name="test", time_step=1.0, excitation=protocol(*amplitudes, per_cycle=per_cycle),
        excitation_kind="displacement", has_time=False,
    )  # fmt: skip
    made = simulate(Specimen(storey=BoucWen(**element)), path, {}, engine=LANES, channels=["force"])
    force = made.channels["force"]
    rng = np.random.default_rng(5)
    return made.with_channels({"force": force + noise * np.max(np.abs(force)) * rng.standard_normal(len(force))})


def shaken(n_storeys: int, amplitude: float, **element: float) -> tuple[ShearBuilding, Record]:
    storey = BoucWen(
        **{"k": 4e6 * n_storeys, "c": 6e3 * n_storeys, "alpha": 0.1, "u_y": 0.01, "rho": 0.6, "n": 2.0, **element}
    )
    model = ShearBuilding(masses=[12e3] * n_storeys, storey=storey)
    motion = el_centro("chopra", duration=20.0)
    motion = replace(motion, excitation=amplitude * motion.excitation)
    channels = [f"acceleration_{i + 1}" for i in range(n_storeys)]
    return model, simulate(model, motion, {}, snr_db=30.0, seed=3, engine=LANES, channels=channels)


def inside(model: Structure, truth: dict[str, float]) -> None:
    """Every true value lies between the 1 and the 99 % quantile of its prior."""
    for parameter in model.space.parameters:
        probability = parameter.prior.probability(truth[parameter.symbol])
        assert 0.01 < probability < 0.99, (parameter.name, truth[parameter.symbol], str(parameter.prior))


@pytest.mark.parametrize(
    "element",
    [STEEL, {**STEEL, "n": 1.1, "u_y": 0.015}, {**STEEL, "alpha": 0.5}, {**STEEL, "alpha": -0.1, "u_y": 0.01},
     {**STEEL, "rho": 2.0, "u_y": 0.0003, "n": 5.0}],
    ids=["sharp", "gradual", "hardening", "softening", "friction"],
)  # fmt: skip
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_truth_of_a_specimen_lies_inside(element: dict[str, float], noise: float):
    record = cyclic(element, 0.002, 0.005, 0.01, 0.03, noise=noise)
    model = starting_model(record)
    assert model.space.names == ("k", "alpha", "u_y", "rho", "n")
    inside(model, element)


def test_digitised_points_do_not_matter():
    """Coarse and uneven points, repeated ones and a standstill at first, against the smooth record."""
    smooth = cyclic(STEEL, 0.002, 0.005, 0.02, noise=0.0)
    rng = np.random.default_rng(2)
    kept = np.sort(np.concatenate([np.zeros(200, int), rng.choice(smooth.n_times, 160), np.full(3, 300)]))
    rough = replace(smooth, excitation=smooth.excitation[kept], channels={"force": smooth.channels["force"][kept]})
    assert initial_stiffness(rough) == pytest.approx(initial_stiffness(smooth), rel=0.25)
    assert initial_stiffness(smooth) == pytest.approx(STEEL["k"], rel=0.4)


def test_a_push_over_has_a_stiffness():
    path = Record(
        name="push", time_step=1.0, excitation=np.linspace(0.0, 0.1, 300), excitation_kind="displacement",
        channels={"force": 1e6 * np.tanh(np.linspace(0.0, 0.1, 300) / 0.01)}, has_time=False,
    )  # fmt: skip
    assert initial_stiffness(path) == pytest.approx(1e8, rel=0.05)


def test_priors_follow_the_units():
    """Millimetres for metres and kilonewtons for newtons: the same record in other numbers."""
    record = cyclic(STEEL, 0.005, 0.02)
    other = replace(record, excitation=1e3 * record.excitation, channels={"force": 1e-3 * record.channels["force"]})
    one, two = (
        dict(zip(m.space.names, m.space.parameters, strict=True))
        for m in (starting_model(record), starting_model(other))
    )
    points = np.array([0.1, 0.5, 0.9])
    for name, factor in {"k": 1e-6, "u_y": 1e3, "alpha": 1.0, "rho": 1.0, "n": 1.0}.items():
        np.testing.assert_allclose(
            two[name].prior.quantile(points), factor * one[name].prior.quantile(points), rtol=0.01
        )


def test_damping_needs_time():
    record = cyclic(STEEL, 0.005, 0.02)
    assert starting_model(record).element.c == 0.0
    timed = replace(record, has_time=True, time_step=0.01)
    damping, faster = starting_model(timed).element.c, starting_model(replace(timed, time_step=0.005)).element.c
    assert isinstance(damping, HalfNormal)
    assert isinstance(faster, HalfNormal)
    assert faster.scale == pytest.approx(0.5 * damping.scale, rel=0.01)


# Secant of the first half cycle that reaches a tenth of the peak force, read off the files' first rows. [N/m]
MEASURED = {
    "chiu_bracing.csv": 5.4e6,
    "clt_connection_spc1.csv": 4.0e6,
    "steel_damper_ganey.csv": 1.5e7,
    "rc_columns/peer_163.csv": 2.3e7,
    "rc_columns/peer_269.csv": 1.1e7,
}


@pytest.mark.parametrize("name", MEASURED)
def test_measured_stiffnesses(name: str):
    if not (DATA / name).exists():
        pytest.skip(f"measured file {DATA / name} is not here")
    record = read_record(DATA / name)
    assert abs(np.log(initial_stiffness(record) / MEASURED[name])) < 0.6
    assert starting_model(record).element.c == 0.0


@pytest.mark.parametrize("n_storeys", [1, 3, 6])
@pytest.mark.parametrize("amplitude", [0.3, 1.5])
def test_the_truth_of_a_building_lies_inside(n_storeys: int, amplitude: float):
    model, record = shaken(n_storeys, amplitude)
    start = starting_model(record, masses=model.masses)
    assert not start.is_driven
    assert start.space.n_dim == 2 * n_storeys + 4
    inside(start, {p.symbol: model.element.values[p.symbol] for p in start.space.parameters})


def test_the_first_frequency_of_weak_motion():
    model, record = shaken(3, 0.05)
    periods, _ = modes(np.full(3, model.element.k), np.zeros(3), np.array(model.masses))
    assert first_frequency(record) == pytest.approx(1.0 / periods[0], rel=0.06)


def test_joined_records_are_read_with_their_own_time_steps():
    """With the shortest of them for all, a frequency of 2 Hz was told as 8."""
    _, record = shaken(1, 0.05)
    finer = replace(record.until(5.0), time_step=0.25 * record.time_step)
    assert first_frequency(join_records([finer, record])) == first_frequency(record)
    assert first_frequency(join_records([record.with_channels({}), finer])) == first_frequency(finer)
    test = replace(cyclic(STEEL, 0.005, 0.02), has_time=True, time_step=0.04)
    brief = replace(test, time_step=0.01)
    assert starting_model(join_records([brief, test])).element.c == starting_model(test).element.c


def test_a_record_that_lacks_the_highest_channel_tells_no_drift():
    """Joined, it has zeros there, which less its ground acceleration were a motion: a drift of the ground's size."""
    model, record = shaken(3, 0.3)
    strong = replace(record.select(["acceleration_1"]), excitation=20.0 * record.excitation)
    alone, joined = (starting_model(one, masses=model.masses) for one in (record, join_records([record, strong])))
    assert joined.element.u_y == alone.element.u_y


def test_no_half_cycle_lies_across_a_joint():
    """A test was loaded on from where the one before it ended: half a cycle of either was one, with a jump in it."""
    path = np.linspace(0.0, 0.1, 300)
    push = Record(
        name="push", time_step=1.0, excitation=path, excitation_kind="displacement",
        channels={"force": 1e6 * np.tanh(path / 0.01)}, has_time=False,
    )  # fmt: skip
    pull = replace(push, name="pull", excitation=-path, channels={"force": -push.channels["force"]})
    assert initial_stiffness(join_records([push, pull])) == pytest.approx(initial_stiffness(push))


@pytest.mark.parametrize("kind", ["relative_acceleration", "displacement", "drift", "force"])
def test_every_kind_of_channel_tells_the_sizes(kind: str):
    model, record = shaken(2, 0.5)
    channels = [f"{kind}_1", f"{kind}_2"]
    other = simulate(model, record.with_channels({}), {}, engine=LANES, channels=channels)
    expected, found = (starting_model(r, masses=model.masses).element for r in (record, other))
    for name in ("k", "c"):
        medians = [s.values[name].value.median for s in (expected, found)]
        assert 0.5 < medians[1] / medians[0] < 2.0
    assert 0.3 < found.u_y.parent.median / expected.u_y.parent.median < 3.0


def test_without_masses_stiffness_is_per_kilogram():
    model, record = shaken(2, 0.5)
    typed, bare = starting_model(record, masses=model.masses), starting_model(record)
    assert not bare.is_driven
    assert bare.masses == (1.0, 1.0)
    assert isinstance(typed.element.k, PerStorey)
    for name in ("k", "c"):
        ratio = typed.element.values[name].value.median / bare.element.values[name].value.median
        assert ratio == pytest.approx(12e3, rel=0.01)
    assert typed.element.u_y == bare.element.u_y


def test_storeys_reach_up_to_the_highest_measured_floor():
    _, record = shaken(3, 0.5)
    assert starting_model(record.select(["acceleration_3"])).n_links == 3
    assert starting_model(record.select(["acceleration_2", "acceleration_1"])).n_links == 2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"channels": {}}, 'has no force beside its displacement: add .* --columns "displacement, LABEL = force'),
        ({"channels": {"force": np.full(320, 3.0)}}, "force never changes, .*: mend the column, or say with --columns"),
        ({"excitation": np.zeros(320)}, "displacement never changes, .*: mend the column, or say with --columns"),
        # A header [nm] where metres were meant: the sentence was about a prior that nobody had given.
        ({"excitation": 1e-9 * cyclic(STEEL, 0.005, 0.02).excitation}, "displacement reaches 2e-11 in SI units: mend"),
        ({"channels": {"force": np.r_[1e300, np.ones(319)]}}, r"force reaches 1e\+300 in SI units: mend its unit or"),
        ({"excitation": np.arange(19.0), "channels": {"force": np.arange(19.0)}}, "19 samples: at least 32 are needed"),
    ],
)
def test_a_record_without_sizes_is_refused(change: dict[str, object], sentence: str):
    record = cyclic(STEEL, 0.005, 0.02)
    with pytest.raises(UserError, match=sentence):
        starting_model(replace(record, **change))


def test_a_specimen_has_no_masses():
    with pytest.raises(UserError, match="a cyclic test has none"):
        starting_model(cyclic(STEEL, 0.005, 0.02), masses=[1.0])


def test_samples_that_do_not_count_tell_no_size():
    record = cyclic(STEEL, 0.005, 0.01, 0.02)
    spike = record.channels["force"].copy()
    spike[record.n_times // 2] *= 20.0
    counted = np.ones(record.n_times, dtype=np.bool_)
    counted[record.n_times // 2] = False
    masked, spiked = replace(record, counted=counted), replace(record, counted=counted, channels={"force": spike})
    assert starting_model(spiked) == starting_model(masked)
