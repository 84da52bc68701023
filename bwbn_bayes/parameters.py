"""Parameters and their priors.

A :class:`Parameter` is physics: symbol, unit, neutral value, admissible range, source. A prior belongs to the
model that uses the parameter. :class:`ParameterSpace` joins the identified parameters of one model and maps them
to the unit cube, in which every prior is uniform.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, fields
from functools import cached_property
from numbers import Real
from typing import Any, override

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats
from scipy.stats import qmc

from bwbn_bayes.errors import UserError

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]


def is_number(given: object) -> bool:
    """Whether something is a real number; neither text nor a truth value is."""
    return isinstance(given, Real) and not isinstance(given, bool)


def is_list(given: object) -> bool:
    """Whether something has its entries in an order: text, sets and mappings are read otherwise than was meant."""
    is_one = getattr(given, "ndim", 1) == 0  # an array without dimensions says that it is iterable
    return isinstance(given, Iterable) and not is_one and not isinstance(given, (str, bytes, Mapping, AbstractSet))


def require_number(name: str, given: object) -> None:
    """Raise :class:`UserError` unless something is a number of double precision."""
    if not is_number(given):
        raise UserError(f"{name} is {given!r}: give a number")
    if isinstance(given, int) and abs(given) > sys.float_info.max:
        raise UserError(f"{name} is larger than any number of double precision")


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A physical parameter as the literature knows it.

    Parameters
    ----------
    symbol : str
        The literature's symbol, e.g. ``delta_nu``.
    unit : str
        Unit in SI, e.g. ``1/J``; ``""`` where dimensionless.
    neutral : float
        The value at which the parameter's effect vanishes (for a nuisance: a harmless stand-in).
    lower, upper : float
        Admissible range, both ends included. Priors that reach outside are truncated to it.
    description : str
        What it is, in field words.
    source : str
        Where it was defined.
    """

    symbol: str
    unit: str
    neutral: float
    lower: float = -np.inf
    upper: float = np.inf
    description: str = ""
    source: str = ""


@dataclass(frozen=True)
class Prior:
    """Base of all priors: a thin, immutable face on a SciPy distribution."""

    @property
    def distribution(self) -> Any:
        """The frozen SciPy distribution behind this prior."""
        raise NotImplementedError

    @cached_property
    def _frozen(self) -> Any:
        return self.distribution

    @property
    def support(self) -> tuple[float, float]:
        """Lower and upper end of the support."""
        lower, upper = self._frozen.support()
        return float(lower), float(upper)

    @property
    def mean(self) -> float:
        """Prior mean."""
        return float(self._frozen.mean())

    @property
    def sd(self) -> float:
        """Prior standard deviation."""
        return float(self._frozen.std())

    def quantile(self, probability: Floats | float) -> Floats:
        """Value below which the given prior probability lies."""
        return np.asarray(self._frozen.ppf(probability), dtype=np.float64)

    def probability(self, value: Floats | float) -> Floats:
        """Prior probability below a value."""
        return np.asarray(self._frozen.cdf(value), dtype=np.float64)

    def log_density(self, value: Floats | float) -> Floats:
        """Log prior density, minus infinity outside the support."""
        return np.asarray(self._frozen.logpdf(value), dtype=np.float64)

    def truncated(self, lower: float, upper: float) -> Prior:
        """Restrict the prior to ``[lower, upper]`` and normalise it; itself where nothing is cut."""
        where = f"prior {self} truncated"
        require_number(f"{where}: lower", lower)
        require_number(f"{where}: upper", upper)
        if not lower < upper:
            raise UserError(
                f"{where} to [{lower:g}, {upper:g}]: the lower bound comes first and must lie below the upper"
            )
        own_lower, own_upper = self.support
        if lower <= own_lower and own_upper <= upper:
            return self
        if not self.probability(upper) - self.probability(lower) > 0.0:
            raise UserError(
                f"prior {self} has no mass in the admissible range [{lower:g}, {upper:g}]: choose one that reaches it"
            )
        return Truncated(self, lower, upper)


