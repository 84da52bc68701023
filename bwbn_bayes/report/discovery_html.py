"""Render a discovery: its page and figures, and the identification report of the final model beside it."""

from __future__ import annotations

from pathlib import Path

from bwbn_bayes.discovery.outcome import Discovery, UnnamedForce
from bwbn_bayes.discovery.probability import NAMED
from bwbn_bayes.discovery.sentences import probability_in_words
from bwbn_bayes.records.record import Record
from bwbn_bayes.report import discovery_tables as tables
from bwbn_bayes.report.canvas import Drawing
from bwbn_bayes.report.comparison_figures import COMPARISON
from bwbn_bayes.report.discovery_content import DiscoveryContent, gather_discovery
from bwbn_bayes.report.discovery_figures import draw_discovery
from bwbn_bayes.report.html import ReportFiles, data_address, mathml_of, template, write_page, write_report
from bwbn_bayes.report.numbers import NOTHING, percent
from bwbn_bayes.report.tables import quantity_table
from bwbn_bayes.results import Equation


def write_discovery(discovery: Discovery, directory: Path) -> ReportFiles:
    """Write ``report.html`` (self-contained, no scripts), its figures as PNG, and ``identify/`` with the final model's.

    Parameters
    ----------
    discovery : Discovery
        With any verdict.
    directory : Path
        Where to write; made where it does not exist.

    Returns
    -------
    ReportFiles
        The discovery's page and figures.
    """
    files = write_discovery_page(discovery, directory)
    write_report(discovery.result, directory / "identify")
    return files


def write_discovery_page(discovery: Discovery, directory: Path) -> ReportFiles:
    """Write ``report.html`` and its figures, without the final model's report."""
    content = gather_discovery(discovery)
    drawings = draw_discovery(content)
    return write_page(render_discovery(content, drawings), drawings, directory)


def render_discovery(content: DiscoveryContent, drawings: tuple[Drawing, ...]) -> str:
    """The page as text: HTML with inline style and figures; texts are escaped, equations are MathML."""
    discovery = content.discovery
    held_out = discovery.held_out
    by_storey = ", by storey or floor" if not discovery.model.is_driven else ""
    return template("discovery.html.j2").render(
        model=discovery.name,
        record=discovery.record.name,
        run=f"{_counted(discovery)}, {_extent(discovery.record)}; "
        + (f"{held_out.label}: {held_out.record.name}" if held_out is not None else "no held-out record"),
        first=discovery.sentences[0],
        sentences=discovery.sentences[1:],
        key_figures=tables.discovery_key_figures(discovery),
        figures={drawing.name: drawing for drawing in drawings},
        comparison=[drawing.name for drawing in drawings if drawing.name.startswith(COMPARISON)],
        data_address=data_address,
        spots=tables.spot_sentences(discovery),
        effects=tables.effects_table(content.added),
        names=tables.names_table(discovery),
        signatures=tables.signatures_table(content.added),
        notes=tables.effect_notes(content.added),
        parameters=tables.new_parameters_table(content),
        old_equations=_written(content.old_equations),
        new_equations=_written(content.new_equations),
        drift_ratios=quantity_table(
            content.drift_ratios,
            "storey",
            [discovery.model.link_in_words(link) for link in range(1, discovery.model.n_links + 1)],
        ),
        unnamed=discovery.unnamed,
        unnamed_is_force=isinstance(discovery.unnamed, UnnamedForce),
        unnamed_share=percent(discovery.unnamed.share) if discovery.unnamed is not None else "",
        unnamed_sure=probability_in_words(discovery.unnamed.probability) if discovery.unnamed is not None else "",
        unnamed_any=probability_in_words(discovery.unnamed.any_probability) if discovery.unnamed is not None else "",
        steps=discovery.steps,
        limits=tables.limits_table(content.limits, discovery.model),
        named=f"{NAMED:g}",
        limits_label=f"Detection limits{by_storey}",
        never=f"A dash ({NOTHING}) stands",
        assumptions=discovery.result.facts.assumptions,
        provenance=tables.discovery_provenance(discovery),
        held_out=held_out is not None,
    )


def _written(equations: tuple[Equation, ...]) -> list[tuple[str, str]]:
    return [(equation.caption, mathml_of(equation)) for equation in equations]


def _extent(record: Record) -> str:
    """How long the record is: in seconds, or in points where it has no time; of several together."""
    extent = f"{record.duration:.3g} s" if record.has_time else f"{record.n_times} points without time"
    several = f"{len(record.parts)} records{' in sequence' if record.is_sequence else ''}, " if record.parts[1:] else ""
    return f"{several}{extent}"


def _counted(discovery: Discovery) -> str:
    """How many storeys and channels: ``3 storeys, 1 channel``."""
    n_storeys, n_channels = discovery.model.n_links, len(discovery.record.channels)
    storeys = f"{n_storeys} store{'y' if n_storeys == 1 else 'ys'}"
    of = storeys if not discovery.model.is_driven else "a specimen"
    return f"{of}, {n_channels} channel{'' if n_channels == 1 else 's'}"
