"""The verdict in words: strengths by Kass and Raftery's grades, no certainty, what runs away without a number."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from nameless import force_without_a_name

from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Added, Gap, SignatureFacts, UnnamedReading
from bwbn_bayes.discovery.probability import Family
from bwbn_bayes.discovery.sentences import badly_sampled, evidence_in_words, probability_in_words, sentences

NOWHERE: Any = SimpleNamespace(spots=())


def believed(verdict: str, probability: float, *, has_unnamed: bool = False, runner_up: float | None = None) -> Any:
    """With a runner-up so many nats behind the best, or alone."""
    unnamed = (1,) if has_unnamed else None
    best = SimpleNamespace(
        placed=frozenset({("slip_lock", (2,))}), has_unnamed=has_unnamed, unnamed=unnamed, label="the best"
    )
    other = SimpleNamespace(placed=frozenset({("backlash", (2,))}), has_unnamed=False, label="backlash in storey 2")
    explanations = (best,) if runner_up is None else (best, best, other)
    return SimpleNamespace(
        verdict=verdict,
        verdicts={verdict: probability},
        best=best,
        first_of=lambda _: 0,
        explanations=explanations,
        forgiven=np.zeros(len(explanations)),
        log_joint=np.array([40.0, 39.0, 40.0 - (runner_up or 0.0)])[: len(explanations)],
    )


def prediction(nrmse: float, runs_away_after: str = "") -> Prediction:
    return Prediction(
        channels=("force",), values=np.zeros((1, 1)), nrmse=nrmse, nrmse_se=0.0, log_density=0.0,
        runs_away_after=runs_away_after,
    )  # fmt: skip


def gap(before: float, after: float, held_out: Gap | None = None) -> Gap:
    return Gap(noise_floor=0.02, before=prediction(before), after=prediction(after), held_out=held_out)


def added(probability: float = 0.998, deserved: float = 1.0, *, storeys: tuple[int, ...] = (2,), **other: Any) -> Added:
    """A slip at a storey, without a hypothesis' model behind it."""
    signature = SimpleNamespace(plain_name="the shape of the reloading branch")
    effect = SimpleNamespace(summary="the joint slips", signature=signature, level="link")
    where = f"storey {storeys[0]}"
    hypothesis = SimpleNamespace(
        name="slip_lock",
        label=f"slip-lock pinching in {where}",
        at_place=f" in {where}",
        where=where,
        storeys=storeys,
        effect=effect,
    )
    facts = SignatureFacts(
        measure="pinching index", unit="", measured=0.09, mean=0.07, low=0.05, high=0.1, without=0.5, deserved=deserved
    )
    return Added(
        hypothesis=cast(Any, hypothesis),
        probability=probability,
        place_probability=probability,
        log_bayes_factor=812.3,
        log_bayes_factor_se=0.4,
        equivalent=other.get("equivalent", ()),
        equivalent_places=other.get("equivalent_places", ()),
        signature=facts,
        borne_out=other.get("borne_out", 1.0),
        moments={},
    )


@pytest.mark.parametrize(
    ("nats", "words"),
    [
        (812.0, "overwhelming"),
        (10.0, "overwhelming"),
        (9.9, "strong"),
        (5.0, "strong"),
        (2.3, "weak"),
        (1.0, "hardly any"),
        (-40.0, "hardly any"),
    ],
)
def test_how_sure_in_words(nats: float, words: str) -> None:
    assert evidence_in_words(nats) == words


def test_a_prediction_that_runs_away_has_no_number() -> None:
    """A held-out error once read 1.3e14 %."""
    apart = Gap(noise_floor=0.02, before=prediction(0.3), after=prediction(1.3e12, "cycle 9"))
    told = sentences(believed("effects_found", 0.99), (), (added(),), None, NOWHERE, gap(0.2, 0.03, apart))
    assert (
        "On the held-out data, as given, the error is 30.0 %; improved, the prediction runs away after cycle 9; "
        "noise alone leaves 2.0 %."
    ) in told
    assert not any("e+" in sentence or "000" in sentence for sentence in told)


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.5, "0.5"), (0.974, "0.97"), (0.9984, "0.9984"), (1.0, "above 0.999"), (0.004, "below 0.01")],
)
def test_no_probability_is_certainty(value: float, words: str) -> None:
    assert probability_in_words(value) == words


