"""From a model and a record to a posterior: find the modes, choose the scheme, sample, check.

Importance sampling from the modes checks itself. Where it fails its check, transitional MCMC takes over from two starts
that must agree, and the result says what ran, why, and how good it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.base import require_parameters, require_usable
from bwbn_bayes.engines.executors import spread
from bwbn_bayes.engines.journal import kept
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.errors import require_installed
from bwbn_bayes.inference.accuracy import LADDER, Discretisation, choose_scheme, on_rung
from bwbn_bayes.inference.by_importance import by_importance
from bwbn_bayes.inference.by_tmcmc import by_tmcmc
from bwbn_bayes.inference.doubts import doubts
from bwbn_bayes.inference.history import History, Listener
from bwbn_bayes.inference.likelihood import Noise, Posterior, default_noise, require_noise
from bwbn_bayes.inference.modes import Mode, distinct, find_modes, polish
from bwbn_bayes.inference.nested_laplace import NestedLaplace
from bwbn_bayes.inference.residuals import residual_checks
from bwbn_bayes.inference.sampled import Sampled
from bwbn_bayes.inference.scale_of_z import Section, section_of
from bwbn_bayes.inference.settings import METHODS, Settings
from bwbn_bayes.inference.summary import build_result
from bwbn_bayes.inference.tmcmc.sampler import fewest_particles, require_particles
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import DOUBTS, Check, Result
from bwbn_bayes.structures.structure import Structure

Beside = Callable[[Posterior, Floats], tuple[Check, ...]]
"""Checks of a posterior at its optimum ``(n_dim,)``."""
N_ATTEMPTS = 3
_FALLBACK_SHARE, _FEWEST_PARTICLES = 10, 200
"""Where TMCMC takes over, it runs with this fraction of the draws asked for: each costs it some hundred solves."""


def identify(
    model: Structure,
    record: Record,
    *,
    settings: Settings | None = None,
    noise: Noise | None = None,
    name: str = "model",
    assumptions: Sequence[str] = (),
    listener: Listener | None = None,
    beside: Beside | None = None,
) -> Result:
    """Identify the parameters of a model from a record.

    Parameters
    ----------
    model : Structure
        With priors on the parameters to identify.
    record : Record
        Measured channels under one excitation.
    settings : Settings, optional
        Method, engine, seed, number of draws.
    noise : Noise, optional
        How the noise scale enters; by default integrated out under the priors of
        :func:`~bwbn_bayes.inference.likelihood.default_noise`.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted; printed in the report.
    listener : callable, optional
        Told what is being done.
    beside : callable, optional
        Further checks of the model, of posterior and optimum: what else would explain the record.

    Returns
    -------
    Result
        Posterior, checks and facts.

    Raises
    ------
    UserError
        If nothing is to be identified, the record measures nothing, record and model do not belong together, or the
        method's library is not installed.
    """
    settings = settings or Settings()
    if settings.method not in METHODS:
        raise ValueError(f"method {settings.method!r} gives no posterior: call bwbn_bayes.identify")
    require_parameters(model, name)
    require_usable(model, record)
    if noise is not None:
        require_noise(noise, record)
    _require_road(settings, model.space.n_dim)
    history = History(listener, time.perf_counter(), [])
    streams = _streams(settings.seed)
    with (
        spread(engine_by_name(settings.engine), settings.workers, settings.scheduler) as solving,
        kept(solving, settings.checkpoint) as engine,
    ):
        posterior = Posterior(
            model=model, record=record, engine=on_rung(engine, LADDER[0]), noise=noise or default_noise(record)
        )
        fitted = _doubted(_Fitted(*_fit(posterior, streams[:N_ATTEMPTS], history)), beside, history)
        return _sampled(fitted, settings, np.random.default_rng(streams[-1]), history, name, assumptions)


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
        As for :func:`identify`.

    Returns
    -------
    Result
        Posterior, checks and facts.
    """
    settings = settings or Settings()
    history = History(listener, time.perf_counter(), [])
    fitted = _Fitted(*_finish(posterior, points))
    return _sampled(fitted, settings, np.random.default_rng(_streams(settings.seed)[-1]), history, name, assumptions)


def _require_road(settings: Settings, n_dim: int) -> None:
    """Refuse before the search what the road asked for could not do after it."""
    if settings.method == "tmcmc":
        require_particles(settings.particles, n_dim)
    if settings.method in ("smc", "nuts"):
        nutpie = settings.method == "nuts" and settings.sampler == "nutpie"
        require_installed("nuts" if nutpie else "pymc", "sampler nutpie" if nutpie else f"method {settings.method}")


def _streams(seed: int) -> list[np.random.SeedSequence]:
    """A stream for each attempt to find the modes, one for transitional MCMC, one for draws."""
    return np.random.SeedSequence(seed).spawn(N_ATTEMPTS + 2)


class _Fitted(NamedTuple):
    posterior: Posterior
    modes: tuple[Mode, ...]
    discretisation: Discretisation | None
    checks: tuple[Check, ...]


