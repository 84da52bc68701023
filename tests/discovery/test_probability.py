"""From evidences to classes and names, against sums by hand."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.probability import (
    ANOTHER,
    LAW_ERROR,
    NOTHING_MISSING,
    Beliefs,
    beliefs,
    law_errors,
    log_prior,
)
from bwbn_bayes.inference.unnamed.further_link import Span

VARIANTS = {"slip_lock": 4, "cubic_stiffness": 8, "strength_degradation": 4, "stiffness_degradation": 4}
FAMILIES = dict.fromkeys(("strength_degradation", "stiffness_degradation"), "a loss of strength or stiffness")
N_EFFECTS = 20


def hypothesis(name: str, *storeys: int, n_brought: int = 1) -> Any:
    effect, guide = SimpleNamespace(level="link"), SimpleNamespace(family=FAMILIES.get(name, ""))
    return SimpleNamespace(name=name, symbols=(name,), storeys=storeys, n_brought=n_brought, effect=effect, guide=guide)


def explanation(
    log_evidence: float,
    *added: Any,
    unnamed: tuple[int, ...] | None = None,
    is_noise: bool = True,
) -> Explanation:
    result = Explanation(
        added=added,
        posterior=cast(Any, None),
        modes=(),
        evidence=cast(Any, SimpleNamespace(log_evidence=log_evidence, log_evidence_se=0.1)),
        unnamed=unnamed,
        n_places=3,
    )
    result.__dict__["is_noise"] = is_noise  # else found from the record
    return result


SLIP, SLIP_3, CUBIC = hypothesis("slip_lock", 2), hypothesis("slip_lock", 3), hypothesis("cubic_stiffness", 2)


def test_half_of_the_prior_says_that_nothing_is_missing() -> None:
    assert log_prior(explanation(0.0), N_EFFECTS, VARIANTS) == pytest.approx(np.log(NOTHING_MISSING))


def test_the_prior_is_shared_by_effects_their_variants_and_the_unnamed_force() -> None:
    """All explanations of one effect, without unnamed force, have together what the table gives to one effect."""
    one = log_prior(explanation(0.0, SLIP), N_EFFECTS, VARIANTS)
    expected = (1.0 - NOTHING_MISSING) * (1.0 - ANOTHER) ** 2 / (N_EFFECTS * 4)
    assert np.exp(one) == pytest.approx(expected)
    with_it = log_prior(explanation(0.0, SLIP, unnamed=(2,)), N_EFFECTS, VARIANTS)
    assert np.exp(with_it - one) == pytest.approx(ANOTHER**2 / ((1.0 - ANOTHER) * 3))
    # Two effects in either order are one explanation.
    both = log_prior(explanation(0.0, SLIP, CUBIC), N_EFFECTS, VARIANTS)
    assert np.exp(both - one) == pytest.approx(ANOTHER * 2.0 / (N_EFFECTS * 8))


def test_an_unnamed_force_alone_or_with_any_number_of_effects_has_the_whole_of_its_share() -> None:
    """The geometric series over numbers of effects sums to one, with an unnamed force from none on, else from one."""
    many = [hypothesis(f"effect_{i}", 1) for i in range(40)]
    variants = {h.name: 1 for h in many}
    of_each = [
        np.exp(log_prior(explanation(0.0, *many[:k], unnamed=(1,)), 40, variants)) * 3 * 40.0**k for k in range(30)
    ]
    orders = np.cumprod([1.0, *range(1, 30)])
    assert np.sum(of_each / orders) == pytest.approx((1.0 - NOTHING_MISSING) * ANOTHER)


def test_probabilities_are_sums_over_explanations() -> None:
    every = (
        explanation(0.0),
        explanation(20.0, SLIP),
        explanation(19.0, SLIP_3),
        explanation(18.0, SLIP, CUBIC),
        explanation(17.0, SLIP, unnamed=(2,)),
        explanation(5.0, unnamed=(2,)),
    )
    found = beliefs(every, N_EFFECTS, VARIANTS)
    joint = np.exp([one.evidence.log_evidence + log_prior(one, N_EFFECTS, VARIANTS) for one in every])
    share = joint / np.sum(joint)
    assert found.best is every[1]
    assert found.verdict == "effects_found"
    assert found.verdicts == pytest.approx(
        {
            "no_missing_effect": share[0],
            "effects_found": share[1] + share[2] + share[3],
            "partly_explained": share[4],
            "unexplained": share[5],
        }
    )
    assert sum(found.verdicts.values()) == pytest.approx(1.0)
    assert list(found.names) == ["slip_lock", "cubic_stiffness"]
    assert found.names == pytest.approx({"slip_lock": np.sum(share[1:5]), "cubic_stiffness": share[3]})
    assert found.of_places("slip_lock") == pytest.approx({(2,): share[1] + share[3] + share[4], (3,): share[2]})
    assert found.deliverable[0] is every[1]


def test_what_predicts_best_is_delivered_with_every_name_in_it() -> None:
    """With the unnamed force or without, what is named is certain: delivered is the model without, and no other."""
    plain, with_it = explanation(0.0, SLIP), explanation(40.0, SLIP, unnamed=(1,))
    found = beliefs((explanation(30.0, CUBIC), plain, with_it), N_EFFECTS, VARIANTS)
    assert found.best is with_it
    assert found.verdict == "partly_explained"
    assert found.likely == {("slip_lock", (2,))}
    assert found.deliverable[0] is plain


def test_nothing_is_named_where_evidences_are_equal() -> None:
    found = beliefs((explanation(0.0), explanation(0.0, SLIP), explanation(0.0, unnamed=(1,))), N_EFFECTS, VARIANTS)
    assert found.verdict == "no_missing_effect"
    assert found.names["slip_lock"] < 0.05


def test_the_most_probable_of_those_with_what_is_likely_is_delivered() -> None:
    """Of explanations without an unnamed force; what could be named as absent is not among its effects."""
    one, both = explanation(40.0, SLIP), explanation(45.5, SLIP, CUBIC)
    found = beliefs((explanation(0.0), one, both), N_EFFECTS, VARIANTS)
    assert found.likely == {("slip_lock", (2,))}
    assert 0.1 < found.names["cubic_stiffness"] < 0.5
    assert found.deliverable[0] is one
    cost = log_prior(one, N_EFFECTS, VARIANTS) - log_prior(both, N_EFFECTS, VARIANTS)
    even = explanation(40.0 + cost + 0.1, SLIP, CUBIC)
    assert beliefs((explanation(0.0), one, even), N_EFFECTS, VARIANTS).deliverable[0] is even
    # A force of no known law says that there is no cubic spring: the law that takes its part by one is not delivered.
    forced = explanation(60.0, SLIP, unnamed=(1,))
    said = beliefs((explanation(0.0), one, explanation(48.0, SLIP, CUBIC), forced), N_EFFECTS, VARIANTS)
    assert said.names["cubic_stiffness"] < 0.1
    assert said.deliverable[0] is one


def test_where_no_law_leaves_noise_whatever_predicts_best_is_delivered_that_has_the_names() -> None:
    """A measured test: beside the force one effect is named, alone a law needs another, which the force takes up."""
    forced = explanation(90.0, SLIP, unnamed=(1,), is_noise=False)
    wrong = [explanation(v, *added, is_noise=False) for v, added in ((0.0, (SLIP,)), (50.0, (SLIP, CUBIC)))]
    without = explanation(60.0, CUBIC, is_noise=False)
    found = beliefs((forced, *wrong, without), N_EFFECTS, VARIANTS)
    found.__dict__["borne_out"] = {"slip_lock": 0.95}
    assert found.names["cubic_stiffness"] < 0.1
    assert found.deliverable[0] is wrong[1]
    # What not all of the record bears out is no name, and need not be there.
    doubted = beliefs((forced, *wrong, without), N_EFFECTS, VARIANTS)
    doubted.__dict__["borne_out"] = {"slip_lock": 0.8}
    assert doubted.deliverable[0] is without


def test_what_a_law_is_forgiven_makes_it_predict_no_better() -> None:
    """A measured column got a pinch alone, which left 14.2 %, where a law of seven effects left 4.8 %."""
    forced = explanation(90.0, SLIP, unnamed=(1,), is_noise=False)
    one, more = (explanation(v, *added, is_noise=False) for v, added in ((0.0, (SLIP,)), (50.0, (SLIP, CUBIC))))
    found = beliefs((forced, more, one), N_EFFECTS, VARIANTS)
    erring = replace(found, explanations=(forced, one, more), forgiven=np.array([0.0, 80.0, 0.0]))
    erring.__dict__["borne_out"] = {"slip_lock": 0.95}
    assert erring.log_joint[1] > erring.log_joint[2]
    assert erring.deliverable[0] is more


def test_the_law_that_is_delivered_has_one_of_a_family_that_is_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither loss is certain beside the other; without any the law would contradict what is said."""
    monkeypatch.setattr(Beliefs, "_shown", lambda *_: 1.0)
    strength, stiffness = (hypothesis(f"{what}_degradation", 1) for what in ("strength", "stiffness"))
    forced = [explanation(90.0, one, unnamed=(1,), is_noise=False) for one in (strength, stiffness)]
    alone = [explanation(v, one, is_noise=False) for v, one in ((60.0, CUBIC), (40.0, strength), (30.0, stiffness))]
    found = beliefs((*forced, *alone), N_EFFECTS, VARIANTS)
    assert max(found.names.values()) < 0.9
    assert [one.probability for one in found.families] == [pytest.approx(1.0, abs=1e-6)]
    assert found.deliverable[0] is alone[1]


