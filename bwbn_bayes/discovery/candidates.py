"""Hypotheses: one catalogued effect, in one of its forms, at one place of the structure or in every storey alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from bwbn_bayes.elements.catalogue import registered, title_of
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guide_of, is_sought
from bwbn_bayes.engines.base import masses
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats, HalfNormal, Normal, PerStorey, Prior, Truncated
from bwbn_bayes.records.cycles import path_of
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.parts import SPECIMEN, PlacedEffect
from bwbn_bayes.structures.quantities import modes, parameters_at, tangent_stiffness
from bwbn_bayes.structures.structure import Structure

PLACED_LEVELS = ("link", "node", "observation")
"""Levels whose effects act at storeys or floors one by one; the others act on the building as a whole."""
ONSET_SHARE = 0.02
"""Share of the ground motion's energy that has arrived when the strong motion begins."""
MOST_CARRIED = 9
"""Parameters that the effects of one compiled law bring in all, in the first round."""


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """The present model with one more effect.

    Attributes
    ----------
    base : Structure
        The present model.
    effect : Effect
        With priors on what it brings.
    storeys : tuple of int
        Where it acts, one place or, of a storey's law, every storey alike; empty for the whole building.
    scales : Scales
        Sizes at that place.
    guide : SearchGuide
        How the effect is looked for.
    carried : tuple of Effect
        Others that share its compiled law, neutral here.
    has_time : bool
        Whether the record has time, so that a form may depend on rate.
    """

    base: Structure
    effect: Effect
    storeys: tuple[int, ...]
    scales: Scales
    guide: SearchGuide[Any] = field(compare=False, repr=False)
    carried: tuple[Effect, ...] = ()
    has_time: bool = True

    @property
    def name(self) -> str:
        """The effect's canonical name."""
        return self.effect.name

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbols of the effect's parameters."""
        return symbols_of(self.effect)

    @property
    def free_shapes(self) -> tuple[Hypothesis, ...]:
        """The same with the effect in forms of free shape that contain its own, or come close to it.

        Those alone that can act there.
        """
        forms = self.guide.free_shapes(self.scales)
        own = [form for form in forms if _can_act(form, self.base, self.storeys, has_time=self.has_time)]
        return tuple(replace(self, effect=form, guide=guide_of(type(form))) for form in own)

    @property
    def label(self) -> str:
        """What engineers call it, its form and its place, e.g. ``gap impact (one-sided) in storey 2``."""
        form = f" ({self.effect.form})" if self.effect.form else ""
        return f"{title_of(self.name)}{form}{self.at_place}"

    @property
    def at_place(self) -> str:
        """`` in storey 2``, `` at floor 1``; nothing where there is one place only."""
        if not (not self.base.is_driven and self.storeys):
            return ""
        return f" {'at' if self.effect.level in ('node', 'observation') else 'in'} {self.where}"

    @property
    def where(self) -> str:
        """Its place in words: ``storey 2``, ``the building``, ``the specimen``."""
        return place_in_words(self.effect.level, self.storeys) if not self.base.is_driven else SPECIMEN

    @cached_property
    def model(self) -> Structure:
        """The present model with the effect in place, under a law shared with others, compiled already."""
        placed = PlacedEffect(effect=self.effect, storeys=self.storeys)
        return replace(self.base, carried=self.carried, effects=(*self.base.effects, placed))

    @cached_property
    def brought(self) -> tuple[str, ...]:
        """Labels of the identified parameters that the effect brings."""
        present = set(self.base.space.names)
        return tuple(name for name in self.model.space.names if name not in present)

    @property
    def n_brought(self) -> int:
        """How many identified parameters the effect brings."""
        return len(self.brought)

    @cached_property
    def amplitudes(self) -> tuple[str, ...]:
        """Those that switch it on: their priors are normal or half-normal about neutral (all, if none is)."""
        own = {p.name: p.prior for p in self.model.space.parameters}
        switches = tuple(name for name in self.brought if isinstance(_untruncated(own[name]), (Normal, HalfNormal)))
        return switches or self.brought

    def neutral(self, name: str) -> float:
        """Neutral value of one of the parameters brought."""
        symbols = {p.name: p.symbol for p in self.model.space.parameters}
        return next(p.neutral for p in self.effect.parameters if p.symbol == symbols[name])

    def starts(self, base_points: Floats) -> Floats:
        """Points of the new model's unit cube ``(n, n_dim)``: every base point with every combination of the grid."""
        space = self.model.space
        grid = self.guide.starts(self.effect, self.scales)
        symbols = {p.name: p.symbol for p in space.parameters}
        points = self._points(base_points, [grid[symbols[name]] for name in self.brought])
        points = np.clip(points, 1e-4, 1.0 - 1e-4)
        admissible = np.isfinite(space.log_prior_unit(points))
        return points[admissible] if np.any(admissible) else points

    def neutral_points(self, base_point: Floats, amplitude: str, near: float) -> Floats:
        """The base point with one amplitude at neutral or just off it, the others neutral, over the grid of the rest.

        Returns
        -------
        (n, n_dim) array
            In the new model's unit cube; the amplitude is ``near`` in prior probability above neutral.
        """
        space = self.model.space
        grid = self.guide.starts(self.effect, self.scales)
        symbols = {p.name: p.symbol for p in space.parameters}
        choices = [(self.neutral(name),) if name in self.amplitudes else grid[symbols[name]] for name in self.brought]
        points = self._points(base_point[None], choices)
        column = space.names.index(amplitude)
        moved = np.minimum(points[:, column] + near, 1.0 - near)
        points = np.clip(points, 1e-6, 1.0 - 1e-6)
        points[:, column] = moved
        return points

    def _points(self, base_points: Floats, choices: Sequence[Sequence[float]]) -> Floats:
        space = self.model.space
        rows = []
        for point in base_points:
            known = dict(zip(self.base.space.names, self.base.space.from_unit(point[None])[0], strict=True))
            for choice in product(*choices):
                values = {**known, **dict(zip(self.brought, choice, strict=True))}
                rows.append([values[name] for name in space.names])
        return space.to_unit(np.array(rows, dtype=np.float64).reshape(-1, space.n_dim))


