"""The PyMC twin of each prior: the same density, support and normalisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal, Normal, Prior, Truncated, Uniform


def prior_twin(name: str, priors: Sequence[Prior], dims: str | None = None) -> pt.TensorVariable:
    """Add a random variable with the given priors to the PyMC model of the context.

    Parameters
    ----------
    name : str
        Name of the variable.
    priors : sequence of Prior
        One for each element of a vector; a single one where ``dims`` is None.
    dims : str, optional
        Dimension of the vector.

    Returns
    -------
    TensorVariable
        A free variable; for priors of different families a Deterministic that stacks ``name_1``, ``name_2`` and so on.

    Raises
    ------
    UserError
        If a prior is of a kind that has no twin.
    """
    if dims is None:
        return _distribution(priors, vector=False, name=name)
    if len({_family(prior) for prior in priors}) == 1:
        return _distribution(priors, vector=True, name=name, dims=dims)
    parts = [
        _distribution([prior], vector=False, name=f"{name}_{place}") for place, prior in enumerate(priors, start=1)
    ]
    return pm.Deterministic(name, pt.stack(parts), dims=dims)


def _family(prior: Prior) -> tuple[object, ...]:
    """Priors of one family fit into one vector: their bounds are finite or infinite together."""
    if isinstance(prior, Truncated):
        return (Truncated, *_family(prior.parent), *np.isfinite(prior.support))
    return (type(prior),)


def _distribution(
    priors: Sequence[Prior], *, vector: bool, name: str | None = None, dims: str | None = None
) -> pt.TensorVariable:
    """A variable where a name is given, an unnamed distribution otherwise."""

    def each(read: Callable[[Any], float]) -> Floats:
        # Arrays also where one number would do: PyTensor makes single precision of a Python float that fits into it.
        numbers = np.array([read(prior) for prior in priors], dtype=np.float64)
        return numbers if vector else numbers.reshape(())

    first = priors[0]
    arguments: dict[str, object]
    if isinstance(first, Uniform):
        kind, arguments = pm.Uniform, {"lower": each(lambda p: p.lower), "upper": each(lambda p: p.upper)}
    elif isinstance(first, Normal):
        kind, arguments = pm.Normal, {"mu": each(lambda p: p.location), "sigma": each(lambda p: p.scale)}
    elif isinstance(first, HalfNormal):
        kind, arguments = pm.HalfNormal, {"sigma": each(lambda p: p.scale)}
    elif isinstance(first, LogNormal):
        kind = pm.LogNormal
        arguments = {"mu": each(lambda p: np.log(p.median)), "sigma": each(lambda p: p.log_sd)}
    elif isinstance(first, Truncated):
        kind = pm.Truncated
        lower, upper = each(lambda p: p.support[0]), each(lambda p: p.support[1])
        arguments = {
            "dist": _distribution([p.parent for p in priors if isinstance(p, Truncated)], vector=vector),
            "lower": lower if np.all(np.isfinite(lower)) else None,
            "upper": upper if np.all(np.isfinite(upper)) else None,
        }
    else:
        raise UserError(
            f"prior {first} has no PyMC twin: use Uniform, Normal, HalfNormal or LogNormal, or give the parameter a "
            "variable of your own"
        )
    if name is None:
        return kind.dist(**arguments)
    return kind(name, **arguments) if dims is None else kind(name, **arguments, dims=dims)
