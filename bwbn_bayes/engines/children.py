"""Processes that this one has started, and how they end with it; apart from what starts them, which loads slowly."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import threading

RUNNING: list[subprocess.Popen[bytes]] = []
"""Those that compile."""


def stop_compiling() -> None:
    """End every child that compiles at once."""
    for process in RUNNING:
        process.kill()


def end_with_pipe() -> None:
    """For a process that is sent its work by a pipe to its stdin: end when that is closed, as by its parent's end."""
    threading.Thread(target=_follow_pipe, name="pipe", daemon=True).start()


def _follow_pipe() -> None:
    # Not by sys.stdin: a thread that waits there holds its lock, and Python aborts at its end where it meets it.
    while os.read(0, 1):
        pass
    os._exit(1)


def end_with_parent() -> None:
    """For a process that :mod:`multiprocessing` started: end when its parent does, also where that is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), name="parent", daemon=True).start()


def _follow(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
