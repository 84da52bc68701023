"""Several records of one structure in a search: each with its own noise, together more than each alone."""

from __future__ import annotations

import json
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.cli import main
from bwbn_bayes.discovery import workflow
from bwbn_bayes.discovery.candidates import hypotheses, scales_of
from bwbn_bayes.discovery.cross_validation import cross_validated
from bwbn_bayes.discovery.held_out import floor_of, predict, set_apart
from bwbn_bayes.discovery.outcome import Discovery
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.where import disagreement
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, SensorGain, StrengthDegradation, SuddenDamage
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference import modes
from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.least_squares import squares_of
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior, default_noise
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.inference.unnamed.pulses import Knots, answers
from bwbn_bayes.inference.unnamed.storey import functions, over_time
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.joined import JoinedRecord, join_records
from bwbn_bayes.records.readers import write_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.report import write_discovery
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

ENGINE = Lanes(substeps=2, n_threads=1)
FEW = DiscoverySettings(effects=(CubicStiffness, SensorGain), n_workers=1, particles=300)
STOREY = BoucWen(
    k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), A=1.0, beta=Uniform(0.5, 40), gamma=2.0, n=1.3
)
ONE = ShearBuilding(masses=[2.0], storey=STOREY)
TRUTH = {"k": 60.0, "c": 0.4, "alpha": 0.15, "beta": 12.0}
GROUND = el_centro("chopra", duration=20.0)

TWO = ShearBuilding(masses=[2.0, 1.0], storey=BoucWen(k=Uniform(20, 100), c=0.3, alpha=0.1, A=1.0, beta=8.0, gamma=2.0))
POINT = np.array([0.5])


def unlike(seed: int = 3) -> JoinedRecord:
    """Two records of a building with noise, channels and time steps of their own, and a pause between them."""
    rng, values = np.random.default_rng(seed), TWO.space.from_unit(POINT[None])
    parts = [
        replace(GROUND.between(0.0, 6.0), name="first"),
        Record(name="pause", time_step=0.02, excitation=np.zeros(50)),
        replace(GROUND.between(1.0, 13.0), name="second").every(2),
    ]
    names = [("acceleration_1", "acceleration_2"), (), ("drift_1", "acceleration_2")]
    found = []
    for part, own, level in zip(parts, names, (0.02, 0.0, 0.1), strict=True):
        clean = ENGINE.simulate(TWO, values, part, own).values[0] if own else np.empty((0, part.n_times))
        sizes = np.std(clean, axis=1, keepdims=True) if own else clean
        rows = clean + level * sizes * rng.standard_normal(clean.shape)
        found.append(part.with_channels(dict(zip(own, rows, strict=True))))
    return join_records(found)


UNLIKE = unlike()


def posterior_of(record: Record) -> Posterior:
    return Posterior(model=TWO, record=record, engine=ENGINE, noise=default_noise(record))


def test_slopes_are_those_of_the_likelihood() -> None:
    """The normal equations of the engine, which sums over blocks by itself."""
    posterior, point = posterior_of(UNLIKE), np.array([0.4])
    slopes, local = Slopes.at(posterior, point), posterior.linearise(point[None])
    np.testing.assert_allclose(slopes.base.T @ slopes.base, local.information[0], rtol=1e-9)
    np.testing.assert_allclose(slopes.base.T @ slopes.residual.ravel(), local.gradient[0], rtol=1e-9)
    response = ENGINE.simulate(TWO, posterior.split(point[None])[0], UNLIKE).values
    np.testing.assert_allclose(squares_of(UNLIKE, response, None), posterior.misfit(point[None]), rtol=1e-9)
    # Neither a record that measures nothing nor a channel that one of them lacks has any weight.
    pause, lacking = UNLIKE.stretches[1], list(UNLIKE.channels).index("drift_1")
    assert not np.any(slopes.residual[:, pause])
    assert not np.any(slopes.residual[lacking, UNLIKE.stretches[0]])


