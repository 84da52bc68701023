"""What an engine has solved, kept in a file: a run that is killed at any moment goes on to the same result.

A run is a function of its seed, its model, its record and of what the engine answers. So the answers alone are kept.
The same command runs again from its beginning, is given what was solved before, and solves the rest: bit for bit what
it would have come to, whichever method asks, with every count and every random number as it was. A discovery, whose
fits are short and many, keeps whole fits instead (:mod:`~bwbn_bayes.inference.kept`).

A checkpoint ``NAME`` is a file ``NAME.solves``, to which finished solves are appended. A kill in the middle of an entry
leaves one whose hash does not fit: the file ends before it. Answers are believed after some are solved again.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import stat
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import field, fields, make_dataclass, replace
from functools import cache
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any, NamedTuple, Self, cast

import numpy as np

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.base import Engine, NormalEquations, masses
from bwbn_bayes.errors import UNREADABLE_ARRAYS, UserError, writing
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_TITLE = b"bwbn_bayes solves 1\n"
_LENGTH = struct.Struct("<Q")
_HASH = 32
_AT_ONCE = 512
"""Draws that each worker solves between two entries, whole blocks of lanes: a kill loses no more."""
N_SOLVED_AGAIN = 4
"""Draws of the first answer of each kind that are solved again before it is believed."""

Solve = Callable[[slice], tuple[Floats, ...]]
"""Arrays over some of the draws, draw by draw."""
Check = Callable[[tuple[Floats, ...]], bool]
"""Whether arrays over all draws are what would be solved here."""


class Carried(NamedTuple):
    """What another process must know of a journal."""

    path: Path
    content: bytes
    """What it held when it was opened."""
    believed: frozenset[str]
    """Kinds of answers that were checked."""


class Journal:
    """Answers by question; opened with :meth:`opened`.

    Parameters
    ----------
    path : Path
        Name of the checkpoint, without suffix.
    file : raw file, or in memory
        Open for reading and writing, locked; without a buffer, which would be written once more when it is closed.
    """

    def __init__(self, path: Path, file: FileIO | BytesIO) -> None:
        self.path, self._file = path, file
        self._n_before = self.n_lost = 0
        self._marks: list[bytes] = []
        self._places: dict[bytes, tuple[int, int]] = {}
        self._believed: set[str] = set()
        self._lock = threading.RLock()

    @classmethod
    @contextmanager
    def opened(cls, path: Path) -> Iterator[Self]:
        """The journal of a checkpoint, begun where there is none.

        Raises
        ------
        UserError
            If it cannot be kept there, is another file, or another run writes it.
        """
        if path.name in ("", ".."):
            raise UserError(f"checkpoint {path}: it is a directory, give the name of a file in it, without suffix")
        with writing(f"checkpoint {path}", "choose another place"):
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(_solves(path), os.O_RDWR | os.O_CREAT, 0o666)
        with FileIO(handle, "r+") as file:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise UserError(f"checkpoint {path}: {_solves(path)} is no plain file; give another name")
            _claim(path, handle)
            journal = cls(path, file)
            with writing(f"checkpoint {path}", "choose another place"):
                journal._read()
            yield journal

    @property
    def is_empty(self) -> bool:
        """Whether it holds no answer."""
        return not self._places

    def holds(self, question: bytes) -> bool:
        """Whether it holds the answer to a question, or was marked with it."""
        return question in self._places

    def mark(self, *questions: bytes) -> None:
        """Say with the next answer what run it belongs to: hashes as of :func:`question_of`."""
        self._marks = [question for question in questions if question not in self._places]

    @classmethod
    def in_memory(cls, carried: Carried) -> Self:
        """A journal in another process; what it has :attr:`added` its owner will :meth:`take`."""
        journal = cls(carried.path, BytesIO(carried.content))
        journal._read()
        journal._believed |= carried.believed
        return journal

    @property
    def carried(self) -> Carried:
        """What another process must know of it."""
        return Carried(self.path, self._between(0, self._n_before), frozenset(self._believed))

    @property
    def added(self) -> bytes:
        """What it has taken up since it was opened."""
        return self._between(self._n_before, -1)

    def take(self, added: bytes) -> None:
        """Keep what one in another process has :attr:`added`."""
        if self._file.closed:
            return
        other = Journal.in_memory(Carried(self.path, _TITLE + added, frozenset()))
        for question, (begins, length) in other._places.items():
            if question not in self._places:
                self._append_payload(question, other._between(begins - _HASH, _HASH + length))

    def kept(
        self, kind: str, question: bytes, n_draws: int, solve: Solve, *, is_right: Check | None = None
    ) -> tuple[Floats, ...]:
        """Arrays ``(n_draws, ...)`` that answer a question: as they were kept, or solved and kept.

        Parameters
        ----------
        kind : str
            The first answer of each kind is believed only after a check.
        question : bytes
            Hash of all that shapes the answer, as of :func:`question_of`.
        n_draws : int
        solve : callable
            Solves some of the draws.
        is_right : callable, optional
            Checks an answer that was kept; by default some of its draws are solved again.
        """
        if self._file.closed:  # the run is over; whoever looks at its result solves for himself
            return solve(slice(0, n_draws))
        place = self._places.get(question)
        if place is None:
            answer = solve(slice(0, n_draws))
            self._append(question, answer)
            return answer
        answer = self._answer(place, n_draws)
        if kind not in self._believed:
            right = _are_solved_again(answer, solve) if is_right is None else is_right(answer)
            if not right:
                raise UserError(f"checkpoint {self.path}: what it holds is not what is solved here; {self._advice}")
            self._believed.add(kind)
        return answer

    @property
    def _advice(self) -> str:
        return f"delete {_solves(self.path)} to start anew"

    def _read(self) -> None:
        """Find every whole entry; the file ends after the last one."""
        self._file.seek(0)
        title = self._file.read(len(_TITLE))
        if not title:
            self._write(_TITLE)
            self._n_before = len(_TITLE)
            return None
        if title != _TITLE:
            if _TITLE.startswith(title):  # killed while it was begun
                self._file.seek(0)
                self._file.truncate()
                return self._read()
            raise UserError(
                f"checkpoint {self.path}: {_solves(self.path)} is no checkpoint of this version: delete it, or give "
                "another name"
            )
        end = self._file.tell()
        size = self._file.seek(0, os.SEEK_END)
        self._file.seek(end)
        while (payload := self._entry(size)) is not None:
            begins = end + _LENGTH.size + 2 * _HASH
            end = self._file.tell()
            self._places[payload[:_HASH]] = (begins, end - begins)
        self.n_lost = size - end
        self._file.truncate(end)
        self._file.seek(end)
        self._n_before = end
        return None

    def _entry(self, size: int) -> bytes | None:
        """Question and answer of the entry at which the file stands; None where it is not whole."""
        head = self._file.read(_LENGTH.size + _HASH)
        if len(head) < _LENGTH.size + _HASH:
            return None
        (length,) = _LENGTH.unpack(head[: _LENGTH.size])
        if not _HASH <= length <= size - self._file.tell():
            return None
        payload = self._file.read(length)
        return payload if hashlib.sha256(payload).digest() == head[_LENGTH.size :] else None

    def _append(self, question: bytes, answer: Sequence[Floats]) -> None:
        stream = BytesIO()
        stream.write(question)
        for array in answer:
            np.lib.format.write_array(stream, np.ascontiguousarray(array), allow_pickle=False)
        self._append_payload(question, stream.getvalue())

    def _append_payload(self, question: bytes, payload: bytes) -> None:
        head = _LENGTH.pack(len(payload)) + hashlib.sha256(payload).digest()
        with self._lock, writing(f"checkpoint {self.path}", "what was solved before is kept; make room there"):
            while self._marks:  # before the first answer, whichever thread has that
                self._append(self._marks.pop(), (np.zeros(1),))
            begins = self._file.seek(0, os.SEEK_END) + len(head) + _HASH
            self._write(head + payload)
            self._places[question] = (begins, len(payload) - _HASH)

    def _write(self, entry: bytes) -> None:
        """Write where the file stands, whole or not at all."""
        begins, written = self._file.tell(), 0
        try:
            while written < len(entry):  # a disk that fills up takes a part
                written += self._file.write(entry[written:])
        except OSError:
            self._file.truncate(begins)
            raise

    def _between(self, begins: int, length: int) -> bytes:
        """Bytes of the file; to its end where the length is -1."""
        with self._lock:
            self._file.seek(begins)
            return self._file.read(length)

    def _answer(self, place: tuple[int, int], n_draws: int) -> tuple[Floats, ...]:
        _, length = place
        stream = BytesIO(self._between(*place))
        arrays = []
        try:
            while stream.tell() < length:
                arrays.append(np.lib.format.read_array(stream, allow_pickle=False))
        except UNREADABLE_ARRAYS as error:
            raise UserError(f"checkpoint {self.path}: it cannot be read ({error}); {self._advice}") from error
        if not arrays or any(a.dtype != np.float64 or a.ndim == 0 or len(a) != n_draws for a in arrays):
            raise UserError(f"checkpoint {self.path}: no run can have written what it holds; {self._advice}")
        return tuple(arrays)


def _are_solved_again(answer: tuple[Floats, ...], solve: Solve) -> bool:
    """Whether some draws of an answer are what is solved here."""
    some = slice(0, min(N_SOLVED_AGAIN, len(answer[0])))
    again = solve(some)
    return len(again) == len(answer) and all(
        one.shape == kept[some].shape and np.allclose(one, kept[some], rtol=1e-9, atol=0.0, equal_nan=True)
        for one, kept in zip(again, answer, strict=True)
    )


def has_begun(path: Path) -> bool:
    """Whether anything solved is kept under a name."""
    with suppress(OSError):
        return _solves(path).stat().st_size > len(_TITLE)
    return False


def forget(path: Path) -> None:
    """Delete what is kept under a name: the run is done, or is to begin anew.

    Raises
    ------
    UserError
        If another run writes it.
    """
    refused = writing(f"checkpoint {path}", "choose another place")
    with refused, suppress(FileNotFoundError), _solves(path).open("rb") as file:
        _claim(path, file.fileno())
        _solves(path).unlink()


def _claim(path: Path, handle: int) -> None:
    """Lock a journal's file for as long as it is open."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise UserError(f"checkpoint {path}: another run writes it; wait, or give another name") from None


