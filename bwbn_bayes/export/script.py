"""A structure as an OpenSees script that runs by itself: materials, masses, ground motion, analysis, what comes out."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from bwbn_bayes.export.building import Building, building_of
from bwbn_bayes.export.exportable import Exportable, Link
from bwbn_bayes.export.laws import size_of_z
from bwbn_bayes.export.links import LinkScript, link_script
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_source import WIDTH, comment, docstring

_SHARE_OF_Z = 0.01
"""Drift that a step of the analysis covers at the largest drift rate, in the size of z: the error is of first order."""
_FEWEST_SUBSTEPS, _MOST_SUBSTEPS = 8, 200
_UNBALANCE = 1e-9
"""Force left out of balance, in the inertial force of all floors and the largest forces from outside."""


@dataclass(frozen=True, kw_only=True)
class Script:
    """Python source for openseespy.

    Attributes
    ----------
    text : str
    links : tuple of LinkScript
        What each link became.
    notes : tuple of str
        What is left out or approximate, in sentences.
    """

    text: str
    links: tuple[LinkScript, ...]
    notes: tuple[str, ...]


def script_of(structure: Exportable, *, seed: int = 1) -> Script:
    """Write the script.

    Parameters
    ----------
    structure : Exportable
    seed : int
        Of the fit to a loop whose law OpenSees does not have.

    Raises
    ------
    UserError
        If something cannot be translated, or a fit asks for openseespy and it is not installed.
    """
    rng = np.random.default_rng(seed)
    links = tuple(
        link_script(link, rng, is_specimen=structure.is_specimen, time_steps=structure.time_steps)
        for link in structure.links
    )
    building = None if structure.is_specimen else building_of(structure, links)
    fitted = (f"{link.place}: {' '.join(link.says)}" for link in links if link.error is not None)
    notes = (*structure.notes, *(building.notes if building else ()), *fitted)
    environment = Environment(
        loader=PackageLoader("bwbn_bayes.export"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # Python, not HTML: what comes from a file passes through `comment` and `docstring`
        keep_trailing_newline=True,
    )
    text = environment.get_template("opensees.py.j2").render(
        zip=zip,
        docstring=_docstring(structure, notes),
        substeps=_substeps(structure),
        time_steps=None if structure.time_steps is None else _repeated(structure.time_steps),
        excitation=_listed(structure.excitation),
        forces={floor: _listed(force) for floor, force in structure.forces.items()},
        materials=(*links, *(building.materials if building else ())),
        building=building,
        first_force=repr(links[0].first_force),
        n_floors=len(structure.masses),
        tolerance=repr(_tolerance(structure, building)),
    )
    return Script(text=text, links=links, notes=notes)


def _docstring(structure: Exportable, notes: tuple[str, ...]) -> str:
    sentences = (
        "Units: N, m, s, kg, J. Run: python THIS_FILE [SUBSTEPS]; histories are written beside it as CSV.",
        "OpenSees' hysteretic materials are of first order in the step: twice the substeps show what the step does.",
        *notes,
    )
    lines = (line.removeprefix("# ").replace("\\", " ").replace('"', "'") for one in sentences for line in comment(one))
    first = f"{structure.name} for OpenSees, written by bwbn_bayes. Parameters are {structure.origin}."
    return docstring(first, *lines)


def _repeated(time_steps: Floats) -> str:
    """``[0.02] * 400``, one for each run of equal steps [s]; equal but for rounding."""
    runs = [(step, len(list(run))) for step, run in groupby(float(f"{step:.9g}") for step in time_steps)]
    return " + ".join(f"[{step!r}] * {times}" for step, times in runs)


def _listed(values: Floats) -> list[str]:
    if not np.any(values):
        return [f"*[0.0] * {len(values)},"]
    return textwrap.wrap(", ".join(repr(float(value)) for value in values) + ",", WIDTH - 4)


def _substeps(structure: Exportable) -> int:
    """Steps of the analysis for each sample: none moves a link by more than a small share of its z."""
    ways = (_largest_way(link, structure.time_steps) / size_of_z(link) for link in structure.links)
    steps = math.ceil(max(ways) / _SHARE_OF_Z)
    return min(max(steps, _FEWEST_SUBSTEPS), _MOST_SUBSTEPS)


def _largest_way(link: Link, time_steps: Floats | None) -> float:
    """The farthest [m] that the drift goes between two samples, at its largest rate where there is one."""
    if time_steps is None:
        return float(np.max(np.abs(np.diff(link.drift))))
    return float(np.max(time_steps)) * float(np.max(np.abs(link.drift_rate)))


def _tolerance(structure: Exportable, building: Building | None) -> float:
    """Force [N] that may stay out of balance."""
    if building is None:
        return 0.0
    pushed = sum(float(np.max(np.abs(force))) for force in structure.forces.values())
    return _UNBALANCE * (sum(structure.masses) * float(np.max(np.abs(structure.excitation))) + pushed)
