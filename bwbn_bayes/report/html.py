"""Render the report: one self-contained page and the PNG files beside it."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from bwbn_bayes.inference.registry import title_of
from bwbn_bayes.report import tables
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.pieces import Content
from bwbn_bayes.results import Equation, Result

if TYPE_CHECKING:
    from bwbn_bayes.report.canvas import Drawing


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """The files of a report: the page and the figures, which the page holds as copies."""

    html: Path
    figures: tuple[Path, ...]


def write_report(result: Result, directory: Path) -> ReportFiles:
    """Write ``report.html`` (self-contained, no scripts) and its figures as PNG files.

    Parameters
    ----------
    result : Result
        What any method returned; groups that are missing leave their section out.
    directory : Path
        Where to write; made where it does not exist.

    Returns
    -------
    ReportFiles
    """
    from bwbn_bayes.report.figures import draw_all  # with Matplotlib, which a page alone does not need

    content = gather(result)
    drawings = draw_all(content)
    return write_page(render(content, drawings), drawings, directory)


def write_page(page: str, drawings: tuple[Drawing, ...], directory: Path) -> ReportFiles:
    """Write a page as ``report.html`` and its figures as PNG files; the directory is made where it does not exist."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for drawing in drawings:
        path = directory / drawing.name
        path.write_bytes(drawing.png)
        paths.append(path)
    html = directory / "report.html"
    html.write_text(page, encoding="utf-8")
    return ReportFiles(html=html, figures=tuple(paths))


def render(content: Content, drawings: tuple[Drawing, ...]) -> str:
    """The page as text.

    Parameters
    ----------
    content : Content
        Facts and numbers.
    drawings : tuple of Drawing
        Figures, placed by name; sections without theirs are left out.

    Returns
    -------
    str
        HTML with inline style and figures; every text of the result is escaped, equations are MathML.
    """
    facts = content.facts
    return template("report.html.j2").render(
        facts=facts,
        method=title_of(facts.method),
        specimen=content.specimen,
        figures={drawing.name: drawing for drawing in drawings},
        data_address=data_address,
        key_figures=tables.key_figures(facts),
        parameters=[tables.parameter_row(parameter) for parameter in facts.parameters],
        truth_known=any(parameter.true is not None for parameter in facts.parameters),
        fit=tables.fit_table(facts),
        force=tables.force_table(facts, content.places),
        structure=_structure_in_words(content),
        storeys=tables.quantity_table(
            content.storey_quantities, "specimen" if content.specimen else "storey", content.places
        ),
        modes=tables.quantity_table(
            content.modal_quantities, "mode", [f"mode {number}" for number in range(1, facts.storeys + 1)]
        ),
        stages=tables.stage_table(facts),
        evidences=tables.evidence_table(facts),
        checks=[(check, *tables.check_texts(check)) for check in facts.checks],
        equations=[(equation.caption, mathml_of(equation)) for equation in facts.equations],
        provenance=tables.provenance_table(content),
        has_bands=content.has_bands,
        estimate="posterior mean" if content.has_bands else "identified response",
        channels_left_out=content.n_channels - len(content.traces),
        storeys_left_out=facts.storeys - len(content.loops) if content.loops else 0,
    )


def _structure_in_words(content: Content) -> str:
    if content.specimen:
        return "a specimen"
    storeys = sum(place.startswith("storey") for place in content.places)
    parts = ((storeys, "storey", "storeys"), (len(content.places) - storeys, "further link", "further links"))
    return " and ".join(f"{n} {one if n == 1 else more}" for n, one, more in parts if n)


def template(name: str) -> Template:
    """One of the report's templates; every text put into it is escaped."""
    environment = Environment(
        loader=PackageLoader("bwbn_bayes.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def data_address(drawing: Drawing) -> str:
    """A figure as text inside the page."""
    return "data:image/png;base64," + base64.b64encode(drawing.png).decode("ascii")


def mathml_of(equation: Equation) -> Markup:
    """The equation in one ``math`` element; our own printer wrote it, so it is not escaped."""
    inner = equation.mathml.strip()
    whole = inner if inner.startswith("<math") else f'<math display="block">{inner}</math>'
    return Markup(whole)
