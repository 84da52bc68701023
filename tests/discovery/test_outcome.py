"""``discovery.json`` against the contract of schema 2, for every way in which a discovery may end."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from nameless import force_without_a_name

from bwbn_bayes.discovery.outcome import (
    SCHEMA,
    Added,
    DetectionLimit,
    Discovery,
    SignatureFacts,
    Step,
    UnnamedReading,
)
from bwbn_bayes.discovery.where import Spot

NUMBER = (int, float)
MOMENTS = {"mean": NUMBER, "sd": NUMBER}
CONTRACT: dict[str, Any] = {
    "schema": int,
    "verdict": str,
    "verdict_probabilities": {
        "effects_found": NUMBER,
        "partly_explained": NUMBER,
        "unexplained": NUMBER,
        "no_missing_effect": NUMBER,
    },
    "unexplained_share": NUMBER,
    "effects": [
        {
            "name": str,
            "storeys": [int],
            "probability": NUMBER,
            "place_probability": NUMBER,
            "log_bayes_factor": NUMBER,
            "log_bayes_factor_se": NUMBER,
            "equivalent": [str],
            "parameters": {},
            "signature": {
                "measure": str,
                "measured": (*NUMBER, type(None)),
                "identified": {"mean": NUMBER, "low": NUMBER, "high": NUMBER},
                "without": (*NUMBER, type(None)),
            },
        }
    ],
    "where": [{"channel": str, "start_s": NUMBER, "end_s": NUMBER, "residual_to_noise": NUMBER, "sentence": str}],
    "gap": {
        "metric": str,
        "noise_floor": NUMBER,
        "fit": {"before": NUMBER, "after": NUMBER},
        "held_out": {"before": NUMBER, "after": NUMBER},
    },
    "best_model": {"effects": [str], "fit": NUMBER, "held_out": NUMBER},
    "probabilities": {},
    "steps": [{}],
    "candidates": [{}],
    "elapsed_s": NUMBER,
    "seed": int,
}
"""Keys and kinds as DESIGN.md states them; more keys may stand beside them."""


def check(found: Any, wanted: Any, where: str = "discovery") -> None:
    """Whether every wanted key is there with a value of its kind; lists may be empty."""
    if isinstance(wanted, dict):
        assert isinstance(found, dict), where
        for key, inside in wanted.items():
            assert key in found, f"{where} lacks {key}"
            check(found[key], inside, f"{where}.{key}")
    elif isinstance(wanted, list):
        assert isinstance(found, list), where
        for item in found:
            check(item, wanted[0], f"{where}[]")
    else:
        assert isinstance(found, wanted) and not isinstance(found, bool), f"{where} is {found!r}"


def written(discovery: Discovery) -> dict[str, Any]:
    """What a reader of the file sees; not a number and infinity are no JSON."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    facts: dict[str, Any] = json.loads(json.dumps(discovery.as_json(), allow_nan=False), parse_constant=refuse)
    return facts


def test_the_file_keeps_the_contract(run):
    facts = written(run.discovery)
    check(facts, CONTRACT)
    assert facts["schema"] == SCHEMA == 2
    assert facts["gap"]["metric"] == "nrmse"
    assert len(facts["effects"]) == 1
    assert facts["steps"]
    (effect,) = facts["effects"]
    for moments in effect["parameters"].values():
        check(moments, MOMENTS)


def test_the_contract_can_be_broken(run):
    """The check itself: a key left out, and a number as text."""
    facts = written(run.discovery)
    with pytest.raises(AssertionError, match="lacks seed"):
        check({key: value for key, value in facts.items() if key != "seed"}, CONTRACT)
    with pytest.raises(AssertionError, match="elapsed_s"):
        check({**facts, "elapsed_s": "31 s"}, CONTRACT)


