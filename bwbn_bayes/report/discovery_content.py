"""Gather what the page of a discovery shows: the gap, where it was, the candidates of each step, what changed.

Nothing is estimated here; every number comes from the discovery.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Added, DetectionLimit, Discovery, Step
from bwbn_bayes.discovery.where import Disagreement
from bwbn_bayes.inference.arrays import measured_storey_force
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import path_of
from bwbn_bayes.records.record import Record
from bwbn_bayes.report.comparison import Part, begins_of, parts_of
from bwbn_bayes.report.content import DRIFT_RATIO, gather, shown
from bwbn_bayes.report.pieces import Marginal, Quantity
from bwbn_bayes.results import Equation
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.structure import Structure

MAX_EXPLANATIONS = 10
"""Explanations drawn."""
MAX_STOREYS = 3
"""Storeys drawn beside each other."""
_MASSES_TIMES = "masses times measured accelerations"


@dataclass(frozen=True, kw_only=True)
class GapBar:
    """Error of one data set: of the model as given, as improved, and of noise alone.

    None stands for improved where nothing was added, and for what has no name where nothing is known of it.
    """

    label: str
    before: Prediction
    after: Prediction | None
    nameless: Prediction | None
    floor: float

    @property
    def bars(self) -> tuple[tuple[str, Prediction], ...]:
        """``as given``; ``improved`` where something was added; ``with what has no name`` where that is known."""
        every = (("as given", self.before), ("improved", self.after), ("with what has no name", self.nameless))
        return tuple((name, seen) for name, seen in every if seen is not None)


@dataclass(frozen=True, kw_only=True)
class HeatMap:
    """Residual to noise by place along the record: ``values (n_places, n_windows)`` between ``edges``.

    The axis is time [s], or the path covered [m] where the record has no time.
    """

    title: str
    axis: str
    what: str
    places: tuple[str, ...]
    edges: Floats
    values: Floats
    begins: tuple[tuple[float, str], ...] = ()
    """Where each of several joined records begins on the axis, and its name."""


@dataclass(frozen=True, kw_only=True)
class PlaneMap:
    """Residual storey force to noise over drift (rows) and drift rate (columns), each over its peak."""

    title: str
    values: Floats


@dataclass(frozen=True, kw_only=True)
class LoopPair:
    """A storey's measured and modelled force against drift before and, where something was added, after; N and m."""

    storey: int
    title: str
    source: str
    """Where the measured force comes from, in words."""
    measured: Floats | None
    drifts: tuple[Floats, ...]
    forces: tuple[Floats, ...]
    runs: tuple[slice, ...]
    """Samples that hang together: of several records that find the structure virgin those of each."""


@dataclass(frozen=True, kw_only=True)
class ExplanationBar:
    """An explanation: its probability, and its log odds against the best one, in nat."""

    label: str
    probability: float
    log_odds: float
    chosen: bool


@dataclass(frozen=True, kw_only=True)
class DiscoveryContent:
    """Everything the page of a discovery draws and prints."""

    discovery: Discovery
    parts: tuple[Part, ...]
    gaps: tuple[GapBar, ...]
    by_time: tuple[HeatMap, ...]
    by_state: tuple[PlaneMap, ...]
    loops: tuple[LoopPair, ...]
    explanations: tuple[ExplanationBar, ...]
    n_weighed: int
    new_marginals: tuple[Marginal, ...]
    drift_ratios: tuple[Quantity, ...]
    """Of the final model; none where the building has no heights."""
    old_equations: tuple[Equation, ...]
    new_equations: tuple[Equation, ...]

    @property
    def added(self) -> tuple[Added, ...]:
        """Effects of the final model that the given one lacks."""
        return self.discovery.added

    @property
    def named_loops(self) -> tuple[LoopPair, ...]:
        """Those of the storeys to which a law was added; none where that is all of them."""
        added = [one.hypothesis for one in self.added if one.hypothesis.effect.level == "link"]
        own = tuple(loop for loop in self.loops if any(loop.storey in one.storeys for one in added))
        return own if len(own) < len(self.loops) else ()

    @property
    def limits(self) -> tuple[DetectionLimit, ...]:
        """The smallest effects that the record could have shown."""
        return self.discovery.limits


