"""Many integrals over one variable at once, each on panels as narrow as its integrand asks for.

A rule with fixed nodes steps over a peak narrower than their distance and reports no error. Here panels begin at marks
where peaks may lie and are halved until two rules agree on each, and until no peak can hide between two nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bwbn_bayes.parameters import Booleans, Floats

Rows = NDArray[np.int64]
LogDensity = Callable[[Rows, Floats], Floats]
"""Log density ``(n, n_nodes)`` of some rows ``(n,)`` at abscissas ``(n, n_nodes)``."""

_COARSE, _FINE = (np.polynomial.legendre.leggauss(n) for n in (8, 16))
_LOG_TOLERANCE = float(np.log(1e-7))
"""Largest difference between the two rules on a panel, as a share of its row's integral; the finer is far better."""
_LARGEST_STEP = 10.0
"""Largest change of the log density between two nodes: beyond, a peak between them may be missed. [nat]"""
_NEGLIGIBLE = 40.0
"""A panel this far below its row's largest counts for nothing. [nat]"""
_DEPTH = 40
"""Halvings at most: at a jump of the density, what is left then has a width of 1e-12."""
_CELLS = 128
"""Cells of a panel that is drawn from; within a cell a draw is uniform."""


class Panels(NamedTuple):
    """Resolved panels ``(n,)`` of ``n_rows`` rows, ordered: row, ends, log of the integral in units of ``largest``."""

    row: Rows
    low: Floats
    high: Floats
    log_mass: Floats
    largest: Floats

    @property
    def log_integral(self) -> Floats:
        """Log of the integral of each row ``(n_rows,)``; minus infinity where it has no mass."""
        with np.errstate(divide="ignore"):
            share = np.bincount(self.row, np.exp(self.log_mass), len(self.largest))
            return np.asarray(self.largest + np.log(share))

    def draw(self, log_density: LogDensity, rng: np.random.Generator) -> Floats:
        """One abscissa ``(n_rows,)`` from each row's density; not a number where a row has no mass."""
        n_rows = len(self.largest)
        which, where, inside = rng.random((3, n_rows))
        first = np.searchsorted(self.row, np.arange(n_rows + 1))
        reached = np.append(0.0, np.cumsum(np.exp(self.log_mass)))
        below, above = reached[first[:-1]], reached[first[1:]]
        rows = np.flatnonzero(above > below)
        panel = np.searchsorted(reached, (below + which * (above - below))[rows], side="right") - 1
        # Rounding of the sums may carry a draw into the next row.
        panel = np.clip(panel, first[rows], first[rows + 1] - 1)
        low, width = self.low[panel], (self.high - self.low)[panel]
        density = log_density(rows, low[:, None] + width[:, None] * (np.arange(_CELLS) + 0.5) / _CELLS)
        within = np.cumsum(np.exp(density - np.max(density, axis=1, keepdims=True)), axis=1)
        cell = np.sum(within < where[rows, None] * within[:, -1:], axis=1)
        result = np.full(n_rows, np.nan)
        result[rows] = low + width * (cell + inside[rows]) / _CELLS
        return result


def resolve(log_density: LogDensity, edges: Floats) -> Panels:
    """Panels on which the rows' densities are integrated to rounding.

    Parameters
    ----------
    log_density : callable
        Of the rows.
    edges : (n_rows, n_edges) array
        Ascending in each row; peaks narrower than the distances between edges have edges beside them.

    Returns
    -------
    Panels
        Those of a row cover what lies between its edges.
    """
    row = np.repeat(np.arange(len(edges)), edges.shape[1] - 1)
    low, high = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    wide = high > low
    row, low, high = row[wide], low[wide], high[wide]
    largest = np.full(len(edges), -np.inf)
    done = []
    for depth in range(_DEPTH):
        log_mass, log_error, log_bound, step = _tried(log_density, row, low, high)
        np.maximum.at(largest, row, log_mass)
        top = largest[row]
        settled = (log_error <= top + _LOG_TOLERANCE) & (step <= _LARGEST_STEP)
        settled |= (log_bound < top - _NEGLIGIBLE) | (depth == _DEPTH - 1)
        done.append((row[settled], low[settled], high[settled], log_mass[settled]))
        row, low, high = _halved(row, low, high, ~settled)
        if not len(row):
            break
    row, low, high, log_mass = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.lexsort((low, row))
    relative = log_mass - np.where(np.isfinite(largest), largest, 0.0)[row]
    return Panels(row[order], low[order], high[order], relative[order], largest)


def _tried(log_density: LogDensity, row: Rows, low: Floats, high: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Of each panel: log integral, log of its error, a bound of the log integral, largest step between nodes."""
    half = 0.5 * (high - low)
    nodes = np.concatenate([_COARSE[0], _FINE[0]])
    density = log_density(row, low[:, None] + half[:, None] * (1.0 + nodes))
    with np.errstate(divide="ignore", invalid="ignore"):
        coarse, fine = (
            logsumexp(part + np.log(rule[1]), axis=1) + np.log(half)
            for part, rule in zip(np.split(density, [len(_COARSE[0])], axis=1), (_COARSE, _FINE), strict=True)
        )
        ordered = density[:, np.argsort(nodes)]
        step = np.nan_to_num(np.max(np.abs(np.diff(ordered, axis=1)), axis=1), nan=0.0, posinf=np.inf)
        larger = np.maximum(coarse, fine)
        log_error = np.where(larger > -np.inf, larger + np.log(-np.expm1(-np.abs(fine - coarse))), -np.inf)
    return fine, log_error, np.max(density, axis=1) + step + np.log(2.0 * half), step


def _halved(row: Rows, low: Floats, high: Floats, chosen: Booleans) -> tuple[Rows, Floats, Floats]:
    """Both halves of each chosen panel."""
    row, low, high = row[chosen], low[chosen], high[chosen]
    middle = 0.5 * (low + high)
    return np.concatenate([row, row]), np.concatenate([low, middle]), np.concatenate([middle, high])
