"""The tables of a discovery's page as text."""

from __future__ import annotations

import math

from markupsafe import Markup

from bwbn_bayes.discovery.candidates import place_in_words
from bwbn_bayes.discovery.outcome import Added, DetectionLimit, Discovery
from bwbn_bayes.discovery.sentences import evidence_in_words
from bwbn_bayes.report.discovery_content import DiscoveryContent
from bwbn_bayes.report.numbers import NOTHING, duration, html_symbol, html_unit, percent, significant, with_uncertainty
from bwbn_bayes.report.tables import KeyFigure, Table, parameter_row

MAX_SPOTS = 6


def discovery_key_figures(discovery: Discovery) -> tuple[KeyFigure, ...]:
    """The handful of numbers under the verdict."""
    gap, apart = discovery.gap, discovery.held_out
    figures = []
    for added in discovery.added[:2]:
        factor = added.log_bayes_factor
        value, _ = with_uncertainty((factor, 0.0), max(added.log_bayes_factor_se, 0.04 * abs(factor)))
        figures.append(KeyFigure(value=f"{value} nat", label=f"log Bayes factor of {added.hypothesis.name}"))
    arrow = "\N{RIGHTWARDS ARROW}"
    fitted = _share(gap.before.nrmse)
    fitted += f" {arrow} {_share(gap.after.nrmse)}" if discovery.added else ""
    figures.append(KeyFigure(value=fitted, label=f"error of fit; noise alone {_share(gap.noise_floor)}"))
    if apart and gap.held_out:
        predicted = _share(gap.held_out.before.nrmse)
        predicted += f" {arrow} {_share(gap.held_out.after.nrmse)}" if discovery.added else ""
        figures.append(
            KeyFigure(
                value=predicted, label=f"error on the {apart.label}; noise alone {_share(gap.held_out.noise_floor)}"
            )
        )
    if discovery.verdict != "no_missing_effect":
        left = "of the disagreement left unexplained"
        figures.append(KeyFigure(value=percent(discovery.unexplained_share), label=left))
    return tuple(figures)


def spot_sentences(discovery: Discovery) -> tuple[str, ...]:
    """Stretches of time in which the given model's residual stands out; none where what it leaves is noise."""
    spots = discovery.before.spots[:MAX_SPOTS] if discovery.verdict != "no_missing_effect" else ()
    return tuple(f"{spot.sentence[:1].upper()}{spot.sentence[1:]}." for spot in spots)


def _share(value: float) -> str:
    """A percentage to one decimal, as the sentences have it."""
    return f"{100.0 * value:.1f}\N{NO-BREAK SPACE}%"


def effects_table(added: tuple[Added, ...]) -> Table:
    """Each added effect: how sure, at this place, and what it cannot be told from."""
    return Table(
        columns=("effect", "evidence", "probability", "at this place", "log Bayes factor [nat]", "cannot be told from"),
        rows=tuple(_effect_row(one) for one in added),
    )


def _effect_row(added: Added) -> tuple[str | Markup, ...]:
    factor, se = added.log_bayes_factor, added.log_bayes_factor_se
    value, error = with_uncertainty((factor, se), se)
    return (
        added.title,
        evidence_in_words(factor),
        significant(added.name_probability, 3),
        significant(added.place_probability, 3),
        f"{value} ± {error}",
        ", ".join(added.alternatives) or "nothing else",
    )


def effect_notes(added: tuple[Added, ...]) -> tuple[str, ...]:
    """What each added effect is, and which experiment would tell it from its equivalents, in sentences."""
    notes: list[str] = []
    for one in added:
        hypothesis = one.hypothesis
        notes.append(f"{hypothesis.label}: {hypothesis.effect.summary} ({hypothesis.effect.source}).")
        notes += one.separation
    return tuple(notes)


def new_parameters_table(content: DiscoveryContent) -> Table:
    """Posterior of the parameters that the added effects brought."""
    rows = []
    for marginal in content.new_marginals:
        row = parameter_row(marginal.parameter)
        rows.append((row.symbol, row.mean, row.sd, row.interval, row.unit, row.prior))
    return Table(columns=("parameter", "mean", "sd", "90 % interval", "unit", "prior"), rows=tuple(rows))


def limits_table(limits: tuple[DetectionLimit, ...], n_storeys: int) -> Table:
    """Smallest detectable size by effect and place; of an effect's forms the one that is easiest to see."""
    cells: dict[tuple[str, str, str], dict[int, DetectionLimit]] = {}
    for limit in limits:
        key = (limit.name, limit.parameter.split("[")[0], limit.unit)
        place = limit.storeys[0] if limit.storeys else 0
        row = cells.setdefault(key, {})
        if place not in row or limit.smallest < row[place].smallest:
            row[place] = limit
    places = [0, *range(1, n_storeys + 1)]
    used = [place for place in places if any(place in row for row in cells.values())]
    rows = tuple(
        (
            Markup("{} <span class='prior'>{}</span>").format(name, html_symbol(symbol)),
            html_unit(unit) if unit else "",
            significant(max(limit.expected for limit in row.values()), 2),
            *(_size(row[place].smallest) if place in row else "" for place in used),
        )
        for (name, symbol, unit), row in cells.items()
    )
    headings = [str(place) if place else place_in_words("structure", ()) for place in used]
    return Table(columns=("effect", "unit", "expected size", *headings), rows=rows)


def _size(smallest: float) -> str:
    return significant(smallest, 2) if math.isfinite(smallest) else NOTHING


def discovery_provenance(discovery: Discovery) -> Table:
    """Where the numbers come from."""
    result, apart = discovery.result.facts, discovery.held_out
    rows = [
        ("model", discovery.name),
        ("fitted record", discovery.record.name),
        (apart.label, apart.record.name) if apart is not None else ("held-out record", "none"),
        ("seed", str(discovery.seed)),
        ("time, without the final posterior", duration(discovery.elapsed_s)),
        *((label, text) for label, text in result.provenance.items() if label not in ("seed", "engine")),
    ]
    return Table(columns=("", ""), rows=tuple(rows))
