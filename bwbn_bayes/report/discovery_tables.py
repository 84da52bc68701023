"""The tables of a discovery's page as text."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from bwbn_bayes.discovery.candidates import place_in_words
from bwbn_bayes.discovery.outcome import Added, DetectionLimit, Discovery, Gap, SignatureFacts, UnnamedReading
from bwbn_bayes.discovery.sentences import evidence_in_words, nats_in_words, probability_in_words, runner_up
from bwbn_bayes.elements.catalogue import capital, title_of
from bwbn_bayes.report.discovery_content import DiscoveryContent
from bwbn_bayes.report.numbers import (
    NOTHING,
    display_scale,
    duration,
    html_symbol,
    html_unit,
    percent,
    significant,
    with_uncertainty,
)
from bwbn_bayes.report.tables import KeyFigure, Table, parameter_row
from bwbn_bayes.structures.parts import SPECIMEN
from bwbn_bayes.structures.structure import Structure

MAX_SPOTS = 6
MAX_NAMES = 8
LEAST_SHOWN = 0.001
"""Less probable effects are left out."""


def discovery_key_figures(discovery: Discovery) -> tuple[KeyFigure, ...]:
    """The handful of numbers under the verdict: how sure, against what, and how far the errors shrank."""
    figures = [
        KeyFigure(
            value=probability_in_words(one.title_probability),
            label=f"{one.title}: {evidence_in_words(one.log_bayes_factor)} evidence, "
            f"{nats_in_words(one.log_bayes_factor)}",
        )
        for one in discovery.added[:2]
    ]
    if not discovery.added and discovery.verdict != "not_searched":
        sure = probability_in_words(discovery.verdict_probabilities[discovery.verdict])
        figures.append(KeyFigure(value=sure, label=f"probability of {discovery.verdict.replace('_', ' ')}"))
    last = discovery.steps[-1] if discovery.steps else None
    second = runner_up(last.explanations, last.log_joint) if last is not None and last.explanations else None
    if second is not None:
        figures.append(KeyFigure(value=nats_in_words(second[1]), label=f"to the next best laws, {second[0].label}"))
    changed, apart, gap = bool(discovery.added), discovery.held_out, discovery.gap
    figures.append(_error_figure("fitted record", gap, changed=changed))
    if apart is not None and gap.held_out is not None:
        figures.append(_error_figure(apart.label, gap.held_out, changed=changed))
        if gap.held_out.interval is not None:
            inside = percent(gap.held_out.interval.coverage)
            figures.append(KeyFigure(value=inside, label="of the held-out points lie inside their 90 % intervals"))
    if discovery.unnamed is not None:
        share = percent(discovery.unnamed.share)
        figures.append(KeyFigure(value=share, label=_nameless(discovery)))
    return tuple(figures)


def _nameless(discovery: Discovery) -> str:
    if isinstance(discovery.unnamed, UnnamedReading):
        return f"of {discovery.unnamed.channel} is an error of no known kind"
    return "of the force follows no known law"


def _error_figure(what: str, gap: Gap, *, changed: bool) -> KeyFigure:
    """Error as given and improved; where a prediction runs away, that instead of its number."""
    stages = [("as given", gap.before), *([("improved", gap.after)] if changed else [])]
    values = ["runs away" if seen.runs_away_after else _share(seen.nrmse) for _, seen in stages]
    lost = [f"; {word}, away after {seen.runs_away_after}" for word, seen in stages if seen.runs_away_after]
    label = f"error on the {what}; noise alone {_share(gap.noise_floor)}{''.join(lost)}"
    return KeyFigure(value=" \N{RIGHTWARDS ARROW} ".join(values), label=label)


def spot_sentences(discovery: Discovery) -> tuple[str, ...]:
    """Stretches of time in which the given model's residual stands out; none where what it leaves is noise."""
    spots = discovery.before.spots[:MAX_SPOTS] if discovery.verdict != "no_missing_effect" else ()
    return tuple(f"{capital(spot.sentence)}." for spot in spots)


def _share(value: float) -> str:
    """A percentage to one decimal, as the sentences have it."""
    return f"{100.0 * value:.1f}\N{NO-BREAK SPACE}%"


def effects_table(added: tuple[Added, ...]) -> Table:
    """Each effect of the improved model: how sure, at this place, and what it cannot be told from."""
    return Table(
        columns=("effect", "evidence", "probability", "at this place", "log Bayes factor [nat]", "cannot be told from"),
        rows=tuple(_effect_row(one) for one in added),
    )