def gather_discovery(discovery: Discovery) -> DiscoveryContent:
    """Gather the page's content.

    Parameters
    ----------
    discovery : Discovery
        With any verdict, with or without held-out data.

    Returns
    -------
    DiscoveryContent
    """
    brought = {name for one in discovery.added for name in one.moments}
    before, after = (_equations(one, discovery.record) for one in (discovery.model, discovery.improved))
    final = gather(discovery.result)
    stages = [("Model as given", discovery.before)]
    stages += [("Improved model", discovery.after)] if discovery.added else []
    return DiscoveryContent(
        discovery=discovery,
        parts=parts_of(discovery),
        gaps=_gaps(discovery),
        by_time=tuple(_heat_map(discovery, title, seen) for title, seen in stages),
        by_state=_planes(discovery.model, stages) if discovery.record.has_time else (),
        loops=_loops(discovery),
        explanations=_explanations(discovery.steps[-1], discovery.added) if discovery.steps else (),
        n_weighed=len(discovery.steps[-1].explanations) if discovery.steps else 0,
        new_marginals=tuple(m for m in final.marginals if m.parameter.name in brought),
        drift_ratios=tuple(one for one in final.storey_quantities if one.name == DRIFT_RATIO),
        old_equations=tuple(e for e in before if e not in after),
        new_equations=tuple(e for e in after if e not in before),
    )


def _gaps(discovery: Discovery) -> tuple[GapBar, ...]:
    gap, apart, changed = discovery.gap, discovery.held_out, bool(discovery.added)
    parts = [("fitted record", gap), *([(apart.label, gap.held_out)] if apart and gap.held_out else [])]
    return tuple(
        GapBar(
            label=label,
            before=own.before,
            after=own.after if changed else None,
            nameless=own.nameless,
            floor=own.noise_floor,
        )
        for label, own in parts
    )


def _heat_map(discovery: Discovery, title: str, seen: Disagreement) -> HeatMap:
    """Storey forces where they are measured, and the other channels."""
    model, record = discovery.model, discovery.record
    rows = seen.rows(model)
    forces = f"storey forces ({_MASSES_TIMES})" if not model.is_driven else "measured force"
    kinds = {row.storey is not None: forces if row.storey is not None else "channels" for row in rows}
    return HeatMap(
        title=title,
        axis="time [s]" if record.has_time else "path covered [m]",
        what=" and other ".join(kinds.values()),
        places=tuple(row.place if row.storey is not None else row.channel.replace("_", " ") for row in rows),
        edges=seen.edges if record.has_time else _path_at(seen.edges, record),
        values=np.array([row.ratios for row in rows]),
        begins=begins_of(record, record.times if record.has_time else path_of(record.excitation)),
    )


def _path_at(instants: Floats, record: Record) -> Floats:
    return np.asarray(np.interp(instants, record.times, path_of(record.excitation)))


def _planes(model: Structure, stages: Sequence[tuple[str, Disagreement]]) -> tuple[PlaneMap, ...]:
    """Storey by storey, row by row of the figure: as given, then improved."""
    first = stages[0][1].by_state
    storeys = shown([i for i, plane in enumerate(first) if np.any(np.isfinite(plane))], MAX_STOREYS)
    words = ("as given", "improved")
    return tuple(
        PlaneMap(title=f"{model.link_in_words(i + 1).capitalize()}, {word}", values=seen.by_state[i])
        for word, (_, seen) in zip(words, stages, strict=False)
        for i in storeys
    )


def _loops(discovery: Discovery) -> tuple[LoopPair, ...]:
    stages = [discovery.histories[name] for name in (("before", "after") if discovery.added else ("before",))]
    places = range(1, discovery.model.n_links + 1)
    of_building = not discovery.model.is_driven
    return tuple(
        LoopPair(
            storey=storey,
            title=discovery.model.link_in_words(storey).capitalize(),
            source="the force measured by the floors above" if of_building else "the measured force",
            measured=_measured_force(discovery.model, discovery.record, storey),
            drifts=tuple(rows["drift"][storey - 1] for rows in stages),
            forces=tuple(rows["restoring_force"][storey - 1] for rows in stages),
            runs=tuple(stretch for _, stretch in discovery.record.runs),
        )
        for storey in shown(places, MAX_STOREYS)
    )


def _measured_force(model: Structure, record: Record, storey: int) -> Floats | None:
    if model.is_driven:
        force = record.channels.get("force")
        return None if force is None else record.where_counted(force, otherwise=np.nan)
    force = measured_storey_force(model, record, storey)
    return None if force is None else record.where_counted(force, otherwise=np.nan)


def _explanations(step: Step, added: Sequence[Added]) -> tuple[ExplanationBar, ...]:
    """The best of the last round; marked, those that hold just what the improved model holds."""
    improved = {(one.hypothesis.symbols, one.hypothesis.storeys) for one in added}
    rows = zip(step.explanations, step.probabilities, step.log_joint, strict=True)
    return tuple(
        ExplanationBar(
            label=one.label,
            probability=probability,
            log_odds=log_joint - step.log_joint[0],
            chosen=one.effects_key == improved,
        )
        for one, probability, log_joint in list(rows)[:MAX_EXPLANATIONS]
    )


def _equations(model: Structure, record: Record) -> tuple[Equation, ...]:
    return tuple(Equation(caption=e.caption, mathml=e.mathml) for e in structure_equations(model, record))
