"""``--columns``, and ``columns`` in a model file: records of others from the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes import Record, el_centro, read_record, simulate, write_record
from bwbn_bayes.cli import main
from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.model_file import load_model_file

MAP = "Zeit = time [s], ag = ground_acceleration [m/s^2], Dach = acceleration_1 [m/s^2]"
MODEL = """
from bwbn_bayes import BoucWen, ShearBuilding, Uniform, el_centro

storey = BoucWen(k=Uniform(20, 60), c=0.2, alpha=0.05, A=1.0, beta=30.0, gamma=15.0, n=1.2)
model = ShearBuilding(masses=[1.0], storey=storey)
truth = {"k": 40.0}
"""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    path = tmp_path_factory.mktemp("model") / "one.py"
    path.write_text(MODEL, encoding="utf-8")
    file = load_model_file(path)
    return simulate(file.model, el_centro("chopra", duration=4.0), file.truth, snr_db=30.0)


@pytest.fixture
def folder(tmp_path: Path, record: Record) -> Path:
    """The record as a German spreadsheet saves it, and model files."""
    columns = (record.times, record.excitation, record.channels["acceleration_1"])
    rows = np.column_stack(columns).tolist()
    lines = ["Zeit;Bemerkung;ag;Dach", *(f"{t:.2f};gut;{a!r};{y!r}".replace(".", ",") for t, a, y in rows)]
    (tmp_path / "lauf.csv").write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "one.py").write_text(MODEL, encoding="utf-8")
    (tmp_path / "mapped.py").write_text(f"{MODEL}columns = {MAP!r}\n", encoding="utf-8")
    return tmp_path


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    with pytest.raises(SystemExit) as leaving:
        main([str(argument) for argument in arguments])
    return int(leaving.value.code or 0), capsys.readouterr().err


def test_the_map_gives_the_record(folder: Path, record: Record) -> None:
    again = read_record(folder / "lauf.csv", MAP)
    assert again.content_hash == record.content_hash


@pytest.mark.usefixtures("undrawn")
def test_identify_and_simulate_take_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    common = ("--record", folder / "lauf.csv", "--out", folder / "out")
    assert run(capsys, "identify", folder / "one.py", *common, "--columns", MAP, "--particles", 200)[0] == 0
    by_file = run(capsys, "simulate", folder / "mapped.py", *common)
    assert by_file[0] == 0
    by_option = run(capsys, "simulate", folder / "one.py", *common, "--columns", MAP)
    assert by_option[0] == 0
    made = [read_record(folder / "out" / f"{name}.csv") for name in ("mapped", "one")]
    assert made[0].content_hash == made[1].content_hash


def test_the_starting_model_names_it(folder: Path, record: Record, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "model", folder / "lauf.csv", "--columns", MAP, "--out", folder / "start.py")[0] == 0
    file = load_model_file(folder / "start.py")
    assert file.columns == MAP
    assert file.record is not None
    assert file.record.content_hash == record.content_hash
    # A record in the model's place is read with it, too.
    assert load_model_file(folder / "lauf.csv", MAP).model == file.model


def test_discover_reads_the_held_out_record_with_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Up to the search, which refuses a held-out record that is the record."""
    arguments = ("discover", folder / "mapped.py", "--record", folder / "lauf.csv", "--held-out", folder / "lauf.csv")
    code, told = run(capsys, *arguments, "--out", folder / "out")
    assert code == 2
    assert "held" in told
    assert "column" not in told


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("identify", "one.py", "--record", "lauf.csv"), "column Zeit: the name is not known"),
        (("identify", "one.py", "--record", "lauf.csv", "--columns", "Zeit"), "the column map reads 'Zeit' as zeit"),
        (("identify", "one.py", "--columns", MAP), "no record is given: add --record FILE"),
        (("discover", "one.py", "--columns", MAP, "--held-out", "end"), "no record is given: add --record FILE"),
        (("simulate", "one.py", "--columns", MAP), "no record is given: add --record FILE"),
        (("model", "lauf.csv", "--columns", "Dach = roof [g]"), "the column map reads 'Dach' as roof"),
        (("identify", "bad.py", "--record", "lauf.csv"), "bad.py, `columns`: the item 'a b = c d' of the column map"),
        (("identify", "number.py", "--record", "lauf.csv"), "`columns` must be a column map in quotes"),
    ],
)
def test_every_mistake_gets_one_sentence(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    (folder / "bad.py").write_text(f"{MODEL}columns = 'a b = c d'\n", encoding="utf-8")
    (folder / "number.py").write_text(f"{MODEL}columns = 3\n", encoding="utf-8")
    monkeypatch.chdir(folder)
    code, told = run(capsys, *arguments)
    assert code == 2
    assert sentence in told
    assert told.startswith("error: ")
    assert told.count("\n") == 1


def test_a_matlab_file_stands_for_its_starting_model(folder: Path, record: Record) -> None:
    """It was once run as Python: only .csv and .nc were known as records."""
    savemat = pytest.importorskip("scipy.io").savemat
    savemat(folder / "run.mat", {"u": np.array(record.excitation), "y": record.channels["acceleration_1"]})
    columns = "50 = sampling_rate [Hz], u = ground_acceleration [m/s^2], y = acceleration_1 [m/s^2]"
    file = load_model_file(folder / "run.mat", columns)
    assert file.record is not None
    assert file.record.content_hash == record.content_hash
    write_record(file.record, folder / "again.csv")
    assert file.model == load_model_file(folder / "again.csv").model
    with pytest.raises(UserError, match=r"run\.mat, column "):
        load_model_file(folder / "run.mat")
