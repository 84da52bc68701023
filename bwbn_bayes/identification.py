"""One door to every method: the samplers, whose models the catalogue is held against, and the baselines."""

from __future__ import annotations

from collections.abc import Sequence

from bwbn_bayes.baselines.genetic import GeneticSettings
from bwbn_bayes.baselines.ipv import Variant
from bwbn_bayes.baselines.methods import identify_by_networks, identify_by_search
from bwbn_bayes.discovery.alternatives import alternatives_check
from bwbn_bayes.inference.history import Listener
from bwbn_bayes.inference.identify import identify as identify_by_sampling
from bwbn_bayes.inference.likelihood import Noise
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Result
from bwbn_bayes.structures.structure import Structure


def identify(
    model: Structure,
    record: Record,
    *,
    settings: Settings | None = None,
    noise: Noise | None = None,
    genetic: GeneticSettings | None = None,
    ipv: Variant = "printed",
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
        Measured channels under one excitation.
    settings : Settings, optional
        Method, engine, seed, number of draws.
    noise : Noise, optional
        How the noise scale enters a posterior; the baselines have none.
    genetic : GeneticSettings, optional
        Options of ``ga``; the paper's by default.
    ipv : {"printed", "drift"}
        Inputs of ``ipv``.
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
        If nothing is to be identified, the record measures nothing, or record and model do not belong together.
    """
    settings = settings or Settings()
    if settings.method == "ga":
        return identify_by_search(model, record, settings, genetic or GeneticSettings(), name, assumptions, listener)
    if settings.method == "ipv":
        return identify_by_networks(model, record, settings, ipv, name, assumptions, listener)
    return identify_by_sampling(
        model,
        record,
        settings=settings,
        noise=noise,
        name=name,
        assumptions=assumptions,
        listener=listener,
        beside=alternatives_check,
    )
