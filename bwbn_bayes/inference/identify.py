"""From a model and a record to a posterior: find the modes, choose the scheme, sample, check.

Importance sampling from the modes checks itself. Where it fails its check, transitional MCMC takes over from two starts
that must agree, and the result says what ran, why, and how good it is.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np

from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.base import require_parameters, require_usable
from bwbn_bayes.engines.executors import spread
from bwbn_bayes.engines.journal import kept
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.accuracy import (
    Discretisation,
    coarsest_stable,
    in_singles,
    on_rung,
)
from bwbn_bayes.inference.arrays import noise_scales
from bwbn_bayes.inference.as_one import counted_as_one
from bwbn_bayes.inference.doubts import doubts
from bwbn_bayes.inference.finely import solve_finely
from bwbn_bayes.inference.history import History, Listener
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior, default_noise, require_noise
from bwbn_bayes.inference.method import Beside, Task
from bwbn_bayes.inference.modes import Mode, distinct, find_modes, polish, turned_inwards
from bwbn_bayes.inference.registry import method
from bwbn_bayes.inference.residuals import leaves_noise, residual_checks
from bwbn_bayes.inference.sampled import Given, Sampled
from bwbn_bayes.inference.scale_of_z import Section, section_of
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import build_result
from bwbn_bayes.inference.unnamed.beside import Accompanied, require_room_for_force
from bwbn_bayes.inference.unnamed.beside import Beside as Force
from bwbn_bayes.inference.unnamed.beside import beside as with_force
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import DOUBTS, Check, Result

N_ATTEMPTS = 3


class Sampling(ABC):
    """A method that samples a posterior: the optima are found and the model is judged first, alike for all."""

    along_orbits: ClassVar[bool] = False
    """Whether it samples what the record can see of a posterior with A free, and draws are spread along A's orbits."""

    def refuse(self, task: Task) -> None:
        """Refuse before the search what could not be done after it."""
        if task.options is not None:
            raise UserError(f"method {task.settings.method} has no options of its own: leave options out")
        require_parameters(task.model, task.name)
        require_usable(task.model, task.record)
        if task.noise is not None:
            require_noise(task.noise, task.record)
        if task.unnamed_force:
            require_room_for_force(task.record, task.noise)

    @abstractmethod
    def sample(self, given: Given) -> Sampled:
        """Draws, evidences and checks."""

    def identify(self, task: Task) -> Result:
        """Find the optima, judge the model, sample."""
        settings, model, record = task.settings, task.model, task.record
        self.refuse(task)
        history = History(task.listener, time.perf_counter(), [])
        streams = _streams(settings.seed)
        with (
            spread(engine_by_name(settings.engine), settings.workers, settings.scheduler) as solving,
            kept(solving, settings.checkpoint) as engine,
        ):
            noise = task.noise or default_noise(record)
            tried = coarsest_stable(Posterior(model=model, record=record, engine=solving, noise=noise))
            # What is tried on draws that nobody keeps is not kept either.
            rung = tried.engine
            posterior = tried.with_engine(on_rung(engine, rung) if isinstance(rung, Lanes) else engine)
            fitted = _fit(posterior, streams[:N_ATTEMPTS], history)
            if task.noise is None and not task.unnamed_force:
                fitted = _counted(fitted)
            return _result(self, _doubted(fitted, task.beside, history), history, task)


def identify_from(
    posterior: Posterior,
    points: Floats,
    *,
    settings: Settings | None = None,
    name: str = "model",
    assumptions: Sequence[str] = (),
    listener: Listener | None = None,
) -> Result:
    """Sample a posterior whose optima are known already.

    Parameters
    ----------
    posterior : Posterior
        Model, record and noise; its engine gives way to the scheme that is fine enough.
    points : (n, n_dim) array
        Optima in the unit cube, best first.
    settings, name, assumptions, listener
        As for :func:`bwbn_bayes.identify`.

    Returns
    -------
    Result
        Posterior, checks and facts.
    """
    settings = settings or Settings()
    sampling = method(settings.method)
    if not isinstance(sampling, Sampling):
        raise ValueError(f"method {settings.method!r} samples no posterior")
    history = History(listener, time.perf_counter(), [])
    task = Task(model=posterior.model, record=posterior.record, settings=settings, name=name, assumptions=assumptions)
    return _result(sampling, _finish(posterior, points), history, task)


def _streams(seed: int) -> list[np.random.SeedSequence]:
    """A stream for each attempt to find the modes, one for transitional MCMC, one for draws."""
    return np.random.SeedSequence(seed).spawn(N_ATTEMPTS + 2)


class _Fitted(NamedTuple):
    posterior: Posterior
    modes: tuple[Mode, ...]
    discretisation: Discretisation | None
    checks: tuple[Check, ...]


