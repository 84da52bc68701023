"""The verdict in words: strengths by Kass and Raftery's grades, no certainty, no number for what runs away."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Added, Gap, SignatureFacts, UnnamedForce
from bwbn_bayes.discovery.sentences import error_in_words, evidence_in_words, sentences

NOWHERE: Any = SimpleNamespace(spots=())


def believed(verdict: str, probability: float) -> Any:
    return SimpleNamespace(verdict=verdict, verdicts={verdict: probability})


def prediction(nrmse: float) -> Prediction:
    return Prediction(channels=("force",), values=np.zeros((1, 1)), nrmse=nrmse, nrmse_se=0.0, log_density=0.0)


def gap(before: float, after: float, held_out: Gap | None = None) -> Gap:
    return Gap(noise_floor=0.02, before=prediction(before), after=prediction(after), held_out=held_out)


def added(probability: float = 0.998, deserved: float = 1.0, *, storeys: tuple[int, ...] = (2,), **other: Any) -> Added:
    """A slip at a storey, without a hypothesis' model behind it."""
    signature = SimpleNamespace(plain_name="the shape of the reloading branch")
    effect = SimpleNamespace(summary="the joint slips", signature=signature, level="link")
    where = f"storey {storeys[0]}"
    hypothesis = SimpleNamespace(label=f"slip_lock, {where}", where=where, storeys=storeys, effect=effect)
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


@pytest.mark.parametrize("error", [3.0, 1.3e12, np.inf, np.nan])
def test_a_prediction_that_runs_away_has_no_number(error: float) -> None:
    """A held-out error once read 1.3e14 %."""
    assert error_in_words(error) == "a prediction that runs away"
    told = sentences(believed("effects_found", 0.99), (added(),), None, NOWHERE, gap(0.2, 0.03, gap(0.3, error)))
    assert (
        "The error on the held-out data goes from 30.0 % to a prediction that runs away; noise alone is 2.0 %." in told
    )


def test_errors_are_shares_of_the_signal() -> None:
    assert error_in_words(0.0213) == "2.1 %"
    assert error_in_words(2.5) == "250.0 %"


def test_what_is_missing_how_sure_and_what_it_does_come_first() -> None:
    spot = SimpleNamespace(channel="acceleration_2", sentence="floor 2 from 8 to 14 s")
    other = SimpleNamespace(channel="acceleration_1", sentence="floor 1 from 1 to 2 s")
    where: Any = SimpleNamespace(spots=(other, spot))
    told = sentences(believed("effects_found", 0.97), (added(),), None, where, gap(0.18, 0.021))
    assert told == (
        "The model lacks slip_lock, storey 2: the joint slips (probability 0.97).",
        (
            "Slip_lock, storey 2: overwhelming evidence (probability 0.998, 812 nats); pinching index: measured 0.09, "
            "identified 0.07, without it 0.5."
        ),
        "The error on the fitted record goes from 18.0 % to 2.1 %; noise alone is 2.0 %.",
        "Where it showed: floor 2 from 8 to 14 s.",
    )


def test_nothing_missing_is_one_sentence() -> None:
    told = sentences(believed("no_missing_effect", 0.9999999), (), None, NOWHERE, gap(0.02, 0.02))
    assert told == ("The model as given explains the record: nothing is missing (probability above 0.999).",)


def test_a_law_without_its_signature_goes_by_its_plain_name() -> None:
    """Evidence says that a law helps; it does not say that the loop is pinched."""
    told = sentences(believed("effects_found", 0.95), (added(deserved=0.02),), None, NOWHERE, gap(0.2, 0.1))
    assert told[0].startswith("Something is missing that the catalogue can hold, but no single effect is certain")
    assert told[1].startswith("The shape of the reloading branch, storey 2: overwhelming evidence")
    assert told[1].endswith("; the law helps, but not by what its usual name says.")
    assert not any("slip_lock" in sentence for sentence in told)


@pytest.mark.parametrize(("probability", "word"), [(0.7, "Possibly, slip_lock"), (0.3, "Perhaps, slip_lock")])
def test_what_is_not_certain_is_said_to_be_so(probability: float, word: str) -> None:
    one = added(probability, equivalent=("backlash",), equivalent_places=((1,),))
    told = sentences(believed("effects_found", 0.95), (one,), None, NOWHERE, gap(0.2, 0.1))
    assert told[1].startswith(word)
    assert "the record cannot tell it from backlash or the same at storey 1" in told[1]


@pytest.mark.parametrize(
    ("verdict", "effects", "first"),
    [
        ("partly_explained", (added(),), "The model lacks slip_lock, storey 2, and more: beside it stays a force"),
        ("unexplained", (), "Model and record disagree, and no catalogued effect explains it better than a force"),
    ],
)
def test_a_force_of_no_known_law_is_told_with_its_share(verdict: str, effects: tuple[Added, ...], first: str) -> None:
    force = UnnamedForce(storey=1, place="storey 1", probability=0.93, share=0.12, drift=np.zeros(2), force=np.zeros(2))
    told = sentences(believed(verdict, 0.93), effects, force, NOWHERE, gap(0.2, 0.1))
    assert told[0].startswith(first)
    assert any("at storey 1 takes up what the model does not: 12 % of the force (probability 0.93)" in s for s in told)