def test_what_is_missing_how_sure_and_what_it_does_come_first() -> None:
    spot = SimpleNamespace(channel="acceleration_2", sentence="floor 2 from 8 to 14 s")
    other = SimpleNamespace(channel="acceleration_1", sentence="floor 1 from 1 to 2 s")
    where: Any = SimpleNamespace(spots=(other, spot))
    told = sentences(believed("effects_found", 0.97, runner_up=13.2), (), (added(),), None, where, gap(0.18, 0.021))
    assert told == (
        "The model lacks slip-lock pinching in storey 2: the joint slips (probability 0.97).",
        (
            "Slip-lock pinching in storey 2: overwhelming evidence (812 nats, probability 0.998); pinching index 0.09 "
            "measured, 0.07 identified (0.05 to 0.1), 0.5 without it."
        ),
        "The next best set of laws, backlash in storey 2, is 13 nats behind.",
        "On the fitted record the error falls from 18.0 % to 2.1 %; noise alone leaves 2.0 %.",
        "Where it showed: floor 2 from 8 to 14 s.",
    )


def test_effects_that_predict_without_a_name_are_told_together() -> None:
    """Beside a force of no known law; where none is likely, each is said to be uncertain by itself."""
    force = force_without_a_name(0.999, 0.2, place="the specimen")
    weak = [replace(added(p, storeys=(s,)), log_bayes_factor=-3.0) for s, p in ((1, 0.02), (3, 0.05))]
    certain = believed("partly_explained", 0.999, has_unnamed=True)
    told = sentences(certain, (), (added(), *weak), force, NOWHERE, gap(0.3, 0.06))
    assert told[1].startswith("Slip-lock pinching in storey 2: overwhelming")
    assert told[2].startswith("A force of no known law at the specimen")
    assert told[3] == (
        "The improved model also has slip-lock pinching in storey 1 and slip-lock pinching in storey 3, with which it "
        "predicts better; none of them has earned a name (the likeliest with probability 0.05)."
    )
    assert not any(sentence.startswith("Perhaps") for sentence in told)
    (one,) = (
        s for s in sentences(certain, (), (weak[0],), force, NOWHERE, gap(0.3, 0.06)) if s.startswith("The improved")
    )
    assert one.endswith(", with which it predicts better; it has not earned a name (probability 0.02).")
    alone = sentences(believed("effects_found", 0.9), (), (added(), *weak), None, NOWHERE, gap(0.3, 0.06))
    assert sum(sentence.startswith("Perhaps") for sentence in alone) == 2


def test_nothing_missing_is_told_with_the_error() -> None:
    told = sentences(believed("no_missing_effect", 0.9999999, runner_up=4.6), (), (), None, NOWHERE, gap(0.02, 0.02))
    assert told == (
        "The model as given explains the record: nothing is missing (probability above 0.999).",
        "The next best set of laws, backlash in storey 2, is 4.6 nats behind.",
        "On the fitted record the error is 2.0 %; noise alone leaves 2.0 %.",
    )


def test_a_law_without_its_signature_goes_by_its_plain_name() -> None:
    """Evidence says that a law helps; it does not say that the loop is pinched."""
    told = sentences(believed("effects_found", 0.95), (), (added(deserved=0.02),), None, NOWHERE, gap(0.2, 0.1))
    assert told[0] == "The model lacks the shape of the reloading branch in storey 2 (probability 0.95)."
    assert told[1].startswith("The shape of the reloading branch in storey 2: overwhelming evidence")
    assert "(812 nats, probability 0.998)" in told[1]
    assert "; the law helps, but not by what its name, slip-lock pinching, says; pinching index" in told[1]