def _solves(path: Path) -> Path:
    return path.with_name(f"{path.name}.solves")


@contextmanager
def kept(engine: Engine, checkpoint: Path | None) -> Iterator[Engine]:
    """An engine that keeps what it solves under a name, and gives what was kept before; the same one without a name."""
    if checkpoint is None:
        yield engine
        return
    with Journal.opened(checkpoint) as journal:
        own: dict[str, Any] = {one.name: getattr(engine, one.name) for one in fields(cast("Any", engine))}
        yield _kept_kind(type(engine))(**own, journal=journal)


@cache
def _kept_kind(kind: type) -> Callable[..., Engine]:
    """An engine's kind, keeping; still of that kind, so that a finer scheme of it keeps too."""
    journal = ("journal", Journal, field(repr=False))
    return make_dataclass(f"Kept{kind.__name__}", [journal], bases=(_Keeping, kind), frozen=True, kw_only=True)


class _Keeping:
    """What an engine that keeps does beside its own."""

    journal: Journal

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """As of the engine; some draws at a time."""
        engine: Any = super()
        asked_about = about(self, model, record)
        result = np.empty((len(draws), len(record.blocks)))
        at_once = _AT_ONCE * getattr(self, "n_workers", 1)
        for start in range(0, len(draws), at_once):
            own = draws[start : start + at_once]

            def solve(some: slice, own: Floats = own) -> tuple[Floats, ...]:
                return (engine.misfit(model, own[some], record),)

            question = question_of("misfit", asked_about, own)
            (result[start : start + at_once],) = self.journal.kept(f"misfit {asked_about}", question, len(own), solve)
        return result

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """As of the engine; kept where that takes less room than a byte for each sample that was solved."""
        engine: Any = super()

        def solve(some: slice) -> tuple[Floats, ...]:
            own = engine.normal_equations(model, draws[some], record, free=None if free is None else free[some])
            return own.misfit, own.gradient, own.information

        if len(record.blocks) * 8 * (1 + model.space.n_dim) ** 2 > record.n_times or not len(draws):
            return NormalEquations(**dict(zip(_EQUATIONS, solve(slice(None)), strict=True)))
        asked_about = about(self, model, record)
        asked = [draws] if free is None else [draws, free]
        answer = self.journal.kept(
            f"normal equations {asked_about}", question_of("normal equations", asked_about, *asked), len(draws), solve
        )
        return NormalEquations(**dict(zip(_EQUATIONS, answer, strict=True)))