@dataclass(frozen=True)
class Uniform(Prior):
    """Uniform between two bounds."""

    lower: float
    upper: float

    def __post_init__(self) -> None:
        _require_numbers(self)
        if not (np.isfinite(self.lower) and np.isfinite(self.upper) and self.lower < self.upper):
            raise UserError(
                f"Uniform({self.lower}, {self.upper}): the lower bound must lie below the upper, both finite"
            )
        if float(self.upper) - float(self.lower) == np.inf:
            raise UserError(f"Uniform({self.lower}, {self.upper}): the bounds are too far apart, bring them nearer")

    @property
    @override
    def distribution(self) -> Any:
        return stats.uniform(self.lower, self.upper - self.lower)

    # Written out, here and below: SciPy's checks cost more than the arithmetic, and samplers ask for small batches.
    @property
    @override
    def support(self) -> tuple[float, float]:
        return float(self.lower), float(self.upper)

    @override
    def quantile(self, probability: Floats | float) -> Floats:
        return self.lower + np.asarray(probability, dtype=np.float64) * (self.upper - self.lower)

    @override
    def probability(self, value: Floats | float) -> Floats:
        return np.clip((np.asarray(value, dtype=np.float64) - self.lower) / (self.upper - self.lower), 0.0, 1.0)

    @override
    def log_density(self, value: Floats | float) -> Floats:
        inside = (np.asarray(value) >= self.lower) & (np.asarray(value) <= self.upper)
        return np.where(inside, -np.log(self.upper - self.lower), -np.inf)

    def __str__(self) -> str:
        return f"Uniform({self.lower:g}, {self.upper:g})"


@dataclass(frozen=True)
class Normal(Prior):
    """Normal with mean and standard deviation."""

    location: float
    scale: float

    def __post_init__(self) -> None:
        _require_numbers(self)
        _require_positive(self, "scale", self.scale)
        if not np.isfinite(self.location):
            raise UserError(f"{self}: location must be a finite number")

    @property
    @override
    def distribution(self) -> Any:
        return stats.norm(self.location, self.scale)

    @property
    @override
    def support(self) -> tuple[float, float]:
        return -np.inf, np.inf

    @override
    def quantile(self, probability: Floats | float) -> Floats:
        return np.asarray(self.location + self.scale * special.ndtri(probability))

    @override
    def probability(self, value: Floats | float) -> Floats:
        return np.asarray(special.ndtr((np.asarray(value) - self.location) / self.scale))

    @override
    def log_density(self, value: Floats | float) -> Floats:
        standard = (np.asarray(value) - self.location) / self.scale
        return np.asarray(-0.5 * np.square(standard) - _log_normalisation(self.scale))

    def __str__(self) -> str:
        return f"Normal({self.location:g}, {self.scale:g})"


@dataclass(frozen=True)
class HalfNormal(Prior):
    """Half-normal on the positive axis with the scale of its parent normal."""

    scale: float

    def __post_init__(self) -> None:
        _require_numbers(self)
        _require_positive(self, "scale", self.scale)

    @property
    @override
    def distribution(self) -> Any:
        return stats.halfnorm(0.0, self.scale)

    @property
    @override
    def support(self) -> tuple[float, float]:
        return 0.0, np.inf

    @override
    def quantile(self, probability: Floats | float) -> Floats:
        return np.asarray(self.scale * np.sqrt(2.0) * special.erfinv(probability))

    @override
    def probability(self, value: Floats | float) -> Floats:
        return np.asarray(special.erf(np.maximum(value, 0.0) / (self.scale * np.sqrt(2.0))))

    @override
    def log_density(self, value: Floats | float) -> Floats:
        value = np.asarray(value)
        log_density = np.log(2.0) - 0.5 * np.square(value / self.scale) - _log_normalisation(self.scale)
        return np.where(value >= 0.0, log_density, -np.inf)

    def __str__(self) -> str:
        return f"HalfNormal({self.scale:g})"