def test_a_signature_that_could_not_be_measured_is_told_with_the_reason() -> None:
    """A law of pinching was named of a record off whose loops no pinching index can be read."""
    unknown = SignatureFacts.of_none("pinching index", "", "it takes a motion that comes back through zero")
    one = replace(added(), signature=unknown)
    told = sentences(believed("effects_found", 0.95), (), (one,), None, NOWHERE, gap(0.2, 0.1))
    assert told[0] == "The model lacks the shape of the reloading branch in storey 2 (probability 0.95)."
    assert told[1] == (
        "The shape of the reloading branch in storey 2: overwhelming evidence (812 nats, probability 0.998); whether "
        "it is slip-lock pinching is not known, since its signature (pinching index) could not be measured: it takes a "
        "motion that comes back through zero."
    )


@pytest.mark.parametrize(
    ("probability", "word"),
    [(0.7, "Possibly slip-lock pinching in storey 2: "), (0.3, "Perhaps slip-lock pinching in storey 2: ")],
)
def test_what_is_not_certain_is_said_to_be_so(probability: float, word: str) -> None:
    one = added(probability, equivalent=("backlash",), equivalent_places=((1,),))
    told = sentences(believed("effects_found", 0.95), (), (one,), None, NOWHERE, gap(0.2, 0.1))
    assert told[0].startswith("Something is missing that the catalogue can hold, but no single effect is certain")
    assert told[1].startswith(word)
    assert "the record cannot tell it from backlash or the same at storey 1" in told[1]


@pytest.mark.parametrize(
    ("verdict", "effects", "is_force", "first"),
    [
        (
            "partly_explained",
            (added(),),
            True,
            "The model lacks slip-lock pinching in storey 2, and more: beside it stays a force of no known law",
        ),
        (
            "partly_explained",
            (),
            False,
            "What the model lacks is only partly known: beside it stays what no smooth force explains",
        ),
        (
            "unexplained",
            (),
            True,
            "Model and record disagree, and no catalogued effect explains it better than a force",
        ),
        ("unexplained", (), False, "Model and record disagree, and neither a catalogued effect nor a smooth force"),
    ],
)
def test_what_has_no_name_is_told_first(verdict: str, effects: tuple[Added, ...], is_force: bool, first: str) -> None:
    """What an explanation leaves may be a force of the states, or what no force of them is."""
    force = force_without_a_name(0.93, 0.12)
    told = sentences(
        believed(verdict, 0.93, has_unnamed=is_force), (), effects, force if is_force else None, NOWHERE, gap(0.2, 0.1)
    )
    assert told[0].startswith(first)
    share = "at storey 1 takes up what the model does not: 12 % of the force (probability 0.93)"
    assert any(share in sentence for sentence in told) == is_force


def test_what_is_told_is_of_the_class_that_is_the_most_probable() -> None:
    """The most probable explanation has no force, the class has one: what stays was told to be no smooth force."""
    found = believed("partly_explained", 0.6)
    forced = SimpleNamespace(**{**vars(found.best), "has_unnamed": True, "unnamed": (1,)})
    found.explanations, found.first_of = (found.best, forced), {"partly_explained": 1}.__getitem__
    found.forgiven, found.log_joint = np.array([3.0, 0.0]), np.array([40.0, 39.8])
    (first, *_) = sentences(found, (), (added(),), None, NOWHERE, gap(0.2, 0.1))
    assert first.endswith("and more: beside it stays a force of no known law (probability 0.6).")


def test_an_error_of_a_sensor_is_told_with_what_is_left_beside_it() -> None:
    error = UnnamedReading(
        channel="acceleration_2", probability=0.97, any_probability=0.97, share=0.2,
        function="of what the sensor shows", shown=np.zeros(2), error=np.zeros(2),
    )  # fmt: skip
    seen = replace(gap(0.2, 0.2, replace(gap(0.3, 0.3), nameless=prediction(0.05))), nameless=prediction(0.02))
    best = believed("unexplained", 0.97, has_unnamed=True)
    best.best.unnamed = "acceleration_2"
    told = sentences(best, (), (), error, NOWHERE, seen)
    assert told[0].endswith("no catalogued effect explains it better than an error of a sensor (probability 0.97).")
    assert told[1] == (
        "An error of no known kind in acceleration_2 takes up what the model does not: 20 % of the reading "
        "(probability 0.97), an error of what the sensor shows. With it 2 % of the fitted record and 5 % of the "
        "held-out data is left."
    )


