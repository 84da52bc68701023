"""The one result every method returns and every report reads: a DataTree of arrays and a dataclass of facts.

Groups of the tree (dimensions in brackets; ``floor`` and ``storey`` count from 1; units are attributes, that of
``time`` is ``1`` where the record is a path, whose points it counts; ``draw`` is a draw's number in the posterior, also
where a group holds a part of them):

``posterior``, ``prior``
    one variable per parameter symbol: ``alpha (chain, draw)``, ``k (chain, draw, storey)``; and
    ``noise_sd (chain, draw, channel)``, drawn for each draw where the likelihood integrates it out
``sample_stats``
    ``lp (chain, draw)``: log likelihood and log prior density
``log_likelihood``
    ``measured (chain, draw, channel, time)``: of every sample that counts given draw and noise scale, for a subset of
    the draws; of a long record, of every stretch of samples, at the time of its first. ``az.loo`` reads it,
    ``az.loo_pit`` reads it with the next two where it is of every sample. Behind a filter samples are not independent:
    the sum then exceeds what the likelihood counts
``observed_data``
    ``measured (channel, time)``
``posterior_predictive``
    ``measured (chain, draw, channel, time)``: noise included, for the same draws; of a long record a few of them
``constant_data``
    the excitation ``(time)``; a building's ``mass (floor)``, the nodes that its links join, ``joins (link, end)``, and,
    where given, ``height (storey)``;
    ``measured_storey_force (storey, time)`` where masses and sensors allow
``response_bands``
    ``drift, drift_rate, restoring_force, hysteretic_displacement, hysteretic_energy (statistic, storey, time)`` and
    ``acceleration (statistic, floor, time)``, noise-free: ``mean``, ``lower`` and ``upper`` (the 5 and 95 % quantiles)
    over a subset of the draws
``response``
    the same variables with ``draw`` in the place of ``statistic``: a few draws of that subset, 25 or, of a long record,
    down to 2
``predictive_bands``
    one variable per measured channel, noise included: ``(statistic, time)`` over the subset
``parameters_by_storey``
    ``k, c, alpha, ... (draw, storey)`` every parameter of the storey law for the subset
``quantities``
    what an engineer asks next, for the same subset (buildings): ``peak_drift, ... (draw, storey)``
    (``peak_drift_ratio`` where heights are given), ``modal_period, modal_damping_ratio (draw, mode)``,
    ``period (draw, time_point)``
``true_response``
    the same variables as ``response`` without ``draw``, where the truth is known

Methods without a posterior leave out ``posterior``, ``prior``, ``sample_stats``, bands and ``posterior_predictive``,
and give ``prediction`` (one variable per channel ``(time)``); the genetic algorithm also ``estimate`` (as
``posterior``, one draw) and ``history`` (``best, median, spread (generation)``).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Union, get_args, get_origin, get_type_hints

from bwbn_bayes.errors import UNREADABLE_ARRAYS, UserError, replace_file

if TYPE_CHECKING:
    import xarray as xr

SCHEMA = 1
POINTS = "1"
"""Unit of the coordinate ``time`` of a path without time."""
DOUBTS = ("quiet residual", "within the prior", "alternatives")
"""Checks whose failure puts a model that explains its record in doubt, and does not refuse it."""
_LEVEL, _WORTH_PACKING = 4, 4096


@dataclass(frozen=True, kw_only=True)
class ParameterFacts:
    """What is known of one identified parameter after the run."""

    name: str
    symbol: str
    unit: str
    prior: str
    mean: float
    sd: float
    hdi90: tuple[float, float]
    true: float | None = None
    flag: str = ""
    """Empty, ``"prior-bound"``, ``"unidentified"``, or for a point estimate ``"at a bound"``."""

    @property
    def z_score(self) -> float | None:
        """Distance of the posterior mean from the true value in posterior sds, where the truth is known."""
        if self.true is None or not self.sd > 0.0:
            return None
        return (self.mean - self.true) / self.sd


@dataclass(frozen=True, kw_only=True)
class StageFacts:
    """One stage of a sampler's history."""

    stage: int
    tempering_parameter: float
    acceptance: float
    effective_sample_size: float
    n_solves: int
    log_evidence: float
    elapsed_s: float
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One thing the method checked about itself: ``value`` against ``limit``, passed or not, in a sentence."""

    name: str
    value: float
    limit: float
    passed: bool
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Equation:
    """One equation of the model as presentation MathML."""

    caption: str
    mathml: str


@dataclass(frozen=True, kw_only=True)
class Facts:
    """Everything about a run that is not an array."""

    method: str
    """What produced the result: a sampler, ``ga`` (one point, sd and interval NaN) or ``ipv`` (forces only)."""
    model: str
    record: str
    engine: str
    seed: int
    parameters: tuple[ParameterFacts, ...]
    log_evidence: float
    log_evidence_se: float
    nrmse: Mapping[str, float]
    """Per channel: rms of (measured minus posterior mean prediction) over rms of the measured signal."""
    noise_sd: Mapping[str, float]
    """Per channel: posterior mean of the noise standard deviation."""
    n_solves: int
    n_stages: int
    elapsed_s: float
    effective_sample_size: float
    storeys: int
    verdict: tuple[str, ...] = ()
    """Two sentences: what was found, and whether it can be trusted."""
    identifiability: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()
    stages: tuple[StageFacts, ...] = ()
    equations: tuple[Equation, ...] = ()
    assumptions: tuple[str, ...] = ()
    discretisation: Mapping[str, Any] = field(default_factory=dict)
    """``scheme``, ``joint_shift_sd`` (posterior sds), ``log_likelihood_shift``, ``nrmse``."""
    restoring_force: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Per storey (``"1"``), against the true one: ``nrmse``, ``correlation_time`` and ``correlation_drift`` (R-x)."""
    evidences: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Log evidence and its standard error by road, e.g. ``importance``, ``tmcmc (bridge)``."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Versions, seed, data hash, processor: label to text."""

    @property
    def grade(self) -> str:
        """``"explains"``, ``"doubtful"`` or ``"refused"``: whether the model explains its record by the checks."""
        failed = [check.name for check in self.checks if not check.passed]
        if any(name.startswith("residual") for name in failed):
            return "refused"
        return "doubtful" if set(failed) & set(DOUBTS) else "explains"

    def as_json(self) -> dict[str, Any]:
        """``result.json``, schema 1; a number that is not finite becomes None, which JSON can hold."""
        facts: dict[str, Any] = {
            "schema": SCHEMA,
            "method": self.method,
            "model": self.model,
            "record": self.record,
            "engine": self.engine,
            "seed": self.seed,
            "parameters": {
                p.name: {
                    "mean": p.mean,
                    "sd": p.sd,
                    "hdi90": list(p.hdi90),
                    "true": p.true,
                    "unit": p.unit,
                    "flag": p.flag,
                }
                for p in self.parameters
            },
            "log_evidence": self.log_evidence,
            "log_evidence_se": self.log_evidence_se,
            "evidences": {road: list(pair) for road, pair in self.evidences.items()},
            "fit": {"nrmse": dict(self.nrmse)},
            "noise_sd": dict(self.noise_sd),
            "restoring_force": {storey: dict(values) for storey, values in self.restoring_force.items()},
            "grade": self.grade,
            "checks": [asdict(check) for check in self.checks],
            "discretisation": dict(self.discretisation),
            "effective_sample_size": self.effective_sample_size,
            "n_solves": self.n_solves,
            "n_stages": self.n_stages,
            "elapsed_s": self.elapsed_s,
        }
        return {key: finite(value) for key, value in facts.items()}