def test_numbers_are_those_of_the_discovery(run):
    discovery, facts = run.discovery, written(run.discovery)
    (added,) = discovery.added
    (effect,) = facts["effects"]
    assert effect["log_bayes_factor"] == added.log_bayes_factor
    assert effect["log_bayes_factor_se"] == added.log_bayes_factor_se
    assert effect["probability"] == added.probability * added.signature.deserved
    assert effect["law_probability"] == added.probability  # noise is left: nothing has to be borne out
    assert discovery.probabilities["cubic_stiffness"] == effect["probability"]
    assert effect["parameters"]["k3"] == dict(zip(("mean", "sd"), added.moments["k3"], strict=True))
    assert facts["unexplained_share"] == discovery.unexplained_share
    assert facts["verdict"] == max(facts["verdict_probabilities"], key=facts["verdict_probabilities"].__getitem__)
    assert sum(facts["verdict_probabilities"].values()) == pytest.approx(1.0)
    assert facts["gap"]["fit"] == {"before": discovery.gap.before.nrmse, "after": discovery.gap.after.nrmse}
    assert facts["gap"]["noise_floor"] == discovery.gap.noise_floor
    assert facts["best_model"]["fit"] == discovery.gap.after.nrmse
    assert facts["best_model"]["held_out"] == discovery.gap.held_out.after.nrmse


def test_candidates_are_what_the_last_round_believed(run):
    last, facts = run.discovery.steps[-1], written(run.discovery)
    assert [step["step"] for step in facts["steps"]] == list(range(1, len(facts["steps"]) + 1))
    assert [c["log_joint"] for c in facts["candidates"]] == sorted(last.log_joint, reverse=True)
    assert sum(c["probability"] for c in facts["candidates"]) == pytest.approx(1.0)
    given = [c for c in facts["candidates"] if not c["effects"]]
    assert [1] in [c["unnamed_force"] for c in given] and None in [c["unnamed_force"] for c in given]
    assert all(c["evidence"] in ("Laplace", "importance") for c in facts["candidates"])


def test_an_effect_of_the_whole_building_reports_no_storey(run):
    (added,) = run.discovery.added
    whole = replace(added, hypothesis=replace(added.hypothesis, storeys=()))
    (effect,) = written(replace(run.discovery, added=(whole,)))["effects"]
    assert effect["storeys"] == []


def test_without_held_out_data_the_gap_is_that_of_the_fit_alone(run):
    gap = replace(run.discovery.gap, held_out=None)
    facts = written(replace(run.discovery, gap=gap, held_out=None))
    assert facts["gap"].keys() == {"metric", "noise_floor", "fit"}
    assert facts["best_model"]["held_out"] is None


def test_what_is_not_finite_is_null(run):
    """A limit that the record could not show, and a signature that cannot be told without the effect."""
    limit = DetectionLimit(
        label="sensor_gain, floor 1", name="sensor_gain", storeys=(1,), parameter="gain", unit="", smallest=np.inf,
        expected=0.1,
    )  # fmt: skip
    facts = written(replace(run.discovery, limits=(limit,)))
    assert facts["detection_limits"] == [
        {"effect": "sensor_gain", "storeys": [1], "parameter": "gain", "unit": "", "smallest": None}
    ]
    (added,) = run.discovery.added
    untold = replace(added, signature=replace(added.signature, without=np.nan))
    facts = written(replace(run.discovery, added=(untold,)))
    check(facts, CONTRACT)
    assert facts["effects"][0]["signature"]["without"] is None


def test_nothing_named_leaves_no_effect(run):
    first = run.discovery.steps[0]
    step = Step(
        number=1, parent="nothing", sentence="Nothing.", explanations=first.explanations[:0], probabilities=(),
        log_joint=(), elapsed_s=1.0,
    )  # fmt: skip
    facts = written(replace(run.discovery, verdict="no_missing_effect", added=(), steps=(step,)))
    check(facts, CONTRACT)
    assert (facts["effects"], facts["candidates"], facts["best_model"]["effects"]) == ([], [], [])
    assert facts["steps"] == [{"step": 1, "parent": "nothing", "sentence": "Nothing.", "elapsed_s": 1.0}]


