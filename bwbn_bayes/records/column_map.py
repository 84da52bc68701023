"""What the columns of a file stand for: a column map, and the same words in the header of a file.

A map is a list of items, separated by commas, ``LABEL = NAME [UNIT] minus OTHER [UNIT]``::

    t = time [ms], ag = ground_acceleration [g], roof = displacement_3 [mm] minus table

``LABEL`` is what the file calls the column (``column 3`` is its third, quotes enclose a label with a comma), ``NAME``
what this package calls it. The unit is left out where the file names it. ``minus`` subtracts another column of the
file: so an absolute displacement becomes one relative to the ground. ``time_step`` and ``sampling_rate`` are names,
too; there a number may stand for the label, ``256 = sampling_rate [Hz]``. An item that is a label alone keeps its name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from bwbn_bayes.errors import UserError, require_kind

EXAMPLE = '"ag = ground_acceleration [g], roof = acceleration_3 [m/s^2]"'

_UNIT = r"(?:\s*\[([^\[\]]*)\])?"
_HEADER = re.compile(rf"(\S(?:.*?\S)??){_UNIT}(?:\s+minus\s+(\S(?:.*?\S)??){_UNIT})?")
_ROUND_UNIT = re.compile(r"(\S(?:.*?\S)??)\s*\(([^()]*)\)")
_PIECE = re.compile(r"""[^,"'\[(]+|"[^"]*"|'[^']*'|\[[^\]]*\]|\([^)]*\)|(,)|.""", re.DOTALL)


class Meaning(NamedTuple):
    """What a column is called or is to be called, its unit where it is named, and the column to subtract from it."""

    name: str
    unit: str | None = None
    minus: str | None = None
    minus_unit: str | None = None


class Item(NamedTuple):
    """One item of a column map: the file's label, and what it stands for."""

    label: str
    meaning: Meaning


def header_meaning(cell: str) -> Meaning | None:
    """What a cell of a header says, ``NAME [UNIT]``, ``NAME (UNIT)`` or ``NAME [UNIT] minus OTHER [UNIT]``."""
    match = _HEADER.fullmatch(cell.strip())
    if match is None or "[" in match.group(1) or "[" in (match.group(3) or ""):
        return None
    name, unit, minus, minus_unit = match.groups()
    round_unit = _ROUND_UNIT.fullmatch(name) if unit is None and minus is None else None
    if round_unit is not None:
        name, unit = round_unit.groups()
    return Meaning(name, *(part if part is None else part.strip() for part in (unit, minus, minus_unit)))


def parse_columns(text: str) -> tuple[Item, ...]:
    """Items of a column map.

    Raises
    ------
    UserError
        If it is no text, an item is not ``LABEL = NAME [UNIT]``, or a name is given twice.
    """
    require_kind("columns", text, str, f"give a column map as text, such as {EXAMPLE}")
    items = tuple(_item(part) for part in _split(text))
    names = [item.meaning.name for item in items]
    for position, name in enumerate(names):
        if name in names[:position]:
            raise UserError(f"the column map gives {name} twice: keep one")
    return items


def _split(text: str) -> list[str]:
    """Parts between commas that stand outside quotes and brackets."""
    parts = [""]
    for match in _PIECE.finditer(text):
        if match.group(1):
            parts.append("")
        else:
            parts[-1] += match.group(0)
    parts = [part.strip() for part in parts]
    if not all(parts):
        raise UserError(f"the column map {text[:60]!r} has an empty item: write it like {EXAMPLE}")
    return parts


def _item(part: str) -> Item:
    # The last sign of equality: a label may hold one, a name may not.
    quoted = re.fullmatch(r"""("[^"]*"|'[^']*')\s*(?:=(.*))?""", part, re.DOTALL)
    label, equals, told = (quoted.group(1), quoted.group(2), quoted.group(2)) if quoted else part.rpartition("=")
    if not equals:
        label = told = part if quoted is None else label
    told = told or ""
    meaning = header_meaning(_unquoted(told))
    if meaning is None or not _unquoted(label) or (equals and not re.fullmatch(r"\w+", meaning.name)):
        raise UserError(f"the item {part[:60]!r} of the column map is not understood: write it like {EXAMPLE}")
    if not equals:
        label = meaning.name
    minus = None if meaning.minus is None else _unquoted(meaning.minus)
    return Item(_unquoted(label), meaning._replace(name=meaning.name.lower(), minus=minus))


def _unquoted(text: str) -> str:
    text = text.strip()
    is_quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return " ".join((text[1:-1] if is_quoted else text).split())


def find_column(label: str, labels: Sequence[Sequence[str]]) -> int | None:
    """Position of the column that a label names; capitals and white space do not count.

    Parameters
    ----------
    label : str
        As a map has it.
    labels : sequence of sequence of str
        All that each column of the file answers to.
    """
    wanted = _plain(label)
    for position, known in enumerate(labels):
        if wanted in map(_plain, known):
            return position
    by_position = re.fullmatch(r"column ([1-9][0-9]{0,4})", wanted)
    if by_position and int(by_position.group(1)) <= len(labels):
        return int(by_position.group(1)) - 1
    return None


def _plain(label: str) -> str:
    return " ".join(label.split()).casefold()