def _counted(fitted: _Fitted) -> _Fitted:
    """With samples of a specimen's loop counted as ``discover`` counts them, where more than noise is left of them."""
    posterior, best = fitted.posterior, fitted.modes[0].point
    noise = posterior.noise
    is_specimen = posterior.record.excitation_kind == "displacement"
    if not is_specimen or not isinstance(noise, IntegratedNoise) or leaves_noise(posterior, best):
        return fitted
    view = posterior.with_noise(counted_as_one(noise, posterior, best))
    points = np.array([mode.point for mode in fitted.modes])
    return fitted._replace(posterior=view, modes=distinct(*polish(view, points, n_iterations=20)))


def _doubted(fitted: _Fitted, beside: Beside | None, history: History) -> _Fitted:
    """With the checks that put a model in doubt."""
    view, best = fitted.posterior, fitted.modes[0]
    found = doubts(view, best)
    if beside is not None:
        history.say("asking the catalogue what else would explain the record")
        found = (*found, *beside(view, best.point))
    return fitted._replace(checks=(*fitted.checks, *found))


def _result(sampling: Sampling, fitted: _Fitted, history: History, task: Task) -> Result:
    """Sample, along the orbits of A and with a force beside the model where that is wanted, and put it together."""
    posterior, modes, settings, assumptions = fitted.posterior, fitted.modes, task.settings, tuple(task.assumptions)
    *_, seeds, stream = _streams(settings.seed)
    rng = np.random.default_rng(stream)
    target, at = posterior, modes
    section = section_of(posterior) if sampling.along_orbits else None
    if section is not None:
        history.say("A shares the scale of z with others: integrating along it")
        target, at = section, _modes_on(section, modes)
        assumptions = (*assumptions, section.sentence)
    explains = all(check.passed for check in fitted.checks if check.name not in DOUBTS)
    if task.unnamed_force:
        history.say("looking for a force of no known law beside the model")
        force = with_force(target, at)
        target, at, explains = force.posterior, force.modes, True
        assumptions = (*assumptions, force.sentence)
        posterior = _accompanied(posterior, section, force)
    at = tuple(turned_inwards(target, mode) for mode in at)
    found = sampling.sample(Given(target, at, settings, rng, seeds, history, explains))
    noise_sd, draws = noise_scales(target, found.draws.points, rng), found.draws
    if section is not None:
        draws = draws.with_points(lambda points: section.spread(points, rng))
    return build_result(
        posterior,
        modes if section is not None else at,
        draws,
        noise_sd,
        method=found.method,
        asked=settings.method,
        seed=settings.seed,
        name=task.name,
        assumptions=assumptions,
        checks=(*fitted.checks, *found.checks),
        discretisation=fitted.discretisation,
        stages=tuple(history.stages),
        evidences=found.evidences,
        elapsed=lambda: time.perf_counter() - history.began,
        rng=rng,
    )


def _accompanied(posterior: Posterior, section: Section | None, force: Force) -> Posterior:
    """The posterior whose draws respond with a force of their own beside them."""

    def point_of(values: Floats) -> Floats:
        points = posterior.space.to_unit(values[None])
        return np.asarray((points if section is None else section.to_section(points))[0])

    engine = Accompanied(engine=posterior.engine, beside=force, point_of=point_of)
    return replace(posterior, engine=engine, noise=force.posterior.noise)


def _fit(posterior: Posterior, streams: Sequence[np.random.SeedSequence], history: History) -> _Fitted:
    """Modes at the final scheme; searched again from new and more starts while the residual is not noise."""
    fitted: _Fitted | None = None
    for attempt, stream in enumerate(streams):
        rng = np.random.default_rng(stream)
        history.say(
            "finding the mode" if attempt == 0 else "the residual is not noise: searching again from more starts"
        )
        found = find_modes(
            in_singles(posterior) if attempt == 0 else posterior,
            rng,
            n_starts=1024 * 4**attempt,
            progress=lambda facts: history.tell_window(posterior, facts),
        )
        points = np.array([mode.point for mode in found])
        if fitted is not None:  # the scheme is judged at the best
            points = np.concatenate([points, [mode.point for mode in fitted.modes]])
            points = points[np.argsort(-fitted.posterior.log_likelihood(points), kind="stable")]
        fitted = _finish(posterior, points)
        if all(check.passed for check in fitted.checks):
            break
    assert fitted is not None
    return fitted


def _finish(posterior: Posterior, points: Floats) -> _Fitted:
    """The modes under the scheme that the record asks for, and what they leave."""
    solved = solve_finely(posterior, points)
    return _Fitted(*solved, residual_checks(solved.posterior, solved.modes[0].point))


def _modes_on(section: Section, modes: tuple[Mode, ...]) -> tuple[Mode, ...]:
    """The same optima among what the record can see; those on one orbit are one."""
    points = section.to_section(np.array([mode.point for mode in modes]))
    return distinct(*polish(section, points, n_iterations=20))
