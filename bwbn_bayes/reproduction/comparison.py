"""Printed figures beside ours, one line for each number."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from io import StringIO
from pathlib import Path

import numpy as np

from bwbn_bayes.errors import replace_file
from bwbn_bayes.reproduction.cases import STOREYS, Case, cases_of, printed_column
from bwbn_bayes.reproduction.measure import Outcome
from bwbn_bayes.reproduction.printed import Row, printed

_FORCES = {f"corr_{r}_storey{i}": (r, str(i)) for i in STOREYS for r in ("R_t", "R_x")}
_PARAMETERS = (
    "k[1]", "k[2]", "k[3]", "c[1]", "c[2]", "c[3]", "A", "alpha", "beta", "gamma", "n", "delta_nu", "delta_nu_jump",
    "delta_eta", "delta_eta_jump", "sigma", "delta_s",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Line:
    """One printed number and ours.

    Attributes
    ----------
    table : int
    method, group, snr, excitation : str
        Of the case.
    quantity : str
        Column of the printed table.
    paper : str
        As printed.
    ours : float
        Against the noise-free truth; NaN where the case was not run or the method gives no such number.
    ours_noisy : float
        Correlations against the noisy record instead; NaN for other quantities.
    limit : float
        Cramer-Rao standard deviation of a parameter, in the quantity's unit; NaN for other quantities.
    n_seeds : int
        Errors are medians of absolute values where there is more than one.
    n_covered : int, optional
        In how many of them the 90 % interval holds the true value; None without intervals.
    """

    table: int
    method: str
    group: str
    snr: str
    excitation: str
    quantity: str
    paper: str
    ours: float = float("nan")
    ours_noisy: float = float("nan")
    limit: float = float("nan")
    n_seeds: int = 0
    n_covered: int | None = None


def comparison(tables: Sequence[int], outcomes: Sequence[Outcome]) -> tuple[Line, ...]:
    """Every number of the printed results, with ours where the case was run.

    Parameters
    ----------
    tables : sequence of int
        Printed tables; those of assignments (1 and 4) give no lines.
    outcomes : sequence of Outcome
        Finished cases, several seeds of one allowed.
    """
    by_case: dict[Case, list[Outcome]] = {}
    for outcome in outcomes:
        by_case.setdefault(outcome.case, []).append(outcome)
    lines: list[Line] = []
    for table in tables:
        for case, row in zip(cases_of(table), printed(table), strict=False):
            build = _errors if table == 2 else _correlations
            lines += build(table, case, row, by_case.get(case, []))
    return tuple(lines)


def write_csv(lines: Sequence[Line], path: Path) -> None:
    """Write the lines as CSV; numbers that do not exist stay empty."""
    file = StringIO(newline="")
    writer = csv.DictWriter(file, [field.name for field in fields(Line)])
    writer.writeheader()
    for line in lines:
        plain = asdict(line)
        writer.writerow({k: "" if isinstance(v, float) and np.isnan(v) else v for k, v in plain.items()})
    replace_file(path, file.getvalue().encode())


def _line(table: int, case: Case, quantity: str, paper: str, outcomes: Sequence[Outcome]) -> Line:
    return Line(
        table=table,
        method=case.method,
        group=str(case.group),
        snr=case.snr,
        excitation=case.excitation,
        quantity=quantity,
        paper=paper,
        n_seeds=len(outcomes),
    )


def _correlations(table: int, case: Case, row: Row, outcomes: Sequence[Outcome]) -> list[Line]:
    lines = []
    for column, (kind, storey) in _FORCES.items():
        line = _line(table, case, column, row[column], outcomes[:1])
        if outcomes:
            values = outcomes[0].force[storey]
            line = replace(line, ours=values[f"{kind}_truth"], ours_noisy=values[f"{kind}_noisy"])
        lines.append(line)
    line = _line(table, case, "running_time_s", row["running_time_s"], outcomes[:1])
    return [*lines, replace(line, ours=outcomes[0].elapsed_s) if outcomes else line]


def _errors(table: int, case: Case, row: Row, outcomes: Sequence[Outcome]) -> list[Line]:
    return [
        _error(_line(table, case, printed_column(label), row[printed_column(label)], outcomes), label, outcomes)
        for label in _PARAMETERS
    ]


def _error(line: Line, label: str, outcomes: Sequence[Outcome]) -> Line:
    """Error in percent of the true value, as printed; in the parameter's own unit where the true value is zero."""
    found = [outcome.parameters[label] for outcome in outcomes if label in outcome.parameters]
    if not found:
        return line
    scale = 100.0 / found[0]["true"] if found[0]["true"] != 0.0 else 1.0
    errors = [scale * (p["value"] - p["true"]) for p in found]
    inside = [p["low"] <= p["true"] <= p["high"] for p in found if np.isfinite(p["low"])]
    return replace(
        line,
        ours=errors[0] if len(errors) == 1 else float(np.median(np.abs(errors))),
        limit=abs(scale) * found[0]["cramer_rao"],
        n_covered=sum(inside) if inside else None,
    )
