"""The Record: validation, parts, measured storey forces, identity."""

from __future__ import annotations

import copy
import pickle
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import Record, read_record, si_unit, write_record


def building(**changes: object) -> Record:
    rng = np.random.default_rng(3)
    fields: dict[str, object] = {
        "name": "shake table",
        "time_step": 0.02,
        "excitation": rng.standard_normal(101),
        "channels": {f"acceleration_{i}": rng.standard_normal(101) for i in (1, 2, 3)},
        "provenance": {"laboratory": "somewhere"},
        "truth": {"k[1]": 20.0},
        "noise_sd": {"acceleration_2": 0.1},
    }
    return Record(**(fields | changes))  # type: ignore[arg-type]


def test_time_base() -> None:
    record = building()
    assert record.n_times == 101
    assert record.duration == pytest.approx(2.0)
    assert record.times[0] == 0.0
    assert record.times[-1] == pytest.approx(2.0)
    assert record.floors == (1, 2, 3)


def test_nothing_can_be_changed() -> None:
    values = np.ones(101)
    record = building(excitation=values)
    values[0] = 5.0
    assert record.excitation[0] == 1.0
    for array in (record.excitation, record.times, record.channels["acceleration_1"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 2.0
    with pytest.raises(TypeError):
        record.channels["acceleration_1"] = values  # type: ignore[index]
    with pytest.raises(FrozenInstanceError):
        record.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"time_step": 0.0}, "time_step is 0 s: it must be a positive number"),
        ({"time_step": -0.1}, "time_step is -0.1 s: it must be a positive number"),
        ({"time_step": 2e-302}, "time_step is 2e-302 s: it must lie between 1e-09 and 1e[+]06 s"),
        ({"time_step": 1e300}, "time_step is 1e[+]300 s: it must lie between"),
        ({"time_step": np.nan}, "time_step is nan s: it must be a positive number"),
        ({"time_step": np.inf}, "time_step is inf s: it must be a positive number"),
        ({"excitation": np.ones(7), "channels": {}}, "the record has 7 points: at least 8 are needed"),
        ({"excitation": np.ones((9, 2))}, "ground_acceleration has 2 dimensions"),
        ({"excitation": np.r_[np.ones(100), np.nan]}, "ground_acceleration is nan at point 101"),
        ({"channels": {"acceleration_1": np.full(101, np.inf)}}, "acceleration_1 is inf at point 1"),
        (
            {"channels": {"acceleration_1": np.ones(100)}},
            "channel acceleration_1 has 100 points but the excitation 101",
        ),
        ({"channels": {"acceleration_0": np.ones(101)}}, "channel acceleration_0 is not known"),
        ({"channels": {"velocity_1": np.ones(101)}}, "channel velocity_1 is not known"),
        ({"channels": {"force": np.ones(101)}}, "channel force is not known"),
        ({"excitation_kind": "displacement"}, "channel acceleration_1 does not belong to a cyclic test"),
        ({"excitation_kind": "velocity"}, "excitation_kind is 'velocity'"),
        ({"truth": {"k[1]": np.nan}}, r"the true value of k\[1\] is nan"),
        ({"truth": {"": 1.0}}, "the label '' is empty or holds a colon"),
        ({"provenance": {"a: b": "c"}}, "the label 'a: b' is empty or holds a colon"),
        ({"provenance": {"time_step": "c"}}, "provenance key 'time_step' is reserved"),
        ({"provenance": {"true k": "c"}}, "provenance key 'true k' is reserved"),
        ({"noise_sd": {"acceleration_9": 1.0}}, "noise_sd names acceleration_9, which the record does not have"),
        ({"noise_sd": {"acceleration_1": -1.0}}, "noise_sd of acceleration_1 is -1.0"),
    ],
)
def test_bad_input_is_one_sentence(changes: dict[str, object], sentence: str) -> None:
    if "channels" in changes or "excitation_kind" in changes:
        changes = {"noise_sd": {}, **changes}
    with pytest.raises(UserError, match=sentence) as caught:
        building(**changes)
    assert "\n" not in str(caught.value)