@pytest.mark.parametrize("in_sequence", [False, True])
def test_errors_have_the_past_of_their_own_record(in_sequence: bool) -> None:
    """Log likelihood, slope and information by block are those of each record under its own filters."""
    record = join_records(UNLIKE.parts, in_sequence=in_sequence)
    filters = (np.array([0.5]), np.empty(0), np.array([0.9, -0.3]), np.array([0.2]))
    noise, points = default_noise(record), np.array([[0.4], [0.55]])
    correlation = Correlation(coefficients=filters, blocks=record.blocks)
    posterior = posterior_of(record).with_noise(replace(noise, correlation=correlation))
    values = posterior.split(points)[0]
    left = record.measured - ENGINE.simulate(TWO, values, record).values
    expected = np.zeros(2)
    assert noise.correlation_samples == 1.0
    for own, block, scale in zip(filters, record.blocks, noise.scale, strict=True):
        part, place = record.parts[block.part], record.stretches[block.part]
        alone = IntegratedNoise(shape=1.0, scale=(scale,), correlation=Correlation(coefficients=(own,)))
        white = Correlation(coefficients=(own,)).whitened(left[:, block.channel, None, place])
        misfit = np.sum(np.square(white), axis=2)
        expected += alone.log_likelihood(misfit, float(part.n_times), np.empty((2, 0)))
    local = posterior.linearise(points)
    np.testing.assert_allclose(local.log_likelihood, expected, rtol=1e-9)
    slopes = Slopes.at(posterior, points[0])
    np.testing.assert_allclose(slopes.base.T @ slopes.base, local.information[0], rtol=1e-9)
    np.testing.assert_allclose(slopes.base.T @ slopes.residual.ravel(), local.gradient[0], rtol=1e-9)


def test_stretches_that_are_left_out_lie_in_one_record_each() -> None:
    """At a bound nothing moves, so that a stretch's density is that of its residuals under the others' level."""
    point = np.array([1.0])
    posterior = posterior_of(UNLIKE)
    found = cross_validated(posterior, point)
    expected = []
    for part, n in ((UNLIKE.parts[0], 8), (UNLIKE.parts[2], 8)):
        values, as_one = posterior.split(point[None])[0], default_noise(part).as_one
        left = part.measured - ENGINE.simulate(TWO, values, part).values[0]
        for own in np.array_split(np.arange(part.n_times), n):
            variance = np.mean(np.square(np.delete(left, own, axis=1)), axis=1)[:, None]
            density = -0.5 * (np.square(left[:, own]) / variance + np.log(2.0 * np.pi * variance))
            expected.append(float(np.sum(density / as_one)))
    assert found.log_score == pytest.approx(sum(expected), rel=1e-9)


def test_a_residual_is_found_in_its_record_at_its_time() -> None:
    record = UNLIKE
    times = record.parts[2].times
    blow = np.where((times >= 6.0) & (times <= 8.0), 3.0 * np.sin(9.0 * times), 0.0)
    second = record.parts[2].with_channels(
        {name: row + (blow if name == "acceleration_2" else 0.0) for name, row in record.parts[2].channels.items()}
    )
    seen = disagreement(posterior_of(join_records([*record.parts[:2], second])), POINT)
    spot = seen.spots[0]
    assert spot.record == "second"
    assert spot.start_s == pytest.approx(6.0, abs=1.1)
    assert spot.end_s == pytest.approx(8.0, abs=1.1)
    assert " s of second" in spot.sentence
    assert len(seen.edges) == len(seen.parts) + 1 == seen.by_window.shape[1] + 1
    assert np.all(np.diff(seen.edges) > 0.0)
    assert np.all(np.isnan(seen.by_window[:, seen.parts == 1]))
    assert seen.residual_to_noise[[0, 2]] == pytest.approx([1.0, 1.0], rel=0.2)
    assert seen.residual_to_noise[1] > 3.0


def test_an_error_over_records_is_that_of_each() -> None:
    posterior, point = posterior_of(UNLIKE), np.array([0.45])
    whole = predict(posterior, point, UNLIKE, np.random.default_rng(1), counted=UNLIKE.kept)
    each = [predict(posterior_of(one), point, one, np.random.default_rng(1)) for one in UNLIKE.parts if one.channels]
    assert whole.nrmse == pytest.approx(np.sqrt(np.mean([one.nrmse**2 for one in each])))
    floors = [floor_of(one) for one in UNLIKE.parts if one.channels]
    assert floor_of(UNLIKE) == pytest.approx(np.sqrt(np.mean(np.square(floors))))


