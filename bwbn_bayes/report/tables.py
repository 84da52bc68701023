"""The report's tables as text: every number with the digits it deserves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from bwbn_bayes.report.numbers import (
    NOTHING,
    Scale,
    display_scale,
    duration,
    html_symbol,
    html_unit,
    percent,
    significant,
    with_uncertainty,
)
from bwbn_bayes.report.pieces import Content, Quantity
from bwbn_bayes.results import Check, Facts, ParameterFacts

_NORMAL_95 = 1.645
_DISCRETISATION = {
    "scheme": "scheme",
    "joint_shift_sd": "joint shift of the posterior by the time step [posterior sd]",
    "log_likelihood_shift": "shift of the log likelihood by the time step [nat]",
    "nrmse": "relative error of the response (against the finest scheme)",
}


@dataclass(frozen=True, kw_only=True)
class Table:
    """Header cells and rows of cells; the first cell of a row is its heading."""

    columns: tuple[str | Markup, ...]
    rows: tuple[tuple[str | Markup, ...], ...]

    def __bool__(self) -> bool:
        return bool(self.rows)


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """One parameter's texts."""

    name: str
    symbol: Markup
    unit: Markup
    prior: str
    mean: str
    sd: str
    interval: str
    true: str
    z_score: str
    flag: str


@dataclass(frozen=True, kw_only=True)
class KeyFigure:
    """A number worth seeing first, and what it is."""

    value: str
    label: str


def parameter_row(parameter: ParameterFacts) -> ParameterRow:
    """Texts of one parameter: sd with two digits, everything else to the same place."""
    low, high = parameter.hdi90
    unit, factor = _multiple(parameter)
    values = (parameter.mean, parameter.sd, low, high, _or_nan(parameter.true))
    mean, sd, low_text, high_text, true = with_uncertainty(
        tuple(factor * value for value in values), factor * parameter.sd
    )
    z_score = parameter.z_score
    return ParameterRow(
        name=parameter.name,
        symbol=html_symbol(parameter.name),
        unit=html_unit(unit),
        prior=parameter.prior if unit == parameter.unit else f"{parameter.prior} {parameter.unit}",
        mean=mean,
        sd=sd,
        interval=_interval(low_text, high_text),
        true=true,
        z_score=NOTHING if z_score is None else _signed(z_score),
        flag=parameter.flag,
    )


def _multiple(parameter: ParameterFacts) -> Scale:
    """The multiple in which a force, stiffness or damping is told; lengths stay in metres."""
    if not parameter.unit.startswith("N"):
        return Scale(parameter.unit, 1.0)
    return display_scale(parameter.unit, abs(parameter.mean))


def key_figures(facts: Facts) -> tuple[KeyFigure, ...]:
    """The handful of numbers under the verdict."""
    worst = max(facts.nrmse.values(), default=float("nan"))
    evidence, error = with_uncertainty((facts.log_evidence, facts.log_evidence_se), facts.log_evidence_se)
    passed = sum(check.passed for check in facts.checks)
    figures = [
        KeyFigure(value=str(len(facts.parameters)), label="parameters to identify"),
        KeyFigure(value=percent(worst), label="largest misfit, rms over rms"),
    ]
    if np.isfinite(facts.log_evidence):
        figures += [
            KeyFigure(value=evidence, label=f"log evidence, ± {error} nat"),
            KeyFigure(value=significant(facts.effective_sample_size, 3), label="effective draws"),
        ]
    figures += [
        KeyFigure(value=duration(facts.elapsed_s), label=f"{facts.n_solves:,} solves".replace(",", "\N{THIN SPACE}")),
    ]
    if facts.checks:
        figures.insert(1, KeyFigure(value=f"{passed} of {len(facts.checks)}", label="checks passed"))
    return tuple(figures)


def fit_table(facts: Facts) -> Table:
    """Misfit and noise per channel."""
    rows = tuple(
        (channel.replace("_", " "), percent(share), significant(facts.noise_sd.get(channel, float("nan")), 3))
        for channel, share in facts.nrmse.items()
    )
    return Table(columns=("channel", "misfit (NRMSE)", "noise sd, in the channel's unit"), rows=rows)


