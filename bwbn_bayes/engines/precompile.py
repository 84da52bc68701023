"""Compile lane kernels in a process of their own: compiling holds the interpreter, so threads do not help.

The child compiles the pickled laws that its parent sends it into the kernel cache, and ends when the parent does.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.cache_files import cache_directory
from bwbn_bayes.engines.children import RUNNING, end_with_pipe
from bwbn_bayes.engines.lane_laws import compile_law, is_compiled

_CHILD = """
import sys
sys.path.append(sys.argv[1])
from bwbn_bayes.engines.precompile import compile_laws_sent
compile_laws_sent()
"""


def precompile(laws: Mapping[StoreyLaw, bool], *, driven: bool, single: bool = False) -> threading.Thread | None:
    """Begin to compile the laws that the cache lacks; the thread that waits for it, None where it lacks none.

    Parameters
    ----------
    laws : mapping of StoreyLaw to bool
        Whether a law will be solved with derivatives too; compiled in this order.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    single : bool
        Whether the kernels compute with numbers of 32 bits.
    """
    directory = cache_directory()
    missing = {law: with_tangents for law, with_tangents in laws.items() if not is_compiled(law, driven, single=single)}
    if not missing or directory is None:
        return None
    process = subprocess.Popen(
        # -P: the current folder may be anybody's, it is no place to import from.
        [sys.executable, "-P", "-c", _CHILD, str(Path(__file__).parents[2])],
        env={**os.environ, "BWBN_CACHE_DIR": str(directory)},
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    RUNNING.append(process)
    waiting = threading.Thread(target=_attend, args=(process, pickle.dumps((missing, driven, single))), daemon=True)
    waiting.start()
    return waiting


def _attend(process: subprocess.Popen[bytes], laws: bytes) -> None:
    """Send the laws, and keep the pipe open until they are compiled: its end tells the child that nobody waits."""
    assert process.stdin is not None
    with suppress(BrokenPipeError), process.stdin:
        process.stdin.write(laws)
        process.stdin.flush()
        process.wait()


def compile_laws_sent() -> None:
    """Compile what the parent sends."""
    laws, driven, single = pickle.load(sys.stdin.buffer)
    end_with_pipe()
    for law, with_tangents in laws.items():
        compile_law(law, driven, with_tangents, single=single)
