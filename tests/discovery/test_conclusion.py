"""The verdict: what counts as found, as contributing, and as unexplained."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery.conclusion import (
    Grown,
    _sentences,
    _verdict,
    _what_stays,
    _why_withdrawn,
    badly_sampled,
    is_explained,
    unexplained_share,
    what_stayed,
)
from bwbn_bayes.discovery.outcome import Added, Gap, Step
from bwbn_bayes.discovery.run import DiscoverySettings, Present, Run
from bwbn_bayes.results import Check, Facts


def fitted(ratios: tuple[float, ...], *, noise: bool = False, quiet: bool = False) -> Present:
    """A fitted model that leaves so many times the noise on each channel."""
    disagreement = SimpleNamespace(residual_to_noise=np.array(ratios))
    return cast(Present, SimpleNamespace(disagreement=disagreement, is_noise=noise, is_quiet=quiet))


def effects(
    n: int, names: str = "abcd", parameters: Mapping[int, str] | None = None, doubts: Mapping[int, str] | None = None
) -> tuple[Added, ...]:
    """Effects by one letter each, all at storey 1; some, by their number, change a parameter or are in doubt.

    A capital has one law.
    """
    changed = parameters or {}
    own = [{"parameter": changed[i]} if i in changed else {} for i in range(n)]
    laws = [SimpleNamespace(one_law=names[i].isupper(), **own[i]) for i in range(n)]
    hypotheses = (SimpleNamespace(name=names[i], storeys=(1,), effect=laws[i]) for i in range(n))
    told = doubts or {}
    return cast(
        tuple[Added, ...],
        tuple(
            SimpleNamespace(candidate=SimpleNamespace(hypothesis=h), doubt=told.get(i, ""))
            for i, h in enumerate(hypotheses)
        ),
    )


GIVEN = fitted((3.0, 2.0))
"""Excess energies of 8 and 3."""


def test_the_share_counts_what_exceeds_the_noise() -> None:
    assert unexplained_share(GIVEN, fitted((2.0, 1.0))) == pytest.approx(3.0 / 11.0)
    assert unexplained_share(GIVEN, fitted((0.9, 1.0))) == 0.0
    assert unexplained_share(GIVEN, fitted((9.0, 9.0))) == 1.0
    assert unexplained_share(fitted((0.9,)), fitted((0.9,))) == 0.0


# The share left is (r^2 - 1) / 11 with r the first channel's ratio.
@pytest.mark.parametrize(
    ("n_added", "ratio", "noise", "verdict"),
    [
        (0, 3.0, False, "unexplained"),
        (0, 1.0, True, "no_missing_effect"),
        (1, 1.2, False, "effects_found"),
        (2, 1.2, False, "effects_found"),
        (1, 1.3, False, "partly_explained"),
        (1, 1.4, False, "partly_explained"),
        (2, 1.4, False, "partly_explained"),
        (3, 1.0, True, "partly_explained"),
        (2, 1.6, True, "effects_found"),
        (2, 1.6, False, "unexplained"),
        (1, 1.8, True, "effects_found"),
        (1, 1.8, False, "partly_explained"),
        (1, 2.5, True, "partly_explained"),
        (1, 2.5, False, "unexplained"),
    ],
)
def test_verdict(n_added: int, ratio: float, noise: bool, verdict: str) -> None:
    present = fitted((ratio, 1.0), noise=noise)
    assert _verdict(GIVEN, present, effects(n_added), None) == verdict
    assert is_explained(GIVEN, present, effects(n_added)) == (verdict in ("effects_found", "no_missing_effect"))


def test_most_of_a_large_gap_is_not_enough() -> None:
    """Of 24 times the noise, 4 times is left: 2.6 % of the energy, and not the right law."""
    given = fitted((24.0,))
    assert unexplained_share(given, fitted((4.0,))) < 0.03
    assert _verdict(given, fitted((4.0,)), effects(1), None) == "partly_explained"
    assert _verdict(given, fitted((1.1,)), effects(1), None) == "effects_found"


def bar(nrmse: float, se: float = 0.0) -> Any:
    return SimpleNamespace(nrmse=nrmse, nrmse_se=se)


def missing(after: float, se: float = 0.0, before: float = 0.1) -> Gap:
    return Gap(noise_floor=0.01, before=bar(before), after=bar(after, se))


def test_a_gap_is_closed_within_a_quarter_of_the_noise_or_two_standard_errors() -> None:
    assert missing(0.0125).is_closed
    assert not missing(0.0126).is_closed
    assert missing(0.02, se=0.005).is_closed
    assert not missing(0.02, se=0.004).is_closed


@pytest.mark.parametrize(
    ("n_added", "after", "verdict"),
    [
        (0, 0.05, "no_missing_effect"),
        (1, 0.011, "effects_found"),
        (1, 0.02, "partly_explained"),
        (2, 0.02, "partly_explained"),
        (3, 0.011, "partly_explained"),
        (3, 0.02, "unexplained"),
        (1, 0.099, "partly_explained"),
        (1, 0.1, "unexplained"),
        (2, 0.05, "partly_explained"),
        (2, 0.052, "unexplained"),
        (2, 0.2, "unexplained"),
        (2, np.inf, "unexplained"),
        (1, np.nan, "unexplained"),
    ],
)
def test_what_imitates_the_record_does_not_foresee_others(n_added: int, after: float, verdict: str) -> None:
    """The fit leaves noise; the verdict turns on the held-out record.

    Of its error beyond the noise, in energy, (after^2 - 0.01^2) / (0.1^2 - 0.01^2) is left; a quarter at 0.0507.
    """
    assert _verdict(GIVEN, fitted((1.0, 1.0), noise=True), effects(n_added), missing(after)) == verdict


def step(number: int, *, passes: bool) -> Step:
    decision = cast(Any, SimpleNamespace(passes=passes))
    return Step(
        number=number,
        model=cast(Any, None),
        disagreement=cast(Any, None),
        decision=decision,
        sentence=f"Step {number}.",
        elapsed_s=1.0,
    )


def test_two_forms_of_one_effect_at_one_place_are_an_imitation() -> None:
    """Of three, or of two that are shapes of one law; two alone may be a gap with other stops to either side."""
    noise = fitted((1.0, 1.0), noise=True)
    assert _verdict(GIVEN, noise, effects(3, "aba"), None) == "unexplained"
    assert _verdict(GIVEN, noise, effects(2, "aa"), None) == "effects_found"
    assert _verdict(GIVEN, noise, effects(2, "AA"), None) == "unexplained"
    assert _verdict(GIVEN, noise, effects(2, "AB"), None) == "effects_found"
    reason = "two forms of A at one place can only imitate another effect"
    assert _why_withdrawn(0.0, effects(2, "AA"), None) == reason
    reason = "two forms of a at one place can only imitate another effect"
    assert _why_withdrawn(0.0, effects(3, "aba"), None) == reason
    assert _why_withdrawn(0.3, effects(2, "aa"), None) == what_stayed(0.3)
    assert _verdict(GIVEN, noise, effects(3, "aba", {0: "gamma", 2: "n"}), None) == "partly_explained"
    assert _verdict(GIVEN, noise, effects(3, "aba", {0: "n", 2: "n"}), None) == "unexplained"


def test_a_name_in_doubt_stays_only_where_it_leaves_noise() -> None:
    noise, near = fitted((1.0, 1.0), noise=True), fitted((1.4, 1.0))
    one, second = effects(1, doubts={0: "a: hardly"}), effects(2, doubts={1: "b: hardly"})
    assert _verdict(GIVEN, noise, one, None) == "effects_found"
    assert _verdict(GIVEN, near, one, None) == "unexplained"
    assert _verdict(GIVEN, near, effects(1), None) == "partly_explained"
    assert _why_withdrawn(0.05, one, None) == "a: hardly"
    # A first one stays without what followed only if it is not itself in doubt.
    stays = [_what_stays(GIVEN, Grown(near, added, near, True), lambda _: None)[0] for added in (second, one + one)]
    assert stays == ["partly_explained", "unexplained"]


@pytest.mark.parametrize(
    ("n_added", "level", "stay"),
    [(3, 1.3, 1), (3, 1.6, 0), (1, 1.3, 1)],
    ids=["near", "far", "alone"],
)
def test_the_first_effect_stays_where_it_came_near(n_added: int, level: float, stay: int) -> None:
    """Several that miss the held-out record are withdrawn, but not a first one that left little more than noise."""
    first = fitted((level, 1.0))
    grown = Grown(first if n_added == 1 else fitted((1.0, 1.0), noise=True), effects(n_added), first, True)
    verdict, present, added = _what_stays(GIVEN, grown, lambda _: missing(0.02))
    assert verdict == ("partly_explained" if stay else "unexplained")
    assert added == grown.added[:stay]
    assert present is (first if stay else GIVEN)


@pytest.mark.parametrize(("level", "ahead", "stay"), [(8.0, 0.19, 1), (8.2, 0.19, 0), (8.0, 0.21, 0)])
def test_the_first_effect_stays_where_hardly_anything_is_left(level: float, ahead: float, stay: int) -> None:
    """A law of another shape leaves a few hundredths of a large gap, which is many times a small noise.

    The shares left are (level^2 - 1) / 1599 of the record and (ahead^2 - .0001) / .9999 of the held-out one.
    """
    given, first, both = fitted((40.0,)), fitted((level,)), fitted((1.0,), noise=True)
    of = {id(first): missing(ahead, before=1.0), id(both): missing(0.6, before=1.0)}
    verdict, present, added = _what_stays(given, Grown(both, effects(2), first, True), lambda model: of[id(model)])
    assert (verdict, len(added)) == (("partly_explained", 1) if stay else ("unexplained", 0))
    assert present is (first if stay else given)


@pytest.mark.parametrize("of_first", [0.05, 0.3])
def test_what_foresees_no_more_than_the_given_model_does_not_stay(of_first: float) -> None:
    """Two effects leave noise and miss the held-out record by more than without them; the first alone may not."""
    first, both = fitted((1.1, 1.0)), fitted((1.0, 1.0), noise=True)
    grown = Grown(both, effects(2), first, True)
    verdict, present, added = _what_stays(GIVEN, grown, lambda model: missing(of_first if model is first else 0.3))
    stays = of_first < 0.1
    assert verdict == ("partly_explained" if stays else "unexplained")
    assert added == grown.added[: int(stays)]
    assert present is (first if stays else GIVEN)
    reason = "the held-out record is missed by 30.0 times its noise, no less than without"
    assert _why_withdrawn(0.0, effects(2), missing(0.3)) == reason
    reason = "the held-out record is missed by 6.0 times its noise, 35 % of the disagreement there stayed"
    assert _why_withdrawn(0.09, effects(2), missing(0.06)) == reason
    # Where both are right to within the noise nothing is wrong with either.
    assert _verdict(GIVEN, both, effects(1), missing(0.011, before=0.0109)) == "effects_found"


def test_what_did_not_stay_is_said_to_be_withdrawn() -> None:
    told: list[str] = []
    run = Run(settings=DiscoverySettings(), rng=np.random.default_rng(1), listener=told.append)
    run.steps += [step(1, passes=True), step(2, passes=False), step(3, passes=True)]
    decision = run.steps[2].decision
    assert decision is not None
    run.withdraw("a later effect makes it superfluous", decision)
    sentences = [one.sentence for one in run.steps]
    assert sentences == ["Step 1.", "Step 2.", "Step 3. It is withdrawn: a later effect makes it superfluous."]
    assert [one.withdrawn for one in run.steps] == [False, False, True]
    assert told == []
    run.note("It rained.")
    assert (run.notes, told[-1]) == (["It rained."], "It rained.")


def test_what_the_record_cannot_tell_apart_stands_in_the_headline() -> None:
    hypothesis = SimpleNamespace(
        label="slip_lock, storey 2", storeys=(2,), effect=SimpleNamespace(level="link", summary="the joint slips")
    )
    decision = SimpleNamespace(equivalent=("gap_impact",), equivalent_places=((1,),))
    one = Added(candidate=cast(Any, SimpleNamespace(hypothesis=hypothesis)), decision=cast(Any, decision), moments={})
    before = cast(Any, SimpleNamespace(spots=(), residual_to_noise=np.array([9.0, 1.0])))
    gap = missing(0.1)
    first, _ = _sentences("effects_found", (one,), 0.0, before, before, gap)
    assert first == (
        "The model lacks slip_lock, storey 2 (or gap_impact or the same at storey 1: the record cannot tell): "
        "the joint slips."
    )
    first, _ = _sentences("partly_explained", (one,), 0.06, before, before, gap)
    assert first.endswith(" contributes, but 6 % of the disagreement stays unexplained, 9.0 times the noise.")
    after: Any = SimpleNamespace(residual_to_noise=np.array([1.1, 1.0]))
    first, *_ = _sentences("partly_explained", (one,), 0.0, before, after, replace(gap, held_out=missing(0.02)))
    assert first.endswith(" contributes, but the held-out record is missed by 2.0 times its noise.")


def test_noise_that_rises_and_falls_is_no_place_of_disagreement() -> None:
    spot = SimpleNamespace(channel="acceleration_1", sentence="storey 1, 0 to 9 s: residual 2.0 times the noise")
    before = cast(Any, SimpleNamespace(spots=(spot,), residual_to_noise=np.array([2.0])))
    gap = missing(0.1)
    assert _sentences("no_missing_effect", (), 0.0, before, before, gap) == (
        "The model as given explains the record: what it leaves is noise.",
    )
    assert len(_sentences("unexplained", (), 1.0, before, before, gap)) == 2


@pytest.mark.parametrize(
    ("method", "k", "worth", "told"),
    [("importance", 0.3, 1900.0, False), ("importance", 0.9, 40.0, True), ("importance", 0.6, 40.0, True),
     ("importance", 0.9, 400.0, True), ("tmcmc", 9.0, 5.0, False)],
)  # fmt: skip
def test_errors_that_rest_on_hardly_a_draw_are_said_to_be_rough(
    method: str, k: float, worth: float, told: bool
) -> None:
    checks = (
        Check(name="Pareto k", value=k, limit=0.7, passed=k <= 0.7, sentence=""),
        Check(name="effective draws", value=worth, limit=2000.0, passed=False, sentence=""),
    )
    said = badly_sampled(cast(Facts, SimpleNamespace(method=method, checks=checks)))
    assert len(said) == told
    assert all(f"worth {worth:.0f} independent" in sentence for sentence in said)
