"""Compile lane kernels in a process of their own: compiling holds the interpreter, so threads do not help.

``python -m bwbn_bayes.engines.precompile FILE`` compiles the pickled laws of a file into the kernel cache.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.lanes import compile_law, is_compiled


def precompile(laws: Mapping[StoreyLaw, bool], *, driven: bool) -> threading.Thread | None:
    """Begin to compile the laws that the cache lacks; the thread that waits for it, None where it lacks none.

    Parameters
    ----------
    laws : mapping of StoreyLaw to bool
        Whether a law will be solved with derivatives too; compiled in this order.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    """
    missing = {law: with_tangents for law, with_tangents in laws.items() if not is_compiled(law, driven)}
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
    for law, with_tangents in laws.items():
        compile_law(law, driven, with_tangents)


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