_EQUATIONS = tuple(one.name for one in fields(NormalEquations))


def question_of(kind: str, words: str, *arrays: Floats | Booleans) -> bytes:
    """Hash of a question: what is asked, in words, and with which arrays."""
    digest = hashlib.sha256(f"{kind}\n{words}\n{[(a.dtype.str, a.shape) for a in arrays]}\n".encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.digest()


@cache
def _law_in_words(law: StoreyLaw) -> str:
    """Its ``repr``, made once: it takes long beside the hash of the rest."""
    return repr(law)


@cache
def _code() -> str:
    """Hash of the package's own text: what other code has solved answers nothing here."""
    package = Path(__file__).parents[1]
    texts = (path.read_bytes() for path in sorted(package.rglob("*.py")))
    return hashlib.sha256(b"".join(texts)).hexdigest()


def search_in_words(model: Structure, record: Record, seed: int) -> str:
    """All that shapes a search."""
    return "\n".join((_code(), *model_in_words(model), record.content_hash, str(seed)))


def about(engine: Any, model: Structure, record: Record) -> str:
    """Hash of all that shapes an answer, but for the draws; threads do not."""
    threaded = any(one.name == "n_threads" for one in fields(engine))
    words = (
        _code(),
        # Who solves does not matter: one process, several, or a cluster.
        re.sub("^(Kept|Spread)*", "", repr(replace(engine, n_threads=1) if threaded else engine)),
        *model_in_words(model),
        record.content_hash,
    )
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def model_in_words(model: Structure) -> tuple[str, ...]:
    """All of a model that shapes an answer, but for its parameters' values."""
    table = model.table
    return (
        type(model).__name__,
        repr(model),
        _law_in_words(model.law),
        table.fixed.tobytes().hex(),
        table.index.tobytes().hex(),
        masses(model).tobytes().hex(),
    )
