"""The decision on evidence made by hand: every rule by which an effect is named, or not."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.evidence import PRIOR_WIDTHS, Evidence
from bwbn_bayes.discovery.name import THRESHOLD, Decision, decide, worth_fitting
from bwbn_bayes.discovery.score import Score
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, SensorGain, SlipLock
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.parameters import HalfNormal, Normal, Uniform
from bwbn_bayes.structures.shear_building import ShearBuilding

BASE = ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(k=Uniform(5, 60), beta=2.0, gamma=1.0))
SCALES = Scales(**dict.fromkeys(Scales.__dataclass_fields__, 1.0))
CUBIC, DAMPER = CubicStiffness(k3=Normal(0.0, 1.0)), QuadraticDamping(c2=HalfNormal(1.0))
GAIN = SensorGain(gain=Normal(1.0, 0.1))
SLIP = SlipLock(delta_s=HalfNormal(0.1), sigma=Uniform(0.01, 0.1))
WIDER, NARROWER = "ten times wider", "ten times narrower"


def hypothesis(effect: Effect, storey: int = 1) -> Hypothesis:
    return Hypothesis(base=BASE, effect=effect, storeys=(storey,), scales=SCALES)


def evidence(
    log_evidence: float, se: float = 0.0, shifts: Mapping[str, float] | None = None, coloured: float = 0.0
) -> Evidence:
    return Evidence(
        log_likelihood=0.0, log_evidence=log_evidence, log_evidence_se=se, pareto_k=0.1, coloured_gain=coloured,
        means={}, sds={}, prior_shifts={**dict.fromkeys(PRIOR_WIDTHS, 0.0), **(shifts or {})},
    )  # fmt: skip


PRESENT = evidence(-500.0)


def decision(
    *weighed: tuple[Hypothesis, Evidence], present: Evidence = PRESENT, considered: Sequence[Hypothesis] | None = None
) -> Decision:
    """Evidences are given above the present model's log evidence of -500."""
    above = [(h, replace(e, log_evidence=e.log_evidence - 500.0)) for h, e in weighed]
    return decide(present, above, considered if considered is not None else [h for h, _ in weighed])


def test_the_threshold_is_eight_nats_of_posterior_odds() -> None:
    """One hypothesis has half the prior probability, the present model the other half."""
    assert THRESHOLD == 8.0
    assert decision((hypothesis(CUBIC), evidence(8.01))).passes
    assert not decision((hypothesis(CUBIC), evidence(7.99))).passes


def test_the_threshold_holds_beyond_the_errors_of_both_evidences() -> None:
    """Errors of 3 and 4 nats are 5 together."""
    present = evidence(-500.0, se=3.0)
    assert decision((hypothesis(CUBIC), evidence(13.01, se=4.0)), present=present).passes
    assert not decision((hypothesis(CUBIC), evidence(12.99, se=4.0)), present=present).passes


def test_each_model_has_its_better_account_of_the_noise() -> None:
    """An effect that only mimics the colour of the noise gains nothing over a present model with coloured noise."""
    present = evidence(-500.0, coloured=40.0)
    (candidate,) = decision((hypothesis(CUBIC), evidence(45.0)), present=present).candidates
    assert candidate.log_bayes_factor == pytest.approx(5.0)
    (candidate,) = decision((hypothesis(CUBIC), evidence(45.0, coloured=4.0)), present=present).candidates
    assert candidate.log_bayes_factor == pytest.approx(9.0)


def test_nothing_weighed_names_nothing() -> None:
    empty = decide(PRESENT, [], [])
    assert empty.leader is None
    assert not empty.passes
    assert empty.equivalent == ()
    assert empty.equivalent_places == ()
    assert "No catalogued effect" in empty.sentence


def test_prior_odds_split_over_effects_then_over_forms_and_places() -> None:
    """Three effects considered; one at two places: a sixth of the alternatives' half to each of those."""
    considered = [hypothesis(CUBIC, 1), hypothesis(CUBIC, 2), hypothesis(DAMPER, 1), hypothesis(GAIN, 1)]
    made = decision(*((h, evidence(10.0)) for h in considered), considered=considered)
    odds = {(c.hypothesis.name, c.place): np.exp(c.log_prior_odds) for c in made.candidates}
    assert odds == pytest.approx(
        {
            ("cubic_stiffness", (1,)): 1 / 6,
            ("cubic_stiffness", (2,)): 1 / 6,
            ("quadratic_damping", (1,)): 1 / 3,
            ("sensor_gain", (1,)): 1 / 3,
        }
    )
    assert sum(odds.values()) == pytest.approx(1.0)


def test_prior_odds_run_over_what_was_considered_not_over_what_was_fitted() -> None:
    """Leaving out hopeless hypotheses must not make the others likelier beforehand."""
    considered = [hypothesis(CUBIC, 1), hypothesis(CUBIC, 2), hypothesis(DAMPER, 1), hypothesis(GAIN, 1)]
    made = decision((hypothesis(CUBIC, 1), evidence(9.0)), considered=considered)
    assert made.candidates[0].log_prior_odds == pytest.approx(-np.log(6.0))
    assert made.candidates[0].log_odds == pytest.approx(9.0 - np.log(6.0))
    assert not made.passes


