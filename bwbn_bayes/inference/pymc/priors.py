"""The PyMC twin of each prior: the same density, support and normalisation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pymc as pm
import pytensor.tensor as pt

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, LogNormal, Normal, Prior, Truncated, Uniform


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

    def each(numbers: Sequence[float]) -> object:
        return np.array(numbers, dtype=np.float64) if vector else float(numbers[0])

    first = priors[0]
    arguments: dict[str, object]
    if isinstance(first, Uniform):
        kind = pm.Uniform
        arguments = {"lower": each([p.support[0] for p in priors]), "upper": each([p.support[1] for p in priors])}
    elif isinstance(first, Normal):
        kind = pm.Normal
        arguments = {"mu": each([p.location for p in priors]), "sigma": each([p.scale for p in priors])}
    elif isinstance(first, HalfNormal):
        kind, arguments = pm.HalfNormal, {"sigma": each([p.scale for p in priors])}
    elif isinstance(first, LogNormal):
        kind = pm.LogNormal
        arguments = {"mu": each([np.log(p.median) for p in priors]), "sigma": each([p.log_sd for p in priors])}
    elif isinstance(first, Truncated):
        kind = pm.Truncated
        ends = [each([p.support[end] for p in priors]) for end in (0, 1)]
        lower, upper = (end if np.all(np.isfinite(end)) else None for end in ends)
        parent = _distribution([p.parent for p in priors], vector=vector)
        arguments = {"dist": parent, "lower": lower, "upper": upper}
    else:
        raise UserError(
            f"prior {first} has no PyMC twin: use Uniform, Normal, HalfNormal or LogNormal, or give the parameter a "
            "variable of your own"
        )
    if name is None:
        return kind.dist(**arguments)
    return kind(name, **arguments) if dims is None else kind(name, **arguments, dims=dims)