def _doubted(fitted: _Fitted, beside: Beside | None, history: History) -> _Fitted:
    """With the checks that put a model in doubt."""
    view, best = fitted.posterior, fitted.modes[0]
    found = doubts(view, best)
    if beside is not None:
        history.say("asking the catalogue what else would explain the record")
        found = (*found, *beside(view, best.point))
    return fitted._replace(checks=(*fitted.checks, *found))


def _sampled(
    fitted: _Fitted,
    settings: Settings,
    rng: np.random.Generator,
    history: History,
    name: str,
    assumptions: Sequence[str],
) -> Result:
    """The posterior by the road asked for, and by TMCMC where importance sampling fails its check."""
    posterior, modes = fitted.posterior, fitted.modes
    target, at = posterior, modes
    section = section_of(posterior) if settings.method in ("importance", "tmcmc") else None
    if section is not None:
        history.say("A shares the scale of z with others: integrating along it")
        target, at = section, _modes_on(section, modes)
        assumptions = (*assumptions, section.sentence)
    method: str = settings.method
    nested: NestedLaplace | None = None
    if method == "importance":
        # Where nothing takes over, the bent posterior of a model that leaves more than noise is not worth following.
        follows = settings.fallback or all(c.passed for c in fitted.checks if c.name not in DOUBTS)
        found, nested = by_importance(target, at, settings, rng, history, follows=follows)
    elif method == "tmcmc":
        found = by_tmcmc(target, at, settings, _streams(settings.seed)[N_ATTEMPTS], history)
    else:
        found = _by_pymc(posterior, modes, settings, history)
    draws, evidences, checks = found
    if draws is None:
        history.say("the proposal does not cover the posterior: falling back to TMCMC")
        method = "tmcmc"
        fewest = max(_FEWEST_PARTICLES, fewest_particles(target.n_dim))
        fewer = replace(settings, particles=max(fewest, settings.particles // _FALLBACK_SHARE))
        second = by_tmcmc(target, at, fewer, _streams(settings.seed)[N_ATTEMPTS], history, nested)
        draws, evidences, checks = second.draws, {**evidences, **second.evidences}, (*checks, *second.checks)
    assert draws is not None
    if section is not None:
        draws = draws.with_points(lambda points: section.spread(points, rng))
    return build_result(
        posterior,
        modes,
        draws,
        method=method,
        asked=settings.method,
        seed=settings.seed,
        name=name,
        assumptions=assumptions,
        checks=(*fitted.checks, *checks),
        discretisation=fitted.discretisation,
        stages=tuple(history.stages),
        evidences=evidences,
        elapsed=lambda: time.perf_counter() - history.began,
        rng=rng,
    )


def _by_pymc(posterior: Posterior, modes: tuple[Mode, ...], settings: Settings, history: History) -> Sampled:
    """PyMC's SMC or NUTS."""
    # Imported here: PyMC takes seconds to load, which the other roads need not pay.
    from bwbn_bayes.inference.pymc.roads import sample_road

    return Sampled(
        *sample_road(
            posterior,
            modes,
            method="smc" if settings.method == "smc" else "nuts",
            plain=settings.variant == "plain",
            sampler=settings.sampler,
            particles=settings.particles,
            seed=settings.seed,
            say=history.say,
        )
    )


def _fit(
    posterior: Posterior, streams: Sequence[np.random.SeedSequence], history: History
) -> tuple[Posterior, tuple[Mode, ...], Discretisation | None, tuple[Check, ...]]:
    """Modes at the final scheme; searched again from new and more starts while the residual is not noise."""
    modes: tuple[Mode, ...] = ()
    for attempt, stream in enumerate(streams):
        rng = np.random.default_rng(stream)
        history.say(
            "finding the mode" if attempt == 0 else "the residual is not noise: searching again from more starts"
        )
        found = find_modes(
            posterior, rng, n_starts=1024 * 4**attempt, progress=lambda facts: history.tell_window(posterior, facts)
        )
        points = np.array([mode.point for mode in (*found, *modes)])
        view, modes, discretisation, checks = _finish(posterior, points)
        if all(check.passed for check in checks):
            break
    return view, modes, discretisation, checks


def _finish(
    posterior: Posterior, points: Floats
) -> tuple[Posterior, tuple[Mode, ...], Discretisation | None, tuple[Check, ...]]:
    """Choose the scheme at the first point and polish all of them under it."""
    view, discretisation = posterior, None
    if isinstance(posterior.engine, Lanes):
        scheme, discretisation = choose_scheme(posterior, points[0], posterior.engine)
        view = posterior.with_engine(scheme)
    points, local = polish(view, points, n_iterations=20)
    modes = distinct(points, local)
    return view, modes, discretisation, residual_checks(view, modes[0].point)


def _modes_on(section: Section, modes: tuple[Mode, ...]) -> tuple[Mode, ...]:
    """The same optima among what the record can see; those on one orbit are one."""
    points = section.to_section(np.array([mode.point for mode in modes]))
    return distinct(*polish(section, points, n_iterations=20))