@dataclass(frozen=True)
class LogNormal(Prior):
    """Log-normal with median and logarithmic standard deviation."""

    median: float
    log_sd: float

    def __post_init__(self) -> None:
        _require_numbers(self)
        _require_positive(self, "median", self.median)
        _require_positive(self, "log_sd", self.log_sd)

    @property
    @override
    def distribution(self) -> Any:
        return stats.lognorm(self.log_sd, scale=self.median)

    @property
    @override
    def support(self) -> tuple[float, float]:
        return 0.0, np.inf

    @override
    def quantile(self, probability: Floats | float) -> Floats:
        return np.asarray(self.median * np.exp(self.log_sd * special.ndtri(probability)))

    @override
    def probability(self, value: Floats | float) -> Floats:
        with np.errstate(divide="ignore"):
            standard = np.log(np.maximum(value, 0.0) / self.median) / self.log_sd
        return np.asarray(special.ndtr(standard))

    @override
    def log_density(self, value: Floats | float) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithm = np.log(np.asarray(value, dtype=np.float64))
            standard = (logarithm - np.log(self.median)) / self.log_sd
            log_density = -0.5 * np.square(standard) - logarithm - _log_normalisation(self.log_sd)
        return np.where(np.asarray(value) > 0.0, log_density, -np.inf)

    def __str__(self) -> str:
        return f"LogNormal({self.median:g}, {self.log_sd:g})"


@dataclass(frozen=True)
class Truncated(Prior):
    """Another prior restricted to an interval and normalised."""

    parent: Prior
    lower: float
    upper: float

    @cached_property
    def _masses(self) -> tuple[float, float]:
        return float(self.parent.probability(self.lower)), float(self.parent.probability(self.upper))

    @property
    @override
    def support(self) -> tuple[float, float]:
        lower, upper = self.parent.support
        return max(lower, self.lower), min(upper, self.upper)

    @property
    @override
    def mean(self) -> float:
        return float(np.mean(self._midpoint_values))

    @property
    @override
    def sd(self) -> float:
        return float(np.std(self._midpoint_values))

    @cached_property
    def _midpoint_values(self) -> Floats:
        return self.quantile((np.arange(4096) + 0.5) / 4096)

    @override
    def quantile(self, probability: Floats | float) -> Floats:
        low, high = self._masses
        # Rounding may carry a quantile just outside.
        return np.clip(self.parent.quantile(low + np.asarray(probability) * (high - low)), *self.support)

    @override
    def probability(self, value: Floats | float) -> Floats:
        low, high = self._masses
        return np.clip((self.parent.probability(value) - low) / (high - low), 0.0, 1.0)

    @override
    def log_density(self, value: Floats | float) -> Floats:
        low, high = self._masses
        lower, upper = self.support
        inside = (np.asarray(value) >= lower) & (np.asarray(value) <= upper)
        return np.where(inside, self.parent.log_density(value) - np.log(high - low), -np.inf)

    def __str__(self) -> str:
        return f"{self.parent} on [{self.support[0]:g}, {self.support[1]:g}]"


def _log_normalisation(scale: float) -> float:
    return float(np.log(scale) + 0.5 * np.log(2.0 * np.pi))


def _require_numbers(prior: Prior) -> None:
    for one in fields(prior):
        require_number(f"{type(prior).__name__}: {one.name}", getattr(prior, one.name))


