"""Generated code on disk: files named by a hash of everything that shapes what is in them."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding

from bwbn_bayes.engines.cache_files import cache_directory, discard, read_checked, read_own, write_checked, write_whole


def code_path(kind: str, source: str, *shaped_by: str) -> Path | None:
    """Where generated source is kept, beside its machine code; None where nothing is.

    Parameters
    ----------
    kind : str
        First part of the file's name.
    source : str
        The name goes on with a hash of it, of the processor, of the versions of Python and llvmlite, and of what else
        is said to shape the machine code: changed source has other files, and a second process reuses the first one's.
    shaped_by : str
        That else.
    """
    directory = cache_directory()
    return None if directory is None else directory / f"{code_name(kind, source, *shaped_by)}.py"


def code_name(kind: str, source: str, *shaped_by: str) -> str:
    """The name of generated source and its machine code, without suffix."""
    everything = (source, _processor(), llvmlite.__version__, platform.python_version(), *shaped_by)
    return f"{kind}_{hashlib.sha256('\n'.join(everything).encode()).hexdigest()[:20]}"


@cache
def _processor() -> str:
    return str(llvmlite.binding.get_host_cpu_name() + llvmlite.binding.get_host_cpu_features().flatten())


def keep_source(path: Path, source: bytes) -> None:
    """Write source for people to read; it is executed from memory, as it was generated."""
    kept = read_own(path)
    if kept != source:
        if kept is not None:
            discard(path, "it is not what was generated")
        write_whole(path, source)


def remembered(kind: str, key: str, make: Callable[[], Any]) -> Any:
    """What ``make`` made when it was last asked under this key, in this or another process; made now if never.

    Parameters
    ----------
    kind : str
        First part of the file's name.
    key : str
        Everything that shapes the result; a hash of it names the file.
    make : callable
        Its result must be plain data: numbers, text, and lists and mappings of them.
    """
    path = _kept_path(kind, key)
    if path is None:
        return make()
    kept = read_checked(path)
    if kept is not None:
        return json.loads(kept)
    made = make()
    write_checked(path, json.dumps(made).encode())
    return made


def is_remembered(kind: str, key: str) -> bool:
    """Whether :func:`remembered` would find what was made under a key."""
    path = _kept_path(kind, key)
    return path is not None and path.exists()


def _kept_path(kind: str, key: str) -> Path | None:
    directory = cache_directory()
    return None if directory is None else directory / f"{kind}_{hashlib.sha256(key.encode()).hexdigest()[:20]}.kept"
