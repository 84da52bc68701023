"""The numbers that the paper prints, row by row, as text.

References
----------
.. [1] Y. Zhao, M. Noori, W. A. Altabey, T. Awad, "A Comparison of Three Different Methods for the Identification of
   Hysterically Degrading Structures Using BWBN Model", Front. Built Environ. 4:80, 2019,
   doi:10.3389/fbuil.2018.00080, tables 1 to 7.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

TABLES = (1, 2, 3, 4, 5, 6, 7)

Row = Mapping[str, str]


@cache
def printed(table: int) -> tuple[Row, ...]:
    """Rows of a printed table: column name to text, as printed; SNR ``inf`` stands for the paper's dash.

    Parameters
    ----------
    table : int
        From 1 to 7.
    """
    text = files("bwbn_bayes.reproduction").joinpath("printed", f"table{table}.csv").read_text(encoding="utf-8")
    return tuple(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def one_row(table: int, **values: str) -> Row:
    """The one row of a table with these values.

    Raises
    ------
    LookupError
        If there is not exactly one.
    """
    found = [row for row in printed(table) if all(row[name] == value for name, value in values.items())]
    if len(found) != 1:
        raise LookupError(f"table {table} has {len(found)} rows with {values}")
    return found[0]
