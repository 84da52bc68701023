"""Intelligent Parameter Varying as a method: forces by networks, no parameters."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.baselines.ipv import Variant, fit_forces
from bwbn_bayes.baselines.outcome import forces_result
from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.base import masses, require_usable
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.method import Task
from bwbn_bayes.inference.summary import provenance_of
from bwbn_bayes.records.record import require_whole
from bwbn_bayes.results import Result


@dataclass(frozen=True, kw_only=True)
class IpvSettings:
    """Inputs of the networks: as printed in the paper, or drifts."""

    variant: Variant = "printed"


class ByNetworks:
    """The storeys' forces by radial basis networks; its options are :class:`IpvSettings`."""

    def identify(self, task: Task) -> Result:
        """Train a network for each storey."""
        options = IpvSettings() if task.options is None else task.options
        if not isinstance(options, IpvSettings):
            raise UserError(f"the options of method ipv are IpvSettings, not {type(options).__name__}")
        model, record, settings, listener = task.model, task.record, task.settings, task.listener
        if model.is_driven:
            raise UserError("IPV needs a ShearBuilding: in a specimen the force is measured, there is none to learn")
        if not model.is_chain or record.forces:
            raise UserError(
                "IPV needs storeys alone under a moving ground: it cannot tell a brace or an applied force apart"
            )
        require_usable(model, record)
        require_whole(record)
        if listener is not None:
            listener("training a radial basis network for each storey", None)
        began = time.perf_counter()
        fit = fit_forces(record, masses(model), np.random.default_rng(settings.seed), variant=options.variant)
        elapsed = time.perf_counter() - began
        return forces_result(
            model,
            record,
            fit,
            seed=settings.seed,
            name=task.name,
            assumptions=task.assumptions,
            provenance=provenance_of(record, settings.seed, engine_by_name(settings.engine)),
            elapsed_s=elapsed,
        )