def _effect_row(added: Added) -> tuple[str | Markup, ...]:
    factor, se = added.log_bayes_factor, added.log_bayes_factor_se
    value, error = with_uncertainty((factor, se), se)
    return (
        capital(added.title),
        evidence_in_words(factor),
        probability_in_words(added.title_probability),
        probability_in_words(added.place_probability),
        f"{value} ± {error}",
        ", ".join(added.alternatives) or "nothing else",
    )


def names_table(discovery: Discovery) -> Table:
    """Probability of each name, as :attr:`~bwbn_bayes.discovery.outcome.Discovery.probabilities` has it."""
    likely = [(name, p) for name, p in discovery.probabilities.items() if p >= LEAST_SHOWN][:MAX_NAMES]
    rows = tuple((capital(title_of(name)), probability_in_words(p)) for name, p in likely)
    return Table(columns=("effect", "probability of the name"), rows=rows)


def signatures_table(added: tuple[Added, ...]) -> Table:
    """What each effect does to the loop: measured, identified, and without the effect."""
    columns = (
        "effect",
        "measure",
        "measured",
        "identified",
        "90 % interval",
        "without the effect",
        "deserves its name",
    )
    return Table(columns=columns, rows=tuple(_signature_row(one, one.signature) for one in added if one.signature))


def _signature_row(added: Added, seen: SignatureFacts) -> tuple[str | Markup, ...]:
    measure = Markup("{} [{}]").format(seen.measure, html_unit(seen.unit)) if seen.unit else seen.measure
    return (
        capital(added.title),
        measure,
        NOTHING if seen.measured is None else significant(seen.measured, 2),
        significant(seen.mean, 2),
        f"{significant(seen.low, 2)} to {significant(seen.high, 2)}",
        significant(seen.without, 2),
        NOTHING if seen.unmeasured else probability_in_words(seen.deserved),
    )


def effect_notes(added: tuple[Added, ...]) -> tuple[str, ...]:
    """What each added effect is, from which size it is called so, and what would tell it from its equivalents."""
    notes: list[str] = []
    for one in added:
        effect, name = one.hypothesis.effect, title_of(one.hypothesis.name)
        reason = effect.signature.reason
        least = f" It deserves the name {name} from a least size on: {reason}." if reason else ""
        notes.append(f"{capital(one.title)}: {one.meaning} ({effect.source}).{least}")
        notes += one.separation
    return tuple(notes)


def new_parameters_table(content: DiscoveryContent) -> Table:
    """Posterior of the parameters that the added effects brought."""
    rows = []
    for marginal in content.new_marginals:
        row = parameter_row(marginal.parameter)
        rows.append((row.symbol, row.mean, row.sd, row.interval, row.unit, row.prior))
    return Table(columns=("parameter", "mean", "sd", "90 % interval", "unit", "prior"), rows=tuple(rows))


def limits_table(limits: tuple[DetectionLimit, ...], model: Structure) -> Table:
    """Smallest detectable size by effect and place; of an effect's forms the one that is easiest to see."""
    cells: dict[tuple[str, str, str], dict[int, DetectionLimit]] = {}
    for limit in limits:
        key = (limit.name, limit.parameter.split("[")[0], limit.unit)
        place = limit.storeys[0] if limit.storeys else 0
        row = cells.setdefault(key, {})
        if place not in row or limit.smallest < row[place].smallest:
            row[place] = limit
    of_specimen = model.is_driven
    places = [0, *range(1, model.n_links + 1)]
    used = [place for place in places if any(place in row for row in cells.values())]
    rows = tuple(_limit_row(*key, [row.get(place) for place in used]) for key, row in cells.items())
    headings = [SPECIMEN if of_specimen else str(place or place_in_words("structure", ())) for place in used]
    return Table(columns=("effect", "unit", "expected size", *headings), rows=rows)


def _limit_row(name: str, symbol: str, unit: str, limits: Sequence[DetectionLimit | None]) -> tuple[str | Markup, ...]:
    expected = max(limit.expected for limit in limits if limit is not None)
    scale = display_scale(unit, expected)
    return (
        Markup("{} <span class='prior'>{}</span>").format(capital(title_of(name)), html_symbol(symbol)),
        html_unit(scale.unit) if unit else "",
        significant(scale.factor * expected, 2),
        *("" if limit is None else _size(scale.factor * limit.smallest) for limit in limits),
    )


def _size(smallest: float) -> str:
    """Two digits, no more."""
    return significant(float(f"{smallest:.1e}"), 2) if math.isfinite(smallest) else NOTHING


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
