"""How a command ends that cannot be done: one sentence on stderr, exit code 2."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from typing import NoReturn, TextIO

from rich.console import Console
from rich.text import Text

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What the system says where a disk takes no more."""

_MOST = 1200
"""Characters of a sentence, whatever it quotes: its beginning says where, its end what to do."""


def refuse(sentence: str) -> NoReturn:
    """Leave with a sentence."""
    # Imported here: help should not wait for it.
    from bwbn_bayes.records.record import one_line

    said = one_line(sentence)
    if len(said) > _MOST:
        said = f"{said[: _MOST // 2]} ... {said[-_MOST // 2 :]}"
    message = Text.assemble(("error: ", "bold red"), said)
    try:
        Console(stderr=True).print(message, soft_wrap=True)
    except OSError:
        drop(sys.stderr)
    sys.exit(2)


def refuse_what_the_system_refuses(error: OSError) -> int:
    """Leave where a name is one that no file can have, is closed to the user, or what is shown finds no room.

    Where there is no reader, the exit code.

    Raises
    ------
    OSError
        Any other: what the system refuses is told where it happens, or it is a mistake of ours.
    """
    if isinstance(error, BrokenPipeError):  # whoever read has read enough
        drop(sys.stdout)
        return 1
    if error.errno == errno.ENAMETOOLONG:  # asking whether there is such a file says so
        refuse(f"{str(error.filename)[:60]}...: no file can have so long a name, give a shorter one")
    if error.errno in _NO_ROOM:
        drop(sys.stdout)
        place = error.filename or "what is shown"
        refuse(f"{place} cannot be written ({error.strerror}): make room, or choose another place")
    if isinstance(error, PermissionError) and error.filename is not None:
        refuse(f"{os.fspath(error.filename)}: {error.strerror}: ask for the right to it, or give another path")
    raise error


def drop(stream: TextIO | None) -> None:
    """Forget what waits in a stream, and what comes: into one that takes nothing Python would try again at the end."""
    with suppress(OSError):
        if stream is not None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