N = 4000


def leaving(*sizes: float, added: Sequence[Any] = (), n: int = N, unnamed: Any = None) -> Explanation:
    """Of n samples with an unknown level of noise, an explanation that leaves histories of these sizes beside it.

    They are in the unit of the noise, and each is uncorrelated with the others.
    """
    log_evidence = -0.5 * n * float(np.log(1.0 + np.sum(np.square(sizes))))
    result = explanation(log_evidence, *added, unnamed=unnamed)
    result.__dict__["residual"] = np.sqrt(n) * np.array([[*sizes, 0.0, 0.0][:2]])  # else solved for
    result.__dict__["over_noise"] = lambda rows: 0.5 * float(np.sum(np.square(rows)))
    return result


@pytest.mark.parametrize("error", [0.005, 0.02, 0.1])
@pytest.mark.parametrize("size", [5.0, 30.0])
def test_by_how_much_a_law_must_err_is_told_from_the_squares_that_are_left(error: float, size: float) -> None:
    """A law that does 5 or 30 times the noise, and what it errs by taken up by a second effect that is not there."""
    given, alone = leaving(size), leaving(0.0, error * size, added=[SLIP])
    both = leaving(added=[SLIP, CUBIC])
    found, forgiven = law_errors((given, alone, both))
    assert found[1] == pytest.approx(error, rel=0.02 + (error * size) ** 2)  # of first order
    gained = both.evidence.log_evidence - alone.evidence.log_evidence
    assert forgiven[1] == pytest.approx(max(gained - 0.5 * (found[1] / LAW_ERROR) ** 2, 0.0))
    assert found[[0, 2]].tolist() == forgiven[[0, 2]].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("error", "named"), [(0.015, False), (0.1, True)])
