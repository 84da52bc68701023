"""Processes that this one has started to compile for it; apart from what starts them, which takes seconds to load."""

from __future__ import annotations

import subprocess

RUNNING: list[subprocess.Popen[bytes]] = []


def stop_compiling() -> None:
    """End every child at once."""
    for process in RUNNING:
        process.kill()
