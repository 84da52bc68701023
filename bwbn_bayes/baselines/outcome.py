"""From a point estimate, or from learned forces, to the :class:`~bwbn_bayes.results.Result` every report reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from bwbn_bayes.baselines.genetic import GeneticFit, GeneticSettings
from bwbn_bayes.baselines.ipv import HIGH_PASS_HZ, ForceFit, force_noise_sd, kinematics
from bwbn_bayes.engines.base import masses
from bwbn_bayes.inference.arrays import (
    constant_dataset,
    observed_dataset,
    parameter_dataset,
    response_dataset,
)
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.residuals import residual_checks
from bwbn_bayes.inference.summary import (
    conventions,
    fit_error,
    force_agreement,
    observe,
    predicted_channels,
    provenance_of,
    true_histories,
)
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.noise import noise_sds
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Check, Equation, Facts, ParameterFacts, Result, StageFacts
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.quantities import engineering_quantities, landmarks_of, storey_parameters
from bwbn_bayes.structures.structure import Structure

NAN = float("nan")
SETTLED = 0.02
"""Spread of a population, in the unit cube, below which it has settled."""
IDENTITY = 0.01
"""Departure of learned from measured forces below which a network adds nothing to the measurement."""


def genetic_result(
    posterior: Posterior,
    fit: GeneticFit,
    *,
    settings: GeneticSettings,
    seed: int,
    name: str,
    assumptions: Sequence[str],
    stages: tuple[StageFacts, ...],
    elapsed_s: float,
) -> Result:
    """The best individual with its response; no posterior, no intervals, no evidence.

    Parameters
    ----------
    posterior : Posterior
        Model, record and the engine for the final response.
    fit : GeneticFit
        What the search found.
    settings : GeneticSettings
        How it searched.
    seed : int
        Of the run.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted.
    stages : tuple of StageFacts
        One for each generation.
    elapsed_s : float
        Time of the search. [s]

    Returns
    -------
    Result
        Groups ``estimate`` (one variable per symbol), ``prediction`` (one variable per channel), ``history``
        (``best``, ``median``, ``spread`` by ``generation``) and the common ones without ``posterior``.
    """
    record, model = posterior.record, posterior.model
    values = model.space.from_unit(fit.point[None])
    rows = observe(posterior.engine, model, values, record)
    signals = predicted_channels(model, record, rows)
    truth = true_histories(model, record)
    checks = (*residual_checks(posterior, fit.point), _settled(fit))
    facts = Facts(
        method="ga",
        model=name,
        record=record.name,
        engine=posterior.engine.name,
        seed=seed,
        parameters=_point_facts(model, record, fit.point, values[0]),
        log_evidence=NAN,
        log_evidence_se=NAN,
        nrmse=fit_error(record, signals[0]),
        noise_sd=_residual_sd(record, signals[0]),
        n_solves=fit.n_solves,
        n_stages=len(stages),
        elapsed_s=elapsed_s,
        effective_sample_size=NAN,
        storeys=model.n_links,
        verdict=_genetic_verdict(fit, checks),
        checks=checks,
        stages=stages,
        equations=tuple(Equation(caption=e.caption, mathml=e.mathml) for e in structure_equations(model, record)),
        assumptions=(*assumptions, *model.warnings, _genetic_words(settings), *conventions(model)),
        discretisation={"scheme": posterior.engine.scheme},
        restoring_force=force_agreement(rows["restoring_force"][0], truth),
        provenance=provenance_of(record, seed, posterior.engine),
    )
    storeys = list(range(1, model.n_links + 1))
    response = response_dataset(rows, record, storeys)
    by_storey = storey_parameters(model, values)
    groups = {
        **_measurement(model, record, storeys, signals[0], truth),
        "estimate": parameter_dataset(model.space.parameters, values, model.n_links),
        "history": _history(fit),
        "response": response,
        "parameters_by_storey": by_storey,
    }
    if not model.is_driven:
        known = landmarks_of(response, model.law, by_storey, [run.start for _, run in record.runs])
        groups["quantities"] = engineering_quantities(
            known, by_storey, model.masses, model.law, model.heights, model.joints
        )
    return Result(tree=xr.DataTree.from_dict(groups), facts=facts)


def forces_result(
    model: Structure,
    record: Record,
    fit: ForceFit,
    *,
    seed: int,
    name: str,
    assumptions: Sequence[str],
    provenance: Mapping[str, str],
    elapsed_s: float,
) -> Result:
    """Learned storey forces and how far they are the measurement itself; no parameters.

    Parameters
    ----------
    model : Structure
        Gives the masses and, where the record knows the true parameters, the true forces to compare with.
    record : Record
        What the networks were trained on.
    fit : ForceFit
        The networks and their forces.
    seed : int
        Of the run.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted.
    provenance : mapping of str to str
        Label to text.
    elapsed_s : float
        Time of the training. [s]

    Returns
    -------
    Result
        ``response`` holds the learned ``restoring_force`` and the drifts it is drawn against.
    """
    mass = masses(model)
    drift, rate = kinematics(record, model.n_links)
    rows = {"drift": drift[None], "drift_rate": rate[None], "restoring_force": fit.forces[None]}
    truth = true_histories(model, record)
    floors = range(1, model.n_links + 1)
    accelerations = record.select([f"acceleration_{floor}" for floor in floors])
    signals = np.diff(fit.forces, axis=0, append=np.zeros((1, record.n_times))) / mass[:, None]
    noise_sd = dict(zip(accelerations.channels, noise_sds(accelerations).tolist(), strict=True))
    checks = _force_checks(fit)
    facts = Facts(
        method="ipv",
        model=name,
        record=record.name,
        engine="none",
        seed=seed,
        parameters=(),
        log_evidence=NAN,
        log_evidence_se=NAN,
        nrmse=fit_error(accelerations, signals),
        noise_sd=noise_sd,
        n_solves=0,
        n_stages=0,
        elapsed_s=elapsed_s,
        effective_sample_size=NAN,
        storeys=model.n_links,
        verdict=_force_verdict(fit),
        identifiability=_amplification(fit, noise_sd, mass),
        checks=checks,
        assumptions=(*assumptions, *_force_words(fit)),
        restoring_force=force_agreement(rows["restoring_force"][0], truth),
        provenance=provenance,
    )
    storeys = list(floors)
    groups = {
        **_measurement(model, accelerations, storeys, signals, truth),
        "response": response_dataset(rows, record, storeys),
    }
    return Result(tree=xr.DataTree.from_dict(groups), facts=facts)


def _measurement(
    model: Structure, record: Record, storeys: list[int], signals: Floats, truth: Mapping[str, Floats] | None
) -> dict[str, xr.Dataset]:
    time = {"time": record.times}
    predicted = {channel: ("time", signals[i]) for i, channel in enumerate(record.channels)}
    groups = {
        "observed_data": observed_dataset(record),
        "prediction": xr.Dataset(predicted, coords=time),
        "constant_data": constant_dataset(model, record),
    }
    if truth is not None:
        groups["true_response"] = response_dataset(truth, record, storeys).isel(draw=0)
    return groups


def _point_facts(model: Structure, record: Record, point: Floats, values: Floats) -> tuple[ParameterFacts, ...]:
    return tuple(
        ParameterFacts(
            name=parameter.name,
            symbol=parameter.symbol,
            unit=parameter.unit,
            prior=str(parameter.prior),
            mean=float(values[i]),
            sd=NAN,
            hdi90=(NAN, NAN),
            true=record.truth.get(parameter.name),
            flag="at a bound" if min(point[i], 1.0 - point[i]) < 1e-3 else "",
        )
        for i, parameter in enumerate(model.space.parameters)
    )


def _residual_sd(record: Record, signals: Floats) -> dict[str, float]:
    return dict(zip(record.channels, np.std(record.measured - signals, axis=1).tolist(), strict=True))


def _history(fit: GeneticFit) -> xr.Dataset:
    names = ("best", "median", "spread")
    columns = {name: ("generation", [getattr(g, name) for g in fit.generations]) for name in names}
    return xr.Dataset(columns, coords={"generation": [g.number for g in fit.generations]})


def _settled(fit: GeneticFit) -> Check:
    spread = fit.generations[-1].spread
    return Check(
        name="population settled",
        value=spread,
        limit=SETTLED,
        passed=spread < SETTLED,
        sentence=f"The last generation still spreads over {spread:.3f} of the unit cube (0.29 before the search).",
    )


def _genetic_verdict(fit: GeneticFit, checks: Sequence[Check]) -> tuple[str, str]:
    first = (
        f"The genetic algorithm's best individual leaves {fit.objective:.3g} of the objective (1 for each channel left "
        "unexplained); it is one point, without intervals and without evidence."
    )
    failed = [check.sentence for check in checks if not check.passed]
    second = f"Read it with care: {' '.join(failed)}" if failed else f"It passed all {len(checks)} of its checks."
    return first, second


def _genetic_words(settings: GeneticSettings) -> str:
    shares = ", ".join(f"{share:g}" for share in settings.windows)
    return (
        f"Genetic algorithm: population {settings.population}, elite {settings.elite}, crossover "
        f"{settings.crossover:g}, {settings.generations} generations after the first, judged by these shares of the "
        f"record in turn: {shares}."
    )


def _force_checks(fit: ForceFit) -> tuple[Check, ...]:
    if fit.variant != "printed":
        return ()
    largest = float(np.max(fit.departure))
    return (
        Check(
            name="identity map",
            value=largest,
            limit=IDENTITY,
            passed=largest < IDENTITY,
            sentence=f"The learned forces depart from sums of measured accelerations by at most {100 * largest:.2g} % "
            "of their rms (eqs. 21 to 23 make the two equal).",
        ),
    )


def _force_verdict(fit: ForceFit) -> tuple[str, str]:
    first = "The networks give the history of every storey's force, and no parameter of any model."
    if fit.variant == "printed":
        return first, (
            "With the printed inputs they repeat sums of the measured accelerations, noise included: the force costs a "
            "sum, and nothing can be predicted that was not measured."
        )
    share = ", ".join(f"{100 * value:.2g} %" for value in fit.departure)
    return first, (
        f"As functions of drift and drift rate they miss {share} of the measured force (storeys from the ground up): "
        "such a function has no memory, and a hysteretic force has."
    )


def _amplification(fit: ForceFit, noise_sd: Mapping[str, float], mass: Floats) -> tuple[str, ...]:
    """How much noise the sums of accelerations carry, against the force."""
    force_sd, rms = force_noise_sd(noise_sd, mass), np.sqrt(np.mean(np.square(fit.measured_forces), axis=1))
    shares = ", ".join(f"{100 * share:.2g} %" for share in force_sd / rms)
    return (
        f"Independent noise of the floors adds up to {shares} of the measured force's rms, storeys from the ground up.",
    )


def _force_words(fit: ForceFit) -> tuple[str, ...]:
    sizes = ", ".join(str(len(network.widths)) for network in fit.networks)
    inputs = {
        "printed": "relative acceleration, ground acceleration and the learned force above",
        "drift": "drift and drift rate",
    }[fit.variant]
    return (
        f"IPV: inputs {inputs}; {sizes} hidden neurons (storeys from the ground up), chosen by validation.",
        "The networks are trained on the record alone; the true force never enters. The force holds the viscous part.",
        f"Drifts not measured are integrated accelerations without what is slower than {HIGH_PASS_HZ:g} Hz.",
    )
