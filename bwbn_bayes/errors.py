"""The one exception that means "the user can mend this"."""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from zipfile import BadZipFile

UNREADABLE_ARRAYS = (
    *(OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError),
    *(BadZipFile, EOFError, MemoryError, NotImplementedError, RuntimeError, zlib.error),
)
"""What reading JSON and an archive of arrays may raise where they are not what was written, or no such thing at all."""


class UserError(ValueError):
    """A mistake in a model, a record or an option.

    The message is one sentence: what is wrong, where, and what to do. The command line prints it without a
    traceback and exits with code 2.
    """


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
