"""What one search carries along: its options, its clock, the present model and its fit."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from types import NoneType

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.elsewhere import Elsewhere
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.outcome import Step
from bwbn_bayes.discovery.pace import Pace, Progress
from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.discovery.score import Score, scores
from bwbn_bayes.discovery.unfinished import Unfinished
from bwbn_bayes.discovery.workers import Threads, Workers
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.executors import Executor
from bwbn_bayes.engines.lanes import Lanes, usable_processors
from bwbn_bayes.errors import UserError, in_short, require_kind
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.settings import require_checkpoint, require_few_particles, require_whole

Listener = Callable[[str, Progress | Unfinished | None], None]
"""Called with what is being done or was found; with how far it is; after each step with all that is known by then."""

_LEAST = {"seed": 0, "most_effects": 0, "most_rounds": 0, "particles": 1, "n_workers": 1, "workers": 1}


@dataclass(frozen=True, kw_only=True)
class DiscoverySettings:
    """Options of a discovery.

    Parameters
    ----------
    seed : int
        The run is a function of it.
    most_effects : int
        Effects added at most.
    most_rounds : int
        Explanations that are built upon at most; of a building as many again, which lack one of the best one's effects.
    particles : int
        Effective draws of the final posterior.
    n_workers : int
        Threads of this process: hypotheses fitted at once where no other process fits them.
    workers : int
        Processes that fit hypotheses; with one, the threads of this process do.
    scheduler : str, optional
        Address of a Dask scheduler whose workers fit them instead.
    effects : tuple of Effect classes, optional
        Those to consider; the whole catalogue by default.
    time_limit_s : float, optional
        Nothing further is tried after it: what was found by then is concluded. [s]
    checkpoint : Path, optional
        What was fitted is kept in the file of this name, without suffix; the same search goes on from there.
    resume : bool
        Whether it does; otherwise what is kept there is forgotten when the search begins.

    Raises
    ------
    UserError
        If the time limit is no positive number, a count or the seed is no whole number in its range, or the effects are
        no classes of effects.
    """

    seed: int = 1
    most_effects: int = 4
    most_rounds: int = 4
    particles: int = 2000
    n_workers: int = usable_processors()
    workers: int = 1
    scheduler: str | None = None
    effects: tuple[type[Effect], ...] | None = None
    time_limit_s: float | None = None
    checkpoint: Path | None = None
    resume: bool = True

    def __post_init__(self) -> None:
        limit = self.time_limit_s
        require_kind("DiscoverySettings: time_limit_s", limit, (Real, NoneType), "give a number of seconds")
        if limit is not None and not 0.0 < limit < np.inf:
            raise UserError(f"time limit: {limit:g} s is no time to search in, give a positive number of seconds")
        require_whole(self, _LEAST)
        require_few_particles(self.particles)
        require_checkpoint(self)
        if self.effects is not None:
            _require_classes(self.effects)


def _require_classes(effects: object) -> None:
    """Raise :class:`UserError` unless these are classes of effects, of which there is one at least."""
    advice = "give a tuple of classes, such as (SlipLock,), or leave it out for the whole catalogue"
    if not isinstance(effects, (tuple, list)):
        raise UserError(f"DiscoverySettings: effects is {in_short(effects)}: {advice}")
    if not effects:
        raise UserError(f"DiscoverySettings: effects is empty: {advice}")
    for one in effects:
        if not (isinstance(one, type) and Effect in one.__mro__):
            raise UserError(f"DiscoverySettings: effects holds what is no class of effects, {in_short(one)}: {advice}")


@dataclass
class Run:
    """What a run collects."""

    settings: DiscoverySettings
    rng: np.random.Generator
    listener: Listener | None
    name: str = "model"
    """The model's, in reports."""
    data: str = ""
    """Hash of the record as given."""
    executor: Executor | None = None
    """Whose workers fit hypotheses; the threads of this process where there is none."""
    began: float = field(default_factory=time.perf_counter)
    steps: list[Step] = field(default_factory=list)
    scored: tuple[Explanation | None, tuple[tuple[Hypothesis, Score], ...]] = (None, ())
    """What was scored last, with its hypotheses."""
    notes: list[str] = field(default_factory=list)
    """What the reader of the verdict must know besides."""
    first_fits: tuple[Fit, ...] = ()
    """What the first round came to, best first."""
    considered_first: tuple[Hypothesis, ...] = ()
    """Hypotheses of the first round."""
    variants: Counter[str] = field(default_factory=Counter)
    """Forms and places of each effect, those of free shape too."""
    binding: tuple[str, ...] = ()
    """Priors of the model as given that bind, in sentences."""
    cut_short: tuple[str, ...] = ()
    """That a time limit ended the search, in a sentence: it bears on every probability."""
    stopped: bool = False
    """Whether something was left out for want of time."""

    def anew(self) -> Run:
        """A run of the same settings, clock and random stream, in which nothing was searched yet."""
        return replace(
            self,
            steps=[],
            notes=list(self.notes),
            scored=(None, ()),
            first_fits=(),
            considered_first=(),
            variants=Counter(),
        )

    def say(self, text: str, facts: Progress | Unfinished | None = None) -> None:
        """Tell the listener, if there is one."""
        if self.listener is not None:
            self.listener(text, facts)

    def must_stop(self) -> bool:
        """Whether the time is over, so that what was to come is left out."""
        limit = self.settings.time_limit_s
        if limit is not None and self.elapsed >= limit:
            self.stopped = True
        return self.stopped

    def consider(self, first: tuple[Hypothesis, ...]) -> None:
        """Begin with the hypotheses of the first round; each name's share of the prior is split over its own."""
        self.considered_first = first
        usual = {(h.name, h.symbols, h.storeys) for h in first}
        free = {(form.name, form.symbols, form.storeys) for h in first for form in h.free_shapes}
        names = {name for name, *_ in usual}
        self.variants = Counter(name for name, *_ in usual | free if name in names)

    @property
    def pace(self) -> Pace:
        """Of its stages."""
        return Pace(must_stop=self.must_stop, tell=self.say, workers=self.workers)

    @property
    def workers(self) -> Workers:
        """Those that fit hypotheses."""
        return Threads(self.settings.n_workers) if self.executor is None else Elsewhere(self.executor)

    def beside[T, R](self, function: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """What a function makes of each item, as :meth:`Workers.each` does, however late it is."""
        return [made[0] for made in self.workers.each(function, items) if made is not None]

    def note(self, text: str) -> None:
        """Keep a sentence for the verdict, and tell the listener."""
        self.notes.append(text)
        self.say(text)

    @property
    def elapsed(self) -> float:
        """Seconds since the run began."""
        return time.perf_counter() - self.began


def on_threads(posterior: Posterior, n_threads: int) -> Posterior:
    """The posterior with so many threads for its solves."""
    engine = posterior.engine
    if not isinstance(engine, Lanes):
        raise TypeError(f"discovery solves on the lanes engine, not on {engine.name}")
    return posterior.with_engine(replace(engine, n_threads=n_threads))


def on_one_thread(posterior: Posterior) -> Posterior:
    """The posterior on one thread: hypotheses are what runs beside each other."""
    return on_threads(posterior, 1)


def hypotheses_of(present: Explanation, run: Run, most_carried: float) -> tuple[Hypothesis, ...]:
    """Every hypothesis about the present model; of a specimen under one law, whatever it has of the catalogue."""
    found = hypotheses(
        present.model,
        scales_of(present.posterior, present.best),
        measured=tuple(present.posterior.record.channels),
        has_time=present.posterior.record.has_time,
        in_one_go=len(present.posterior.record.runs) == 1,
        effects=run.settings.effects,
        most_carried=most_carried,
    )
    if not (present.is_specimen and present.added):
        return found
    return tuple(replace(one, carried=all_but((*present.added, one), run)) for one in found)


def all_but(added: Sequence[Hypothesis], run: Run) -> tuple[Effect, ...]:
    """Every form of every effect that was considered but those that are added: with them the law of all effects.

    Of those that move the base a law has one.
    """
    present = {one.symbols for one in added}
    every = {h.symbols: h.effect for h in run.considered_first if h.effect.level != "observation"}
    bases = [one.effect for one in added if one.effect.moves_base]
    bases += [effect for symbols, effect in every.items() if effect.moves_base and symbols not in present]
    spare = {id(effect) for effect in bases[1:]}
    return tuple(effect for symbols, effect in every.items() if symbols not in present and id(effect) not in spare)


def score_all(present: Explanation, every: Sequence[Hypothesis], run: Run) -> tuple[tuple[Hypothesis, Score], ...]:
    """What every hypothesis could gain at the present fit, to first order."""
    found = scores(on_one_thread(present.posterior), every, present.best, workers=run.workers)
    return tuple(zip(every, found, strict=True))
