"""Squared residuals and their derivatives under the correlation of a record's errors, from what an engine answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bwbn_bayes.engines.base import Engine, NormalEquations
from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.blocks import counts, mean_squares
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


def squared_residuals(
    engine: Engine,
    model: Structure,
    values: Floats,
    record: Record,
    correlation: Correlation | None,
) -> Floats:
    """Sums ``(n_draws, n_blocks)`` of squared whitened residuals; infinite where the solve failed.

    Parameters
    ----------
    engine, model, record : Engine, Structure, Record
    values : (n_draws, n_parameters) array
        In the parameters' own units.
    correlation : Correlation or None
        Of the samples' errors; none where they are independent.
    """
    if correlation is None:
        return engine.misfit(model, values, record)
    return squares_of(record, engine.simulate(model, values, record).values, correlation)


def squares_of(record: Record, response: Floats, correlation: Correlation | None) -> Floats:
    """The same of responses ``(n_draws, n_channels, n_times)``."""
    with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away misses by infinity
        misfit = squares(record, record.where_counted(record.measured - response), correlation)
    return np.where(np.isfinite(misfit), misfit, np.inf)


def squares(record: Record, rows: Floats, correlation: Correlation | None) -> Floats:
    """Sums ``(n, n_blocks)`` of squares of rows ``(n, n_channels, n_times)``, whitened."""
    if correlation is None:
        return np.asarray(mean_squares(record, rows) * counts(record))
    return correlation.squares(rows)


def normal_equations(
    engine: Engine,
    model: Structure,
    values: Floats,
    record: Record,
    correlation: Correlation | None,
    free: Booleans | None = None,
) -> NormalEquations:
    """Least squares of whitened residuals and derivatives; ``free`` as in :meth:`Engine.normal_equations`."""
    if correlation is None:
        return engine.normal_equations(model, values, record, free=free)
    response, slopes = engine.sensitivities(model, values, record, free=free)
    slopes = slopes if free is None else np.where(free[:, :, None, None], slopes, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        rows = np.concatenate([(record.measured - response.values)[:, None], slopes], axis=1)
        found = correlation.equations(record.where_counted(rows))
        return replace(found, misfit=np.where(np.isfinite(found.misfit), found.misfit, np.inf))