def test_a_gain_that_not_all_of_the_record_bears_out_is_told() -> None:
    def told(one: Added) -> str:
        return sentences(believed("partly_explained", 0.99, runner_up=4.6), (), (one,), None, NOWHERE, gap(0.2, 0.1))[1]

    doubted = told(added(borne_out=0.6))
    assert doubted.startswith("Possibly slip-lock pinching in storey 2: overwhelming evidence")
    assert "; more than noise is left, and something else may look like it (borne out with probability 0.6)" in doubted
    assert "borne out" not in told(added())


def test_a_shape_that_not_all_of_the_record_bears_out_is_not_what_the_model_lacks() -> None:
    doubted = added(deserved=0.02, borne_out=0.6)
    told = sentences(believed("partly_explained", 0.99), (), (doubted,), None, NOWHERE, gap(0.2, 0.1))
    assert told[0].startswith("What the model lacks is only partly known")
    assert told[1].startswith("The shape of the reloading branch in storey 2")


def test_a_small_force_without_a_name_has_a_share_all_the_same() -> None:
    force = force_without_a_name(1.0, 0.0013)
    told = sentences(believed("unexplained", 1.0, has_unnamed=True), (), (), force, NOWHERE, gap(0.2, 0.1))
    assert "takes up what the model does not: 0.1 % of the force" in told[1]


def test_a_doubtful_place_of_what_has_no_name_is_told_with_how_sure_it_is_that_anything_has_none() -> None:
    """A probability of 0.4 read as if the force itself were in doubt."""
    force = force_without_a_name(0.4, 0.12, any_probability=0.98)
    told = sentences(believed("unexplained", 0.98, has_unnamed=True), (), (), force, NOWHERE, gap(0.2, 0.1))
    assert "12 % of the force (probability 0.4; that anything has no name, 0.98)" in told[1]


def test_what_is_certain_of_a_family_is_said_where_none_of_its_effects_has_a_name() -> None:
    names = frozenset({"strength_degradation", "stiffness_degradation"})
    loss = Family(title="a loss of strength or stiffness", names=names, probability=0.97, log_bayes_factor=208.0)
    told = sentences(believed("partly_explained", 0.99), (loss,), (added(),), None, NOWHERE, gap(0.2, 0.1))
    assert told[0].startswith("The model lacks slip-lock pinching in storey 2 and a loss of strength or stiffness, and")
    assert told[1] == (
        "A loss of strength or stiffness: overwhelming evidence (208 nats, probability 0.97); which of stiffness "
        "degradation and strength degradation it is, the record does not tell."
    )
    doubtful = replace(loss, probability=0.89)
    assert not any("A loss" in s for s in sentences(
        believed("partly_explained", 0.99), (doubtful,), (added(),), None, NOWHERE, gap(0.2, 0.1)
    ))  # fmt: skip
    own = replace(loss, names=frozenset({"slip_lock", "stiffness_degradation"}))
    named = sentences(believed("partly_explained", 0.99), (own,), (added(),), None, NOWHERE, gap(0.2, 0.1))
    assert not any("loss" in sentence for sentence in named)


def test_a_posterior_that_could_not_be_sampled_well_is_told_with_the_way_to_a_better_one() -> None:
    """The same method was said to fall back by itself, which it does for a heavy tail of the weights alone."""

    def facts(k: float, worth: float, *, passed: bool) -> Any:
        checks = (("Pareto k", k, passed), ("effective draws", worth, True))
        return SimpleNamespace(
            method="importance", checks=[SimpleNamespace(name=n, value=v, passed=p) for n, v, p in checks]
        )

    for few in (facts(0.5, 25.0, passed=True), facts(0.9, 400.0, passed=False)):
        (told,) = badly_sampled(few)
        assert "bwbn identify improved_model.py --method tmcmc samples it" in told
        assert told.endswith("into reports/improved_model_tmcmc there.")
        assert "falls back" not in told
    assert badly_sampled(facts(0.5, 400.0, passed=True)) == ()
