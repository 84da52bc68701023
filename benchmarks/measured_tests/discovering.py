"""``discover`` on a measured test, and the one place that knows what it hands back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.measured_tests.specimens import MeasuredTest, both_errors, nrmse
from bwbn_bayes import Discovery, DiscoverySettings, discover, starting_model
from bwbn_bayes.elements.loops import pinching_index, strength_lost_per_cycle
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import repeated_samples
from bwbn_bayes.records.record import Record

PINCHES = ("slip_lock", "foliente_pinching")
SURE = 0.9
"""Probability from which an effect is named."""
PINCHED = 0.25
"""Pinching index of the identified loop below which it is called pinched."""

_FINE = Lanes(substeps=8, resolution=0.03)
"""The engine that draws the identified response: finer than any search."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect that an answer holds.

    Attributes
    ----------
    name : str
    storeys : tuple of int
    probability : float or None
        That it is part of the model; None where the answer's schema has none.
    identified : float or None
        Posterior mean of its signature, where the answer has one.
    """

    name: str
    storeys: tuple[int, ...]
    probability: float | None
    identified: float | None

    @property
    def is_named(self) -> bool:
        """Whether it is named with confidence; an answer without probabilities names whatever it holds."""
        return self.probability is None or self.probability >= SURE


@dataclass(frozen=True, kw_only=True)
class Kin:
    """Effects of which an answer says that one or another is there."""

    title: str
    names: tuple[str, ...]
    probability: float


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What this benchmark takes from ``discovery.json``.

    Attributes
    ----------
    verdict : str
    probability : float or None
        Of the verdict.
    effects : tuple of Effect
    families : tuple of Kin
    fit, held_out : float or None
        Errors [%] of the best model; None where there is none, or where the prediction runs away.
    seconds : float
    """

    verdict: str
    probability: float | None
    effects: tuple[Effect, ...]
    families: tuple[Kin, ...]
    fit: float | None
    held_out: float | None
    seconds: float


def read_answer(facts: Mapping[str, Any]) -> Answer:
    """Read ``discovery.json``, of schema 2 or 1.

    Parameters
    ----------
    facts : mapping
        The parsed file.
    """
    best, gap = facts.get("best_model") or {}, facts["gap"]
    errors = {part: best.get(part, (gap.get(part) or {}).get("after")) for part in ("fit", "held_out")}
    return Answer(
        verdict=facts["verdict"],
        probability=facts.get("verdict_probabilities", {}).get(facts["verdict"]),
        effects=tuple(
            Effect(
                name=effect["name"],
                storeys=tuple(effect["storeys"]),
                probability=effect.get("probability"),
                identified=((effect.get("signature") or {}).get("identified") or {}).get("mean"),
            )
            for effect in facts["effects"]
        ),
        families=tuple(
            Kin(title=kin["title"], names=tuple(kin["names"]), probability=kin["probability"])
            for kin in facts.get("families", ())
        ),
        fit=_per_cent(errors["fit"]),
        held_out=_per_cent(errors["held_out"]),
        seconds=float(facts["elapsed_s"]),
    )


def identified_response(discovery: Discovery, record: Record) -> Floats:
    """Measured channels ``(n_channels, n_times)`` by the improved model at its most probable draw, from rest."""
    tree = discovery.result.tree
    chain, draw = np.unravel_index(np.argmax(tree["sample_stats"]["lp"].to_numpy()), tree["sample_stats"]["lp"].shape)
    posterior = tree["posterior"].isel(chain=int(chain), draw=int(draw))
    values = np.array([[_value(posterior, p.name, p.symbol) for p in discovery.improved.space.parameters]])
    return np.asarray(_FINE.simulate(discovery.improved, values, record).values[0])


def discover_first_part(test: MeasuredTest, seed: int) -> tuple[dict[str, Any], Floats]:
    """Discover on the fitted part of a test and predict the rest, knowing only the fitted part.

    Returns
    -------
    facts : dict
        ``discovery.json``, and ``errors``: those of the identified response where the package has none to hold out.
    response : (n_channels, n_times) array
        Of the whole record.
    """
    end = test.rule == "parting_time"
    discovery = discover(
        starting_model(test.training),
        test.record if end else test.training,
        held_out="end" if end else None,
        settings=DiscoverySettings(seed=seed),
        name=test.name,
    )
    response = identified_response(discovery, test.record)
    return {**discovery.as_json(), "errors": both_errors(test, response)}, response


def discover_whole(test: MeasuredTest, seed: int) -> tuple[dict[str, Any], Floats]:
    """Discover on the whole record, as labels are about the whole; ``loops`` has measured and identified measures.

    Returns
    -------
    facts : dict
    response : (n_channels, n_times) array
    """
    discovery = discover(
        starting_model(test.record), test.record, settings=DiscoverySettings(seed=seed), name=test.name
    )
    response = identified_response(discovery, test.record)
    displacement, force = test.pulled
    loops = {
        name: {"measured": measure(displacement, force), "identified": measure(displacement, response[0])}
        for name, measure in (("pinching_index", pinching_index), ("strength_lost", strength_lost_per_cycle))
    }
    return {**discovery.as_json(), "errors": (nrmse(test.record.measured, response), None), "loops": loops}, response


def discover_first_cycles(test: MeasuredTest, seed: int) -> tuple[dict[str, Any], Floats]:
    """Discover on the first cycle at each amplitude of a test and predict those that repeat it.

    Returns
    -------
    facts : dict
        ``discovery.json``, and ``errors``: those of its best model, fitted and held out.
    response : (n_channels, n_times) array
        Of the whole record.

    Raises
    ------
    UserError
        If the test has no repeat cycles.
    """
    fitted = replace(test.record, counted=~repeated_samples(test.record.excitation))
    discovery = discover(
        starting_model(fitted), test.record, held_out="repeats", settings=DiscoverySettings(seed=seed), name=test.name
    )
    facts = discovery.as_json()
    answer = read_answer(facts)
    return {**facts, "errors": (answer.fit, answer.held_out)}, identified_response(discovery, test.record)


def says_pinched(answer: Answer, identified_index: float | None) -> bool:
    """Whether an answer calls a specimen pinched: a pinch is named, or one of two, and the loop is a pinched one.

    Parameters
    ----------
    answer : Answer
    identified_index : float or None
        Pinching index of the identified loop, which counts where the answer has no signature.
    """
    for effect in answer.effects:
        index = identified_index if effect.identified is None else effect.identified
        if effect.name in PINCHES and effect.is_named and index is not None and index < PINCHED:
            return True
    either = any(kin.probability >= SURE and set(kin.names) <= set(PINCHES) for kin in answer.families)
    return either and identified_index is not None and identified_index < PINCHED


def _per_cent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _value(posterior: Any, name: str, symbol: str) -> float:
    """One parameter by its label, such as ``k[2]``, from a draw of the posterior group."""
    if name in posterior:
        return float(posterior[name])
    values = posterior[symbol]
    return float(values.sel({values.dims[-1]: int(name.removeprefix(symbol).strip("[]"))}))