def test_text_becomes_single_lines() -> None:
    record = building(name=" two\nlines ", provenance={"a  key": "x\r\ny\u2028z"})
    assert record.name == "two lines"
    assert dict(record.provenance) == {"a key": "x y z"}


def test_parts_of_a_record() -> None:
    record = building()
    part = record.between(0.5, 1.0)
    np.testing.assert_array_equal(part.excitation, record.excitation[25:51])
    np.testing.assert_array_equal(part.channels["acceleration_3"], record.channels["acceleration_3"][25:51])
    assert part.times[0] == 0.0
    assert part.provenance["part"] == "0.5 to 1 s"
    assert part.until(0.3).provenance["part"] == "0 to 0.3 s of (0.5 to 1 s)"
    assert dict(part.truth) == dict(record.truth)
    assert record.until(0.2).n_times == 11
    assert record.until(record.duration) is record


def path(**changes: object) -> Record:
    fields = {"time_step": 1.0, "excitation_kind": "displacement", "channels": {}, "noise_sd": {}, "has_time": False}
    return building(**(fields | changes))


def test_a_path_without_time_stays_one() -> None:
    """Its parts, channels and copies too; points take the place of seconds."""
    for same in (path(), path().until(20.0), path().with_channels({"force": np.ones(101)}), copy.deepcopy(path())):
        assert not same.has_time
        assert same.provenance["time_base"] == "no time column: the points are a path, taken 1 s apart"
    assert path().between(10.0, 20.0).provenance["part"] == "points 11 to 21"
    assert not path().equals(path(has_time=True))


def test_a_ground_motion_has_time() -> None:
    with pytest.raises(UserError, match="has_time must be true"):
        building(has_time=False)


def test_every_sample_time_can_end_a_part() -> None:
    # Rounding once dropped the last sample of some windows: 0.3 / 0.1 is 2.9999999999999996.
    record = building(time_step=0.1)
    for last in range(8, 101):
        assert record.until(last * 0.1).n_times == last + 1


@pytest.mark.parametrize(("start", "end"), [(-1.0, 1.0), (1.0, 0.5), (0.0, 3.0), (1.0, np.nan)])
def test_a_part_outside_the_record_is_refused(start: float, end: float) -> None:
    with pytest.raises(UserError, match="is not inside the record shake table"):
        building().between(start, end)


def test_too_short_a_part_is_refused() -> None:
    with pytest.raises(UserError, match="at least 8 are needed"):
        building().until(0.1)


def test_select_keeps_order_and_noise() -> None:
    chosen = building().select(["acceleration_3", "acceleration_2"])
    assert list(chosen.channels) == ["acceleration_3", "acceleration_2"]
    assert dict(chosen.noise_sd) == {"acceleration_2": 0.1}
    assert chosen.floors == (2, 3)
    with pytest.raises(
        UserError, match="has no channel drift_1: it has acceleration_1, acceleration_2, acceleration_3"
    ):
        building().select(["drift_1"])


def test_with_channels_replaces_what_belongs_to_channels() -> None:
    record = building().with_channels({"drift_1": np.zeros(101)})
    assert list(record.channels) == ["drift_1"]
    assert dict(record.noise_sd) == {}
    assert dict(record.truth) == {"k[1]": 20.0}
    other = record.with_channels({"drift_1": np.zeros(101)}, noise_sd={"drift_1": 1e-3}, truth={"c[1]": 0.1})
    assert dict(other.noise_sd) == {"drift_1": 1e-3}
    assert dict(other.truth) == {"c[1]": 0.1}


def test_storey_forces_of_an_elastic_building() -> None:
    # Closed form: undamped eigenvector of three equal storeys, x_i = sin(i pi/7) q(t), storey force k (x_i - x_{i-1}).
    mass, stiffness = 2.0, 50.0
    omega_squared = 4.0 * stiffness / mass * np.sin(np.pi / 14.0) ** 2
    times = 0.01 * np.arange(400)
    motion = np.cos(np.sqrt(omega_squared) * times)
    shape = np.sin(np.arange(4) * np.pi / 7.0)
    accelerations = {f"acceleration_{i}": -omega_squared * shape[i] * motion for i in (3, 1, 2)}
    record = Record(name="free vibration", time_step=0.01, excitation=np.zeros(400), channels=accelerations)
    expected = stiffness * np.diff(shape)[:, None] * motion
    np.testing.assert_allclose(record.storey_forces([mass] * 3), expected, atol=1e-12)


