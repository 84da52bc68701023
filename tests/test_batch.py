"""Many records in one table and one page, run once each; one that is refused does not hold up the others."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_at

from bwbn_bayes import BoucWen, ShearBuilding, UserError, simulate, sine, write_record
from bwbn_bayes.cli import batch
from bwbn_bayes.cli.batch import Job, jobs_of, records_of, run_batch
from bwbn_bayes.cli.interruption import UNFINISHED_SEARCH
from bwbn_bayes.engines.journal import Journal

MODEL = """from bwbn_bayes import BoucWen, ShearBuilding, Uniform
model = ShearBuilding(masses=[1.0], storey=BoucWen(
    k=Uniform(20, 60), c=0.2, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5))
"""


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Two records of one building, one that is none, and notes."""
    building = ShearBuilding(masses=[1.0], storey=BoucWen(k=40.0, c=0.2, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5))
    data = tmp_path / "data"
    data.mkdir()
    for i in (1, 2):
        ground = sine(amplitude=1.0 * i, frequency_hz=1.0, duration=6.0, time_step=0.02)
        write_record(
            simulate(building, ground, {}, channels=["acceleration_1"], snr_db=30.0, seed=i), data / f"r{i}.csv"
        )
    (data / "broken.csv").write_text("time [s],acceleration_1 [m/s^2]\n0,x\n")
    (data / "notes.md").write_text("mine")
    (tmp_path / "model.py").write_text(MODEL)
    return tmp_path


def _jobs(fleet: Path, particles: str = "100") -> list[Job]:
    options = ("--particles", particles)
    return jobs_of(
        records_of(str(fleet / "data"), fleet / "out"),
        fleet / "out",
        model=fleet / "model.py",
        discover=False,
        options=options,
    )


@pytest.mark.slow
def test_a_fleet_is_run_once_and_told_in_one_table(fleet: Path) -> None:
    said: list[str] = []
    rows = run_batch(_jobs(fleet), fleet / "out", 2, said.append)
    assert [(row.record, row.status) for row in rows if row.record == "broken"] == [("broken", "refused")]
    done = {row.record: row for row in rows if row.status != "refused"}
    assert set(done) == {"r1", "r2"}
    for row in done.values():
        mean, sd = row.parameters["k"]
        assert mean is not None and sd is not None
        assert abs(mean - 40.0) < 5.0 * sd
        assert (fleet / "out" / row.report).exists()
    with (fleet / "out" / "batch.csv").open() as file:
        table = {line["record"]: line for line in csv.DictReader(file)}
    assert float(table["r2"]["k mean"]) == done["r2"].parameters["k"][0]
    assert table["broken"]["k mean"] == ""
    assert len(json.loads((fleet / "out" / "batch.json").read_text())) == 3
    assert 'href="r1/report.html"' in (fleet / "out" / "batch.html").read_text()
    assert not list((fleet / "out").rglob("*.solves"))
    said.clear()
    run_batch(_jobs(fleet), fleet / "out", 1, said.append)
    assert said[0] == "3 records, 2 of them done before"