def _require_positive(prior: Prior, name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise UserError(f"{type(prior).__name__}: {name} is {value}, it must be a positive number")


@dataclass(frozen=True)
class PerStorey:
    """One value or prior for each storey: ``PerStorey(Uniform(5, 60))`` or ``PerStorey([10.0, 20.0, 40.0])``."""

    value: float | Prior | tuple[float | Prior, ...]

    def __init__(self, value: float | Prior | Sequence[float | Prior]) -> None:
        if isinstance(value, Iterable) and not is_list(value):
            raise UserError(
                f"PerStorey({value!r}): give a list with a number or a prior for each storey, or one for all"
            )
        frozen = tuple(value) if isinstance(value, Iterable) else value
        object.__setattr__(self, "value", frozen)

    def at(self, position: int, n_storeys: int) -> float | Prior:
        """The value at a position (from 0) among ``n_storeys``."""
        if not isinstance(self.value, tuple):
            return self.value
        if len(self.value) != n_storeys:
            raise UserError(f"PerStorey holds {len(self.value)} values for {n_storeys} storeys: give one for each")
        return self.value[position]


Value = float | Prior | PerStorey
"""A known number, a prior (identified), or one of either for each storey."""


@dataclass(frozen=True, kw_only=True)
class FreeParameter:
    """A parameter that is to be identified: its label in results, its prior, its unit and where it acts."""

    name: str
    symbol: str
    unit: str
    prior: Prior
    storeys: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """A joint condition on the parameters, such as ``beta + gamma > 0``.

    ``holds`` takes draws ``(n_draws, n_parameters)`` in the parameters' own units and returns ``(n_draws,)``;
    ``columns`` are those it looks at.
    """

    text: str
    holds: Callable[[Floats], Booleans]
    columns: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ParameterSpace:
    """The identified parameters of a model, their joint prior and its map to the unit cube.

    Every prior is uniform on the unit cube. Joint constraints cut a region out of it; the prior is normalised over
    what is left by a scrambled Sobol quadrature (2**15 points, fixed seed), so that evidences compare.
    """

    parameters: tuple[FreeParameter, ...]
    constraints: tuple[Constraint, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Labels, e.g. ``("k[1]", "k[2]", "alpha")``."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def n_dim(self) -> int:
        """Number of identified parameters."""
        return len(self.parameters)

    def from_unit(self, points: Floats) -> Floats:
        """Map points of the unit cube ``(n_draws, n_parameters)`` to the parameters' own units."""
        columns = [p.prior.quantile(points[:, i]) for i, p in enumerate(self.parameters)]
        return np.stack(columns, axis=1) if columns else np.zeros_like(points)

    def to_unit(self, values: Floats) -> Floats:
        """Map parameter values ``(n_draws, n_parameters)`` to the unit cube."""
        columns = [p.prior.probability(values[:, i]) for i, p in enumerate(self.parameters)]
        return np.stack(columns, axis=1) if columns else np.zeros_like(values)

    def unit_scale(self, values: Floats) -> Floats:
        """Derivative of the parameters' own values with respect to the unit coordinate, ``(n_draws, n_parameters)``."""
        columns = [np.exp(-p.prior.log_density(values[:, i])) for i, p in enumerate(self.parameters)]
        return np.stack(columns, axis=1) if columns else np.zeros_like(values)

    def admissible(self, values: Floats) -> Booleans:
        """Whether each draw ``(n_draws, n_parameters)`` satisfies every joint constraint."""
        ok = np.ones(len(values), dtype=np.bool_)
        for constraint in self.constraints:
            ok &= constraint.holds(values)
        return ok

    @cached_property
    def log_admissible_mass(self) -> float:
        """Log prior mass of the admissible region before normalisation."""
        if not self.constraints or not self.parameters:
            return 0.0
        # Over the parameters concerned alone: a model with more of the others is normalised by the same number.
        columns = sorted({column for constraint in self.constraints for column in constraint.columns})
        points = qmc.Sobol(len(columns), rng=np.random.default_rng(20190101)).random_base2(15)
        values = np.zeros((len(points), self.n_dim))
        for column, position in zip(columns, points.T, strict=True):
            values[:, column] = self.parameters[column].prior.quantile(position)
        share = float(np.mean(self.admissible(values)))
        if share == 0.0:
            texts = "; ".join(constraint.text for constraint in self.constraints)
            raise UserError(f"no point of the prior is admissible ({texts}): widen or move the priors")
        return float(np.log(share))

    def log_prior_unit(self, points: Floats) -> Floats:
        """Log density of the joint prior on the unit cube: constant inside, minus infinity outside."""
        inside = np.all((points >= 0.0) & (points <= 1.0), axis=1)
        result = np.full(len(points), -np.inf)
        if np.any(inside):
            ok = self.admissible(self.from_unit(points[inside]))
            result[inside] = np.where(ok, -self.log_admissible_mass, -np.inf)
        return result

    def sample_unit(self, rng: np.random.Generator, n_draws: int) -> Floats:
        """Draw ``(n_draws, n_parameters)`` points of the unit cube from the joint prior."""
        accepted = np.empty((0, self.n_dim))
        self.log_admissible_mass  # noqa: B018  (raises where nothing is admissible, before the loop below could spin)
        while len(accepted) < n_draws:
            points = rng.random((n_draws, self.n_dim))
            accepted = np.concatenate([accepted, points[self.admissible(self.from_unit(points))]])
        return accepted[:n_draws]
