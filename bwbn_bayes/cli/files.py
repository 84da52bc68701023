"""What the command line writes: new files take their names only when all of them are whole."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from bwbn_bayes.cli.interruption import COMMITTING, UNFINISHED
from bwbn_bayes.discovery.improved_model import improved_model_source
from bwbn_bayes.discovery.outcome import Discovery
from bwbn_bayes.discovery.unfinished import Unfinished
from bwbn_bayes.errors import UserError, writing
from bwbn_bayes.records.readers import read_record, write_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.html import render, write_page
from bwbn_bayes.report.second_process import SecondProcess, all_drawn
from bwbn_bayes.results import Result
from bwbn_bayes.structures.examples import example_files
from bwbn_bayes.structures.starting_source import starting_source

_PREFIX = ".partial-"
_OURS = re.compile(re.escape(_PREFIX) + r"[a-z0-9_]{8}")


def writable(directory: Path) -> Path:
    """The directory, tried before a long run, not after it; one that was not there is left for the results to make."""
    with _writing(directory):
        missing = [one for one in (directory, *directory.parents) if not one.exists()]
        with replacing(directory):
            pass
        for made in missing:
            with suppress(OSError):  # another command that began with this one is at work there
                made.rmdir()
    return directory


def _writing(directory: Path) -> AbstractContextManager[None]:
    return writing(f"--out {directory}", "choose another directory")


@contextmanager
def replacing(directory: Path, *, report: bool = False) -> Iterator[Path]:
    """A place for new files beside the old ones; they take their names only when all of them are whole.

    Of an earlier report in the same directory, figures that the new one does not have are removed.
    """
    with _writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        _sweep(directory)
        with TemporaryDirectory(dir=directory, prefix=_PREFIX) as name, _claimed(Path(name)):
            yield Path(name)
            with COMMITTING:
                made = _take_names(Path(name), directory)
            if report:
                _sweep_figures(made)


def _sweep_figures(made: list[Path]) -> None:
    """Remove an earlier report's figures that the new one does not have."""
    from bwbn_bayes.report.canvas import is_ours  # with Matplotlib, once something was drawn

    for place in {path.parent for path in made}:
        for old in set(place.glob("*.png")) - set(made):
            if is_ours(old):
                old.unlink()


def _take_names(fresh: Path, directory: Path) -> list[Path]:
    made = []
    for path in sorted(found for found in fresh.rglob("*") if found.is_file()):
        made.append(directory / path.relative_to(fresh))
        made[-1].parent.mkdir(exist_ok=True)
        path.replace(made[-1])
    return made