def force_table(facts: Facts, places: Sequence[str]) -> Table:
    """Restoring force against the noise-free truth, per link, and their names in words."""
    rows = tuple(
        (
            place,
            percent(values.get("nrmse", float("nan"))),
            _correlation(values.get("correlation_time", float("nan"))),
            _correlation(values.get("correlation_drift", float("nan"))),
        )
        for place, values in zip(places, facts.restoring_force.values(), strict=False)
    )
    return Table(columns=("force against the truth", "NRMSE", "R over time", "R over drift"), rows=rows)


def quantity_table(quantities: tuple[Quantity, ...], heading: str, places: Sequence[str]) -> Table:
    """Engineering quantities, one row for each place, a link or a mode: mean, and the 90 % band below it."""
    if not quantities:
        return Table(columns=(), rows=())
    columns = [_quantity_cells(quantity) for quantity in quantities]
    rows = tuple(zip(places, *(cells for _, cells in columns), strict=False))
    return Table(columns=(heading, *(heading for heading, _ in columns)), rows=rows)


def stage_table(facts: Facts) -> Table:
    """The sampler's history; a column of labels where stages have names, none for what was not counted."""
    columns: list[tuple[str, list[str]]] = [
        ("stage", [str(stage.stage) for stage in facts.stages]),
        ("what", [stage.label for stage in facts.stages]),
        ("tempering parameter", [significant(stage.tempering_parameter, 3) for stage in facts.stages]),
        ("acceptance", [percent(s.acceptance) if np.isfinite(s.acceptance) else NOTHING for s in facts.stages]),
        ("effective draws", [significant(stage.effective_sample_size, 3) for stage in facts.stages]),
        ("solves", [f"{stage.n_solves:,}".replace(",", "\N{THIN SPACE}") for stage in facts.stages]),
        ("log evidence", [significant(stage.log_evidence, 6) for stage in facts.stages]),
        ("time", [duration(stage.elapsed_s) for stage in facts.stages]),
    ]
    kept = [(heading, cells) for heading, cells in columns if any(cell not in ("", NOTHING) for cell in cells)]
    return Table(
        columns=tuple(heading for heading, _ in kept), rows=tuple(zip(*(cells for _, cells in kept), strict=True))
    )


def evidence_table(facts: Facts) -> Table:
    """Log evidence by road."""
    rows = tuple((road, *with_uncertainty((value, error), error)) for road, (value, error) in facts.evidences.items())
    return Table(columns=("road", "log evidence [nat]", "standard error"), rows=rows)


def check_texts(check: Check) -> tuple[str, str]:
    """Value and limit of a check."""
    return significant(check.value, 3), significant(check.limit, 3)


def provenance_table(content: Content) -> Table:
    """Where the numbers come from: run, discretisation, versions."""
    facts = content.facts
    rows = [("model", facts.model), ("record", facts.record), ("engine", facts.engine), ("seed", str(facts.seed))]
    rows += [(_DISCRETISATION.get(name, name), _plain(value)) for name, value in facts.discretisation.items()]
    rows += [(name, text) for name, text in facts.provenance.items() if name not in ("seed", "engine")]
    return Table(columns=("", ""), rows=tuple(rows))


def _quantity_cells(quantity: Quantity) -> tuple[Markup, list[Markup]]:
    band = quantity.band
    finite = np.abs(band.middle[np.isfinite(band.middle)])
    unit, factor = display_scale(quantity.unit, float(finite.max()) if finite.size else 0.0)
    cells = []
    for values in zip(factor * band.middle, factor * band.lower, factor * band.upper, strict=True):
        middle, low, high = with_uncertainty(values, (values[2] - values[1]) / (2.0 * _NORMAL_95))
        band_text = Markup('<span class="band">{}</span>').format(_interval(low, high)) if low != high else ""
        cells.append(Markup("{}{}").format(middle, band_text))
    heading = Markup("{} [{}]").format(quantity.name, html_unit(unit)) if unit else Markup(quantity.name)
    return heading, cells


def _interval(low: str, high: str) -> str:
    return f"{low} to {high}" if low != high else low


def _correlation(value: float) -> str:
    return f"{value:.5f}" if np.isfinite(value) else NOTHING


def _plain(value: object) -> str:
    return significant(value, 2) if isinstance(value, float) else str(value)


def _signed(value: float) -> str:
    text = f"{value:+.1f}"
    return "0.0" if float(text) == 0.0 else text.replace("-", "\N{MINUS SIGN}")


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
