"""One door to every method, with the catalogue's doubts about a model that is sampled."""

from __future__ import annotations

from collections.abc import Sequence

from bwbn_bayes.discovery.alternatives import alternatives_check
from bwbn_bayes.errors import require_kind
from bwbn_bayes.inference.history import Listener
from bwbn_bayes.inference.likelihood import Noise
from bwbn_bayes.inference.method import Task
from bwbn_bayes.inference.registry import method, require_possible
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.records.record import Record, require_record
from bwbn_bayes.results import Result
from bwbn_bayes.structures.structure import Structure, require_structure


def identify(
    model: Structure,
    record: Record,
    *,
    settings: Settings | None = None,
    noise: Noise | None = None,
    options: object = None,
    unnamed_force: bool = False,
    name: str = "model",
    assumptions: Sequence[str] = (),
    listener: Listener | None = None,
) -> Result:
    """Identify a model from a record by any method.

    Parameters
    ----------
    model : Structure
        With priors on the parameters to identify. IPV uses its masses only.
    record : Record
        Measured channels under one excitation, or several records of the structure
        (:func:`~bwbn_bayes.records.joined.join_records`).
    settings : Settings, optional
        Method, engine, seed, number of draws.
    noise : Noise, optional
        How the noise scale enters a posterior, by default integrated out under the priors of
        :func:`~bwbn_bayes.inference.likelihood.default_noise`; the baselines have none.
    options : GeneticSettings or IpvSettings, optional
        A baseline's own; the paper's by default.
    unnamed_force : bool
        Whether a force of no known law stands beside the model, a Gaussian process in every storey, so that all
        intervals know of model error (:mod:`bwbn_bayes.inference.unnamed.beside`). Of one record, under integrated
        white noise; the checks still are those of the model alone.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted; printed in the report.
    listener : callable, optional
        Told what is being done.

    Returns
    -------
    Result
        ``ga`` gives one point, ``ipv`` forces only, the others a posterior.

    Raises
    ------
    UserError
        If an argument is of another kind, nothing is to be identified, the record measures nothing, record and model do
        not belong together, the options are another method's, its library is not installed, or it can do no such thing.
    """
    require_structure(model)
    require_record(record)
    settings = Settings() if settings is None else settings
    require_kind("settings", settings, Settings, "give Settings(...), or leave them out")
    require_possible(settings.method, unnamed_force=unnamed_force, checkpoint=settings.checkpoint)
    task = Task(
        model=model,
        record=record,
        settings=settings,
        noise=noise,
        options=options,
        unnamed_force=unnamed_force,
        name=name,
        assumptions=assumptions,
        listener=listener,
        beside=alternatives_check if settings.alternatives else None,
    )
    return method(settings.method).identify(task)