def symbols_of(effect: Effect) -> tuple[str, ...]:
    """Symbols of an effect's parameters: each form of each effect has its own."""
    return tuple(p.symbol for p in effect.parameters)


def place_in_words(level: str, storeys: tuple[int, ...]) -> str:
    """Storeys or floors on which an effect of a level acts."""
    if not storeys:
        return "the building"
    kind = "floor" if level in ("node", "observation") else "storey"
    return f"{kind}{'s' if len(storeys) > 1 else ''} {', '.join(map(str, storeys))}"


def _untruncated(prior: Prior) -> Prior:
    return prior.parent if isinstance(prior, Truncated) else prior


def hypotheses(
    base: Structure,
    scales: Sequence[Scales],
    *,
    measured: Sequence[str],
    has_time: bool = True,
    in_one_go: bool = True,
    effects: Sequence[type[Effect]] | None = None,
    most_carried: float = MOST_CARRIED,
) -> tuple[Hypothesis, ...]:
    """Every catalogued effect, in every form, at every place where the present model has it not.

    Parameters
    ----------
    base : Structure
        The present model.
    scales : sequence of Scales
        One per storey, from the ground up.
    measured : sequence of str
        Channels of the record: a sensor that does not exist cannot be wrong.
    has_time : bool
        Whether the record has time; without, effects that depend on rate or time take no part.
    in_one_go : bool
        Whether there is one beginning; where several records find the structure virgin, what happens at an instant
        takes no part: it would happen in each of them.
    effects : sequence of Effect classes, optional
        The whole catalogue by default. An effect without a guide takes no part.
    most_carried : float
        Parameters that the effects of one compiled law may bring in all. More make every solve slower; with infinity
        there is one law for every hypothesis but a second base, whatever the present model has of the catalogue.
    """
    result = []
    addable: dict[tuple[str, ...], bool] = {}
    for effect_class in filter(is_sought, effects if effects is not None else registered()):
        guide = guide_of(effect_class)
        for storeys in _places(effect_class, base, measured):
            own = mean_scales([scales[storey - 1] for storey in storeys] or scales[:1])
            for effect in guide.priors(own):
                if not _can_act(effect, base, storeys, has_time=has_time) or (not in_one_go and effect.is_an_event):
                    continue
                hypothesis = Hypothesis(
                    base=base, effect=effect, storeys=storeys, scales=own, guide=guide, has_time=has_time
                )
                if hypothesis.symbols not in addable:
                    addable[hypothesis.symbols] = _addable(base, effect)
                if addable[hypothesis.symbols] and not is_present(base, effect, storeys):
                    result.append(hypothesis)
    return sharing_laws(result, most_carried)


