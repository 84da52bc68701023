"""What is known of the unnamed force at the end: where it acts, how likely it is, its share and its shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.outcome import UnnamedForce
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.probability import POSSIBLE, Beliefs
from bwbn_bayes.discovery.where import storey_in_words
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.state_function import StateForce
from bwbn_bayes.inference.unnamed.storey import Neighbourhood, over_time


def unnamed_facts(pool: Pool, believed: Beliefs) -> UnnamedForce | None:
    """The unnamed force of the most probable explanation that has one; None where one is less likely than not."""
    chosen = next((one for one in believed.explanations if one.has_unnamed), None)
    if believed.unnamed < POSSIBLE or chosen is None:
        return None
    tell = _of_specimen if pool.shared is not None else _of_storey
    return tell(chosen, believed.unnamed)


def _of_specimen(one: Explanation, probability: float) -> UnnamedForce:
    """Its expectation given what the law leaves."""
    evidence, record = one.evidence, one.posterior.record
    assert evidence.correlation is not None
    residual = residual_of(evidence.posterior, evidence.modes[0].point)[0]
    force = evidence.correlation.shared_part(residual)[record.kept]
    measured = record.channels["force"][record.kept]
    return UnnamedForce(
        storey=1,
        place=storey_in_words(one.model, 1),
        probability=probability,
        share=float(np.std(force) / np.sqrt(np.mean(np.square(measured)))),
        state=record.excitation[record.kept],
        force=force,
    )


def _of_storey(one: Explanation, probability: float) -> UnnamedForce:
    """What is expected of it, in the storey where it is the largest share of the force."""
    found, record = one.estimate, one.posterior.record
    assert found is not None
    if isinstance(found, StateForce):
        values = one.posterior.split(one.best[None])[0]
        rows = {kind: own[0] for kind, own in observe(one.posterior.engine, one.model, values, record).items()}
        forces = {found.storey: found.effect.force(found.weights, rows[found.effect.state][found.storey - 1])}
    else:
        posterior = one.evidence.posterior
        here = Neighbourhood(posterior=posterior, point=found.point, share=UNNAMED_SCALE, forces=found.forces)
        if not np.isfinite(here.log_likelihood):  # what is right to first order need not be solvable as a whole
            here = replace(here, point=one.evidence.modes[0].point, forces={})
        rows = here.rows
        forces = {at: over_time(force, record, one.model) for at, force in found.forces.items()}
    whole = np.sqrt(np.mean(np.square(rows["restoring_force"]), axis=1))
    shares = {at: float(np.sqrt(np.mean(np.square(force)))) / whole[at - 1] for at, force in forces.items()}
    storey = max(shares, key=lambda at: shares[at])
    over = found.effect.state if isinstance(found, StateForce) else ""
    return UnnamedForce(
        storey=storey,
        place=storey_in_words(one.model, storey) if len(shares) == 1 else "every storey",
        probability=probability,
        share=shares[storey],
        function=found.kind,
        over=over,
        state=rows[over or "drift"][storey - 1][record.kept],
        force=forces[storey][record.kept],
    )