def test_a_force_of_no_known_law_is_written_with_its_share(run):
    force = force_without_a_name(0.98, 0.12)
    facts = written(replace(run.discovery, verdict="unexplained", added=(), unnamed=force))
    check(facts, CONTRACT)
    assert facts["unnamed_force"] == {
        "storey": 1, "place": "storey 1", "probability": 0.98, "any_probability": 0.98, "share": 0.12,
    }  # fmt: skip


def test_an_error_of_a_sensor_has_a_key_of_its_own(run):
    error = UnnamedReading(
        channel="acceleration_1", probability=0.98, any_probability=0.99, share=0.12,
        function="that changes in time", shown=np.zeros(3), error=np.zeros(3),
    )  # fmt: skip
    gap = replace(run.discovery.gap, nameless=replace(run.discovery.gap.after, nrmse=0.03))
    facts = written(replace(run.discovery, verdict="unexplained", added=(), unnamed=error, gap=gap))
    check(facts, CONTRACT)
    assert facts["unnamed_force"] is None
    assert facts["unnamed_reading"] == {
        "channel": "acceleration_1", "probability": 0.98, "any_probability": 0.99, "share": 0.12,
        "function": "that changes in time",
    }  # fmt: skip
    assert facts["gap"]["fit"]["beside_unnamed"] == 0.03


def test_the_places_of_the_disagreement_are_those_found(run):
    spot = Spot(channel="acceleration_1", start_s=2.0, end_s=4.0, residual_to_noise=3.4, sentence="there")
    facts = written(replace(run.discovery, before=replace(run.discovery.before, spots=(spot,))))
    assert facts["where"] == [
        {
            "channel": "acceleration_1",
            "start_s": 2.0,
            "end_s": 4.0,
            "cycles": None,
            "residual_to_noise": 3.4,
            "sentence": "there",
        }
    ]


@pytest.mark.parametrize(
    ("probability", "deserved", "grade", "title"),
    [
        (0.999, 1.0, "named", "slip-lock pinching in storey 2"),
        (0.95, 0.95, "named", "slip-lock pinching in storey 2"),
        (0.8, 1.0, "possible", "slip-lock pinching in storey 2"),
        (0.999, 0.7, "possible", "slip-lock pinching in storey 2"),
        (0.999, 0.1, "shape", "the shape of the reloading branch in storey 2"),
        (0.3, 1.0, "weak", "slip-lock pinching in storey 2"),
        (0.3, 0.0, "weak", "the shape of the reloading branch in storey 2"),
    ],
)
def test_a_name_takes_a_probable_law_and_its_signature(probability, deserved, grade, title):
    """Of a law that is there without the size that its name stands for, the shape is told instead."""
    signature = SignatureFacts(
        measure="pinching index", unit="", measured=0.3, mean=0.3, low=0.2, high=0.4, without=0.5, deserved=deserved
    )
    effect = SimpleNamespace(signature=SimpleNamespace(plain_name="the shape of the reloading branch"))
    hypothesis = SimpleNamespace(label="slip-lock pinching in storey 2", at_place=" in storey 2", effect=effect)
    added = Added(
        hypothesis=cast(Any, hypothesis), probability=probability, place_probability=probability,
        log_bayes_factor=9.0, log_bayes_factor_se=0.1, equivalent=(), equivalent_places=(), signature=signature,
        borne_out=1.0, moments={},
    )  # fmt: skip
    assert (added.grade, added.title) == (grade, title)
    assert added.name_probability == pytest.approx(probability * deserved)
    # That the law is there is as probable as the law, whatever it deserves to be called.
    plain = title == "the shape of the reloading branch in storey 2"
    assert added.title_probability == (probability if plain else added.name_probability)
    # What has no measure is always nameable.
    assert replace(added, signature=None).name_probability == probability
    # What the record does not bear out all over is no matter of its shape.
    doubtful = replace(added, signature=None, borne_out=0.4)
    assert doubtful.name_probability == pytest.approx(0.4 * probability)
    assert doubtful.grade == "weak"
