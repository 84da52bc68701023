"""What is held out, on signals whose parting time is known; predictions of it against closed forms.

The standard error of a prediction is compared with the spread of many records.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from bwbn_bayes.cli import main
from bwbn_bayes.discovery import workflow
from bwbn_bayes.discovery.held_out import HeldOut, Prediction, floor_of, parting_time, predict, set_apart
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SensorGain, SlipLock
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.excitation import el_centro, sine
from bwbn_bayes.records.readers import read_record, write_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.report.discovery_content import gather_discovery
from bwbn_bayes.report.discovery_figures import draw_discovery
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.starting_model import starting_model
from bwbn_bayes.structures.structure import Structure

MODEL = ShearBuilding(
    masses=[2.0, 1.0], storey=BoucWen(k=Uniform(20, 100), c=0.3, alpha=0.1, beta=8.0, gamma=2.0, n=1.3)
)
POINT = np.array([0.5])
ENGINE = Lanes(substeps=1, n_threads=1)
CHANNELS = ("acceleration_1", "acceleration_2")
TRAINING, UNSEEN = el_centro("chopra", duration=8.0), el_centro("rsn6_180", duration=10.0)
TRAINING_SD = (0.05, 0.02)


def response(ground: Record) -> Floats:
    return ENGINE.simulate(MODEL, MODEL.space.from_unit(POINT[None]), ground, CHANNELS).values[0]


@pytest.fixture(scope="module")
def clean() -> Floats:
    return response(UNSEEN)


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    """Fitted to a record whose residual at POINT has an rms of exactly TRAINING_SD."""
    values = response(TRAINING)
    signs = np.where(np.arange(TRAINING.n_times) % 2 == 0, 1.0, -1.0)
    channels = {name: row + sd * signs for name, row, sd in zip(CHANNELS, values, TRAINING_SD, strict=True)}
    record = replace(TRAINING, channels=channels)
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))


def predicted(posterior: Posterior, measured: Floats, seed: int = 1) -> Prediction:
    record = replace(UNSEEN, channels=dict(zip(CHANNELS, measured, strict=True)))
    return predict(posterior, POINT, record, np.random.default_rng(seed))


def test_the_error_is_the_closed_form(posterior: Posterior, clean: Floats) -> None:
    """Gains off by 10 % and 30 %: errors of 0.1 / 1.1 and 0.3 / 1.3 of what was measured, whatever the motion."""
    found = predicted(posterior, clean * np.array([[1.1], [1.3]]))
    assert found.channels == CHANNELS
    np.testing.assert_array_equal(found.values, clean)
    assert found.nrmse == pytest.approx(np.sqrt(0.5 * ((0.1 / 1.1) ** 2 + (0.3 / 1.3) ** 2)), rel=1e-12)


def test_the_log_density_is_the_closed_form(posterior: Posterior, clean: Floats) -> None:
    """Errors of one and two of the training record's noise levels: the normal density at 1 and at 2."""
    shifts = np.array([[TRAINING_SD[0]], [2.0 * TRAINING_SD[1]]])
    found = predicted(posterior, clean + shifts)
    each = -0.5 * np.array([1.0, 4.0]) - np.log(TRAINING_SD) - 0.5 * np.log(2.0 * np.pi)
    assert found.log_density == pytest.approx(np.mean(each), rel=1e-9)


def test_a_perfect_prediction(posterior: Posterior, clean: Floats) -> None:
    found = predicted(posterior, clean)
    assert (found.nrmse, found.nrmse_se) == (0.0, 0.0)


def test_the_standard_error_is_the_spread_of_records(posterior: Posterior, clean: Floats) -> None:
    """White noise of a tenth of each channel's rms: over 60 records the sd of the error is known to 9 %.

    Blocks of ten samples have a heavy-tailed spread of their own, so that the mean of the bootstrap is asked for a
    quarter.
    """
    sd = 0.1 * np.sqrt(np.mean(clean**2, axis=1, keepdims=True))
    found = [
        predicted(posterior, clean + sd * np.random.default_rng([2, seed]).standard_normal(clean.shape), seed)
        for seed in range(60)
    ]
    errors = np.array([one.nrmse for one in found])
    assert np.mean(errors) == pytest.approx(0.1 / np.sqrt(1.01), rel=0.01)
    assert np.mean([one.nrmse_se for one in found]) == pytest.approx(np.std(errors, ddof=1), rel=0.25)