def sharing_laws(every: Sequence[Hypothesis], most_carried: float) -> tuple[Hypothesis, ...]:
    """The same hypotheses in groups of one law each: compiling a law takes longer than solving it for all of them.

    Sensors are read outside the law: theirs is the base's own. A law has one effect that moves the base.

    Parameters
    ----------
    every : sequence of Hypothesis
        Of one present model; those that come first share the first law.
    most_carried : float
        As for :func:`hypotheses`.
    """
    groups: list[dict[tuple[str, ...], Effect]] = [{}]
    group_of: dict[tuple[str, ...], dict[tuple[str, ...], Effect]] = {}
    for hypothesis in every:
        effect = hypothesis.effect
        symbols = hypothesis.symbols
        if effect.level == "observation" or symbols in group_of:
            continue
        if sum(map(len, groups[-1])) + len(symbols) > most_carried:
            groups.append({})
        alone = effect.moves_base and any(other.moves_base for other in groups[-1].values())
        group = {} if alone else groups[-1]
        group[symbols] = effect
        group_of[symbols] = group
    result = []
    for hypothesis in every:
        symbols = hypothesis.symbols
        carried = hypothesis.base.carried
        if symbols in group_of:
            carried = tuple(effect for other, effect in group_of[symbols].items() if other != symbols)
        result.append(replace(hypothesis, carried=carried))
    return tuple(result)


def _places(effect_class: type[Effect], base: Structure, measured: Sequence[str]) -> tuple[tuple[int, ...], ...]:
    if effect_class.level not in PLACED_LEVELS:
        return ((),) if not base.is_driven else ()
    if effect_class.level != "link" and base.is_driven:
        return ()
    if effect_class.level == "link":
        storeys = tuple(i for i in range(1, base.n_links + 1) if base.element_of(i) in effect_class.elements)
    else:
        storeys = tuple(range(1, base.n_floors + 1))
    if effect_class.level == "observation":
        return tuple((s,) for s in storeys if f"acceleration_{s}" in measured)
    single = tuple((s,) for s in storeys)
    # Storeys are alike more often than floors are: what one lacks, all may lack.
    return (*single, storeys) if effect_class.level == "link" and len(storeys) > 1 else single


def _can_act(effect: Effect, base: Structure, storeys: tuple[int, ...], *, has_time: bool) -> bool:
    """Whether a form means something in a record with or without time, and acts on the elements of a place.

    One form of an effect may act on fewer than another.
    """
    if effect.needs_time and not has_time:
        return False
    return effect.level != "link" or all(base.element_of(one) in effect.elements for one in storeys)


def _addable(base: Structure, effect: Effect) -> bool:
    """Whether the model has what the effect refers to."""
    try:
        # What another effect of the model refers to cannot be taken out of it.
        bare = replace(base, effects=tuple(p for p in base.effects if p.effect.name != effect.name))
        return bare.with_effect(effect).space.n_dim > bare.space.n_dim
    except UserError:
        return False