def test_what_a_law_errs_by_is_no_further_effect(error: float, named: bool) -> None:
    """A softened stop was a hard one with cubic stiffness beside it, by a hundred nats of the eighty thousand."""
    size = 30.0
    every = leaving(size), leaving(0.0, error * size, added=[SLIP]), leaving(added=[SLIP, CUBIC])
    found = beliefs(every, N_EFFECTS, VARIANTS, laws_err=True)
    assert (found.names["cubic_stiffness"] > 0.9) == named
    assert found.names["slip_lock"] > 0.99
    assert beliefs(every, N_EFFECTS, VARIANTS).names["cubic_stiffness"] > 0.9  # a law without error


def test_what_a_law_does_is_no_matter_of_what_else_could_account_for_it() -> None:
    """Autoregressive errors beside the model as given take most of what a law explains; it does as much as before."""
    size = 30.0
    given, alone, both = leaving(size), leaving(0.0, 0.015 * size, added=[SLIP]), leaving(added=[SLIP, CUBIC])
    taken = SimpleNamespace(log_evidence=alone.evidence.log_evidence - 500.0, log_evidence_se=0.1)
    coloured = replace(given, evidence=cast(Any, taken))
    coloured.__dict__.update(residual=given.residual, is_noise=False)
    found, _ = law_errors((coloured, alone, both))
    assert found[1] == pytest.approx(0.015, rel=0.2)


def test_in_much_noise_no_error_of_a_law_is_seen() -> None:
    """An effect as large as the noise: a second one, of a third of it, is worth what it is worth."""
    every = leaving(1.0, n=600), leaving(0.0, 0.3, added=[SLIP], n=600), leaving(added=[SLIP, CUBIC], n=600)
    _, forgiven = law_errors(every)
    assert np.all(forgiven == 0.0)