def test_an_error_in_one_stretch_is_less_certain_than_one_throughout(posterior: Posterior, clean: Floats) -> None:
    """The bootstrap sees time: the same energy in a tenth of the record could as well have been missed."""
    n = clean.shape[1]
    signs = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    throughout = predicted(posterior, clean + 0.1 * signs)
    burst = (np.arange(n) < n // 10) * np.sqrt(n / (n // 10))
    local = predicted(posterior, clean + 0.1 * signs * burst)
    # What was measured differs by the error itself.
    assert local.nrmse == pytest.approx(throughout.nrmse, rel=0.02)
    assert local.nrmse_se > 20.0 * throughout.nrmse_se
    # Three of thirty blocks hold all: the share drawn has an sd of sqrt(0.1 0.9 / 30) = 0.055 about 0.1.
    assert local.nrmse_se == pytest.approx(0.5 * local.nrmse * 0.0548 / 0.1, rel=0.3)


def test_the_draws_come_from_the_stream_given(posterior: Posterior, clean: Floats) -> None:
    noisy = clean + 0.05 * np.random.default_rng(3).standard_normal(clean.shape)
    assert predicted(posterior, noisy, 4).nrmse_se == predicted(posterior, noisy, 4).nrmse_se
    assert predicted(posterior, noisy, 4).nrmse_se != predicted(posterior, noisy, 5).nrmse_se


def test_a_channel_that_was_not_trained_on_has_a_noise_level_of_its_own(posterior: Posterior) -> None:
    rng = np.random.default_rng(6)
    drift = ENGINE.simulate(MODEL, MODEL.space.from_unit(POINT[None]), UNSEEN, ("drift_1",)).values[0, 0]
    record = replace(UNSEEN, channels={"drift_1": drift + 1e-3 * rng.standard_normal(UNSEEN.n_times)})
    found = predict(posterior, POINT, record, rng)
    # The mean log density of a normal sample at its own sd; the model-free level is good to a few per cent.
    assert found.log_density == pytest.approx(-0.5 - np.log(1e-3) - 0.5 * np.log(2.0 * np.pi), abs=0.2)


def test_the_floor_is_the_noise_over_the_signal(clean: Floats) -> None:
    """30 and 20 dB: the root mean square of 10^-1.5 and 10^-1, to the few per cent of a model-free estimate."""
    rng = np.random.default_rng(7)
    rms = np.sqrt(np.mean(clean**2, axis=1))
    noisy = clean + (rms * np.array([10.0**-1.5, 10.0**-1.0]))[:, None] * rng.standard_normal(clean.shape)
    record = replace(UNSEEN, channels=dict(zip(CHANNELS, noisy, strict=True)))
    assert floor_of(record) == pytest.approx(np.sqrt(0.5 * (1e-3 + 1e-2)), rel=0.12)


def test_a_record_that_measures_nothing_is_the_users_mistake(posterior: Posterior) -> None:
    with pytest.raises(UserError, match="measures nothing"):
        predict(posterior, POINT, replace(UNSEEN, channels={}), np.random.default_rng(8))


def test_only_what_comes_after_counts(posterior: Posterior, clean: Floats) -> None:
    """Nonsense in the first 600 samples, a gain off by 10 % after them; the state comes from the whole motion."""
    measured = 1.1 * clean
    measured[:, :600] = 7.0
    record = replace(UNSEEN, channels=dict(zip(CHANNELS, measured, strict=True)))
    found = predict(posterior, POINT, record, np.random.default_rng(9), counted=slice(600, None))
    np.testing.assert_array_equal(found.values, clean[:, 600:])
    assert found.nrmse == pytest.approx(0.1 / 1.1, rel=1e-12)
    noisy = clean + 0.01 * np.random.default_rng(10).standard_normal(clean.shape)
    record = replace(UNSEEN, channels=dict(zip(CHANNELS, noisy, strict=True)))
    rms = np.sqrt(np.mean(noisy[:, 600:] ** 2, axis=1))
    assert floor_of(record, counted=slice(600, None)) == pytest.approx(np.sqrt(np.mean((0.01 / rms) ** 2)), rel=0.12)


TIMES = 0.01 * np.arange(1001)
STOREY = BoucWen(k=Uniform(20, 100), c=0.3, alpha=0.1, beta=8.0, gamma=2.0, n=1.3)
SPECIMEN = Specimen(storey=STOREY)


def waves(amplitude: Callable[[Floats], Any]) -> Floats:
    """Ten seconds of a sine of 1 Hz; ``amplitude`` of time."""
    return np.asarray(amplitude(TIMES) * np.sin(2.0 * np.pi * TIMES))


def cyclic(force: Floats) -> Record:
    return Record(
        name="test 3", time_step=0.01, excitation=force, excitation_kind="displacement", channels={"force": force}
    )


def shaken(**channels: Floats) -> Record:
    return Record(name="run 3", time_step=0.01, excitation=np.cos(TIMES), channels=channels)


STEADY = waves(np.ones_like)
ENDING = waves(lambda t: np.where(t < 7.0, 1.0, 0.0))
"""The last sample of its positive half waves at 0.6 or more lies at 6.39 s: 6.5 s - asin(0.6) / (2 pi) = 6.398 s."""


@pytest.mark.parametrize(
    ("force", "time"),
    [
        (STEADY, 8.5),
        (ENDING, 6.38),
        (ENDING + 5.0, 6.38),
        (1e-6 * ENDING, 6.38),
        (waves(lambda t: np.where(t < 7.0, 1.0, 0.61)), 8.5),
        (waves(lambda t: np.where(t < 7.0, 0.61, 1.0)), 8.5),
        # A test of growing amplitude: its end is the strongest.
        (waves(lambda t: np.ceil(t)), 8.5),
    ],
)
def test_both_parts_move_strongly(force: Floats, time: float) -> None:
    assert parting_time(SPECIMEN, cyclic(force)) == pytest.approx(time, abs=1e-9)


@pytest.mark.parametrize(
    ("force", "reached"),
    [
        (waves(lambda t: np.where(t < 4.0, 1.0, 0.505)), 50),
        (waves(lambda t: np.where(t < 9.0, 0.599, 1.0)), 59),
        # Strong in one direction only, and a single spike.
        (np.maximum(STEADY, np.where(TIMES < 4.0, -1.0, -0.25)), None),
        (waves(lambda t: np.where(t < 4.0, 1.0, 0.3)) + 0.9 * (np.abs(TIMES - 8.0) < 0.005), None),
    ],
)
def test_no_end_to_hold_out_is_told(force: Floats, reached: int | None) -> None:
    share = "" if reached is None else f"reaches at most {reached} % of the peak of force"
    with pytest.raises(UserError, match=rf"'test 3' has no end .* between 5 and 8.5 s.*{share}.*--held-out FILE"):
        parting_time(SPECIMEN, cyclic(force))


def test_a_path_without_time_is_parted_between_points() -> None:
    """It was said to be parted between seconds."""
    path = replace(cyclic(waves(lambda t: np.where(t < 4.0, 1.0, 0.3))), has_time=False)
    with pytest.raises(UserError, match=r"no end to hold out: wherever it is parted between points 501 and 851, one"):
        parting_time(SPECIMEN, path)


def test_a_building_is_judged_by_its_base_shear_where_that_is_measured() -> None:
    """The base shear is that of a steady motion, though both floors' own accelerations come to rest."""
    building = ShearBuilding(masses=[2.0, 1.0], storey=STOREY)
    early = waves(lambda t: np.where(t < 4.0, 1.0, 0.0))
    both = shaken(acceleration_1=0.5 * (ENDING - early), acceleration_2=early)
    assert parting_time(building, both) == pytest.approx(6.38)
    with pytest.raises(UserError, match="0 % of the peak of acceleration_2"):
        parting_time(building, both.select(["acceleration_2"]))
    # Without the masses of every floor each channel must pass.
    taller = ShearBuilding(masses=[2.0, 1.0, 1.0], storey=STOREY)
    assert parting_time(taller, shaken(acceleration_1=STEADY, acceleration_3=ENDING)) == pytest.approx(6.38)


def test_the_parts_meet_and_do_not_overlap() -> None:
    whole = cyclic(ENDING)
    training, apart = set_apart(SPECIMEN, whole, "end")
    assert apart == HeldOut(record=whole, after_s=training.duration)
    assert training.n_times == apart.first == 639
    assert apart.label == "held-out end, after 6.38 s"
    other = cyclic(STEADY)
    assert set_apart(SPECIMEN, whole, other) == (whole, HeldOut(record=other))
    assert (HeldOut(record=other).first, HeldOut(record=other).label) == (0, "held-out record")
    assert set_apart(SPECIMEN, whole, None) == (whole, None)
    with pytest.raises(UserError, match=r"'other\.csv'.*read_record"):
        set_apart(SPECIMEN, whole, "other.csv")  # type: ignore[arg-type]


def test_what_comes_after_changes_nothing_but_the_held_out_figures() -> None:
    model = ShearBuilding(masses=[2.0], storey=STOREY)
    clean = simulate(model, sine(3.0, 1.0, 8.0, 0.02), {"k": 60.0}, snr_db=30.0, seed=4)
    changed = clean.channels["acceleration_1"].copy()
    changed[-40:] *= 0.8
    settings = DiscoverySettings(effects=(SensorGain,), particles=100, n_workers=1)
    facts = [
        discover(model, record, held_out="end", settings=settings).as_json()
        for record in (clean, clean.with_channels({"acceleration_1": changed}))
    ]
    figures = [one["gap"].pop("held_out") for one in facts]
    for one in facts:
        del one["best_model"]["held_out"], one["data_sha256"]  # that of the whole record as given
        one["sentences"] = [sentence for sentence in one["sentences"] if "held-out" not in sentence]
        one["elapsed_s"] = [step.pop("elapsed_s") for step in one["steps"]] and None
    assert facts[0] == facts[1]
    assert figures[0]["after_s"] == figures[1]["after_s"] == pytest.approx(6.8)
    # A model that is right leaves the noise; a fifth of the signal in 40 of 60 samples is far more.
    assert figures[0]["after"] < 1.3 * figures[0]["noise_floor"]
    assert figures[1]["after"] > 3.0 * figures[1]["noise_floor"]


def test_the_command_says_that_there_is_no_end(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_record(shaken(acceleration_1=waves(lambda t: np.exp(-t))), tmp_path / "dying.csv")
    options = ["--record", str(tmp_path / "dying.csv"), "--held-out", "end", "--out", str(tmp_path / "out")]
    with pytest.raises(SystemExit) as leaving:
        main(["discover", str(inputs / "one_storey.py"), *options])
    assert leaving.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: record 'run 3' has no end to hold out")


@pytest.mark.parametrize("held_out", ["end", "repeats"])
def test_a_starting_model_reads_no_size_off_what_is_held_out(
    held_out: Literal["end", "repeats"], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The priors of ``bwbn discover RECORD --held-out end`` were made of the whole record's peaks."""
    path, given = pushed(*THRICE), []
    force = 1e5 * np.tanh(path.excitation / 0.005) + 4e4 * np.sign(np.gradient(path.excitation))
    _, apart = set_apart(COLUMN, replace(path, channels={"force": force}), held_out)
    assert apart is not None
    force[apart.counted] *= 1.5
    write_record(replace(path, channels={"force": force}), tmp_path / "column.csv")

    def noted(model: Structure, *_: object, **__: object) -> None:
        given.append(model)
        raise UserError("enough")

    monkeypatch.setattr(workflow, "discover", noted)
    with pytest.raises(SystemExit):
        main(["discover", str(tmp_path / "column.csv"), "--held-out", held_out, "--out", str(tmp_path / "out")])
    record = read_record(tmp_path / "column.csv")
    assert given == [starting_model(set_apart(COLUMN, record, held_out)[0])]
    assert given != [starting_model(record)]


def test_what_is_left_of_a_short_record_can_be_fitted() -> None:
    """30 of 36 points were left, and refused for their noise when the search had begun."""
    short = shaken(acceleration_1=STEADY).until(0.35)
    with pytest.raises(UserError, match="no end to hold out: of its 36 points at least 32 must be left to fit"):
        parting_time(MODEL, short)


def pushed(*amplitudes: float, per_half: int = 24) -> Record:
    """A path through half cycles of these amplitudes [m], pulled and pushed in turn, from rest; no force yet."""
    targets = [0.0, *(a * (-1.0) ** i for i, a in enumerate(amplitudes))]
    ways = [np.linspace(a, b, per_half + 1)[1:] for a, b in pairwise(targets)]
    return Record(
        name="column", time_step=1.0, excitation=np.concatenate([[0.0], *ways]), excitation_kind="displacement",
        has_time=False,
    )  # fmt: skip


THRICE = np.repeat([0.005, 0.01, 0.015, 0.02], 6)
"""Three cycles at each of four amplitudes."""
COLUMN = Specimen(storey=BoucWen(k=Uniform(1e5, 1e6), c=0.0, alpha=0.05, A=1.0, beta=200.0, gamma=100.0, n=1.5))


def test_the_first_cycle_at_each_amplitude_is_fitted_and_the_others_are_held_out() -> None:
    path = pushed(*THRICE)
    record = path.with_channels({"force": np.arange(1.0, path.n_times + 1.0)})
    training, apart = set_apart(COLUMN, record, "repeats")
    assert apart is not None and apart.label == "held-out repeat cycles" and apart.record is record
    half = (np.arange(path.n_times) - 1) // 24
    held_out = (half >= 0) & (half % 6 >= 2)
    np.testing.assert_array_equal(apart.counted, np.flatnonzero(held_out))
    np.testing.assert_array_equal(training.counted, ~held_out)
    np.testing.assert_array_equal(training.channels["force"], np.where(held_out, 0.0, record.channels["force"]))
    np.testing.assert_array_equal(training.excitation, record.excitation)


@pytest.mark.parametrize(
    ("record", "sentence"),
    [
        (cyclic(STEADY), "'test 3' has no repeat cycles to hold out: 18 of its 21 half cycles repeat .* 4 must not"),
        (cyclic(waves(np.ceil)), "0 of its 21 half cycles repeat an amplitude, at least 2 must .* --held-out end$"),
        (shaken(acceleration_1=STEADY), "'run 3' is a ground motion, which repeats no cycles: .* --held-out end$"),
        # The end was advised where there is none either.
        (cyclic(waves(lambda t: np.exp(-t))), "0 of its .*; hold out another .* --held-out FILE$"),
        (shaken(acceleration_1=waves(lambda t: np.exp(-t))), "no cycles: hold out another .* --held-out FILE$"),
    ],
)
def test_no_repeat_cycles_to_hold_out_are_told(record: Record, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        set_apart(SPECIMEN, record, "repeats")


@pytest.mark.usefixtures("undrawn")
def test_repeat_cycles_change_nothing_but_the_held_out_figures() -> None:
    """A slip that the model as given lacks; then the same test with nonsense in its repeat cycles.

    Of 384 held-out points whose intervals hold nine of ten, the share inside has a standard error of 1.5 % if they are
    independent, as the white noise of this record is. A free shape of the slip is a nat ahead of the usual form.
    """
    slipping = COLUMN.with_effect(SlipLock(delta_s=1e-4, sigma=0.05))
    clean = simulate(slipping, pushed(*THRICE), {"k": 4e5}, snr_db=30.0, seed=5)
    held_out = set_apart(COLUMN, clean, "repeats")[1]
    assert held_out is not None
    changed = clean.channels["force"].copy()
    changed[held_out.counted] *= 1e3 * np.random.default_rng(6).random(len(held_out.counted))
    settings = DiscoverySettings(effects=(SlipLock,), particles=100, most_effects=1, n_workers=1)
    found = [
        discover(COLUMN, record, held_out="repeats", settings=settings)
        for record in (clean, clean.with_channels({"force": changed}))
    ]
    facts = [one.as_json() for one in found]
    figures = [one["gap"].pop("held_out") for one in facts]
    for one in facts:
        del one["best_model"]["held_out"], one["data_sha256"]  # that of the whole record as given
        one["sentences"] = [sentence for sentence in one["sentences"] if "held-out" not in sentence]
        one["elapsed_s"] = [step.pop("elapsed_s") for step in one["steps"]] and None
    assert facts[0] == facts[1]
    assert [one["name"] for one in facts[0]["effects"]] == ["slip_lock"]
    assert figures[0]["repeats"] and figures[0]["after"] < 1.3 * figures[0]["noise_floor"]
    assert abs(figures[0]["coverage_90"] - 0.9) < 4.0 * 0.015
    assert figures[1]["coverage_90"] < 0.05
    interval = found[0].gap.held_out.interval if found[0].gap.held_out is not None else None
    assert interval is not None and interval.in_words in found[0].sentences
    np.testing.assert_array_equal(interval.low, found[1].gap.held_out.interval.low)  # type: ignore[union-attr]
    # The page draws both parts, and the record that is written is the whole one.
    assert found[0].measurement is clean
    drawn = {drawing.name: drawing for drawing in draw_discovery(gather_discovery(found[0]))}
    assert "90 % predictive intervals" in drawn["loops_by_cycle.png"].caption
    with pytest.raises(UserError, match="do not count: give the whole record"):
        write_record(found[0].record, Path("never.csv"))


def test_the_command_refuses_the_repeat_cycles_of_a_building(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_record(shaken(acceleration_1=STEADY), tmp_path / "quake.csv")
    options = ["--record", str(tmp_path / "quake.csv"), "--held-out", "repeats", "--out", str(tmp_path / "out")]
    with pytest.raises(SystemExit) as leaving:
        main(["discover", str(inputs / "one_storey.py"), *options])
    assert leaving.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: record 'run 3' is a ground motion, which repeats no cycles: hold out another")


def test_repeat_cycles_of_a_test_with_more_points_than_are_fitted_are_thinned_alike(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They were looked for in the thinned record by their places in the whole one, which ended in an IndexError."""
    monkeypatch.setattr(workflow, "MOST_POINTS", 300)
    slipping = COLUMN.with_effect(SlipLock(delta_s=1e-4, sigma=0.05))
    record = simulate(slipping, pushed(*THRICE), {"k": 4e5}, snr_db=30.0, seed=5)
    settings = DiscoverySettings(effects=(SlipLock,), particles=100, most_effects=1, n_workers=1)
    found = discover(COLUMN, record, held_out="repeats", settings=settings)
    assert found.held_out is not None and found.gap.held_out is not None
    assert found.record.n_times == found.held_out.record.n_times == (record.n_times + 1) // 2
    assert found.gap.held_out.interval is not None
    assert 0.8 < found.gap.held_out.interval.coverage < 0.98


def test_repeat_cycles_that_turn_beside_the_points_kept_are_thinned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the turning points more than the most were left and thinned again, beside what is held out of the first."""
    monkeypatch.setattr(workflow, "MOST_POINTS", 344)
    monkeypatch.setattr(workflow, "_given", lambda _, record, *__: record)
    monkeypatch.setattr(workflow, "_searched", lambda record, _: record)
    monkeypatch.setattr(workflow, "conclude", lambda record, apart, *_: (record, apart))
    path = pushed(*THRICE, per_half=100)
    force = path.excitation + 1e-3 * np.random.default_rng(1).standard_normal(path.n_times)
    settings = DiscoverySettings(n_workers=1)
    found: Any = discover(COLUMN, path.with_channels({"force": force}), held_out="repeats", settings=settings)
    record, apart = found
    assert record.n_times == apart.record.n_times > 344
    np.testing.assert_array_equal(np.flatnonzero(~record.counted), apart.counted)
