"""What is said of each name in the end, on explanations without any dynamics."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import conclusion, probability
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.elements.effects import CubicStiffness, SlipLock
from bwbn_bayes.elements.law import Effect

MECHANISMS = {"a": "wear", "b": "play", "c": "wear", "d": "rust"}
FAMILIES = {"a": "a loss", "b": "", "c": "", "d": "a loss"}


def explanation(names: str, log_evidence: float, *, estimate: Any = None, left: float = 1e-9, shown: str = "") -> Any:
    """With so much residual energy beyond the noise left; a measured loop shows some of its effects."""
    return SimpleNamespace(
        names=frozenset(names),
        effects_key=frozenset(names),
        added=tuple(
            SimpleNamespace(
                name=name,
                effect=SimpleNamespace(mechanism=MECHANISMS[name]),
                guide=SimpleNamespace(family=FAMILIES[name]),
            )
            for name in names
        ),
        evidence=SimpleNamespace(log_evidence=log_evidence, log_evidence_se=0.1 * len(names)),
        disagreement=SimpleNamespace(residual_to_noise=np.sqrt([1.0 + left])),
        loop_shows=lambda name: name in shown,
        estimate=estimate,
        has_unnamed=estimate is not None,
        is_specimen=False,
        is_noise=False,
    )


@pytest.fixture(autouse=True)
def compared(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """Evidences that are compared in stretches, in the place of the comparison, which says 0.7."""
    found: list[tuple[float, float]] = []

    def compare(one: Any, other: Any) -> float:
        found.append((one.log_evidence, other.log_evidence))
        return 0.7

    monkeypatch.setattr(probability, "probability_of_being_better", compare)
    return found


def believed(*explanations: Any) -> Beliefs:
    nothing = np.zeros(len(explanations))
    return Beliefs(explanations=cast(Any, explanations), log_prior=nothing, law_error=nothing, forgiven=nothing)


def test_the_best_with_an_effect_is_compared_with_the_best_without_it(compared: list[tuple[float, float]]) -> None:
    """A building's explanation with an unnamed force, though it leads, is not asked."""
    forced = explanation("", 90.0, estimate="a force")
    every = (
        forced, explanation("ab", 89.9), explanation("b", 89.5, left=1.0), explanation("a", 1.0, left=1.0),
        explanation("", 0.0, left=2.0),
    )  # fmt: skip
    assert believed(*every).borne_out == pytest.approx({"a": 0.7, "b": 0.7}, rel=1e-3)
    assert sorted(compared) == [(89.9, 1.0), (89.9, 89.5)]


def test_of_a_specimen_evidence_says_how_far_stretches_agree(compared: list[tuple[float, float]]) -> None:
    every = explanation("a", 50.0), explanation("", 0.0, left=2.0)
    every[0].is_specimen = True
    assert believed(*every).borne_out == pytest.approx({"a": 1.0}, rel=1e-3)
    assert compared == []


def test_another_law_of_the_same_mechanism_is_no_rival(compared: list[tuple[float, float]]) -> None:
    """Which of two laws of wear it is, the evidence tells; that there is wear, the record."""
    found = believed(explanation("a", 50.0), explanation("c", 30.0), explanation("", 0.0)).borne_out
    assert set(found) == {"a"}
    assert compared == [(50.0, 0.0)]


def test_without_a_rival_there_is_nothing_to_bear_out() -> None:
    assert believed(explanation("a", 50.0), explanation("ab", 40.0)).borne_out == {"a": 1.0}


@pytest.mark.parametrize(
    ("left", "shown", "expected"),
    [
        (0.5, "", 0.7 * 0.8 / (0.8 + 0.2 * 0.5 * 9.2103)),  # half of what has no name: any law may have that
        (0.04, "", 0.7 * 0.8 / (0.8 + 0.2 * 0.04 * 9.2103)),
        (0.0, "", 0.7 * 0.8 / (0.8 + 0.2 * 1e-4 * 9.2103)),  # no law errs by less than a hundredth
        (0.5, "a", 0.7),
    ],
)
def test_what_leaves_much_may_be_an_imitation(left: float, shown: str, expected: float) -> None:
    """By hand: densities of what is left, 1 / (x ln(1e4)) of what is there and 1 of what looks like it, at 4 to 1."""
    every = believed(explanation("a", 50.0, left=left, shown=shown), explanation("", 0.0, left=1.0))
    assert every.borne_out["a"] == pytest.approx(expected, rel=1e-4)


def test_what_bends_alike_says_nothing_of_an_imitation() -> None:
    """Which of two names it is, evidence tells: imitations are asked of the other effects with nothing in the place."""
    every = believed(
        explanation("ab", 50.0, left=0.02),
        explanation("db", 30.0, left=0.02),
        explanation("b", 10.0, left=0.5),
        explanation("", 0.0, left=2.0),
    )
    assert every.borne_out["a"] == pytest.approx(0.7 * 0.8 / (0.8 + 0.2 * 0.04 * 9.2103), rel=1e-4)
    # Without b nothing was fitted but the model as given, of which half is explained in vain.
    assert every.borne_out["b"] == pytest.approx(0.7 * 0.8 / (0.8 + 0.2 * 0.01 * 9.2103), rel=1e-4)


