"""The command line."""

from __future__ import annotations

import atexit
import gc
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave the process with its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.
    """
    from bwbn_bayes.cli.interruption import interruptible

    # The end of the process would search all that it holds for cycles, several times: a third of a second.
    atexit.register(gc.freeze)
    with interruptible():
        # The commands take a third of a second to load, in which Ctrl-C may come, too.
        from bwbn_bayes.cli.commands import main as run

        run(arguments)


__all__ = ["main"]
