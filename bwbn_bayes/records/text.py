"""Text and numbers out of files that may hold anything."""

from __future__ import annotations

import stat
from pathlib import Path

import numpy as np

from bwbn_bayes.errors import UserError


def is_plain(path: Path) -> bool:
    """Whether a file is one: a named pipe would be waited for, a device has no end; OSError where there is none."""
    return stat.S_ISREG(path.stat().st_mode)


def file_bytes(path: Path) -> bytes:
    """What a file holds; UserError where there is none, or nothing in it."""
    try:
        if not is_plain(path):
            raise UserError(f"{path}: the file cannot be read (it is no plain file): give the path of one")
        data = path.read_bytes()
    except FileNotFoundError:
        raise UserError(f"{path}: no such file, give the path of one") from None
    except OSError as error:
        raise UserError(f"{path}: the file cannot be read ({error.strerror}): mend that, or get it anew") from None
    if not data.strip():
        raise UserError(f"{path}: the file is empty, get it anew")
    return data


def file_text(path: Path) -> str:
    """A file's text in UTF-8; UserError that names the line where it is not."""
    data = file_bytes(path)
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UserError(f"{path}, line {line}: the text is not UTF-8, save the file as UTF-8") from None


def ascii_lines(path: Path) -> list[str]:
    """Lines of a format that is ASCII but for names of places, in whatever encoding those are."""
    return file_bytes(path).decode("utf-8", errors="replace").replace("\r\n", "\n").split("\n")


def number(cell: str, place: str) -> float:
    """A finite number from text; UserError where it is none."""
    text = cell.strip()
    if not text:
        raise UserError(f"{place}: the cell is blank, every cell needs a number")
    try:
        value = float(text)
    except ValueError:
        value = None
    if value is None or "_" in text:
        raise UserError(f"{place}: {text[:40]!r} is not a number")
    if not np.isfinite(value):
        raise UserError(f"{place}: the value is {text[:40]}, every value must be a finite number")
    return value
