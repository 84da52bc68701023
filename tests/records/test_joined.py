"""Records joined: what each says stays its own."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from bwbn_bayes import Record, UserError, add_noise, join_records, periodic
from bwbn_bayes.records.blocks import by_block, by_part, counts, measured_or_nan, over_time
from bwbn_bayes.records.record import require_single, require_whole


def made(name: str, n: int, time_step: float, *channels: str, **others: object) -> Record:
    """A record of noise."""
    rng = np.random.default_rng(n)
    return Record(
        name=name,
        time_step=time_step,
        excitation=rng.normal(size=n),
        channels={channel: rng.normal(size=n) for channel in channels},
        **others,
    )


FIRST = made("a", 20, 0.5, "acceleration_1", "drift_1")
SECOND = made("b", 30, 0.25, "drift_1", "acceleration_2", counted=np.arange(30) < 25)
JOINED = join_records([FIRST, SECOND], in_sequence=True)


def test_each_begins_one_of_its_time_steps_after_the_end_of_the_one_before() -> None:
    np.testing.assert_allclose(JOINED.times[:20], FIRST.times)
    np.testing.assert_allclose(JOINED.times[20:], 9.5 + 0.25 * np.arange(1, 31))
    assert JOINED.duration == pytest.approx(9.5 + 7.5)
    assert JOINED.n_times == 50
    assert JOINED.n_counted == 45
    assert JOINED.name == "a, then b"
    assert join_records([FIRST, SECOND]).name == "a and b"


def test_blocks_are_the_channels_of_each_record() -> None:
    assert [block.label for block in JOINED.blocks] == [
        "acceleration_1 of a", "drift_1 of a", "drift_1 of b", "acceleration_2 of b",
    ]  # fmt: skip
    assert list(JOINED.channels) == ["acceleration_1", "drift_1", "acceleration_2"]
    assert counts(JOINED).tolist() == [20, 20, 25, 25]
    for own, record, channel in zip(
        by_block(JOINED, JOINED.measured),
        (FIRST, FIRST, SECOND, SECOND),
        ("acceleration_1", "drift_1", "drift_1", "acceleration_2"),
        strict=True,
    ):
        np.testing.assert_array_equal(own, record.channels[channel][record.kept])
    (first, rows), (second, others) = by_part(JOINED, JOINED.measured)
    assert (first, second) == (FIRST, SECOND)
    np.testing.assert_array_equal(rows, FIRST.measured)
    np.testing.assert_array_equal(others, SECOND.measured)


def test_values_of_blocks_stand_where_they_were_measured() -> None:
    values = over_time(JOINED, np.array([1.0, 2.0, 3.0, 4.0]))
    assert values.shape == (3, 50)
    assert set(values[0, :20]) == {1.0}
    assert not np.any(values[0, 20:])
    assert set(values[1, :20]) == {2.0}
    assert set(values[1, 20:45]) == {3.0}
    np.testing.assert_array_equal(values == 0.0, np.isnan(measured_or_nan(JOINED)))


def test_one_record_is_its_own_only_part() -> None:
    assert FIRST.parts == (FIRST,)
    assert [block.label for block in FIRST.blocks] == list(FIRST.channels)
    np.testing.assert_array_equal(over_time(FIRST, np.array([1.0, 2.0])), np.repeat([[1.0], [2.0]], 20, axis=1))


def test_the_first_seconds_reach_as_far_as_they_do() -> None:
    assert [part.n_times for part in JOINED.until(7.0).parts] == [15]
    assert [part.n_times for part in JOINED.until(10.0).parts] == [20]  # 2 samples of b are no record
    assert [part.n_times for part in JOINED.until(12.0).parts] == [20, 10]
    assert JOINED.until(12.0).is_sequence
    with pytest.raises(UserError, match="only its beginning"):
        JOINED.between(1.0, 5.0)


def test_records_are_changed_one_by_one() -> None:
    assert [part.time_step for part in JOINED.every(2).parts] == [1.0, 0.5]
    assert [list(part.channels) for part in JOINED.select(["drift_1"]).parts] == [["drift_1"], ["drift_1"]]
    assert [list(part.channels) for part in JOINED.select(["acceleration_2"]).parts] == [[], ["acceleration_2"]]
    ones = JOINED.with_channels({name: np.ones(50) for name in JOINED.channels})
    assert [list(part.channels) for part in ones.parts] == [list(FIRST.channels), list(SECOND.channels)]
    assert np.all(ones.parts[0].measured == 1.0)
    loud = add_noise(JOINED, 20.0, np.random.default_rng(1))
    for part, clean in zip(loud.parts, JOINED.parts, strict=True):
        sizes = np.sqrt(np.mean(clean.measured**2, axis=1))
        np.testing.assert_allclose(list(part.noise_sd.values()), 0.1 * sizes)


def test_what_is_known_of_new_noise_stays_with_its_record() -> None:
    ones = {name: np.ones(50) for name in JOINED.channels}
    told = JOINED.with_channels(ones, noise_sd={"acceleration_2": 0.3})
    assert [dict(part.noise_sd) for part in told.parts] == [{}, {"acceleration_2": 0.3}]


def test_motions_that_nothing_measures_have_no_floors() -> None:
    bare = [Record(name=name, time_step=0.1, excitation=np.ones(20)) for name in ("first", "second")]
    assert join_records(bare).floors == ()


def test_it_survives_a_pickle_and_its_hash_knows_the_order() -> None:
    again = pickle.loads(pickle.dumps(JOINED))
    assert again.equals(JOINED)
    assert again.content_hash == JOINED.content_hash
    others = [join_records([FIRST, SECOND]), join_records([SECOND, FIRST], in_sequence=True)]
    assert len({JOINED.content_hash, *(other.content_hash for other in others)}) == 3
    assert not any(JOINED.equals(other) for other in others)


def test_what_knows_of_one_record_refuses_several() -> None:
    with pytest.raises(UserError, match="'a, then b' joins 2 records, and a search knows of one: give one of them"):
        require_single(JOINED, "a search knows of one:")
    with pytest.raises(UserError, match="joins 2 records"):
        require_whole(JOINED)


def test_periods_that_only_drive_come_before_the_measured_one() -> None:
    steady = periodic(FIRST, periods=3)
    assert [list(part.channels) for part in steady.parts] == [[], [], [], list(FIRST.channels)]
    assert steady.name == "a"
    assert steady.n_counted == 20
    with pytest.raises(UserError, match="periods is 0, it must be a whole number from 1 on"):
        periodic(FIRST, periods=0)


@pytest.mark.parametrize(
    ("records", "message"),
    [
        ([], "was given no record"),
        ([JOINED, FIRST], "joins single records"),
        (
            [FIRST, Record(name="d", time_step=1.0, excitation=np.ones(20), excitation_kind="displacement")],
            "'a' and 'd' cannot be joined: the one is driven by ground_acceleration, the other driven by displacement",
        ),
    ],
)
def test_what_cannot_be_joined_is_one_sentence(records: list[Record], message: str) -> None:
    with pytest.raises(UserError, match=message):
        join_records(records)