def is_present(base: Structure, effect: Effect, storeys: tuple[int, ...]) -> bool:
    """Whether the place has a law of its mechanism already, or the parameter there a value of its own anyway."""
    for placed in base.effects:
        shared = set(placed.storeys) & set(storeys) or placed.storeys == storeys
        if placed.effect.mechanism == effect.mechanism and shared:
            return True
    own = getattr(effect, "parameter", None) if effect.name == "storey_parameter" else None
    if own is None:
        return False
    # Yield displacement and ratio together stand for beta and gamma; what made a linear link hysteretic has its own.
    element = base.element.values
    values = [element[name] for name in ([own] if own in element else ["u_y", "rho"]) if name in element]
    free_here = all(isinstance(v, PerStorey) or (base.n_links == 1 and isinstance(v, Prior)) for v in values)
    return len(storeys) > 1 or free_here


def scales_of(posterior: Posterior, point: Floats) -> tuple[Scales, ...]:
    """Sizes at every storey at a point ``(n_dim,)`` of the unit cube of the present model."""
    model, record = posterior.model, posterior.record
    values, _ = posterior.split(point[None])
    rows = {kind: history[0] for kind, history in observe(posterior.engine, model, values, record).items()}
    columns = zip((p.symbol for p in model.parameters), np.moveaxis(model.table.local(values)[0], 1, 0), strict=True)
    at_start = parameters_at(model.law, xr.Dataset({name: ("storey", column) for name, column in columns}), 0.0)
    parameters = {name: at_start[name].values for name in ("A", *_PARAMETER_SCALES.values())}
    onset = moment_of_share(record, ONSET_SHARE)
    period = _period(model, at_start, rows, record.duration)
    return tuple(
        Scales(
            drift=_peak(rows["drift"][i]),
            drift_rate=_peak(rows["drift_rate"][i]),
            hysteretic_displacement=_peak(rows["hysteretic_displacement"][i]),
            path=max(*(float(path_of(rows["drift"][i, run])[-1]) for _, run in record.runs), 1e-12),
            energy=_peak(rows["hysteretic_energy"][i]),
            force=_peak(rows["restoring_force"][i]),
            **{name: float(parameters[symbol][i]) for name, symbol in _PARAMETER_SCALES.items()},
            mass=float(masses(model)[i]),
            total_mass=float(sum(model.masses)),
            acceleration=max(float(np.std(rows["acceleration"][min(i, len(rows["acceleration"]) - 1)])), 1e-12),
            ground_acceleration=max(float(np.std(record.excitation)), 1e-12),
            period=period,
            onset=onset,
            duration=record.duration,
            time_step=record.time_step,
        )
        for i in range(model.n_links)
    )


def moment_of_share(record: Record, share: float) -> float:
    """Time by which such a share of what drives has arrived, in energy [s]."""
    energy = np.cumsum(np.sum(np.square(list(record.drivers.values())), axis=0))
    return float(record.times[min(int(np.searchsorted(energy, share * energy[-1])), record.n_times - 1)])


def _period(model: Structure, at_start: xr.Dataset, rows: Mapping[str, Floats], duration: float) -> float:
    """First period [s] of a building at rest, the duration where nothing holds it up; of a specimen, its cycles'."""
    if model.is_driven:
        return float(2.0 * np.pi * np.std(rows["drift"]) / max(float(np.std(rows["drift_rate"])), 1e-300))
    stiffness = tangent_stiffness(at_start, xr.ones_like(at_start["k"])).values
    k_bend = at_start["k_bend"].values[0] if "k_bend" in at_start else None
    periods, _ = modes(stiffness, np.zeros_like(stiffness), np.array(model.masses), model.joints, k_bend)
    # P-Delta may leave a mode without stiffness, which has no period.
    return next(filter(np.isfinite, periods.tolist()), duration)


_PARAMETER_SCALES: Mapping[str, str] = {
    "stiffness": "k",
    "damping": "c",
    "alpha": "alpha",
    "beta": "beta",
    "gamma": "gamma",
    "n": "n",
}


def mean_scales(scales: Sequence[Scales]) -> Scales:
    """Sizes to expect of an effect that acts alike at several places."""
    names = [field.name for field in fields(Scales)]
    return Scales(**{name: float(np.mean([getattr(one, name) for one in scales])) for name in names})


def _peak(history: Floats) -> float:
    return max(float(np.max(np.abs(history))), 1e-12)
