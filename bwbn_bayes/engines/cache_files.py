"""Where generated code is kept, and files that are checked before they are believed.

What is read here is executed: kernels are machine code. So the folder must be the user's own, with nobody else able to
write to it, and so must every file in it; and each file begins with a hash of its contents, so that one cut short by a
crash or a full disk is made anew and never run.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import threading
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

_DIGEST = 64
"""Hexadecimal digits at the beginning of a file, before a line feed."""
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_ABANDONED = 3600.0
"""Age from which a file that was never finished is the remains of a process that was killed. [s]"""


def cache_directory() -> Path | None:
    """The folder for generated code; None where no folder can be used, so that code stays in memory.

    ``$BWBN_CACHE_DIR``, or ``bwbn_bayes`` in the user's cache directory; where that cannot be written, or others can
    write to it, a folder of the user's own among the temporary files, and one sentence on stderr.
    """
    own = os.environ.get("BWBN_CACHE_DIR")
    if own:
        return _first_usable(str(Path(own).absolute()))
    shared = os.environ.get("XDG_CACHE_HOME", "")
    try:
        # A relative path there means nothing, says the XDG standard: it would follow the current folder.
        base = Path(shared) if Path(shared).is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        return _first_usable("")
    return _first_usable(str(base / "bwbn_bayes"))


@cache
def _first_usable(asked: str) -> Path | None:
    """The folder asked for (empty for a user without a home), or the temporary one, or None."""
    fault = _fault(Path(asked)) if asked else "there is no home directory"
    if fault is None:
        return Path(asked).resolve()
    try:
        instead = Path(tempfile.gettempdir()) / f"bwbn_bayes-{_user()}"
        usable = not instead.is_symlink() and _fault(instead) is None
    except OSError:
        usable = False
    place = f"{instead} is used instead" if usable else "nothing is kept, and every run compiles anew"
    tell_once(f"compiled kernels cannot be kept in {asked or 'a folder of yours'} ({fault}): {place}")
    return instead.resolve() if usable else None


def _fault(folder: Path) -> str | None:
    """Why generated code cannot be kept in a folder, which is made where it is missing; None where it can."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        exposed = _exposed(folder.resolve())
        if exposed is None:
            with tempfile.TemporaryFile(dir=folder) as probe:
                probe.write(bytes(4096))
            _sweep(folder)
    except OSError as error:
        return error.strerror or str(error)
    return exposed


def _exposed(folder: Path) -> str | None:
    """How others could put code into a folder."""
    facts = folder.stat()
    if facts.st_uid != _user():
        return "it belongs to another user"
    if facts.st_mode & _OTHERS_WRITE:
        return "others may write to it"
    for parent in folder.parents:
        mode = parent.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return f"others may write to {parent}"
    return None


def _sweep(folder: Path) -> None:
    """Remove what killed processes never finished."""
    for path in folder.glob("*.[0-9]*.[0-9]*.tmp"):
        if time.time() - path.lstat().st_mtime > _ABANDONED:
            path.unlink(missing_ok=True)


def _user() -> int:
    return os.geteuid() if os.name == "posix" else 0


def read_own(path: Path) -> bytes | None:
    """Contents of a file that nobody but the user can have written; None where there is none."""
    try:
        # Without waiting: a named pipe would have nobody at its other end.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(handle, "rb") as file:
            facts = os.fstat(handle)
            if stat.S_ISREG(facts.st_mode) and facts.st_uid == _user() and not facts.st_mode & _OTHERS_WRITE:
                return file.read()
    except FileNotFoundError:
        return None
    except OSError as error:
        discard(path, error.strerror or str(error))
        return None
    discard(path, "others could have written it")
    return None


def read_checked(path: Path) -> bytes | None:
    """Contents that :func:`write_checked` wrote; None where there are none, or damaged ones, which are removed."""
    text = read_own(path)
    if text is None:
        return None
    contents = text[_DIGEST + 1 :]
    if text[: _DIGEST + 1] == _head(contents):
        return contents
    discard(path, "it is damaged")
    return None


def write_checked(path: Path, contents: bytes) -> None:
    """Keep contents under a name, behind their hash."""
    write_whole(path, _head(contents) + contents)


def write_whole(path: Path, contents: bytes) -> None:
    """Replace a file by new contents, whole or not at all; where that fails, nothing is kept and stderr says so."""
    fresh = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}.tmp")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
            file.write(contents)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        tell_once(f"compiled kernels cannot be kept in {path.parent} ({error.strerror or error})")


def discard(path: Path, why: str) -> None:
    """Remove a file that is not what was kept, and say so on stderr."""
    tell_once(f"kernel cache: {path} is made anew ({why})")
    with suppress(OSError):  # a folder in its place, say: then nothing is kept there
        path.unlink(missing_ok=True)


def tell_once(sentence: str) -> None:
    """One line on stderr, the first time that it is said."""
    if sentence not in _TOLD:
        _TOLD.add(sentence)
        print(sentence, file=sys.stderr)


_TOLD: set[str] = set()


def _head(contents: bytes) -> bytes:
    return hashlib.sha256(contents).hexdigest().encode() + b"\n"
