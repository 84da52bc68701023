"""Run one case and measure it: forces against the noise-free truth and the noisy record, parameters, prediction."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bwbn_bayes.baselines.ipv import fit_forces, predict
from bwbn_bayes.engines.base import masses
from bwbn_bayes.engines.lanes import Lanes, usable_processors
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.identification import identify
from bwbn_bayes.inference.likelihood import KnownNoise
from bwbn_bayes.inference.registry import METHODS
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import path_correlation, processor_name
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.noise import add_noise
from bwbn_bayes.records.record import Record
from bwbn_bayes.reproduction.cases import STOREYS, Case, Excitation, building, excitation_of, truth_of
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.results import Facts, Result
from bwbn_bayes.structures.structure import Structure

_ACCELERATIONS = tuple(f"acceleration_{i}" for i in STOREYS)
_CLEAN_CHANNELS = (*_ACCELERATIONS, *(f"drift_{i}" for i in STOREYS), *(f"force_{i}" for i in STOREYS))
_FINE = Lanes(substeps=4, resolution=0.06)
_N_PREDICTED = 100
_REDUNDANT = 0.9

_METHODS: Mapping[str, str] = {"IPV": "ipv", "GA": "ga", "TMCMC": "tmcmc"}

Numbers = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a case gave.

    Attributes
    ----------
    case : Case
    seed : int
    elapsed_s : float
        Time of the method alone, without making the record. [s]
    n_solves : int
    force : mapping of str to mapping
        Per storey: ``R_t_truth``, ``R_x_truth``, ``R_t_noisy``, ``R_x_noisy`` (correlations of the identified force
        with the noise-free truth and with the sum of noisy accelerations) and ``nrmse`` against the truth.
    parameters : mapping of str to mapping
        Per label: ``true``, ``value``, ``sd``, ``low``, ``high`` (90 %) and ``cramer_rao``; NaN where not given.
    redundant : mapping of str to float
        With A free: posterior correlation of each parameter with A where it exceeds 0.9 in size.
    other : mapping of str to float
        Prediction of the noise-free response under the other excitation: ``nrmse`` (largest of the floors) and, with a
        posterior, ``coverage`` of its 90 % intervals; empty where not asked for or impossible.
    drift_variant : mapping of str to float
        For IPV: ``nrmse`` of the force learned from drift and drift rate, ``other_nrmse`` of its prediction.
    remarks : tuple of str
        The method's verdict on itself.
    processor : str
        On which it ran, and how many of its cores there were.
    """

    case: Case
    seed: int
    elapsed_s: float
    n_solves: int
    force: Mapping[str, Numbers]
    parameters: Mapping[str, Numbers] = field(default_factory=dict)
    redundant: Numbers = field(default_factory=dict)
    other: Numbers = field(default_factory=dict)
    drift_variant: Numbers = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    processor: str = "unknown processor"

    @property
    def coverage(self) -> float:
        """Share of the parameters whose 90 % interval holds the true value; NaN without intervals."""
        inside = [p["low"] <= p["true"] <= p["high"] for p in self.parameters.values() if np.isfinite(p["low"])]
        return float(np.mean(inside)) if inside else float("nan")

    @property
    def digits(self) -> float:
        """Correct digits of the force: ``-log10`` of the largest NRMSE of the storeys."""
        return float(-np.log10(max(values["nrmse"] for values in self.force.values())))

    def as_json(self) -> dict[str, Any]:
        """Plain data for the cache."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Outcome:
        """What :meth:`as_json` wrote."""
        return cls(**{**data, "case": Case(**data["case"]), "remarks": tuple(data["remarks"])})


@dataclass(frozen=True, kw_only=True)
class Histories:
    """Noise-free drift [m], true and identified force [N] of a case, each ``(n_storeys, n_times)``."""

    drift: Floats
    true: Floats
    identified: Floats


def run_case(
    case: Case,
    options: Options,
    seed: int,
    *,
    predicts: bool,
    say: Callable[[str], None] | None = None,
    checkpoint: Path | None = None,
) -> tuple[Outcome, Histories]:
    """Identify a case's building and compare with what is true and with what is printed.

    Parameters
    ----------
    case : Case
    options : Options
    seed : int
        Of the noise and the method.
    predicts : bool
        Whether to predict the response under the other excitation too.
    say : callable, optional
        Told what is being done.
    checkpoint : Path, optional
        Where what is solved is kept meanwhile.
    """
    clean = clean_record(building(case, options, identified=False), case.excitation, options)
    record = add_noise(clean.select(_ACCELERATIONS), case.snr_db, np.random.default_rng(seed))
    model = building(case, options, identified=True)
    method = _METHODS[case.method]
    checkpoint = checkpoint if METHODS[method].keeps else None
    result = identify(
        model,
        record,
        settings=Settings(
            method=method, seed=seed, particles=options.particles, checkpoint=checkpoint, alternatives=False
        ),
        noise=_floor(record, options) if case.snr_db is None else None,
        options=options.genetic if method == "ga" else None,
        name=case.key,
        listener=None if say is None else lambda text, _facts: say(text),
    )
    found = _mean_force(result)
    parameters = _parameters(case, result.facts, model, record, options)
    outcome = Outcome(
        case=case,
        seed=seed,
        elapsed_s=result.facts.elapsed_s,
        n_solves=result.facts.n_solves,
        force=_agreement(found, clean, record.storey_forces(masses(model))),
        parameters=parameters,
        redundant=_redundant(result, model) if options.free_a and case.method == "TMCMC" else {},
        other=_prediction(case, options, result, model) if predicts and case.method != "IPV" else {},
        drift_variant=_drift_variant(case, options, clean, seed) if predicts and case.method == "IPV" else {},
        remarks=result.facts.verdict,
        processor=f"{processor_name()}, {usable_processors()} cores",
    )
    drift, true = (np.stack([clean.channels[f"{kind}_{i}"] for i in STOREYS]) for kind in ("drift", "force"))
    return outcome, Histories(drift=drift, true=true, identified=found)


def _mean_force(result: Result) -> Floats:
    """Identified restoring force ``(n_storeys, n_times)``: the posterior's mean, or that of a point estimate."""
    if "response_bands" in result.tree.children:
        force = _group(result, "response_bands")["restoring_force"].sel(statistic="mean")
    else:
        force = _group(result, "response")["restoring_force"].isel(draw=0)
    return np.asarray(force.transpose("storey", "time").values, dtype=np.float64)


