"""Choosing the engine's scheme in the posterior's own units.

A discretisation error ``e`` of the response moves the estimate by ``H^-1 J^T W e``. The cheapest scheme is taken whose
shift has a joint length below half a posterior standard deviation and that moves the log likelihood of the refitted
model by less than half a nat.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import counts, mean_squares, over_time

LIMIT = 0.5
LADDER = (
    Lanes(resolution=0.5, cut_at_turns=False),
    Lanes(resolution=0.5),
    Lanes(resolution=0.25),
    Lanes(substeps=2, resolution=0.5),
    Lanes(resolution=0.125),
    Lanes(substeps=2, resolution=0.25),
    Lanes(substeps=2, resolution=0.06),
    Lanes(substeps=4, resolution=0.25),
    Lanes(substeps=4, resolution=0.06),
    Lanes(substeps=8, resolution=0.03),
    Lanes(substeps=16, resolution=0.015),
)
"""Schemes from cheap to dear: some laws ask for shorter steps everywhere, others where something is sharp."""
_STEADIER = (LADDER[0], *(replace(LADDER[1], substeps=n) for n in (1, 2, 4, 8)), LADDER[-1])
"""Those by which a search may begin, the coarsest first: short steps keep what is stiff from running away, whatever is
sharp beside it."""
_SEED, _N_TRIED, _STABLE = 1, 64, 0.9
"""Draws of the prior that are tried, and the share of what can be solved that a search must solve."""


def on_rung(engine: Engine, rung: Lanes) -> Engine:
    """An engine with a rung's scheme; one that is not of lanes has a tolerance of its own and stays as it is."""
    return _of_lanes(engine, rung) if isinstance(engine, Lanes) else engine


def _of_lanes(engine: Lanes, rung: Lanes) -> Lanes:
    """The same engine, its threads and what it keeps, with a rung's scheme."""
    return replace(engine, substeps=rung.substeps, resolution=rung.resolution, cut_at_turns=rung.cut_at_turns)


@dataclass(frozen=True, kw_only=True)
class Discretisation:
    """What a scheme's error does to the posterior at one point.

    Attributes
    ----------
    scheme : str
        In words.
    joint_shift_sd : float
        Length of the shift of the estimate in posterior standard deviations.
    log_likelihood_shift : float
        Change of the refitted log likelihood.
    nrmse : float
        Error of the response over the rms of the record, the root mean square over its channels.
    """

    scheme: str
    joint_shift_sd: float
    log_likelihood_shift: float
    nrmse: float

    @property
    def acceptable(self) -> bool:
        """Whether both shifts are below one half."""
        return self.joint_shift_sd < LIMIT and abs(self.log_likelihood_shift) < LIMIT

    def as_mapping(self) -> Mapping[str, str | float]:
        """For the facts of a result."""
        return {
            "scheme": self.scheme,
            "joint_shift_sd": self.joint_shift_sd,
            "log_likelihood_shift": self.log_likelihood_shift,
            "nrmse": self.nrmse,
        }


@dataclass(frozen=True, kw_only=True)
class Judge:
    """Measures schemes against the finest one at a point of the unit cube; build it with :meth:`at`."""

    posterior: Posterior
    values: Floats
    exact: Floats
    jacobian: Floats
    weight: Floats
    ran_away: bool = False
    """Whether the slopes of the posterior's own engine did, so that another's are asked for."""

    @classmethod
    def at(cls, posterior: Posterior, point: Floats, finest: Engine) -> Judge:
        """Solve once with the finest engine and take the slopes of the posterior's own at ``point (n_dim,)``.

        Where steps are so long that these run away, as they may where the response does not, the finest has to tell.
        """
        model, record = posterior.model, posterior.record
        values, noise_values = posterior.split(point[None])
        _, slopes = posterior.engine.sensitivities(model, values, record)
        exact = finest.simulate(model, values, record).values[0]
        posterior.solves.add(2)
        ran_away = not np.all(np.isfinite(slopes))
        if ran_away:
            _, slopes = finest.sensitivities(model, values, record)
            posterior.solves.add(1)
        n_times = counts(record)
        misfit = (n_times * mean_squares(record, record.measured - exact))[None]
        weight = over_time(record, np.sqrt(posterior.noise.precision(misfit, n_times, noise_values)[0]))
        scale = model.space.unit_scale(values)[0]
        jacobian = (slopes[0] * scale[:, None, None] * weight).reshape(model.space.n_dim, -1)
        return cls(posterior=posterior, values=values, exact=exact, jacobian=jacobian, weight=weight, ran_away=ran_away)

    def __call__(self, engine: Engine) -> Discretisation:
        """What the engine's error does to the posterior."""
        record = self.posterior.record
        response = engine.simulate(self.posterior.model, self.values, record).values[0]
        self.posterior.solves.add(1)
        whitened = ((self.exact - response) * self.weight).ravel()
        residual = ((record.measured - self.exact) * self.weight).ravel()
        # By the slopes themselves, over those of the prior (12 is its precision in the cube): steep ones, squared,
        # would leave an information matrix that cannot be solved.
        n_dim = len(self.jacobian)
        rows = np.vstack([self.jacobian.T, np.sqrt(12.0) * np.eye(n_dim)])
        orthogonal, triangle = np.linalg.qr(rows)
        # Where the response runs away, so does its shift, and no scheme is accepted.
        shift = solve_triangular(triangle, whitened @ orthogonal[: len(whitened)], check_finite=False)
        moved = shift @ self.jacobian
        left = whitened - moved
        missed = mean_squares(record, self.exact - response) / mean_squares(record, record.measured)
        return Discretisation(
            scheme=engine.scheme,
            joint_shift_sd=float(np.linalg.norm(moved)),
            log_likelihood_shift=float(-residual @ left - 0.5 * left @ left),
            nrmse=float(np.sqrt(np.mean(missed))),
        )

    def has_slopes(self, engine: Engine) -> bool:
        """Whether the engine's slopes are finite, too; asked only where those of the posterior's own ran away."""
        if not self.ran_away:
            return True
        self.posterior.solves.add(1)
        _, slopes = engine.sensitivities(self.posterior.model, self.values, self.posterior.record)
        return bool(np.all(np.isfinite(slopes)))