@pytest.mark.parametrize(
    ("second", "unnamed", "forgiven"),
    [
        (hypothesis("cubic_stiffness", 2), None, True),
        (hypothesis("cubic_stiffness", 3), None, False),
        (hypothesis("cubic_stiffness", 1, 2, 3), None, True),
        (hypothesis("input_scale"), None, False),
        (None, (2,), True),
        (None, (1, 2, 3), True),
        (None, (3,), False),
        (None, Span(0, 2), False),
        (None, "acceleration_2", False),
    ],
)
def test_a_law_errs_where_it_acts(second: Any, unnamed: Any, forgiven: bool) -> None:
    """Two hundred nats by a change of another storey are no error of one per cent of a pinch in this one."""
    added = [SLIP] if second is None else [SLIP, second]
    _, found = law_errors((leaving(30.0), leaving(0.0, 0.3, added=[SLIP]), leaving(added=added, unnamed=unnamed)))
    assert (found[1] > 100.0) == forgiven


def test_a_law_in_another_form_has_the_name_too() -> None:
    """What a hard stop with cubic stiffness explains is what a softened one may err by, though its form is another."""
    soft = hypothesis("slip_lock", 2)
    soft.symbols = ("soft",)
    every = (
        leaving(30.0),
        leaving(0.0, 0.22, added=[soft]),
        leaving(0.0, 0.45, added=[SLIP]),
        leaving(added=[SLIP, CUBIC]),
    )
    found = beliefs(every, N_EFFECTS, VARIANTS, laws_err=True)
    assert found.best is every[1]
    assert found.names["cubic_stiffness"] < 0.1


def test_what_is_left_must_be_noise() -> None:
    """A sensor that drifts is no force of the states: nothing beats the model as given, which yet does not explain."""
    found = beliefs((explanation(20.0, is_noise=False), explanation(0.0, SLIP)), N_EFFECTS, VARIANTS)
    assert found.verdict == "unexplained"
    found = beliefs((explanation(0.0), explanation(40.0, SLIP, is_noise=False)), N_EFFECTS, VARIANTS)
    assert found.verdict == "partly_explained"


def test_the_best_of_the_most_probable_class_may_not_be_the_best_of_all() -> None:
    """Slip alone 0.40, with a force in either storey 0.32 and 0.28."""
    every = tuple(
        explanation(float(np.log(p)), SLIP, unnamed=unnamed)
        for p, unnamed in ((0.40, None), (0.32, (1,)), (0.28, (2,)))
    )
    found = Beliefs(explanations=every, log_prior=np.zeros(3), law_error=np.zeros(3), forgiven=np.zeros(3))
    assert (found.verdict, found.best) == ("partly_explained", every[0])
    assert [found.first_of(verdict) for verdict in ("effects_found", "partly_explained")] == [0, 1]


def test_an_explanation_tells_where_its_unnamed_force_is() -> None:
    """Three of one building read alike."""
    assert explanation(0.0).label == "the model as given"
    assert explanation(0.0, unnamed=(2,)).label == "a force of no known law in storey 2"
    assert replace(explanation(0.0, unnamed=(1,)), n_places=1).label == "a force of no known law"
    linked = replace(explanation(0.0), unnamed=Span(0, 2))
    assert linked.label == "a further link between the ground and floor 2"
    misread = replace(explanation(0.0), unnamed="acceleration_3")
    assert misread.label == "an error of no known kind in acceleration_3"
    assert linked.has_unnamed and misread.has_unnamed


def test_an_effect_is_placed_where_it_comes_into_play() -> None:
    """A stop that storey 1 never meets is as probable in storeys 1 and 2 as in storey 2 alone."""
    alone, alike = explanation(40.0, SLIP), explanation(40.4, hypothesis("slip_lock", 1, 2))
    found = beliefs((explanation(0.0), alone, alike), N_EFFECTS, VARIANTS)
    assert found.best is alike
    assert found.likely == {("slip_lock", (2,))}
    assert found.deliverable[0] is alone
    clear = beliefs((alone, explanation(43.0, hypothesis("slip_lock", 1, 2))), N_EFFECTS, VARIANTS)
    assert clear.likely == {("slip_lock", (1, 2))}