@dataclass(frozen=True, kw_only=True)
class Result:
    """Arrays (an ArviZ DataTree) and facts of one run."""

    tree: xr.DataTree
    facts: Facts

    def save(self, path: Path | str) -> None:
        """Write arrays and facts to one netCDF file.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        tree = self.tree.copy()
        tree.attrs["facts"] = json.dumps(asdict(self.facts))
        # By way of memory: HDF5 on a full disk ends in pages of its own.
        with tree.to_netcdf(engine="h5netcdf", encoding=_compression(tree)) as contents:
            replace_file(path, bytes(contents))

    @classmethod
    def load(cls, path: Path | str) -> Result:
        """Read what :meth:`save` wrote.

        Raises
        ------
        UserError
            If there is no such file, or another than a saved result.
        """
        # Here: facts are also read where no arrays are.
        import xarray as xr

        from bwbn_bayes.records.hdf5 import require_hdf5

        try:
            require_hdf5(path)
            tree = xr.open_datatree(path, engine="h5netcdf").load()
            raw = json.loads(tree.attrs.pop("facts"))
            facts = _built(Facts, raw)
        except FileNotFoundError:
            raise UserError(f"result file {path} does not exist: give the path of a saved result.nc") from None
        except UNREADABLE_ARRAYS as error:
            raise UserError(f"{path} is no saved result: give a result.nc that Result.save wrote") from error
        return cls(tree=tree, facts=facts)


def _compression(tree: xr.DataTree) -> dict[str, dict[str, dict[str, Any]]]:
    """How each group's large arrays are packed; bytes of like significance side by side halve smooth histories."""
    packed = {"zlib": True, "complevel": _LEVEL, "shuffle": True}
    return {
        node.path: {str(name): packed for name, array in node.variables.items() if array.nbytes > _WORTH_PACKING}
        for node in tree.subtree
    }


def _built(kind: Any, raw: Any) -> Any:
    """A value of an annotated kind from what JSON keeps of it; TypeError where it is of another."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return raw
    if is_dataclass(kind) and isinstance(kind, type):
        kinds = get_type_hints(kind)
        return kind(**{name: _built(kinds[name], value) for name, value in dict(raw).items()})
    if origin is Union or origin is UnionType:
        return None if raw is None and NoneType in inner else _built(inner[0], raw)
    if origin is tuple and isinstance(raw, list):
        each = (inner[0],) * len(raw) if inner[-1] is Ellipsis else inner
        return tuple(_built(one, value) for one, value in zip(each, raw, strict=True))
    if origin is Mapping and isinstance(raw, dict):
        return {key: _built(inner[1], value) for key, value in raw.items()}
    if kind is float and type(raw) in (int, float):
        return float(raw)
    if type(raw) is kind:
        return raw
    raise TypeError(f"{raw!r} is no {kind}")


def finite(value: Any) -> Any:
    """The same nest of mappings and lists with None for numbers that JSON cannot hold."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