@pytest.mark.parametrize(
    ("effect", "is_specimen", "shown"),
    [
        (SlipLock(delta_s=0.1, sigma=0.1), True, True),
        (SlipLock(delta_s=0.1, sigma=0.1), False, False),  # no loop was measured
        (CubicStiffness(k3=1.0), True, False),  # no loop shows a cubic spring by itself
    ],
)
def test_what_a_measured_loop_shows(effect: Effect, is_specimen: bool, shown: bool) -> None:
    one: Any = SimpleNamespace(is_specimen=is_specimen, added=(SimpleNamespace(name=effect.name, effect=effect),))
    assert Explanation.loop_shows(one, effect.name) is shown
    assert not Explanation.loop_shows(one, "another")


def test_from_a_twentieth_on_a_name_is_not_given() -> None:
    assert probability.of_no_imitation(0.048) > probability.NAMED > probability.of_no_imitation(0.049)


def test_where_a_law_leaves_noise_the_evidence_says_it_all() -> None:
    right = explanation("a", 50.0)
    right.is_noise = True
    assert believed(right, explanation("", 0.0)).borne_out == {}


def test_improbable_names_are_not_asked() -> None:
    found = believed(explanation("a", 50.0), explanation("b", 30.0), explanation("", 0.0)).borne_out
    assert set(found) == {"a"}


def test_each_name_has_one_probability_wherever_it_is_told() -> None:
    """What was added as the table of effects has it; the others by their law, as far as that is borne out."""
    every = believed(explanation("ab", 50.0), explanation("ac", 50.0), explanation("", 0.0))
    added = SimpleNamespace(hypothesis=SimpleNamespace(name="a"), name_probability=0.3)
    every.__dict__["borne_out"] = {"a": 0.9, "b": 0.8}
    names = conclusion._of_names(every, cast(Any, [added]))
    assert list(names) == ["c", "b", "a"]
    assert names == {"a": 0.3, "b": pytest.approx(0.4), "c": pytest.approx(0.5)}


def test_a_bayes_factor_and_prior_odds_make_the_probability() -> None:
    every = explanation("ab", 3.0), explanation("a", 2.5), explanation("b", 2.0), explanation("", 1.0)
    log_prior, nothing = np.log([0.1, 0.2, 0.3, 0.4]), np.zeros(4)
    own = Beliefs(explanations=cast(Any, every), log_prior=log_prior, law_error=nothing, forgiven=nothing)
    factor, _ = own.bayes_factor(frozenset("a"))
    odds = np.exp(factor) * 0.3 / 0.7
    assert own.of_name("a") == pytest.approx(odds / (1.0 + odds))


def test_a_bayes_factor_is_that_with_and_without_the_effect() -> None:
    every = explanation("ab", 50.0), explanation("a", 40.0), explanation("b", 35.0), explanation("", 0.0)
    factor, error = believed(*every).bayes_factor(frozenset("a"))
    assert (factor, error) == (pytest.approx(15.0, abs=1e-4), pytest.approx(np.hypot(0.2, 0.1)))
    assert believed(explanation("a", 40.0)).bayes_factor(frozenset("a"))[0] == np.inf


def test_one_of_two_that_are_alike_may_be_certain_where_neither_is(compared: list[tuple[float, float]]) -> None:
    """On a brace's test one of two losses was worth 208 nats, and neither had a name for the other's sake."""
    every = believed(
        explanation("ab", 50.0), explanation("bd", 49.9), explanation("b", 10.0, left=1.0), explanation("", 0.0)
    )
    assert every.names["a"] < 0.6
    assert every.names["d"] < 0.6
    (loss,) = every.families
    assert (loss.title, loss.names) == ("a loss", frozenset("ad"))
    assert loss.probability == pytest.approx(0.7, rel=1e-3)  # as far as it is borne out
    assert loss.log_bayes_factor == pytest.approx(40.0 + np.log1p(np.exp(-0.1)), abs=1e-3)
    assert (50.0, 10.0) in compared
    right = explanation("ab", 50.0)
    right.is_noise = True
    (loss,) = believed(right, explanation("bd", 49.9), explanation("b", 10.0)).families
    assert loss.probability == pytest.approx(1.0)


def test_one_effect_alone_is_no_family() -> None:
    assert believed(explanation("ab", 50.0), explanation("b", 10.0)).families == ()


def test_a_family_deserves_its_title_as_far_as_what_is_of_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    best = {"a": 1.0, "b": 1.0, "d": 1.0}
    monkeypatch.setattr(conclusion, "_deserved_at_best", lambda name, _: best[name])
    every = believed(explanation("ab", 50.0), explanation("bd", 49.9), explanation("b", 10.0, left=1.0))

    def told(**deserved: float) -> Any:
        added = [SimpleNamespace(hypothesis=SimpleNamespace(name=k), deserved=v) for k, v in deserved.items()]
        return conclusion._families(every, cast(Any, added))

    assert [one.probability for one in told()] == [pytest.approx(0.7, rel=1e-3)]
    assert [one.probability for one in told(a=0.6, b=0.1, d=0.8)] == [pytest.approx(0.56, rel=1e-3)]
    # One that goes by a plain name says nothing of a loss, and the other is no family by itself.
    assert told(a=0.1) == ()
    # So does one that is not of the improved model, where it stands best.
    best["d"] = 0.0
    assert told(a=0.9) == ()