@contextmanager
def _claimed(directory: Path) -> Iterator[None]:
    """Say of a directory that this process writes it; the system forgets it when the process ends, however it does."""
    handle = os.open(directory, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        UNFINISHED.add(directory)
        yield
    finally:
        UNFINISHED.discard(directory)
        os.close(handle)


def _sweep(directory: Path) -> None:
    """Remove what runs that were killed left half-written."""
    for path in directory.iterdir():
        if _OURS.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
            with suppress(OSError), _claimed(path):
                shutil.rmtree(path)


def write_result(result: Result, directory: Path, hand: SecondProcess | None = None) -> None:
    """Page, figures, ``result.json`` and ``result.nc``; a second process, where there is one, draws meanwhile."""
    with replacing(directory, report=True) as partial, _reported(result, partial, hand):
        save_result(result, partial)


@contextmanager
def _reported(result: Result, directory: Path, hand: SecondProcess | None) -> Iterator[None]:
    """Write a result's page and figures, at the end; a second process, where there is one, draws from the beginning."""
    content = gather(result)
    if hand is not None:
        hand.begin(content)
    yield
    drawings = all_drawn(content, hand)
    write_page(render(content, drawings), drawings, directory)


def save_result(result: Result, directory: Path) -> None:
    """``result.json`` and ``result.nc`` alone."""
    text = json.dumps(result.facts.as_json(), indent=1, allow_nan=False)
    (directory / "result.json").write_text(text + "\n", encoding="utf-8")
    result.save(directory / "result.nc")


def write_discovery_files(
    discovery: Discovery, directory: Path, model: Path, hand: SecondProcess | None = None
) -> None:
    """Page, numbers, record and improved model; ``identify/`` holds what ``bwbn identify`` writes of the latter.

    A second process, where there is one, draws the figures of ``identify/`` meanwhile.
    """
    from bwbn_bayes.report.discovery_html import write_discovery_page

    with replacing(directory, report=True) as partial:
        final = partial / "identify"
        final.mkdir()
        with _reported(discovery.result, final, hand):
            write_discovery_page(discovery, partial)
            save_result(discovery.result, final)
        _save_discovery(discovery, partial)
        names = write_parts(discovery.measurement, partial, "record")
        source = improved_model_source(
            discovery.improved,
            discovery.added,
            name=discovery.name,
            origin=model.resolve(),
            record_files=names,
            in_sequence=discovery.measurement.is_sequence,
            assumptions=discovery.assumptions,
        )
        (partial / "improved_model.py").write_text(source, encoding="utf-8")


def write_parts(record: Record, directory: Path, stem: str) -> list[str]:
    """A record as ``STEM.csv``, each of several as ``STEM_1.csv`` and so on; the names of the files."""
    one = len(record.parts) == 1
    names = [f"{stem}{'' if one else f'_{number}'}.csv" for number in range(1, len(record.parts) + 1)]
    for part, name in zip(record.parts, names, strict=True):
        write_record(part, directory / name)
    return names


def write_unfinished(search: Unfinished, directory: Path) -> None:
    """``discovery.json`` of a search that goes on."""
    with replacing(directory) as partial:
        _save_discovery(search, partial)


def _save_discovery(found: Discovery | Unfinished, directory: Path) -> None:
    text = json.dumps(found.as_json(), indent=1, allow_nan=False)
    (directory / "discovery.json").write_text(text + "\n", encoding="utf-8")


def write_starting_model(record: Path, path: Path, columns: str | None = None) -> tuple[str, ...]:
    """A new model file for a record; what is left for the user to do in it.

    Raises
    ------
    UserError
        If the record is wrong, or the file exists already: it may have been edited.
    """
    beside = record.resolve().parent == path.resolve().parent
    place = Path(record.name) if beside else record.resolve()
    source = starting_source(read_record(record, columns), place, columns)
    write_new(source.text, path)
    return source.to_do


def require_own_results(directory: Path, record: Record) -> None:
    """Refuse to go on in a directory with the results of another record, which would be lost.

    Raises
    ------
    UserError
        If its ``discovery.json`` is that of another record, or damaged.
    """
    path, begins = directory / "discovery.json", "leave out --resume to begin anew and write over them"
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        owner, data = facts["record"], facts.get("data_sha256")
    except FileNotFoundError:
        return
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UserError(
            f"--resume: {path} is damaged and does not say whose results it holds: give another --out, or {begins}"
        ) from None
    if data != record.content_hash:
        raise UserError(
            f"--resume: {directory} holds results of another record, {owner!r}, or of an older version: give another "
            f"--out, or {begins}"
        )


def require_new(path: Path) -> None:
    """Try a new file before long work, not after it.

    Raises
    ------
    UserError
        As of :func:`write_new`.
    """
    write_new("", path)
    path.unlink()


def write_new(text: str, path: Path) -> None:
    """A new file; one that is there already may have been edited.

    Raises
    ------
    UserError
        If there is one, or it cannot be written.
    """
    _write_all_new({path: text.encode()}, path)


def _write_all_new(contents: Mapping[Path, bytes], path: Path) -> None:
    """New files, all of them or none: one that is half written would be in the way of the next try."""
    made: list[Path] = []
    try:
        for place, content in contents.items():
            with place.open("xb") as file:
                made.append(place)
                file.write(content)
    except OSError as error:
        for place in made:
            place.unlink(missing_ok=True)
        if isinstance(error, FileExistsError):
            raise UserError(f"{error.filename} exists already: give another name with --out") from None
        raise UserError(f"--out {path} cannot be written ({error.strerror}): choose another place") from error


def write_example(name: str, path: Path) -> None:
    """A copy of a model file that comes with the package, with the records that it reads beside it.

    Raises
    ------
    UserError
        If there is no such example, or one of its files exists already: it may have been edited.
    """
    source, *records = example_files(name)
    places = {source: path} | {record: path.parent / record.name for record in records}
    _write_all_new({place: original.read_bytes() for original, place in places.items()}, path)