def test_the_end_of_several_records_is_the_last_of_them() -> None:
    parts = [part for part in UNLIKE.parts if part.channels]
    kept, apart = set_apart(TWO, UNLIKE, "end")
    assert apart is not None
    assert kept.parts[0].equals(parts[0])
    assert apart.record.equals(parts[1])
    assert len(apart.counted) == parts[1].n_times
    kept, apart = set_apart(TWO, join_records(UNLIKE.parts, in_sequence=True), "end")
    assert apart is not None
    assert kept.is_sequence
    np.testing.assert_array_equal(apart.counted, np.arange(apart.record.n_times)[apart.record.stretches[2]])
    assert apart.label == "held-out end, second"
    with pytest.raises(UserError, match="one record alone measures anything"):
        set_apart(TWO, join_records(UNLIKE.parts[1:]), "end")


LINEAR = ShearBuilding(masses=[2.0, 1.0], storey=BoucWen(k=Uniform(40, 80), c=0.4, alpha=1.0, beta=12.0, gamma=2.0))


def test_a_force_acts_on_what_comes_after_it_in_the_same_run() -> None:
    """Halves in sequence answer as the whole does, virgin ones as each alone."""
    whole = Record(
        name="whole",
        time_step=0.02,
        excitation=np.sin(0.1 * np.arange(200)),
        channels={"acceleration_1": np.zeros(200), "drift_2": np.zeros(200)},
    )
    halves = [whole.between(0.0, 99 * 0.02), whole.between(100 * 0.02, 199 * 0.02)]
    history = np.exp(-np.square((np.arange(200) - 90) / 15.0))[None]

    def answered(record: Record, force: np.ndarray) -> np.ndarray:
        posterior = Posterior(model=LINEAR, record=record, engine=ENGINE, noise=default_noise(GROUND))
        return answers(posterior, np.array([0.5]), 1, force, 50.0)

    sequence, virgin = (join_records(halves, in_sequence=in_sequence) for in_sequence in (True, False))
    expected = answered(whole, history)
    np.testing.assert_allclose(answered(sequence, history), expected, atol=1e-4 * np.max(np.abs(expected)))
    apart = [answered(half, history[:, own]) for half, own in zip(halves, virgin.stretches, strict=True)]
    np.testing.assert_allclose(answered(virgin, history), np.concatenate(apart, axis=2), rtol=1e-12)
    np.testing.assert_array_equal(over_time(history[0], virgin, LINEAR), history[0])


def test_a_force_of_states_is_one_of_all_records_and_one_that_changes_in_time_is_not() -> None:
    rng = np.random.default_rng(4)
    half = np.cumsum(rng.standard_normal((1, 60)), axis=1)
    states = {kind: np.hstack([half, half]) for kind in ("drift", "drift_rate", "hysteretic_displacement")}
    states["hysteretic_energy"] = np.tile(np.linspace(0.0, 1.0, 60), 2)[None]
    knots = Knots(samples=np.arange(120), times=np.tile(0.1 * np.arange(60), 2), runs=np.repeat(np.arange(2), 60))
    found = functions(states, knots, 0)
    alike, changing = (found[kind].T @ found[kind] for kind in ("of the storey's own states", "that changes in time"))
    np.testing.assert_allclose(alike[:60, 60:], alike[:60, :60], atol=1e-9)
    np.testing.assert_allclose(changing[:60, 60:], 0.0, atol=1e-2 * np.max(changing))


@pytest.mark.parametrize("in_one_go", [True, False])
def test_what_happens_at_an_instant_needs_one_beginning(in_one_go: bool) -> None:
    names = {h.name for h in hypotheses(ONE, [NOMINAL], measured=("acceleration_1",), in_one_go=in_one_go)}
    assert (SuddenDamage.name in names) is in_one_go
    assert CubicStiffness.name in names


def test_a_join_of_one_is_that_record() -> None:
    """The same laws, numbers and names, autoregressive errors and unnamed forces among them."""
    made = simulate(ONE.with_effect(CubicStiffness(k3=1500.0)), GROUND.between(0.0, 6.0), TRUTH, snr_db=10.0, seed=3)
    record = replace(made, truth={})
    settings = replace(FEW, effects=(CubicStiffness,))
    alone, joined = (discover(ONE, one, settings=settings) for one in (record, join_records([record])))
    assert alone.probabilities == joined.probabilities
    assert alone.steps[-1].log_joint == joined.steps[-1].log_joint
    assert alone.sentences == joined.sentences
    assert alone.gap.before.nrmse_se == joined.gap.before.nrmse_se