@cache
def clean_record(model: Structure, excitation: Excitation, options: Options) -> Record:
    """Noise-free accelerations, drifts and forces of a known building by the reference engine."""
    return simulate(model, excitation_of(excitation, options), {}, channels=_CLEAN_CHANNELS)


def _floor(record: Record, options: Options) -> KnownNoise:
    rms = [float(np.sqrt(np.mean(np.square(signal)))) for signal in record.channels.values()]
    return KnownNoise(sd=tuple(options.error_floor * value for value in rms))


def _agreement(found: Floats, clean: Record, noisy: Floats) -> dict[str, dict[str, float]]:
    result = {}
    for i, storey in enumerate(STOREYS):
        true, drift = clean.channels[f"force_{storey}"], clean.channels[f"drift_{storey}"]
        result[str(storey)] = {
            "R_t_truth": float(np.corrcoef(found[i], true)[0, 1]),
            "R_x_truth": path_correlation(found[i], true, drift),
            "R_t_noisy": float(np.corrcoef(found[i], noisy[i])[0, 1]),
            "R_x_noisy": path_correlation(found[i], noisy[i], drift),
            "nrmse": float(np.sqrt(np.mean(np.square(found[i] - true)) / np.mean(np.square(true)))),
        }
    return result


def _parameters(
    case: Case, facts: Facts, model: Structure, record: Record, options: Options
) -> dict[str, dict[str, float]]:
    if not facts.parameters:
        return {}
    truth = truth_of(case)
    noise = _floor(record, options).sd if case.snr_db is None else tuple(record.noise_sd.values())
    bounds = dict(zip(model.space.names, cramer_rao_sd(model, truth, record, noise), strict=True))
    return {
        p.name: {
            "true": truth[p.name],
            "value": p.mean,
            "sd": p.sd,
            "low": p.hdi90[0],
            "high": p.hdi90[1],
            "cramer_rao": float(bounds[p.name]),
        }
        for p in facts.parameters
    }


_UNSEEN = 1e-10
"""Share of the information in a direction, and of a parameter's in such a direction, that rounding may leave."""


