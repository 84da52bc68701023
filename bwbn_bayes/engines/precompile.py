"""Compile lane kernels in a process of their own: compiling holds the interpreter, so threads do not help.

``python -m bwbn_bayes.engines.precompile FILE`` compiles the pickled laws of a file into the kernel cache.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.lanes import compile_law, is_compiled


def precompile(laws: Sequence[StoreyLaw], *, driven: bool) -> threading.Thread | None:
    """Begin to compile the laws that the cache lacks; the thread that waits for it, None where it lacks none.

    Parameters
    ----------
    laws : sequence of StoreyLaw
        Compiled in this order.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    """
    missing = [law for law in dict.fromkeys(laws) if not is_compiled(law, driven)]
    if not missing:
        return None
    with tempfile.NamedTemporaryFile(suffix=".laws", delete=False) as file:
        pickle.dump((missing, driven), file)
    command = [sys.executable, "-m", "bwbn_bayes.engines.precompile", file.name]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    waiting = threading.Thread(target=process.wait, daemon=True)
    waiting.start()
    return waiting


def _main(path: Path) -> None:
    laws, driven = pickle.loads(path.read_bytes())
    path.unlink()
    for law in laws:
        compile_law(law, driven)


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
