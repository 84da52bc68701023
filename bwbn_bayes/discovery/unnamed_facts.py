"""What is known of the unnamed force at the end: where it acts, how likely it is, its share and its shape."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.outcome import UnnamedForce
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.probability import POSSIBLE, Beliefs
from bwbn_bayes.discovery.unnamed_storey import force_of
from bwbn_bayes.discovery.where import storey_in_words
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.inference.summary import observe


def unnamed_facts(pool: Pool, believed: Beliefs) -> UnnamedForce | None:
    """The unnamed force of the most probable explanation that has one; None where one is less likely than not."""
    chosen = next((one for one in believed.explanations if one.is_fitted_with_unnamed), None)
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
        drift=record.excitation[record.kept],
        force=force,
    )


def _of_storey(one: Explanation, probability: float) -> UnnamedForce:
    """The force that its weights make of the states of their optimum."""
    assert one.unnamed is not None
    storey, posterior = one.unnamed[0], one.evidence.posterior
    values, _ = posterior.split(one.evidence.modes[0].point[None])
    rows = observe(posterior.engine, posterior.model, values, posterior.record)
    histories = {kind: history[0, storey - 1] for kind, history in rows.items()}
    parameters = dict(
        zip(
            (p.symbol for p in posterior.model.law.parameters),
            posterior.model.table.local(values)[0, storey - 1],
            strict=False,
        )
    )
    force = force_of(parameters, histories)
    whole = float(np.sqrt(np.mean(np.square(histories["restoring_force"]))))
    return UnnamedForce(
        storey=storey,
        place=storey_in_words(one.model, storey),
        probability=probability,
        share=float(np.sqrt(np.mean(np.square(force)))) / whole,
        drift=histories["drift"],
        force=force,
    )
