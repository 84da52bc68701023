"""``discovery.json`` against the contract of schema 1, for every way in which a discovery may end."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from bwbn_bayes.discovery.unexplained import NearShape, Unexplained

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.outcome import SCHEMA, Added, DetectionLimit, Discovery, Step
from bwbn_bayes.discovery.where import Spot
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CoulombFriction
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.structures.shear_building import ShearBuilding

NUMBER = (int, float)
CONTRACT: dict[str, Any] = {
    "schema": int,
    "verdict": str,
    "unexplained_share": NUMBER,
    "effects": [
        {
            "name": str,
            "storeys": [int],
            "log_bayes_factor": NUMBER,
            "log_bayes_factor_se": NUMBER,
            "equivalent": [str],
            "parameters": {},
        }
    ],
    "where": [{"channel": str, "start_s": NUMBER, "end_s": NUMBER, "residual_to_noise": NUMBER, "sentence": str}],
    "gap": {
        "metric": str,
        "noise_floor": NUMBER,
        "fit": {"before": NUMBER, "after": NUMBER},
        "held_out": {"before": NUMBER, "after": NUMBER},
    },
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
    assert facts["schema"] == SCHEMA == 1
    assert facts["gap"]["metric"] == "nrmse"
    assert len(facts["effects"]) == len(facts["steps"]) - 1 == 1
    (effect,) = facts["effects"]
    for moments in effect["parameters"].values():
        check(moments, {"mean": NUMBER, "sd": NUMBER})


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
    assert effect["log_bayes_factor"] == added.candidate.log_bayes_factor
    of_both = np.hypot(added.candidate.evidence.log_evidence_se, added.decision.present.log_evidence_se)
    assert effect["log_bayes_factor_se"] == pytest.approx(of_both)
    assert effect["parameters"]["k3"] == dict(zip(("mean", "sd"), added.moments["k3"], strict=True))
    assert facts["unexplained_share"] == discovery.unexplained_share
    assert facts["gap"]["fit"] == {"before": discovery.gap.before.nrmse, "after": discovery.gap.after.nrmse}
    assert facts["gap"]["noise_floor"] == discovery.gap.noise_floor
    weighed = [c for step in discovery.steps if step.decision is not None for c in step.decision.candidates]
    assert [c["log_odds"] for c in facts["candidates"]] == [c.log_odds for c in weighed]
    assert [c["step"] for c in facts["candidates"]] == sorted(c["step"] for c in facts["candidates"])


def test_an_effect_of_the_whole_building_reports_no_storey(run):
    (added,) = run.discovery.added
    hypothesis = replace(added.candidate.hypothesis, storeys=())
    whole = replace(added, candidate=replace(added.candidate, hypothesis=hypothesis))
    (effect,) = written(replace(run.discovery, added=(whole,)))["effects"]
    assert effect["storeys"] == []


def test_without_held_out_data_the_gap_is_that_of_the_fit_alone(run):
    gap = replace(run.discovery.gap, held_out=None)
    facts = written(replace(run.discovery, gap=gap, held_out=None))
    assert facts["gap"].keys() == {"metric", "noise_floor", "fit"}


def test_what_is_not_finite_is_null(run):
    """A limit that the record could not show, and a Laplace evidence without a tail."""
    limit = DetectionLimit(
        label="sensor_gain, floor 1", name="sensor_gain", storeys=(1,), parameter="gain", unit="", smallest=np.inf,
        expected=0.1,
    )  # fmt: skip
    facts = written(replace(run.discovery, limits=(limit,)))
    assert facts["detection_limits"] == [
        {"effect": "sensor_gain", "storeys": [1], "parameter": "gain", "unit": "", "smallest": None}
    ]


def test_nothing_named_leaves_no_effect(run):
    given = run.discovery.steps[0]
    step = Step(
        number=1, model=given.model, disagreement=given.disagreement, decision=None, sentence="Nothing.", elapsed_s=1.0
    )
    facts = written(replace(run.discovery, verdict="no_missing_effect", added=(), steps=(step,)))
    check(facts, CONTRACT)
    assert (facts["effects"], facts["candidates"]) == ([], [])
    assert facts["steps"] == [{"step": 1, "sentence": "Nothing.", "withdrawn": False, "elapsed_s": 1.0}]


def test_what_stays_unexplained_is_told_with_the_nearest_shapes(run):
    shape = NearShape(
        label="cubic_stiffness, storey 1", share=0.4, correlation=0.7, log_odds=12.0, sentence="It leaves 60 %."
    )
    facts = written(
        replace(run.discovery, verdict="unexplained", added=(), unexplained=Unexplained(forces=(), nearest=(shape,)))
    )
    check(facts, CONTRACT)
    assert facts["verdict"] == "unexplained"
    assert "cubic_stiffness, storey 1" in json.dumps(facts["unexplained"])


def test_the_places_of_the_disagreement_are_those_found(run):
    spot = Spot(channel="acceleration_1", start_s=2.0, end_s=4.0, residual_to_noise=3.4, sentence="there")
    facts = written(replace(run.discovery, before=replace(run.discovery.before, spots=(spot,))))
    assert facts["where"] == [
        {"channel": "acceleration_1", "start_s": 2.0, "end_s": 4.0, "residual_to_noise": 3.4, "sentence": "there"}
    ]


@pytest.mark.parametrize(("width", "doubt"), [(0.05, ""), (0.06, "it turns over 15 % of the largest drift")])
@pytest.mark.parametrize(("smoothing", "kind"), [(0, " rate"), (1, " rate"), (2, " rate"), (3, "")])
def test_a_friction_that_turns_slowly_is_in_doubt(smoothing: int, kind: str, width: float, doubt: str) -> None:
    scales = replace(NOMINAL, drift_rate=0.4, drift=0.4)
    storey = BoucWen(k=Uniform(20, 100), c=0.3, alpha=0.1, beta=8.0, gamma=2.0, n=1.3)
    base = ShearBuilding(masses=(2.0, 1.0), storey=storey)
    effect = CoulombFriction.default_prior(scales)[smoothing]
    hypothesis = Hypothesis(base=base, effect=effect, storeys=(2,), scales=scales)
    means = dict(zip(hypothesis.model.space.names, [60.0, 0.3, width], strict=True))
    weighed = cast(Any, SimpleNamespace(hypothesis=hypothesis, evidence=SimpleNamespace(means=means)))
    added = Added(candidate=weighed, decision=cast(Any, None), moments={})
    assert added.doubt == (f"{hypothesis.label}: {doubt}{kind}: not dry friction" if doubt else "")
