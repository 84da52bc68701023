"""Finding the global mode: multi-start least squares on windows of the record that grow.

A hysteretic record in full has many local optima; its first seconds have few. Many prior draws compete on a short
window, the best are polished by Levenberg-Marquardt, and before each longer window a cloud drawn from their Laplace
approximations replaces what the shorter window left open. Every candidate costs a sixteenth of a lane block, so sixteen
are kept throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.kept import kept_fit
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.tmcmc.target import Target
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.parameters import Booleans, Constraint, Floats

N_CANDIDATES = 16
N_CLOUD = 128
_DAMPINGS = np.array([1e-4, 1e-2, 1.0, 1e2])
_EDGE = 1e-6


@dataclass(frozen=True, kw_only=True)
class Mode:
    """A local optimum: point of the unit cube, log likelihood, gradient and Gauss-Newton information there."""

    point: Floats
    log_likelihood: float
    gradient: Floats
    information: Floats


@dataclass(frozen=True, kw_only=True)
class WindowFacts:
    """One window of the search: its end [s], the best log likelihood, candidates left, solves so far."""

    end: float
    log_likelihood: float
    n_candidates: int
    n_solves: int


Progress = Callable[[WindowFacts], None]


def windows(duration: float, first: float) -> tuple[float, ...]:
    """Ends of the growing windows: from ``first`` seconds by a factor of 1.5 up to the whole record."""
    ends = [first]
    while ends[-1] * 1.5 < duration * 0.9:
        ends.append(ends[-1] * 1.5)
    return (*ends, duration)


def first_window(posterior: Posterior) -> float:
    """End of the first window: where 2 % of the record's energy has arrived, but at least 150 samples, in seconds.

    Samples are counted from the first that is measured.
    """
    record = posterior.record
    energy = np.sum(
        [np.cumsum(np.square(signal)) / np.sum(np.square(signal)) for signal in record.channels.values()], axis=0
    )
    sample = int(np.searchsorted(energy, 0.02 * energy[-1]))
    first = int(np.arange(record.n_times)[record.kept][0])
    return float(record.times[min(max(sample, first + 150), record.n_times - 1)])


def find_modes(
    posterior: Posterior,
    rng: np.random.Generator,
    *,
    n_starts: int = 1024,
    n_first: int = N_CANDIDATES,
    n_kept: int = N_CANDIDATES,
    reach: float = np.inf,
    progress: Progress | None = None,
) -> tuple[Mode, ...]:
    """Local optima of the posterior, best first.

    Parameters
    ----------
    posterior : Posterior
        Target; a coarse scheme is enough here.
    rng : numpy.random.Generator
        Random stream.
    n_starts : int
        Prior draws on the first window.
    n_first : int
        The best of them, which are polished there.
    n_kept : int
        Candidates on each longer window.
    reach : float
        Candidates further below the best do not keep the others waiting. [nat]
    progress : callable, optional
        Called after every window.
    """
    ends = windows(posterior.record.duration, first_window(posterior))
    points = posterior.sample_prior(rng, n_starts)
    for number, end in enumerate(ends):
        view = posterior.until(end)
        points = best_of(view, points, n_first if number == 0 else n_kept)
        points, local = polish(view, points, n_iterations=30 if number == len(ends) - 1 else 12, reach=reach)
        modes = distinct(points, local)
        if not modes:
            raise UserError(
                f"none of {n_starts} draws of the prior can be solved: narrow the priors, or check record and model"
            )
        if progress is not None:
            best = modes[0].log_likelihood
            progress(
                WindowFacts(end=end, log_likelihood=best, n_candidates=len(modes), n_solves=posterior.solves.total)
            )
        points = np.array([mode.point for mode in modes])
        if number < len(ends) - 1:
            points = np.concatenate([points, cloud(view, modes, rng)])
    return modes


def settled(
    view: Posterior, modes: Sequence[Mode], rng: np.random.Generator, *, reach: float = 50.0
) -> tuple[Mode, ...]:
    """The modes again, after a cloud around them has looked for something better nearby.

    Those that are further below the best than ``reach`` [nat] may not have come to their ends.
    """
    points = np.concatenate([np.array([mode.point for mode in modes]), cloud(view, tuple(modes), rng)])
    return distinct(*polish(view, best_of(view, points, N_CANDIDATES), n_iterations=40, reach=reach))


def best_of(view: Posterior, points: Floats, n: int) -> Floats:
    """The best points by log likelihood, no two of them equal to within a thousandth of the cube."""
    order = np.argsort(-view.log_likelihood(points), kind="stable")
    chosen: list[int] = []
    for index in order:
        if all(np.max(np.abs(points[index] - points[other])) > 1e-3 for other in chosen):
            chosen.append(int(index))
        if len(chosen) == n:
            break
    return points[chosen]


def cloud(view: Posterior, modes: tuple[Mode, ...], rng: np.random.Generator) -> Floats:
    """Draws from the inflated Laplace approximations of the best half of the candidates."""
    kept = modes[: N_CANDIDATES // 2]
    components = [TruncatedStudent.at(m.point, m.gradient, m.information, inflation=4.0) for m in kept]
    cloud = np.concatenate([component.sample(rng, N_CLOUD // len(kept)) for component in components])
    return cloud[np.isfinite(view.log_prior(cloud))]


def polish(
    view: Posterior,
    points: Floats,
    *,
    n_iterations: int,
    held: Booleans | None = None,
    reach: float = np.inf,
    local: Linearisation | None = None,
) -> tuple[Floats, Linearisation]:
    """Levenberg-Marquardt from every point at once, see :func:`climb`, and the expansion where it ends.

    Parameters
    ----------
    view, points, n_iterations, held, reach
        See :func:`climb`.
    local : Linearisation, optional
        At the points, where it is known: it costs more than a step.

    Returns
    -------
    points : (n, n_dim) array
    local : Linearisation
        At the returned points.
    """
    points = _within(points, held) if local is None else points

    def fit(own: Posterior) -> tuple[Floats, ...]:
        known = own.linearise(points, _free(held, points)) if local is None else local
        reached, _, last, moved = _climb(own, points, known, n_iterations=n_iterations, held=held, reach=reach)
        last = _again(own, reached, last, moved, _free(held, reached))
        return reached, last.log_likelihood, last.gradient, last.information

    found, log_likelihood, gradient, information = kept_fit(
        view, f"polish, {n_iterations} steps, reach {reach!r}", points, held, fit
    )
    return found, Linearisation(log_likelihood=log_likelihood, gradient=gradient, information=information)


def climb(
    view: Posterior, points: Floats, *, n_iterations: int, held: Booleans | None = None, reach: float = np.inf
) -> tuple[Floats, Floats]:
    """Levenberg-Marquardt from every point at once; four dampings are tried per step, active bounds respected.

    Parameters
    ----------
    view : Posterior
        Target.
    points : (n, n_dim) array
        Starts in the unit cube.
    n_iterations : int
        Largest number of steps; a candidate rests once it gains no more than 0.01 nat.
    held : (n_dim,) or (n, n_dim) boolean array, optional
        Coordinates that keep their values, of every candidate or of each.
    reach : float
        Candidates further below the best do not keep the others waiting. [nat]

    Returns
    -------
    points : (n, n_dim) array
    log_likelihood : (n,) array
        There.
    """
    points = _within(points, held)

    def fit(own: Posterior) -> tuple[Floats, ...]:
        local = own.linearise(points, _free(held, points))
        return _climb(own, points, local, n_iterations=n_iterations, held=held, reach=reach)[:2]

    found, reached = kept_fit(view, f"climb, {n_iterations} steps, reach {reach!r}", points, held, fit)
    return found, reached


def _climb(
    view: Posterior, points: Floats, local: Linearisation, *, n_iterations: int, held: Booleans | None, reach: float
) -> tuple[Floats, Floats, Linearisation, Booleans]:
    """See :func:`climb`; from the expansion at every candidate, with the last one, and which have moved since."""
    points, free = points.copy(), _free(held, points)
    scale = np.ones(len(points))
    moved, waits = np.zeros(len(points), dtype=np.bool_), np.ones(len(points), dtype=np.bool_)
    reached = local.log_likelihood.copy()
    for _ in range(n_iterations):
        near = reached > np.max(reached) - reach
        rows = np.flatnonzero(waits)
        local = _again(view, points, local, moved & waits, free)
        own = None if free is None else free[rows]
        trials = np.stack(
            [steps(points[rows], local[rows], damping * scale[rows], own) for damping in _DAMPINGS], axis=1
        )
        flat = trials.reshape(-1, trials.shape[-1])
        value = np.where(np.isfinite(view.log_prior(flat)), view.log_likelihood(flat), -np.inf).reshape(
            trials.shape[:2]
        )
        pick = np.argmax(value, axis=1)
        best = value[np.arange(len(rows)), pick]
        # A start that cannot be solved gains without end from any point that can.
        gain = np.where(np.isfinite(best), best, -1e300) - np.maximum(reached[rows], -1e299)
        better = gain > 0.0
        points[rows[better]] = trials[better, pick[better]]
        reached[rows[better]] = best[better]
        moved[rows] = better
        factor = np.where(better, np.where(pick == 0, 0.1, np.where(pick >= 2, 10.0, 1.0)), 100.0)
        scale[rows] = np.clip(scale[rows] * factor, 1e-6, 1e8)
        waits[rows] = (gain > 0.01) | ~(better | (scale[rows] > 1e3))
        if not np.any(near & waits):
            break
    return points, reached, local, moved


def _again(
    view: Posterior, points: Floats, local: Linearisation, moved: Booleans, free: Booleans | None
) -> Linearisation:
    """The expansions, taken anew where candidates have moved."""
    rows = np.flatnonzero(moved)
    if not len(rows):
        return local
    return local.with_rows(rows, view.linearise(points[rows], None if free is None else free[rows]))


def _within(points: Floats, held: Booleans | None) -> Floats:
    """Starts no closer to a face than steps go: one that is, as a draw may be, would be carried away by its first step.

    That loses hundreds of nats where a prior has a long tail, and the candidate stays where it was.
    """
    inside = np.clip(points, _EDGE, 1.0 - _EDGE)
    return inside if held is None else np.where(held, points, inside)


def _free(held: Booleans | None, points: Floats) -> Booleans | None:
    return None if held is None else ~np.broadcast_to(held, points.shape)


def steps(points: Floats, local: Linearisation, damping: Floats, allowed: Booleans | None) -> Floats:
    """One damped Gauss-Newton step of every candidate inside the cube, coordinates held at bounds they press on.

    A candidate whose derivatives ran away stays where it is.
    """
    trials = points.copy()
    free = ~_pressing(points, local.gradient) & (True if allowed is None else allowed)
    diagonal = np.einsum("npp->np", local.information)
    with np.errstate(over="ignore", invalid="ignore"):
        ridge = damping[:, None] * np.maximum(diagonal, 1.0) + 1e-9
    known = np.isfinite(local.gradient).all(axis=1) & np.isfinite(local.information).all(axis=(1, 2))
    known &= np.isfinite(ridge).all(axis=1)
    waiting = np.flatnonzero(np.any(free, axis=1) & known)
    for _ in range(3):
        if len(waiting) == 0:
            break
        own, point = free[waiting], points[waiting]
        matrix = local.information[waiting] * (own[:, :, None] & own[:, None, :])
        # A held coordinate has an equation of its own: no step.
        np.einsum("npp->np", matrix)[:] += np.where(own, ridge[waiting], 1.0)
        step = np.linalg.solve(matrix, np.where(own, local.gradient[waiting], 0.0)[:, :, None])[:, :, 0]
        aim = point + step
        trials[waiting] = np.where(own, np.clip(aim, _EDGE, 1.0 - _EDGE), point)
        blocked = own & ((aim < _EDGE) | (aim > 1.0 - _EDGE))
        hit = blocked & ((point < 2.0 * _EDGE) | (point > 1.0 - 2.0 * _EDGE))
        again = np.any(hit, axis=1) & np.any(blocked != own, axis=1)
        free[waiting] = own & ~hit
        waiting = waiting[again & np.any(free[waiting], axis=1)]
    return trials


def outlook(view: Posterior, points: Floats, local: Linearisation) -> Floats:
    """Log likelihood ``(n,)`` that a Gauss-Newton step from each point leads to at most, by its own expansion."""
    step = steps(points, local, np.full(len(points), _DAMPINGS[0]), None) - points
    promised = np.einsum("np,np->n", step, local.gradient - 0.5 * np.einsum("npq,nq->np", local.information, step))
    return np.asarray(local.log_likelihood + view.most(np.maximum(promised, 0.0)))


def turned_inwards(target: Target, mode: Mode) -> Mode:
    """The expansion at a best fit as a proposal can use it where a joint condition of the prior holds the fit back.

    Its Newton step leads out of the admissible region, and a normal distribution about its end has no draw inside. From
    the condition inwards the posterior falls by one nat over ``1 / |gradient|``: so much more is known, and no step is
    made.
    """
    aim = steps(mode.point[None], expansion_of((mode,)), np.full(1, _DAMPINGS[0]), None)
    if np.isfinite(target.log_prior(aim)[0]):
        return mode
    outwards = np.where(_pressing(mode.point, mode.gradient), 0.0, mode.gradient)
    return replace(mode, gradient=mode.gradient - outwards, information=mode.information + np.outer(outwards, outwards))


def held_back(view: Posterior, mode: Mode) -> tuple[Constraint, float] | None:
    """The joint condition that a step from a best fit would break, and the nats that it promises; None where none."""
    local, point = expansion_of((mode,)), mode.point[None]
    values = view.space.from_unit(steps(point, local, np.full(1, _DAMPINGS[0]), None))
    broken = [condition for condition in view.space.constraints if not condition.holds(values)[0]]
    gain = float(outlook(view, point, local)[0]) - mode.log_likelihood
    return (broken[0], gain) if broken else None


def _pressing(point: Floats, gradient: Floats) -> Booleans:
    """Coordinates at a bound whose gradient points outwards."""
    return ((point <= 2.0 * _EDGE) & (gradient < 0.0)) | ((point >= 1.0 - 2.0 * _EDGE) & (gradient > 0.0))


def distinct(points: Floats, local: Linearisation) -> tuple[Mode, ...]:
    """Optima further than one posterior standard deviation apart, best first."""
    modes: list[Mode] = []
    for index in np.argsort(-local.log_likelihood):
        if not np.isfinite(local.log_likelihood[index]):
            continue
        candidate = Mode(
            point=points[index],
            log_likelihood=float(local.log_likelihood[index]),
            gradient=local.gradient[index],
            information=local.information[index],
        )
        if all(_distance(candidate, mode) > 1.0 for mode in modes):
            modes.append(candidate)
    return tuple(modes)


def expansion_of(modes: Sequence[Mode]) -> Linearisation:
    """The expansions at some optima as one."""
    return Linearisation(
        log_likelihood=np.array([mode.log_likelihood for mode in modes]),
        gradient=np.array([mode.gradient for mode in modes]),
        information=np.array([mode.information for mode in modes]),
    )


def _distance(candidate: Mode, mode: Mode) -> float:
    step = candidate.point - mode.point
    return float(np.sqrt(max(float(step @ mode.information @ step), 0.0)))