@pytest.mark.parametrize(("nats", "quiet"), [(6.0 + np.log(6.0), True), (6.0, False)])
def test_only_what_could_be_named_is_worth_a_fit(nats: float, quiet: bool) -> None:
    """Where the residual is quiet: 8 nats less 2, and the prior odds of one in six; elsewhere six nats."""
    considered = [hypothesis(CUBIC, 1), hypothesis(CUBIC, 2), hypothesis(DAMPER, 1), hypothesis(GAIN, 1)]
    scored = [
        (h, Score(nats=value, amplitude="", unit="", smallest=1.0))
        for h, value in zip(considered, (nats - 0.01, nats + 0.01, nats + 5.0, 0.0), strict=True)
    ]
    assert worth_fitting(scored, quiet=quiet) == (considered[2], considered[1])


def test_an_effect_collects_its_forms_and_places() -> None:
    """Two places of nearly equal evidence share one name: the effect is named, the place is not."""
    made = decision((hypothesis(CUBIC, 1), evidence(20.0)), (hypothesis(CUBIC, 2), evidence(19.0)))
    assert made.by_name["cubic_stiffness"] == pytest.approx(np.logaddexp(20.0, 19.0) - np.log(2.0))
    assert made.leader is not None
    assert made.leader.place == (1,)
    assert made.passes
    assert made.equivalent == ()
    assert made.equivalent_places == ((2,),)


def test_a_place_eight_nats_behind_beyond_error_is_told_apart() -> None:
    ahead = (hypothesis(CUBIC, 1), evidence(30.0, se=0.3))
    for behind, told in ((8.31, ()), (8.29, ((2,),))):
        made = decision(ahead, (hypothesis(CUBIC, 2), evidence(30.0 - behind)))
        assert made.equivalent_places == told


def test_another_effect_within_eight_nats_is_of_the_class() -> None:
    for behind, members in ((7.9, ("quadratic_damping",)), (8.1, ())):
        made = decision((hypothesis(CUBIC), evidence(30.0)), (hypothesis(DAMPER), evidence(30.0 - behind)))
        assert made.equivalent == members
        assert made.passes
        assert ("cannot tell it from quadratic_damping" in made.sentence) == bool(members)
        assert ("is named" in made.sentence) != bool(members)


def test_the_error_of_the_leader_widens_the_class() -> None:
    made = decision((hypothesis(CUBIC), evidence(30.0, se=1.0)), (hypothesis(DAMPER), evidence(21.1)))
    assert made.equivalent == ("quadratic_damping",)


def test_the_simpler_within_three_nats_leads() -> None:
    """Slip brings two parameters, the cubic spring one."""
    made = decision((hypothesis(SLIP), evidence(30.0)), (hypothesis(CUBIC), evidence(27.1)))
    assert made.leader is not None
    assert made.leader.hypothesis.name == "cubic_stiffness"
    assert made.equivalent == ("slip_lock",)
    assert made.passes
    made = decision((hypothesis(SLIP), evidence(30.0)), (hypothesis(CUBIC), evidence(26.9)))
    assert made.leader is not None
    assert made.leader.hypothesis.name == "slip_lock"


def test_among_equals_in_parameters_the_better_leads() -> None:
    made = decision((hypothesis(CUBIC), evidence(28.0)), (hypothesis(DAMPER), evidence(30.0)))
    assert made.leader is not None
    assert made.leader.hypothesis.name == "quadratic_damping"
    assert [c.log_bayes_factor for c in made.candidates] == [30.0, 28.0]


@pytest.mark.parametrize("width", [WIDER, NARROWER])
def test_a_name_must_survive_other_priors(width: str) -> None:
    """Twelve nats of which another width of the prior takes five."""
    assert decision((hypothesis(CUBIC), evidence(12.0, shifts={width: -3.9}))).passes
    fragile = decision((hypothesis(CUBIC), evidence(12.0, shifts={width: -4.1})))
    assert not fragile.passes
    assert fragile.under_other_priors[width]["cubic_stiffness"] == pytest.approx(7.9)
    assert fragile.objection.startswith(f"log odds of 7.9 under priors {width} do not exceed 8 by their error of ")
    assert fragile.sentence.endswith(f", but {fragile.objection}.")


@pytest.mark.parametrize("width", [WIDER, NARROWER])
def test_no_stranger_may_lead_under_other_priors(width: str) -> None:
    """Under another width an effect outside the class overtakes: the name hangs on the prior."""
    ahead = (hypothesis(CUBIC), evidence(60.0))
    stranger = decision(ahead, (hypothesis(DAMPER), evidence(40.0, shifts={width: 25.0})))
    assert stranger.equivalent == ()
    assert not stranger.passes
    member = decision(ahead, (hypothesis(DAMPER), evidence(55.0, shifts={width: 10.0})))
    assert member.equivalent == ("quadratic_damping",)
    assert member.passes


@pytest.mark.parametrize(("leads_by", "doubtful"), [(1.0, 0), (3.0, 1), (13.0, 1), (15.0, 0)])
def test_a_leader_near_the_threshold_is_doubtful_on_laplaces_word_alone(leads_by: float, doubtful: int) -> None:
    """Within 6 nats of the threshold of 8."""
    assert len(decision((hypothesis(CUBIC), evidence(leads_by))).doubtful) == doubtful


def test_a_runner_up_at_the_edge_of_the_class_is_doubtful_however_far_both_lead() -> None:
    """8 nats behind the leader the class of equivalents ends."""
    for behind, doubtful in ((1.0, []), (10.0, ["cubic_stiffness", "quadratic_damping"]), (15.0, [])):
        weighed = [(hypothesis(CUBIC), evidence(500.0)), (hypothesis(DAMPER), evidence(500.0 - behind))]
        assert [c.hypothesis.name for c in decision(*weighed).doubtful] == doubtful


def test_sampled_evidence_is_not_doubtful() -> None:
    sampled = replace(evidence(10.0), method="importance")
    assert not decision((hypothesis(CUBIC), sampled)).doubtful