@pytest.fixture(scope="module")
def hidden() -> JoinedRecord:
    """Two short records of a storey with a cubic spring, drowned in noise."""
    parts = [
        replace(GROUND.between(start, start + 6.0), name=name) for name, start in (("first", 0.0), ("second", 2.0))
    ]
    made = simulate(ONE.with_effect(CubicStiffness(k3=1500.0)), join_records(parts), TRUTH, snr_db=10.0, seed=3)
    assert isinstance(made, JoinedRecord)
    joined = made.with_each(lambda part: replace(part, truth={}))
    assert isinstance(joined, JoinedRecord)
    return joined


@pytest.fixture(scope="module")
def together(hidden: JoinedRecord, tmp_path_factory: pytest.TempPathFactory) -> tuple[Discovery, Path]:
    """What a search in both finds, and where it keeps what it fitted."""
    checkpoint = tmp_path_factory.mktemp("kept") / "search"
    return discover(ONE, hidden, settings=replace(FEW, checkpoint=checkpoint)), checkpoint


def test_two_records_name_what_neither_does(together: tuple[Discovery, Path], hidden: JoinedRecord) -> None:
    found, _ = together
    (added,) = found.added
    assert added.hypothesis.name == CubicStiffness.name
    assert added.grade == "named"
    mean, sd = added.moments[added.hypothesis.brought[0]]
    assert abs(mean - 1500.0) < 4.0 * sd
    for part in hidden.parts:
        alone = discover(ONE, part, settings=FEW)
        assert alone.probabilities.get(CubicStiffness.name, 0.0) < 0.9


def test_virgin_records_are_independent_witnesses(together: tuple[Discovery, Path], hidden: JoinedRecord) -> None:
    best = together[0].steps[-1].explanations[0]
    points = best.posterior.sample_prior(np.random.default_rng(1), 4)
    alone = [replace(best.posterior, record=part, noise=default_noise(part), journal=None) for part in hidden.parts]
    expected = sum(one.log_likelihood(points) for one in alone)
    np.testing.assert_allclose(best.posterior.log_likelihood(points), expected, rtol=1e-9)


