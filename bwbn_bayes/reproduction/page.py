"""The reproduction's page: printed figures beside ours, assumptions, predictions, one self-contained HTML file."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from bwbn_bayes.reproduction.cases import METHODS
from bwbn_bayes.reproduction.comparison import Line
from bwbn_bayes.reproduction.measure import Outcome
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.reproduction.printed import printed

_ASSIGNMENTS = (1, 4)
_NOTHING = "\N{EN DASH}"
_FITS = 0.01
"""Printed and own mean R-x nearer than this fit."""
_CAPTIONS = {
    1: "Table 1: true values and bounds (used as printed)",
    2: "Table 2: parameter errors in percent of the true value",
    3: "Table 3: correlations and running times, all methods",
    4: "Table 4: groups of degradation parameters (used as printed)",
    5: "Table 5: IPV, five groups",
    6: "Table 6: GA, five groups",
    7: "Table 7: TMCMC, five groups",
}
_ALT = {
    "figure7": "Figure 7 again: storey force against drift under the sine, true and identified, without noise.",
    "figure8": "Figure 8 again: storey force against drift under El Centro, true and identified, without noise.",
    "correlations": "One minus R-x, printed against ours: with the noise-free truth (left), the noisy record (right).",
}


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of the page as text."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def render(
    tables: Sequence[int],
    lines: Sequence[Line],
    outcomes: Sequence[Outcome],
    drawings: Sequence[tuple[str, bytes]],
    options: Options,
) -> str:
    """The page as text.

    Parameters
    ----------
    tables : sequence of int
        Printed tables to show.
    lines : sequence of Line
        Printed and own numbers.
    outcomes : sequence of Outcome
        Finished cases.
    drawings : sequence of (str, bytes)
        Names and PNG files.
    options : Options
        What was assumed.
    """
    environment = Environment(
        loader=PackageLoader("bwbn_bayes.reproduction"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        quick=options.quick,
        particles=options.particles,
        assumptions=options.sentences(),
        tables=[_assignment(t) if t in _ASSIGNMENTS else _compared(t, lines) for t in tables],
        findings=findings(lines),
        errors=errors(lines),
        costs=costs(lines),
        processors="; ".join(sorted({outcome.processor for outcome in outcomes})),
        prediction=_prediction(outcomes),
        redundant=_redundant(outcomes),
        figures=[(name, base64.b64encode(png).decode("ascii"), _ALT[name]) for name, png in drawings],
        n_finished=len(outcomes),
        n_missing=sum(not np.isfinite(line.ours) for line in lines if line.quantity == "running_time_s"),
    )


def findings(lines: Sequence[Line]) -> tuple[str, ...]:
    """Which reference the printed R-x fit: one sentence for each method and noise level.

    Parameters
    ----------
    lines : sequence of Line
        Printed and own numbers.
    """
    found = []
    for snr in ("30", "10"):
        for method in METHODS:
            chosen = [
                line
                for line in lines
                if (line.snr, line.method) == (snr, method) and "R_x" in line.quantity and np.isfinite(line.ours)
            ]
            if chosen:
                found.append(_finding(f"{method} at {snr} dB", chosen))
    return tuple(found)


def _finding(name: str, lines: Sequence[Line]) -> str:
    paper = float(np.mean([float(line.paper) for line in lines]))
    truth = float(np.mean([line.ours for line in lines]))
    noisy = float(np.mean([line.ours_noisy for line in lines]))
    nearer = "noisy record" if abs(noisy - paper) < abs(truth - paper) else "noise-free truth"
    gap = min(abs(noisy - paper), abs(truth - paper))
    verdict = f"fits ours with the {nearer}" if gap < _FITS else f"fits neither; the {nearer} is nearer, {gap:.4f} away"
    return (
        f"{name}: mean R-x {paper:.4f} printed, ours {truth:.4f} with the noise-free truth and {noisy:.4f} with the "
        f"noisy record; the printed one {verdict}."
    )


def errors(lines: Sequence[Line]) -> tuple[str, ...]:
    """How large TMCMC's parameter errors are beside their Cramer-Rao bounds, one sentence for each noisy case.

    Parameters
    ----------
    lines : sequence of Line
        Printed and own numbers.
    """
    cases: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        if line.method == "TMCMC" and line.snr != "inf" and np.isfinite(line.ours) and np.isfinite(line.limit):
            cases.setdefault((line.excitation, line.snr), []).append(line)
    found = []
    for (excitation, snr), chosen in cases.items():
        size = np.array([abs(line.ours) / line.limit for line in chosen])
        worst = chosen[int(np.argmax(size))]
        held = sum(line.n_covered or 0 for line in chosen)
        n_seeds, n_small = worst.n_seeds, int(np.count_nonzero(size <= 1.0))
        seeds, kind = ("1 seed", "errors") if n_seeds == 1 else (f"{n_seeds} seeds", "median errors")
        found.append(
            f"{excitation} at {snr} dB, {seeds}: {n_small} of {len(chosen)} {kind} are within their Cramér-Rao sd, the "
            f"largest ({worst.quantity}) is {np.max(size):.2f} of it; 90 % intervals hold {held} of "
            f"{n_seeds * len(chosen)} true values."
        )
    return tuple(found)


def costs(lines: Sequence[Line]) -> tuple[str, ...]:
    """Printed running times beside ours, one sentence for each method.

    Parameters
    ----------
    lines : sequence of Line
        Printed and own numbers.
    """
    found = []
    for method in METHODS:
        times = [
            (float(line.paper), line.ours)
            for line in lines
            if (line.method, line.quantity) == (method, "running_time_s") and np.isfinite(line.ours)
        ]
        if times:
            paper, ours = zip(*times, strict=True)
            found.append(f"{method}: {_range(paper)} printed, {_range(ours)} here.")
    return tuple(found)


def _range(seconds: Sequence[float]) -> str:
    low, high = (f"{value:,.0f}" if value >= 10.0 else f"{value:.2g}" for value in (min(seconds), max(seconds)))
    return f"{low} s" if low == high else f"{low} to {high} s"


def _assignment(table: int) -> Table:
    rows = printed(table)
    return Table(caption=_CAPTIONS[table], columns=tuple(rows[0]), rows=tuple(tuple(row.values()) for row in rows))


def _compared(table: int, lines: Sequence[Line]) -> Table:
    rows = tuple(
        (
            line.method,
            line.group,
            line.snr,
            line.excitation,
            line.quantity,
            line.paper,
            *(_text(value, line) for value in (line.ours, line.ours_noisy, line.limit)),
            f"{line.n_covered} of {line.n_seeds}" if line.n_covered is not None else _NOTHING,
            str(line.n_seeds),
        )
        for line in lines
        if line.table == table
    )
    ours = "ours" if table == 2 else "ours, with the noise-free truth"
    columns = (
        "method", "group", "SNR [dB]", "excitation", "quantity", "paper", ours, "ours, with the noisy record",
        "Cramér-Rao sd", "90 % interval covers", "seeds",
    )  # fmt: skip
    return Table(caption=_CAPTIONS[table], columns=columns, rows=rows)


def _text(value: float, line: Line) -> str:
    if not np.isfinite(value):
        return _NOTHING
    return f"{value:.6f}" if line.quantity.startswith("corr") else f"{value:.4g}"


def _prediction(outcomes: Sequence[Outcome]) -> Table:
    rows = []
    for outcome in outcomes:
        if not (outcome.other or outcome.drift_variant):
            continue
        other, drift = outcome.other, outcome.drift_variant
        rows.append(
            (
                outcome.case.method,
                outcome.case.snr,
                outcome.case.excitation,
                _percent(other.get("nrmse", np.nan)) if other else "cannot: its inputs are the response",
                _percent(other.get("coverage", np.nan)),
                _percent(outcome.coverage),
                f"{outcome.elapsed_s:.3g}",
                f"{outcome.digits:.2f}",
                f"{outcome.elapsed_s / outcome.digits:.3g}" if outcome.digits > 0.0 else _NOTHING,
                str(outcome.n_solves),
                _percent(drift.get("nrmse", np.nan)),
                _percent(drift.get("other_nrmse", np.nan)),
            )
        )
    return Table(
        caption="What the paper did not ask: prediction under the other excitation, coverage, cost",
        columns=(
            "method", "SNR [dB]", "identified from", "error under the other excitation (NRMSE)",
            "its 90 % intervals cover", "parameters covered by 90 % intervals", "time [s]", "digits of the force",
            "s per digit", "solves", "IPV of drift and drift rate: force error", "and its prediction's error",
        ),
        rows=tuple(rows),
    )  # fmt: skip


def _redundant(outcomes: Sequence[Outcome]) -> Table:
    rows = []
    for outcome in outcomes:
        a = outcome.parameters.get("A")
        if outcome.redundant and a is not None:
            along = ", ".join(f"{name} {r:+.3f}" for name, r in outcome.redundant.items())
            name = f"{outcome.case.excitation}, {outcome.case.snr} dB"
            rows.append((name, f"{a['value']:.4g}", f"{a['sd']:.2g}", f"{a['low']:.4g} to {a['high']:.4g}", along))
    return Table(
        caption="The redundant direction, A free: posterior of A, and what moves with it (correlation)",
        columns=("case", "mean of A", "sd", "90 % interval", "correlations above 0.9"),
        rows=tuple(rows),
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f} %" if np.isfinite(share) else _NOTHING
