"""Arguments of another kind at the public entries: one sentence, where each ended in a traceback or was taken."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes import (
    BoucWen,
    CubicStiffness,
    DiscoverySettings,
    Linear,
    Oscillator,
    Settings,
    Uniform,
    UserError,
    add_noise,
    discover,
    identify,
    join_records,
    multisine,
    periodic,
    periods_until_repeated,
    read_record,
    simulate,
    sine,
    starting_model,
    write_record,
)

MODEL = Oscillator(mass=1.0, spring=Linear(k=Uniform(20, 60), c=0.2))
GROUND = sine(1.0, 1.0, 4.0, 0.02)
TRUTH = {"k": 40.0}
RECORD = simulate(MODEL, GROUND, TRUTH, snr_db=30.0)

RECORD_WANTED = "give a Record, which read_record makes of a file and join_records of several records"
CLASSES_WANTED = r"give a tuple of classes, such as \(SlipLock,\)"

MISTAKES: list[tuple[Callable[[], object], str]] = [
    (lambda: identify(MODEL, [RECORD, RECORD]), f"record is of type list: {RECORD_WANTED}"),
    (lambda: identify(MODEL, "x.csv"), f"record is 'x.csv': {RECORD_WANTED}"),
    (lambda: identify("m.py", RECORD), "model is 'm.py': give a structure, such as ShearBuilding"),
    (lambda: identify(BoucWen, RECORD), "model is the class BoucWen: give a structure"),
    (lambda: identify(MODEL, RECORD, settings={}), r"settings is of type dict: give Settings\(\.\.\.\)"),
    (lambda: discover(MODEL, "x.csv"), "record is 'x.csv': give a Record"),
    (lambda: discover("m.py", RECORD), "model is 'm.py': give a structure"),
    (lambda: discover(MODEL, RECORD, settings=Settings()), "settings is of type Settings: give DiscoverySettings"),
    (lambda: starting_model("x.csv"), "record is 'x.csv': give a Record"),
    (lambda: starting_model(RECORD, {1: 2.0}), r"masses = \{1: 2.0\}: give a list"),
    (lambda: simulate(MODEL, "x.csv", TRUTH), "excitation is 'x.csv': give a Record"),
    (lambda: simulate("m.py", GROUND, TRUTH), "model is 'm.py': give a structure"),
    (lambda: simulate(MODEL, GROUND, [40.0]), "values of parameters is of type list: give a number for each label"),
    (lambda: simulate(MODEL, GROUND, TRUTH, channels="drift_1"), r"channels is 'drift_1': .* such as \['drift_1'\]"),
    (lambda: simulate(MODEL, GROUND, TRUTH, seed=1.5), "seed is 1.5, it must be a whole number from 0 on"),
    (lambda: simulate(MODEL, GROUND, TRUTH, seed=-1), "seed is -1, it must be a whole number from 0 on"),
    (lambda: simulate(MODEL, GROUND, TRUTH, snr_db="30"), "snr_db is 30: it must be a number of decibels"),
    (lambda: add_noise(RECORD, True, np.random.default_rng(1)), "snr_db is True: it must be a number of decibels"),
    (lambda: periods_until_repeated(MODEL, "x.csv", TRUTH), "record is 'x.csv': give a Record"),
    (lambda: periodic(GROUND, periods=1.5), "periods is 1.5, it must be a whole number from 1 on"),
    (lambda: periodic("x.csv", periods=2), "record is 'x.csv': give a Record"),
    (lambda: join_records([RECORD, "x.csv"]), "record 2 is 'x.csv': give a Record"),
    (lambda: read_record("x.csv", {"a": "time"}), "columns is of type dict: give a column map as text, such as"),
    (lambda: read_record(3), "path is of type int: give the name of a file"),
    (lambda: multisine(np.random.default_rng(1), (1.0, 60.0), 400, 0.01, rms=1.0), "half the sampling rate, 50 Hz"),
    (lambda: multisine(np.random.default_rng(1), (1.0, 9.0), 400.5, 0.01, rms=1.0), "n_per_period is 400.5"),
    (lambda: Settings(engine="x"), "Settings: engine 'x' is not known: choose one of lanes, cvodes"),
    (lambda: Settings(checkpoint=3), r'Settings: checkpoint is of type int: give the path .* as Path\("run"\)'),
    (lambda: Settings(particles=True), "Settings: particles is True, it must be a whole number"),
    (lambda: Settings(sampler="nutpie"), "sampler nutpie says nothing to method importance: .* choose method nuts"),
    (lambda: Settings(method="ga", variant="plain"), "variant plain says nothing to method ga: leave it out"),
    (lambda: DiscoverySettings(checkpoint="run"), "DiscoverySettings: checkpoint is 'run': give the path of a file"),
    (lambda: DiscoverySettings(time_limit_s="60"), "DiscoverySettings: time_limit_s is '60': give a number of seconds"),
    (lambda: DiscoverySettings(effects=()), f"effects is empty: {CLASSES_WANTED}"),
    (lambda: DiscoverySettings(effects="slip_lock"), f"effects is 'slip_lock': {CLASSES_WANTED}"),
    (lambda: DiscoverySettings(effects=("slip_lock",)), f"effects holds what is .*, 'slip_lock': {CLASSES_WANTED}"),
    (lambda: DiscoverySettings(effects=CubicStiffness), "effects is the class CubicStiffness: give a tuple"),
    (
        lambda: DiscoverySettings(effects=(CubicStiffness(k3=1.0),)),
        "holds what is no class of effects, of type CubicStiffness: give",
    ),
    (lambda: DiscoverySettings(effects=(BoucWen,)), "holds what is no class of effects, the class BoucWen: give"),
]


@pytest.mark.parametrize(("make", "sentence"), MISTAKES, ids=[sentence[:40] for _, sentence in MISTAKES])
def test_an_argument_of_another_kind_is_one_sentence(
    make: Callable[[], object], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_record(RECORD, "x.csv")
    with pytest.raises(UserError, match=sentence) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_what_is_right_is_taken() -> None:
    assert Settings(method="smc", variant="plain").variant == Settings(variant="plain").variant == "plain"
    assert DiscoverySettings(effects=[CubicStiffness]).effects == [CubicStiffness]
    assert periodic(GROUND, periods=np.int64(2)).n_times == 3 * GROUND.n_times