def cramer_rao_sd(model: Structure, truth: Mapping[str, float], record: Record, noise_sd: tuple[float, ...]) -> Floats:
    """Smallest standard deviation of an unbiased estimate of each parameter, ``(n_parameters,)`` in its own unit.

    Parameters
    ----------
    model : Structure
    truth : mapping of str to float
        Where the Fisher information is taken.
    record : Record
        Its channels and excitation.
    noise_sd : tuple of float
        White noise of each channel. [unit of the channel]

    Returns
    -------
    array
        Infinite where a parameter takes part in a direction that the record cannot see; bounds of the priors are not
        taken into account.
    """
    draws = model.draws({name: truth[name] for name in model.space.names})
    information = _FINE.normal_equations(model, draws, record).information[0]
    total = np.einsum("c,cpq->pq", 1.0 / np.square(noise_sd), information)
    scale = np.sqrt(np.diag(total))
    values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
    seen = values > _UNSEEN
    variance = np.square(vectors[:, seen]) @ (1.0 / values[seen])
    hidden = np.sum(np.square(vectors[:, ~seen]), axis=1) > _UNSEEN
    return np.asarray(np.where(hidden, np.inf, np.sqrt(variance) / scale))


def _group(result: Result, name: str) -> xr.Dataset:
    return result.tree.children[name].to_dataset()


def _draws(group: xr.Dataset, model: Structure) -> Floats:
    """Parameter draws ``(n, n_parameters)`` from a group with one variable per symbol."""
    columns = []
    for parameter in model.space.parameters:
        values = group[parameter.symbol]
        own = [dim for dim in values.dims if dim not in ("chain", "draw")]
        if own:
            values = values.sel({own[0]: parameter.storeys[0]})
        columns.append(values.values.ravel())
    return np.column_stack(columns).astype(np.float64)


def _redundant(result: Result, model: Structure) -> dict[str, float]:
    draws = _draws(_group(result, "posterior"), model)
    correlation = np.atleast_2d(np.corrcoef(draws, rowvar=False))
    with_a = correlation[model.space.names.index("A")]
    return {
        name: float(r) for name, r in zip(model.space.names, with_a, strict=True) if name != "A" and abs(r) > _REDUNDANT
    }


def _other(excitation: Excitation) -> Excitation:
    return "ElCentro" if excitation == "Sin" else "Sin"


def _prediction(case: Case, options: Options, result: Result, model: Structure) -> dict[str, float]:
    """The same building, its damages at the same times, under the other excitation."""
    clean = clean_record(building(case, options, identified=False), _other(case.excitation), options)
    true = np.stack([clean.channels[channel] for channel in _ACCELERATIONS])
    has_posterior = "posterior" in result.tree.children
    draws = _draws(_group(result, "posterior" if has_posterior else "estimate"), model)
    chosen = draws[np.linspace(0, len(draws) - 1, min(_N_PREDICTED, len(draws))).astype(np.int64)]
    values = _FINE.simulate(model, chosen, clean, _ACCELERATIONS).values
    found = {"nrmse": _largest_nrmse(np.mean(values, axis=0), true)}
    if has_posterior:
        low, high = np.quantile(values, [0.05, 0.95], axis=0)
        found["coverage"] = float(np.mean((true >= low) & (true <= high)))
    return found


def _largest_nrmse(found: Floats, true: Floats) -> float:
    return float(np.max(np.sqrt(np.mean(np.square(found - true), axis=1) / np.mean(np.square(true), axis=1))))


def _drift_variant(case: Case, options: Options, clean: Record, seed: int) -> dict[str, float]:
    """IPV with drift and drift rate: full state measurement is assumed, drifts are noisy as the accelerations are."""
    model = building(case, options, identified=False)
    channels = [*_ACCELERATIONS, *(f"drift_{i}" for i in STOREYS)]
    record = add_noise(clean.select(channels), case.snr_db, np.random.default_rng(seed))
    began = time.perf_counter()
    fit = fit_forces(record, masses(model), np.random.default_rng(seed), variant="drift")
    elapsed = time.perf_counter() - began
    other = clean_record(model, _other(case.excitation), options)
    true = np.stack([other.channels[channel] for channel in _ACCELERATIONS])
    forces = np.stack([clean.channels[f"force_{i}"] for i in STOREYS])
    predicted = predict(fit, masses(model), replace(other, channels={}, noise_sd={})).acceleration
    return {
        "nrmse": _largest_nrmse(fit.forces, forces),
        "other_nrmse": _largest_nrmse(predicted, true),
        "elapsed_s": elapsed,
    }
