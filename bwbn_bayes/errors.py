"""The one exception that means "the user can mend this"."""

import os
import threading
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from numbers import Integral
from pathlib import Path
from zipfile import BadZipFile

UNREADABLE_ARRAYS = (
    *(OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError),
    *(BadZipFile, EOFError, MemoryError, NotImplementedError, RuntimeError, zlib.error),
)
"""What reading JSON and an archive of arrays may raise where they are not what was written, or no such thing at all."""

EXTRAS: Mapping[str, tuple[str, ...]] = {
    "pymc": ("pymc", "pytensor", "numba"),
    "nuts": ("pymc", "pytensor", "numba", "nutpie"),
    "ga": ("pymoo",),
    "cvodes": ("sundials4py",),
    "distributed": ("distributed",),
}
"""Libraries of the optional parts of an installation, by the name of the extra that brings them."""


class UserError(ValueError):
    """A mistake in a model, a record or an option.

    The message is one sentence: what is wrong, where, and what to do. The command line prints it without a
    traceback and exits with code 2.
    """


def require_kind(name: str, given: object, kind: type | tuple[type, ...], advice: str) -> None:
    """Refuse an argument of another kind.

    Parameters
    ----------
    name : str
        Of the argument.
    given : object
    kind : type or tuple of types
        What it must be.
    advice : str
        What to give, the end of the sentence.
    """
    if not isinstance(given, kind):
        raise UserError(f"{name} is {in_short(given)}: {advice}")


def in_short(given: object) -> str:
    """What was given: text, a number or a class itself, of anything longer its type."""
    if isinstance(given, type):
        return f"the class {given.__name__}"
    if given is None or isinstance(given, (str, float, bool)):
        return f"{given!r:.60}"
    return f"of type {type(given).__name__}"


def whole_number(name: str, given: object, fewest: int) -> int:
    """A whole number from so many on, NumPy's as Python's own; an error where it is another or none."""
    if isinstance(given, bool) or not isinstance(given, Integral) or given < fewest:
        raise UserError(f"{name} is {given!r}, it must be a whole number from {fewest} on")
    return int(given)


@contextmanager
def writing(what: str, advice: str) -> Iterator[None]:
    """While files are written: what the operating system refuses, a full disk say, is the user's to mend.

    Parameters
    ----------
    what : str
        What is written and where, the beginning of the sentence.
    advice : str
        What to do, its end.
    """
    try:
        yield
    except OSError as error:
        raise UserError(f"{what} cannot be written ({error.strerror or error}): {advice}") from error


def replace_file(path: Path | str, contents: bytes) -> None:
    """Write a file beside, and let it take the name when it is whole: a full disk costs nobody what stood there before.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    place = Path(path)
    if place.exists() and not place.is_file():  # a pipe, or a terminal
        place.write_bytes(contents)
        return
    place = place.resolve()  # what a link points to
    fresh = place.with_name(f".new-{os.getpid()}-{threading.get_ident()}")
    try:
        fresh.write_bytes(contents)
        fresh.replace(place)
    finally:
        fresh.unlink(missing_ok=True)


def require_installed(extra: str, what: str) -> None:
    """Refuse what needs a library that is not installed; nothing is imported.

    Parameters
    ----------
    extra : str
        One of :data:`EXTRAS`.
    what : str
        What needs it, the beginning of the sentence.

    Raises
    ------
    UserError
        Naming the library and the extra.
    """
    missing = [library for library in EXTRAS[extra] if find_spec(library) is None]
    if missing:
        raise UserError(
            f"{what} needs {missing[0]}, which is not installed: add the extra {extra}, as in "
            f"pip install 'bwbn-bayes[{extra}]' or, in a clone, uv sync --extra {extra}"
        )