def test_a_resumed_search_answers_the_same(
    together: tuple[Discovery, Path], hidden: JoinedRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, checkpoint = together
    climbed: list[int] = []
    own = modes._climb

    def climb(*arguments: Any, **others: Any) -> Any:
        climbed.append(1)
        return own(*arguments, **others)

    monkeypatch.setattr(modes, "_climb", climb)
    again = discover(ONE, hidden, settings=replace(FEW, checkpoint=checkpoint))
    assert again.probabilities == first.probabilities
    assert not climbed


MODEL = '''"""One storey."""

from bwbn_bayes import BoucWen, ShearBuilding, Uniform

model = ShearBuilding(
    masses=[2.0],  # kg
    storey=BoucWen(
        k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), beta=Uniform(0.5, 40), gamma=2.0, n=1.3
    ),
)
'''


@pytest.fixture(scope="module")
def shocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file, and three records of a storey whose strength goes on falling from one to the next."""
    directory = tmp_path_factory.mktemp("shocks")
    (directory / "storey.py").write_text(MODEL, encoding="utf-8")
    quiet = np.zeros(50)
    parts = [
        replace(
            (part := GROUND.between(start, start + 5.0)),
            name=name,
            excitation=np.concatenate([factor * part.excitation, quiet]),
        )
        for name, start, factor in (("foreshock", 0.0, 0.6), ("main", 0.5, 1.0), ("aftershock", 2.0, 0.8))
    ]
    law = ONE.with_effect(StrengthDegradation(delta_nu=0.3))
    made = simulate(law, join_records(parts, in_sequence=True), TRUTH, snr_db=30.0, seed=5)
    for part in made.parts:
        write_record(replace(part, truth={}), directory / f"{part.name}.csv")
    return directory


def command(shocks: Path, out: Path, *options: str, records: tuple[str, ...]) -> tuple[int, str, str]:
    """``bwbn discover`` with a catalogue of two effects: exit code, stdout, stderr."""

    def with_two_effects(*arguments: Any, settings: DiscoverySettings, **others: Any) -> Discovery:
        settings = replace(settings, effects=(CubicStiffness, StrengthDegradation), n_workers=1)
        return discover(*arguments, settings=settings, **others)

    given = [option for name in records for option in ("--record", str(shocks / f"{name}.csv"))]
    told, heard = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(told), redirect_stderr(heard):
        patch.setattr(workflow, "discover", with_two_effects)
        with pytest.raises(SystemExit) as leaving:
            main(["discover", str(shocks / "storey.py"), *given, *options, "--out", str(out), "--particles", "300"])
    return int(leaving.value.code or 0), told.getvalue(), heard.getvalue()


def test_a_path_begins_anew_where_a_record_finds_the_structure_virgin() -> None:
    """It was added up over all records, as if each went on from the one before it: priors of losses were narrow."""
    channels = ["acceleration_1"]
    shock = simulate(ONE, GROUND.between(0.0, 6.0), TRUTH, snr_db=30.0, seed=1, channels=channels)
    point = ONE.space.to_unit(ONE.draws(TRUTH))[0]
    records = shock, join_records([shock, shock]), join_records([shock, shock], in_sequence=True)
    one, twice, on = (
        scales_of(Posterior(model=ONE, record=own, engine=ENGINE, noise=default_noise(own)), point)[0].path
        for own in records
    )
    assert one > 0.1
    assert twice == one
    assert on > 1.5 * one


@pytest.mark.usefixtures("undrawn")
def test_a_sequence_carries_its_damage_to_the_last_record(shocks: Path, tmp_path: Path) -> None:
    """The improved model predicts the last record, which begins with the damage of those before it."""
    out = tmp_path / "out"
    records = ("foreshock", "main", "aftershock")
    code, told, heard = command(shocks, out, "--sequence", "--held-out", "end", records=records)
    assert code == 0, heard
    assert told.startswith("verdict: effects_found")
    facts = json.loads((out / "discovery.json").read_text(encoding="utf-8"))
    assert facts["record"] == "foreshock, then main"
    (effect,) = facts["effects"]
    assert effect["name"] == StrengthDegradation.name
    assert effect["grade"] == "named"
    apart = facts["gap"]["held_out"]
    assert apart["after"] - apart["noise_floor"] < 0.5 * (apart["before"] - apart["noise_floor"])
    improved = load_model_file(out / "improved_model.py")
    assert improved.record is not None
    assert improved.record.is_sequence
    assert [part.name for part in improved.record.parts] == ["foreshock", "main"]
    assert {place.get("record") for place in facts["where"]} <= {"foreshock", "main"}
    assert "2 records in sequence" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("records", "options", "sentence"),
    [
        (("main",), ("--sequence",), "--sequence is the order of several records: give --record more than once"),
        (("main", "aftershock"), ("--held-out", "repeats"), "repeat cycles are held out of one"),
        (("main", "aftershock"), ("--held-out", "FIRST"), "is the record that the model is fitted to"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    shocks: Path, tmp_path: Path, records: tuple[str, ...], options: tuple[str, ...], sentence: str
) -> None:
    given = [str(shocks / "main.csv") if option == "FIRST" else option for option in options]
    code, told, heard = command(shocks, tmp_path / "out", *given, records=records)
    assert code == 2
    assert not told
    lines = [line for line in heard.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert sentence in lines[0]


def cyclic(name: str, amplitudes: tuple[float, ...]) -> Record:
    wave = np.sin(2.0 * np.pi * np.arange(60) / 60)
    excitation = np.concatenate([one * wave for one in amplitudes])
    return Record(name=name, time_step=0.1, excitation=excitation, excitation_kind="displacement")


@pytest.mark.usefixtures("undrawn")
def test_two_tests_of_a_type_of_specimen_are_searched_together(tmp_path: Path) -> None:
    spring = BoucWen(
        k=Uniform(2e6, 2e7), c=0.0, alpha=Uniform(0.01, 0.3), A=1.0, beta=Uniform(20, 400), gamma=50.0, n=1.0
    )
    model = Specimen(storey=spring)
    truth = {"k": 8e6, "alpha": 0.1, "beta": 150.0}
    tests = [cyclic("A", (0.005, 0.01, 0.02, 0.03)), cyclic("B", (0.01, 0.03, 0.03, 0.02))]
    made = simulate(model.with_effect(CubicStiffness(k3=3e8)), join_records(tests), truth, snr_db=26.0, seed=2)
    assert isinstance(made, JoinedRecord)
    found = discover(model, made.with_each(lambda one: replace(one, truth={})), settings=FEW)
    (added,) = found.added
    assert added.hypothesis.name == CubicStiffness.name
    assert added.grade == "named"
    assert any("of a specimen it is known of one test" in sentence for sentence in found.sentences)
    mean, sd = added.moments["k3"]
    assert abs(mean - 3e8) < 4.0 * sd
    write_discovery(found, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "cycle 1 of A" in page
    assert "2 records, " in page