def test_storey_forces_name_the_missing_floor() -> None:
    record = building().select(["acceleration_1", "acceleration_3"])
    with pytest.raises(UserError, match="the force of storey 1 needs acceleration_2"):
        record.storey_forces([1.0, 1.0, 1.0])
    top = record.storey_forces([1.0, 1.0, 4.0], lowest_storey=3)
    np.testing.assert_array_equal(top, [-4.0 * record.channels["acceleration_3"]])
    with pytest.raises(UserError, match="lowest_storey is 4 for 3 floor masses"):
        record.storey_forces([1.0, 1.0, 1.0], lowest_storey=4)


def test_content_hash_follows_the_data_alone() -> None:
    record = building()
    assert len(record.content_hash) == 64
    assert replace(record, name="other", provenance={}, truth={}, noise_sd={}).content_hash == record.content_hash
    nudged = record.excitation.copy()
    nudged[50] = np.nextafter(nudged[50], 9.0)
    channels = dict(record.channels)
    renamed = {name.replace("_3", "_4"): values for name, values in channels.items()}
    others = [
        replace(record, excitation=nudged),
        replace(record, time_step=0.01),
        replace(record, channels=renamed),
        record.select(["acceleration_3", "acceleration_2", "acceleration_1"]),
    ]
    assert len({record.content_hash, *(other.content_hash for other in others)}) == 5


def test_content_hash_tells_a_path_from_a_test_in_time() -> None:
    timed = Record(name="x", time_step=1.0, excitation=np.arange(8.0), excitation_kind="displacement")
    assert replace(timed, has_time=False).content_hash != timed.content_hash


def test_content_hash_is_stable() -> None:
    # Snapshot: the hash names data in reports and must not change between versions.
    record = Record(name="x", time_step=0.5, excitation=np.arange(8.0), channels={"drift_1": np.ones(8)})
    assert record.content_hash == "7f02613099c94837fd06b55aa6f9ad0f861375c11601c0ef3abc4b3fa3841d13"


def test_equals_sees_every_field() -> None:
    record = building()
    assert record.equals(building())
    other_fields: tuple[dict[str, object], ...] = (
        {"name": "other"},
        {"time_step": 0.01},
        {"excitation": record.excitation + 1.0},
        {"provenance": {}},
        {"truth": {}},
        {"noise_sd": {}},
    )
    for changes in other_fields:
        assert not record.equals(replace(record, **changes))  # type: ignore[arg-type]
    assert not record.equals(record.select(["acceleration_2", "acceleration_1", "acceleration_3"]))
    assert not record.equals(record.select(["acceleration_2"]))
    assert not record.select(["acceleration_2"]).equals(record)


def test_pickles_and_copies() -> None:
    # Records travel to worker processes; a MappingProxyType does not pickle by itself.
    record = building()
    assert pickle.loads(pickle.dumps(record)).equals(record)
    assert copy.deepcopy(record).equals(record)


def test_units_of_channels() -> None:
    assert si_unit("acceleration_12") == si_unit("relative_acceleration_1") == si_unit("ground_acceleration") == "m/s^2"
    assert si_unit("drift_1") == si_unit("displacement_2") == si_unit("displacement") == "m"
    assert si_unit("force") == si_unit("force_3") == "N"
    with pytest.raises(UserError, match="channel speed is not known"):
        si_unit("speed")


def test_what_a_terminal_would_obey_is_not_kept() -> None:
    """An ESC in the name of a record that somebody else sent reached the terminal."""
    motion = Record(name="\x1b]0;mine\x07A\u202eB\x9b31m", time_step=0.1, excitation=np.arange(8.0),
                    provenance={"by\x1b[2J": "me\x00\x1b[31m"})  # fmt: skip
    assert motion.name == "?]0;mine?A?B?31m".replace("?", "\N{REPLACEMENT CHARACTER}")
    assert "\x1b" not in str(dict(motion.provenance))