def test_a_changed_record_model_or_option_is_run_again(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = {
        "checks": [{"passed": False, "sentence": "The weights are <heavy>."}],
        "fit": {"nrmse": {"acceleration_1": 0.03}},
        "log_evidence": 1.0,
        "elapsed_s": 2.0,
        "parameters": {"k": {"mean": 40.0, "sd": 0.5}},
    }
    ran: list[str] = []

    def run(job: Job) -> str:
        ran.append(job.name)
        job.directory.mkdir(parents=True, exist_ok=True)
        (job.directory / "result.json").write_text(json.dumps(facts))
        (job.directory / "batch.json").write_text(json.dumps({"key": job.key}))
        return ""

    monkeypatch.setattr(batch, "_run", run)
    rows = run_batch(_jobs(fleet), fleet / "out", 1, lambda _: None)
    assert {row.status for row in rows} == {"done, with care"}
    page = (fleet / "out" / "batch.html").read_text()
    assert "&lt;heavy&gt;" in page and "40.00 ± 0.50" in page
    assert ran == ["broken", "r1", "r2"]
    run_batch(_jobs(fleet), fleet / "out", 1, lambda _: None)
    assert len(ran) == 3
    with (fleet / "data" / "r2.csv").open("a") as file:
        file.write("\n")
    run_batch(_jobs(fleet), fleet / "out", 1, lambda _: None)
    assert ran[3:] == ["r2"]
    for damaged in ('{"checks": [', "3", "{}"):  # each ended the whole batch in a traceback
        (fleet / "out" / "r1" / "result.json").write_text(damaged)
        run_batch(_jobs(fleet), fleet / "out", 1, lambda _: None)
    assert ran[4:] == ["r1", "r1", "r1"]
    run_batch(_jobs(fleet, particles="200"), fleet / "out", 1, lambda _: None)
    assert len(ran) == 10


def test_a_batch_takes_none_of_its_own_files_for_a_record(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With --out beside the records, batch.csv was refused as one, and each report's record.csv was run again."""
    out = fleet / "data"
    before = records_of(str(out), out)
    jobs = jobs_of(before, out, model=fleet / "model.py", discover=False, options=())

    def ran(job: Job) -> str:
        job.directory.mkdir()
        (job.directory / "begun.txt").write_text(job.key)
        (job.directory / "record.csv").write_bytes(job.record.read_bytes())
        return ""

    monkeypatch.setattr(batch, "_run", ran)
    run_batch(jobs, out, 1, lambda _: None)
    assert (out / "batch.csv").exists() and (out / "r1" / "record.csv").exists()
    assert records_of(str(out), out) == before == records_of(str(out / "**" / "*.csv"), out)


def test_the_unfinished_search_of_a_record_that_was_corrected_is_not_gone_on_with(fleet: Path) -> None:
    """It was refused each time, with the advice to leave out a --resume that nobody had given."""

    def arguments() -> dict[str, tuple[str, ...]]:
        found = records_of(str(fleet / "data"), fleet / "out")
        jobs = jobs_of(found, fleet / "out", model=None, discover=True, options=())
        for job in jobs:
            if not job.directory.exists():
                job.directory.mkdir(parents=True)
                (job.directory / "begun.txt").write_text(job.key)
                with Journal.opened(job.directory / UNFINISHED_SEARCH) as journal:
                    journal.mark(b"begun".ljust(32))
                    journal.kept("kind", b"question".ljust(32), 1, lambda _: (np.zeros(1),))
        return {job.name: job.arguments for job in jobs}

    arguments()
    assert all("--resume" in own for own in arguments().values())
    with (fleet / "data" / "r1.csv").open("a") as file:
        file.write("\n")
    assert {name: "--resume" in own for name, own in arguments().items()} == {"broken": True, "r1": False, "r2": True}


def test_records_that_would_share_a_folder_are_named(tmp_path: Path) -> None:
    places = [tmp_path / one / "same" / "r1.csv" for one in ("a", "b")]
    with pytest.raises(UserError, match=rf"{places[0]} and {places[1]} have the same name"):
        jobs_of(places, tmp_path, model=None, discover=False, options=())


def test_a_name_that_is_no_text_is_told_and_linked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A record whose name is bytes of another encoding ended the batch in a traceback."""
    name = os.fsdecode(b"caf\xe9")
    (tmp_path / f"{name}.csv").write_text("time [s]")
    jobs = jobs_of(
        records_of(str(tmp_path), tmp_path / "out"), tmp_path / "out", model=None, discover=False, options=()
    )
    monkeypatch.setattr(batch, "_run", lambda job: f"{job.record}: nothing in it")
    (row,) = run_batch(jobs, tmp_path / "out", 1, lambda _: None)
    assert (row.record, row.sentence) == ("caf\ufffd", f"{tmp_path}/caf\ufffd.csv: nothing in it")
    assert batch._address(jobs[0]) == "caf%E9/report.html"
    assert "caf\ufffd" in (tmp_path / "out" / "batch.html").read_text()


def test_a_record_that_cannot_be_read_does_not_hold_up_the_others(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Path.read_bytes

    def read(path: Path) -> bytes:
        if path.name == "r1.csv":
            raise PermissionError
        return own(path)

    monkeypatch.setattr(Path, "read_bytes", read)
    assert [job.name for job in _jobs(fleet)] == ["broken", "r1", "r2"]


def test_a_place_without_records_is_the_user_s_mistake(tmp_path: Path) -> None:
    (tmp_path / "a.md").touch()
    for pattern in (str(tmp_path), str(tmp_path / "*.csv")):
        with pytest.raises(UserError, match="no record"):
            records_of(pattern, tmp_path / "out")


def test_a_full_disk_is_one_sentence(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended in a traceback, and only when every record that waited had been run."""
    ran: list[str] = []

    def run(job: Job) -> str:
        ran.append(job.name)
        return "refused"

    monkeypatch.setattr(batch, "_run", run)
    jobs = _jobs(fleet)
    with full_at(0), pytest.raises(UserError, match=r"--out .* cannot be written \(File too large\): finished records"):
        run_batch(jobs, fleet / "out", 1, lambda _: None)
    assert ran == []
    assert list((fleet / "out").iterdir()) == []

    def fill(_: str) -> None:
        if ran:
            raise UserError("full")

    with pytest.raises(UserError, match="full"):
        run_batch(jobs, fleet / "out", 1, fill)
    assert len(ran) < len(jobs)


def test_a_record_that_finds_no_room_does_not_hold_up_the_others(fleet: Path) -> None:
    (fleet / "out").mkdir()
    (fleet / "out" / "r1").write_text("taken")
    said: list[str] = []
    run_batch(_jobs(fleet)[1:2], fleet / "out", 1, said.append)
    assert said[-1].startswith(f"1 of 1: r1: --out {fleet / 'out' / 'r1'} cannot be written (File exists): ")


def test_a_law_under_its_plain_name_is_listed_by_that_name(tmp_path: Path) -> None:
    """The table named an effect which the discovery's own report did not."""
    job = Job(
        name="r", record=tmp_path, directory=tmp_path, arguments=(), finished_file="discovery.json", key="of the same"
    )
    effect = {
        "name": "slip_lock",
        "title": "the shape of the reloading branch in storey 2",
        "storeys": [2],
        "parameters": {"delta_s[2]": {"mean": 0.1, "sd": 0.01}},
    }
    facts = {"verdict": "explained", "effects": [effect], "gap": {"fit": {"after": 0.03}}}
    row = batch._discovered(job, facts)
    assert row.sentence == "explained: the shape of the reloading branch in storey 2"
    assert row.parameters == {"slip_lock.delta_s[2]": (0.1, 0.01)}