def in_doubles(posterior: Posterior) -> Posterior:
    """A posterior whose engine computes with numbers of 64 bits: small differences of responses need them."""
    return _in_precision(posterior, single=False)


def in_singles(posterior: Posterior) -> Posterior:
    """A posterior whose engine computes with numbers of 32 bits where it can, in half the time: for a search."""
    return _in_precision(posterior, single=True)


def _in_precision(posterior: Posterior, *, single: bool) -> Posterior:
    engine = posterior.engine
    return posterior.with_engine(replace(engine, single=single)) if isinstance(engine, Lanes) else posterior


def coarsest_stable(posterior: Posterior) -> Posterior:
    """A posterior under the coarsest scheme that solves what the finest can, of some draws of the prior.

    A step too long for the stiffest mode that the priors allow runs away, and a search finds no draw to begin with.
    """
    engine = posterior.engine
    if not isinstance(engine, Lanes):
        return posterior
    points = posterior.sample_prior(np.random.default_rng(_SEED), _N_TRIED)

    def solves(rung: Lanes) -> NDArray[np.bool_]:
        return np.all(np.isfinite(posterior.with_engine(_of_lanes(engine, rung)).misfit(points)), axis=1)

    if np.mean(solves(LADDER[0])) >= _STABLE:
        return posterior.with_engine(_of_lanes(engine, LADDER[0]))
    every = solves(LADDER[-1])
    enough = (rung for rung in _STEADIER if np.sum(solves(rung) & every) >= _STABLE * np.sum(every))
    return posterior.with_engine(_of_lanes(engine, next(enough)))


def left_out(posterior: Posterior, points: Floats, least: float) -> tuple[NDArray[np.bool_], Floats]:
    """Which points ``(n, n_dim)`` belong to a posterior that is solved twice as finely, and run away in this one.

    A scheme that is fine enough at the optimum may do so beside it, and leave out what is as likely.

    Parameters
    ----------
    posterior : Posterior
        With an engine of lanes.
    points : (n, n_dim) array
        Inside the unit cube.
    least : float
        Log likelihood that what belongs to it has.

    Returns
    -------
    found : (n,) array of bool
    exact : (n,) array
        Log likelihoods, solved more finely.
    """
    engine = posterior.engine
    assert isinstance(engine, Lanes)
    finer = replace(engine, substeps=2 * engine.substeps, resolution=0.5 * engine.resolution)
    own, other = (view.log_likelihood(points) for view in (posterior, posterior.with_engine(finer)))
    found = (other >= least) & ~(own >= least - LIMIT)
    found[found] = _runs_away(posterior, points[found])
    return np.asarray(found), other


def _runs_away(posterior: Posterior, points: Floats) -> NDArray[np.bool_]:
    """Where a response misses more of some channel than was measured; a scheme that is merely coarse does not."""
    if not len(points):
        return np.empty(0, dtype=np.bool_)
    record, (values, _) = posterior.record, posterior.split(points)
    missed = posterior.engine.misfit(posterior.model, values, record)
    posterior.solves.add(len(points))
    return ~np.all(missed <= counts(record) * mean_squares(record, record.measured), axis=1)


def rung_of(engine: Lanes, first: int = 0) -> int:
    """The rung of the ladder, from the rung ``first`` on, that an engine's scheme is, or is but for shorter steps.

    The last but one of none. With shorter steps, a scheme may be several rungs.
    """
    rungs = enumerate(LADDER[first:], start=first)
    same = (number for number, rung in rungs if _of_lanes(engine, _as_short(rung, engine.substeps)) == engine)
    return next(same, max(first, len(LADDER) - 2))


def _as_short(rung: Lanes, substeps: int) -> Lanes:
    """A rung with so many steps per sample at least."""
    return replace(rung, substeps=max(rung.substeps, substeps))


def choose_scheme(
    posterior: Posterior,
    point: Floats,
    engine: Lanes,
    *,
    first: int = 0,
    substeps: int = 1,
    accepts: Callable[[Discretisation], bool] = lambda facts: facts.acceptable,
) -> tuple[Lanes, Discretisation]:
    """The cheapest scheme of the ladder, from its rung ``first`` on, that is fine enough at a point ``(n_dim,)``.

    With ``substeps`` steps per sample at least, since longer ones may run away. Where none is, the finest is returned
    with the figures of the next coarser one, which bound its own; where it is the first, with its own, which no finer
    one tells.
    """
    every = [_of_lanes(engine, _as_short(rung, substeps)) for rung in LADDER]
    # With shorter steps some rungs are one scheme: what was tried is not tried again.
    *ladder, finest = (
        scheme for number, scheme in enumerate(every) if number >= first and scheme not in every[:number]
    )
    judge = Judge.at(posterior, point, finest)
    if not ladder:
        return finest, judge(finest)
    for scheme in ladder:
        facts = judge(scheme)
        if accepts(facts) and judge.has_slopes(scheme):
            return scheme, facts
    return finest, replace(facts, scheme=f"{finest.scheme}; the figures are those of the next coarser one")
