"""Ctrl-C: one sentence, exit code 130, nothing half-written and no child left, at once.

A thread waits for the signal and ends the process. Python's own way, an exception in the main thread, waits for
whatever is being compiled or solved there, for pools to empty, and for libraries that take it for their own.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

from bwbn_bayes.engines.children import stop_compiling

EXIT_CODE = 130
"""What a shell expects of a process that SIGINT ended."""
UNFINISHED_SEARCH = ".unfinished"
"""Checkpoint of a discovery, in the directory that it writes to."""
COMMITTING = threading.Lock()
"""Held while finished files take their names, for the blink of which the end of the process waits."""
UNFINISHED: set[Path] = set()
"""Directories to remove with the process."""
_PATIENCE = 1.0
"""How long the end waits for files to take their names. [s]"""
_SENTENCES: list[Callable[[], str]] = []


@contextmanager
def stopped_with(sentence: Callable[[], str]) -> Iterator[None]:
    """What to say where Ctrl-C ends the process meanwhile."""
    _SENTENCES.append(sentence)
    try:
        yield
    finally:
        _SENTENCES.pop()


@contextmanager
def interruptible() -> Iterator[None]:
    """Meanwhile Ctrl-C ends the process; where it is ignored, as in a background job, it stays ignored."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    signal.signal(signal.SIGINT, lambda *_: None)
    before = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(receiver,), name="interruption", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sender.close()


def leave() -> NoReturn:
    """End the process: one sentence, nothing half-written, no child."""
    try:
        COMMITTING.acquire(timeout=_PATIENCE)
        stop_compiling()
        for child in multiprocessing.active_children():
            child.kill()
        for directory in tuple(UNFINISHED):
            shutil.rmtree(directory, ignore_errors=True)
        sentence = _SENTENCES[-1]() if _SENTENCES else "stopped"
        # A terminal gets back the line and the cursor that a progress bar took.
        taken = "\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else ""
        with suppress(OSError):
            os.write(2, f"{taken}{sentence}\n".encode(errors="replace"))
    finally:
        os._exit(EXIT_CODE)


def _watch(receiver: socket.socket) -> None:
    with receiver:
        while signals := receiver.recv(1):
            if signals[0] == signal.SIGINT:
                leave()