def test_every_third_point_is_as_if_it_had_been_measured_so() -> None:
    record = Record(
        name="cyclic",
        time_step=0.1,
        excitation=np.arange(31.0),
        channels={"force": 2.0 * np.arange(31.0)},
        excitation_kind="displacement",
    )
    kept = record.every(3)
    np.testing.assert_array_equal(kept.excitation, np.arange(0.0, 31.0, 3.0))
    np.testing.assert_array_equal(kept.channels["force"], 2.0 * kept.excitation)
    assert kept.time_step == pytest.approx(0.3)
    assert kept.duration == pytest.approx(record.duration)
    assert kept.provenance["points kept"] == "one in 3"
    assert record.every(1) is record


def test_a_path_keeps_the_points_where_it_turns() -> None:
    """A column's peaks were cut off by one point in two, and the law fitted to the rest left 15.8 % of all for 14.1."""
    path = np.interp(np.arange(31.0), [0.0, 5.0, 16.0, 30.0], [0.0, 1.0, -2.0, 3.0])
    record = Record(
        name="cyclic",
        time_step=1.0,
        excitation=path,
        channels={"force": 2.0 * path},
        excitation_kind="displacement",
        has_time=False,
    )
    kept = record.every(3)
    np.testing.assert_array_equal(kept.excitation, path[[0, 3, 5, 6, 9, 12, 15, 16, 18, 21, 24, 27, 30]])
    np.testing.assert_array_equal(kept.channels["force"], 2.0 * kept.excitation)
    assert kept.provenance["points kept"] == "one in 3, and where it turns"


COUNTED = np.arange(101) % 10 < 7


def test_samples_that_do_not_count_are_forgotten() -> None:
    whole = building()
    masked = replace(whole, counted=COUNTED)
    assert (masked.n_times, masked.n_counted) == (101, np.count_nonzero(COUNTED))
    for before, after in zip(whole.measured, masked.measured, strict=True):
        np.testing.assert_array_equal(after[masked.kept], before[COUNTED])
        assert not np.any(after[~COUNTED])
    np.testing.assert_array_equal(masked.excitation, whole.excitation)
    other = replace(whole, counted=COUNTED, channels={k: np.where(COUNTED, v, 7.0) for k, v in whole.channels.items()})
    assert masked.equals(other)
    assert masked.content_hash == other.content_hash != whole.content_hash
    assert not masked.equals(whole)
    assert pickle.loads(pickle.dumps(masked)).equals(masked)


def test_parts_know_which_samples_count() -> None:
    masked = building(counted=COUNTED)
    np.testing.assert_array_equal(masked.between(0.2, 0.6).counted, COUNTED[10:31])
    assert replace(masked, counted=np.arange(101) < 60).until(1.0).counted is None
    assert building(counted=np.ones(101, dtype=bool)).counted is None


@pytest.mark.parametrize(
    ("counted", "sentence"),
    [
        (COUNTED[:50], "counted has shape \\(50,\\) where the excitation has 101 points"),
        (np.arange(101) < 7, "7 points of the record count: at least 8 are needed"),
    ],
)
def test_a_wrong_mask_is_told(counted: np.ndarray, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        building(counted=counted)


@pytest.mark.parametrize("suffix", [".csv", ".nc"])
def test_no_file_says_which_samples_count(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(UserError, match="30 samples of record 'shake table' do not count: give the whole record"):
        write_record(building(counted=COUNTED), tmp_path / f"masked{suffix}")


@pytest.mark.parametrize("suffix", [".csv", ".nc", ".mat", ".AT2", ".v2", ".smc"])
def test_what_is_no_plain_file_is_not_read(tmp_path: Path, suffix: str) -> None:
    """A named pipe was waited for without end, `/dev/zero` read until memory ended."""
    path = tmp_path / f"record{suffix}"
    path.symlink_to("/dev/null")
    with pytest.raises(UserError, match=r"it is no plain file\): give the path of one"):
        read_record(path)


@pytest.mark.parametrize("counted", [np.ones(7, dtype=np.bool_), np.arange(7) > 0])
def test_a_mask_of_another_length_is_refused(counted: np.ndarray) -> None:
    """One that left nothing out was taken without a word."""
    with pytest.raises(UserError, match=r"counted has shape \(7,\) where the excitation has 101 points"):
        building(counted=counted)
