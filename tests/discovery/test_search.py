"""The search on scripted evidences: what is built upon, in which order, how far; what is left out again."""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import build as building
from bwbn_bayes.discovery import explanation as explaining
from bwbn_bayes.discovery import search as searching
from bwbn_bayes.discovery.build import rebuilt
from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation, key_of
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.discovery.search import search
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CoulombFriction, SensorBias, SensorGain
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.likelihood import KnownNoise, Linearisation, Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Normal, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

Script = Mapping[str, float]
"""Log evidence by the effects' letters, in the order of the alphabet; what is not listed has -100 nats."""
TEST: Any = SimpleNamespace(excitation_kind="displacement", has_time=True, parts=(None, None), blocks=())
"""Two tests of a specimen: no unnamed force is asked for."""


def letter(name: str) -> Any:
    effect = SimpleNamespace(level="link")
    return SimpleNamespace(
        name=name, symbols=(name,), storeys=(1,), label=name, n_brought=1, free_shapes=(), effect=effect
    )


ALPHABET = tuple(letter(name) for name in "abcd")


def explanation(script: Script, *added: Any) -> Explanation:
    log_evidence = script.get("".join(sorted(one.name for one in added)), -100.0)
    modes: Any = (SimpleNamespace(log_likelihood=log_evidence),)
    evidence: Any = SimpleNamespace(log_evidence=log_evidence)
    posterior: Any = SimpleNamespace(record=TEST)
    result = Explanation(added=added, posterior=posterior, modes=modes, evidence=evidence)
    result.__dict__["is_noise"] = result.__dict__["is_quiet"] = True  # else found from the record
    result.__dict__.update(residual=np.zeros((1, 1)), over_noise=lambda _: 0.0)  # no law errs by what others explain
    return result


def searched(script: Script, monkeypatch: pytest.MonkeyPatch, **settings: Any) -> tuple[list[str], Pool]:
    """What was built upon, in order, and the pool; the last step weighs what was found, or asks for a force."""

    def built_upon(parent: Explanation, _: Run) -> list[Explanation]:
        return [explanation(script, *parent.added, one) for one in ALPHABET if one.name not in parent.names]

    monkeypatch.setattr(searching, "hypotheses_of", lambda *_: ALPHABET)
    monkeypatch.setattr(searching, "built_upon", built_upon)
    monkeypatch.setattr(searching, "_together", lambda *_: ())
    monkeypatch.setattr(searching, "left_out", lambda *_: ())
    monkeypatch.setattr(searching, "_reshaped", lambda *_: ())
    monkeypatch.setattr(searching, "_draw_closer", lambda *_: None)
    monkeypatch.setattr(searching, "_change_forms", lambda *_: None)
    monkeypatch.setattr(searching, "_anew", lambda pair: pair[0])
    monkeypatch.setattr(searching, "settled", lambda _, modes, __: modes)
    monkeypatch.setattr(Pool, "weigh", lambda _, **__: None)
    monkeypatch.setattr(Pool, "count", lambda _: False)
    run = run_of(**settings)
    pool = search(explanation({"": 0.0}), run)
    return [step.parent for step in run.steps[:-1]], pool


def run_of(**settings: Any) -> Run:
    return Run(DiscoverySettings(**settings), np.random.default_rng(1), None)


def test_a_step_that_gains_nothing_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The best first effect leads nowhere; the second best is half of the answer. A greedy search ended at `a`."""
    script = {"a": 50.0, "b": 48.0, "c": 20.0, "ab": 40.0, "bd": 90.0, "abd": 80.0}
    parents, pool = searched(script, monkeypatch)
    assert parents == ["the model as given", "a", "b", "b + d"]
    assert pool.ranked()[0].label == "b + d"


def test_no_more_than_a_beam_of_one_number_of_effects_is_built_upon(monkeypatch: pytest.MonkeyPatch) -> None:
    script = {"a": 50.0, "b": 49.5, "c": 49.0, "d": 48.5}
    parents, _ = searched(script, monkeypatch)
    assert parents == ["the model as given", "a", "b"]
    assert searching.BEAM == 2


def test_nothing_far_below_the_best_is_built_upon(monkeypatch: pytest.MonkeyPatch) -> None:
    near, far = 50.0 - searching.REACH + 0.1, 50.0 - searching.REACH - 0.1
    assert searched({"a": 50.0, "b": near}, monkeypatch)[0] == ["the model as given", "a", "b"]
    assert searched({"a": 50.0, "b": far}, monkeypatch)[0] == ["the model as given", "a"]


def test_the_budget_bounds_rounds_and_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    script = {"a": 50.0, "ab": 100.0, "abc": 150.0, "abcd": 200.0}
    assert searched(script, monkeypatch)[0] == ["the model as given", "a", "a + b", "a + b + c"]
    assert searched(script, monkeypatch, most_rounds=2)[0] == ["the model as given", "a"]
    parents, pool = searched(script, monkeypatch, most_effects=2)
    assert parents == ["the model as given", "a"]
    assert pool.ranked()[0].label == "a + b"


@pytest.mark.parametrize("noise_from", [1, 2, 3])
def test_a_building_is_looked_at_deeper_where_one_effect_leaves_anything_of_note(
    monkeypatch: pytest.MonkeyPatch, noise_from: int
) -> None:
    """The deeper look finds `d`, which the race had missed; it is not taken where an effect leaves nothing of note."""
    looked: list[int] = []

    def look_deeper(_: Explanation, pool: Pool, run: Run) -> None:
        looked.append(len(run.steps))
        pool.add([explanation({"d": 180.0}, ALPHABET[3])])

    building = SimpleNamespace(excitation_kind="ground_acceleration", has_time=True, parts=(None,), blocks=())
    monkeypatch.setattr(searching, "_look_deeper", look_deeper)
    monkeypatch.setattr(searching, "_exchange", lambda *_: None)
    monkeypatch.setattr(searching, "follow", lambda *_: None)
    monkeypatch.setattr(searching, "weigh_to_first_order", lambda *_: None)
    monkeypatch.setattr(Explanation, "is_quiet", property(lambda one: len(one.added) >= noise_from))
    monkeypatch.setattr(Explanation, "is_specimen", property(lambda one: one.posterior.record is not building))
    monkeypatch.setattr(sys.modules[__name__], "TEST", building)
    parents, _ = searched({"a": 50.0, "ab": 100.0, "abc": 150.0}, monkeypatch)
    assert looked == ([1] if noise_from > 1 else [])
    later = ["d"] if looked else ["a", "a + b", "a + b + c"]
    assert parents == ["the model as given", *later]


def test_what_was_found_first_must_be_the_best_beside_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """`a` looks most like `b` and `c` together, and leaves noise beside `b`: a pinch stood for a loss of stiffness."""
    building = SimpleNamespace(excitation_kind="ground_acceleration", has_time=True, parts=(None,), blocks=())
    monkeypatch.setattr(searching, "weigh_to_first_order", lambda *_: None)
    monkeypatch.setattr(Explanation, "is_quiet", property(lambda one: len(one.added) > 0))
    monkeypatch.setattr(Explanation, "is_noise", property(lambda one: len(one.added) > 1))
    monkeypatch.setattr(Explanation, "is_specimen", property(lambda one: one.posterior.record is not building))
    script = {"a": 50.0, "b": 20.0, "c": 10.0, "ab": 90.0, "bc": 120.0}
    alone, _ = searched(script, monkeypatch)  # of a specimen every effect is fitted in every round
    assert alone == ["the model as given", "a", "a + b"]
    monkeypatch.setattr(sys.modules[__name__], "TEST", building)
    parents, pool = searched(script, monkeypatch)
    assert parents == ["the model as given", "a", "a + b", "b", "c"]
    assert pool.ranked()[0].label == "b + c"


def test_what_the_best_is_without_each_effect_is_known_before_it_is_exchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tuned mass beside a Maxwell branch had not been fitted without the pinch that stood for a loss of stiffness."""
    a, b, *_ = ALPHABET
    script = {"": 0.0, "a": 30.0, "b": 10.0, "ab": 90.0}
    pool = Pool(run=run_of())
    pool.add([explanation(script), explanation(script, a), explanation(script, a, b)])
    parents: list[str] = []

    def round_of(parent: Explanation, pool: Pool, _: Run) -> None:
        pool.expanded.add(parent.effects_key)
        parents.append(parent.label)

    monkeypatch.setattr(searching, "left_out", lambda *_: [explanation(script, b)])
    monkeypatch.setattr(searching, "_round", round_of)
    searching._exchange(pool, pool.run)
    assert parents == ["b", "a"]


@pytest.mark.parametrize("most_rounds", [0, 1, 3])
def test_an_exchange_builds_upon_no_more_than_the_search(monkeypatch: pytest.MonkeyPatch, most_rounds: int) -> None:
    """Each round may find better laws, whose effects are exchanged in turn: on a frame on sliders it took an hour."""
    pool = Pool(run=run_of(most_rounds=most_rounds))
    script, parents = {"": 0.0, "a": 1.0, "b": 2.0, "ab": 90.0}, list[str]()
    pool.add(explanation(script, *[own for own in ALPHABET if own.name in names]) for names in ("", "a", "b", "ab"))
    pool.expanded.add(frozenset())

    def round_of(parent: Explanation, pool: Pool, _: Run) -> None:
        pool.expanded.add(parent.effects_key)
        parents.append(parent.label)
        n = len(parents)
        one, other, both = letter(f"x{n}"), letter(f"y{n}"), f"x{n}y{n}"
        better = {both: 100.0 * n, f"x{n}": 1.0, f"y{n}": 1.0}
        pool.add(explanation(better, *added) for added in ((one,), (other,), (one, other)))

    monkeypatch.setattr(searching, "left_out", lambda *_: ())
    monkeypatch.setattr(searching, "_round", round_of)
    searching._exchange(pool, pool.run)
    assert len(parents) == most_rounds


def test_no_law_is_sought_in_the_place_of_a_force_that_explains_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """After two rounds a force of one state leaves noise beside the model as given; laws alone were far from it."""
    followed: list[int] = []

    def follow(pool: Pool, run: Run) -> None:
        followed.append(len(run.steps))
        if len(followed) == 1:
            bare = pool.plain[frozenset()]
            pool.add_unnamed(replace(bare, unnamed=(1,), evidence=cast(Any, SimpleNamespace(log_evidence=500.0))))

    building = SimpleNamespace(excitation_kind="ground_acceleration", has_time=True, parts=(None,), blocks=())
    monkeypatch.setattr(searching, "follow", follow)
    monkeypatch.setattr(searching, "_look_deeper", lambda *_: None)
    monkeypatch.setattr(searching, "weigh_to_first_order", lambda *_: None)
    monkeypatch.setattr(Explanation, "is_noise", property(lambda one: one.unnamed is not None))
    monkeypatch.setattr(Explanation, "is_specimen", property(lambda one: one.posterior.record is not building))
    monkeypatch.setattr(sys.modules[__name__], "TEST", building)
    parents, pool = searched({"a": 50.0, "ab": 100.0, "abc": 150.0}, monkeypatch)
    assert parents == ["the model as given", "a"]
    assert followed == [2, 2]
    assert pool.beliefs.best.has_unnamed


@pytest.mark.parametrize("leaves_noise", [False, True])
def test_where_nothing_leaves_noise_another_first_step_is_tried(
    leaves_noise: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`a` looks most like `b` and `d` together, 40 nats better than `b` alone, and leads nowhere."""
    building = SimpleNamespace(excitation_kind="ground_acceleration", has_time=True, parts=(None,), blocks=())
    for name in ("follow", "weigh_to_first_order", "_look_deeper"):
        monkeypatch.setattr(searching, name, lambda *_: None)
    monkeypatch.setattr(Explanation, "is_noise", property(lambda one: leaves_noise or one.names >= {"b", "d"}))
    monkeypatch.setattr(Explanation, "is_specimen", property(lambda one: one.posterior.record is not building))
    monkeypatch.setattr(sys.modules[__name__], "TEST", building)
    script = {"a": 100.0, "b": 60.0, "d": 30.0, "ac": 110.0, "bd": 500.0}
    parents, pool = searched(script, monkeypatch)
    assert ("b" in parents) != leaves_noise
    assert pool.compared.best.label == ("a + c" if leaves_noise else "b + d")


@pytest.mark.parametrize("stopped", [False, True])
def test_the_last_step_tells_what_the_verdict_is_made_of(stopped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of several tests of a specimen, and where the time was over, what was weighed last was in no step."""

    def beside_a_force(_: Explanation, pool: Pool, run: Run) -> str:
        pool.add([explanation({"c": 300.0}, ALPHABET[2])])
        run.stopped = stopped
        return searching._WEIGHED

    monkeypatch.setattr(searching, "_beside_a_force", beside_a_force)
    _, pool = searched({"a": 50.0}, monkeypatch, time_limit_s=600.0)
    last, believed = pool.run.steps[-1], pool.beliefs
    assert last.sentence.startswith("Weighed what was found: the best so far is c, ")
    assert (last.explanations, last.log_joint) == (believed.explanations, tuple(believed.log_joint.tolist()))


def test_what_is_built_upon_is_looked_around_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A better optimum beside those of the race replaces the explanation before anything is added to it."""
    better: Any = (SimpleNamespace(log_likelihood=60.0),)
    monkeypatch.setattr(searching, "settled", lambda *_: better)
    monkeypatch.setattr(explaining, "laplace", lambda _, modes: SimpleNamespace(log_evidence=modes[0].log_likelihood))
    script = {"": 0.0, "a": 50.0}
    pool = Pool(run=run_of())
    pool.run.consider(ALPHABET)
    pool.add([explanation(script), explanation(script, ALPHABET[0])])
    pool.expanded.add(frozenset())
    parent = searching._next(pool, pool.run)
    assert parent is not None
    assert parent.modes is better
    assert pool.ranked()[0] is parent
    assert parent.evidence.log_evidence == 60.0


@pytest.mark.parametrize("is_quiet", [False, True])
def test_sizes_are_guessed_beside_what_leaves_more_than_noise(monkeypatch: pytest.MonkeyPatch, is_quiet: bool) -> None:
    """From next to nothing alone a soft base was left 4,100 nats short beside a pinch, and others stood in for it."""
    guessed = []

    def race(*_: object, guess: bool, **__: object) -> tuple[()]:
        guessed.append(guess)
        return ()

    parent = explanation({}, letter("a"))
    parent.__dict__["is_quiet"] = is_quiet
    score = SimpleNamespace(nats=50.0)
    monkeypatch.setattr(building, "race", race)
    monkeypatch.setattr(building, "on_one_thread", lambda posterior: posterior)
    monkeypatch.setattr(building, "hypotheses_of", lambda *_: ALPHABET)
    monkeypatch.setattr(building, "score_all", lambda _, every, __: [(one, score) for one in every])
    monkeypatch.setattr(building, "_under_smaller_laws", lambda _, every: every)
    for name, value in (("model", None), ("fits", np.zeros((1, 1))), ("is_specimen", False)):
        monkeypatch.setattr(Explanation, name, property(lambda _, value=value: value))
    run = run_of()
    run.consider(cast(tuple[Hypothesis, ...], ALPHABET))
    assert building.built_upon(parent, run) == []
    assert guessed == [not is_quiet]


def test_a_model_as_given_is_built_upon_with_the_hypotheses_of_the_first_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though laws with effects were built upon before it: their hypotheses stand on models with other parameters."""
    raced: list[tuple[Any, ...]] = []
    monkeypatch.setattr(building, "race", lambda _, every, *_args, **_options: raced.append(every) or ())
    monkeypatch.setattr(building, "hypotheses_of", lambda *_: ("of a law with an effect",))
    monkeypatch.setattr(building, "on_one_thread", lambda posterior: posterior)
    run = run_of(n_workers=1)
    run.considered_first = cast(Any, ("of the first round",))
    for added in ((), ("an effect",), ()):
        parent: Any = SimpleNamespace(added=added, is_quiet=False, is_specimen=True, posterior=None, fits=None)
        assert building.built_upon(parent, run) == []
    assert raced == [("of the first round",), ("of a law with an effect",), ("of the first round",)]


def test_what_cannot_be_solved_is_told_once() -> None:
    run = run_of()
    fits: Any = tuple(
        SimpleNamespace(hypothesis=one, log_likelihood=value)
        for one, value in zip(ALPHABET, (3.0, -np.inf, 2.0, -np.inf), strict=True)
    )
    for _ in range(2):
        assert [fit.hypothesis.name for fit in building.solvable(fits, run)] == ["a", "c"]
    assert run.notes == ["Could not be solved for this record and was left out: b, d."]


SPECIMEN = Specimen(storey=BoucWen(k=Uniform(5, 60), beta=2.0, gamma=1.0))
ON_SPECIMEN = hypotheses(SPECIMEN, [NOMINAL], measured=("force",))


def tried_together(
    monkeypatch: pytest.MonkeyPatch, run: Run, *known: Any, is_specimen: bool = True, of: str = "name"
) -> list[list[str]]:
    """Names, or labels, of the combinations that are fitted from all over their priors."""
    tried: list[list[str]] = []

    def fitted(_: Any, added: tuple[Hypothesis, ...], __: Run) -> Iterator[Explanation]:
        assert [placed.effect for placed in added[-1].model.effects] == [one.effect for one in added]
        # A specimen's law is that of every effect, compiled once.
        assert len(added[-1].model.carried) == len({one.symbols for one in run.considered_first}) - len(added)
        tried.append([getattr(one, of) for one in added])
        return iter(())

    monkeypatch.setattr(searching, "fitted", fitted)
    given: Any = SimpleNamespace(is_specimen=is_specimen, model=SPECIMEN)
    pool: Any = SimpleNamespace(plain=dict(enumerate(known)))
    assert list(searching._together(given, pool, run)) == []
    return tried


def test_a_pinch_is_tried_with_a_loss_of_strength_and_stiffness(monkeypatch: pytest.MonkeyPatch) -> None:
    """What BWBN is; one by one none of them gains enough on a column that does all three."""
    run = run_of()
    run.consider(ON_SPECIMEN)
    losses = ["strength_degradation", "stiffness_degradation"]
    assert tried_together(monkeypatch, run) == [[*losses, "slip_lock"], [*losses, "foliente_pinching"]]
    assert tried_together(monkeypatch, run, is_specimen=False) == []
    run.consider(tuple(h for h in ON_SPECIMEN if h.name != "slip_lock"))
    assert tried_together(monkeypatch, run) == [[*losses, "foliente_pinching"]]
    run.consider(tuple(h for h in ON_SPECIMEN if h.name != "strength_degradation"))
    assert tried_together(monkeypatch, run) == []
    run.consider(ON_SPECIMEN)
    usual, other, *_ = (one for one in ON_SPECIMEN if one.name == "stiffness_degradation")
    known = [
        SimpleNamespace(added=(one,), names={one.name}, evidence=SimpleNamespace(log_evidence=v))
        for one, v in ((usual, 1.0), (other, 2.0))
    ]
    tried = tried_together(monkeypatch, run, *known, of="label")
    assert [one[1] for one in tried] == [usual.label, usual.label, other.label, other.label]
    assert {one[0] for one in tried} == {"strength degradation (linear)"}
    few = run_of(most_effects=2)
    few.consider(ON_SPECIMEN)
    assert tried_together(monkeypatch, few) == []


GROUND = el_centro("chopra", duration=6.0)
BUILDING = ShearBuilding(
    masses=[2.0, 1.0],
    storey=BoucWen(k=Normal(60.0, 3.0), c=0.4, alpha=0.15, beta=12.0, gamma=2.0, n=1.3),
)
ENGINE = Lanes(substeps=1, n_threads=1)
CHANNELS = ("acceleration_1", "acceleration_2")
SD = 0.1


@pytest.fixture(scope="module")
def with_two() -> Pool:
    """A bias of the first sensor is hidden; a gain of the second was added beside it."""
    clean: Floats = ENGINE.simulate(BUILDING, np.array([[60.0]]), GROUND, CHANNELS).values[0]
    measured = clean + [[0.1], [0.0]] + SD * np.random.default_rng(1).standard_normal(clean.shape)
    record = GROUND.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    present = Posterior(model=BUILDING, record=record, engine=ENGINE, noise=KnownNoise(sd=(SD, SD)))
    centre = np.full((1, 1), 0.5)
    run = run_of(effects=(SensorBias, SensorGain))
    run.consider(hypotheses(BUILDING, scales_of(present, centre[0]), measured=CHANNELS, effects=run.settings.effects))
    bias = next(h for h in run.considered_first if (h.name, h.storeys) == ("sensor_bias", (1,)))
    gain = next(h for h in run.considered_first if (h.name, h.storeys) == ("sensor_gain", (2,)))
    pool = Pool(run=run)
    given: Any = SimpleNamespace(is_specimen=False, model=BUILDING)
    for added in ((), rebuilt(given, (bias, gain), run)):
        posterior = present.with_model(added[-1].model if added else BUILDING)
        modes = distinct(*polish(posterior, np.full((1, posterior.n_dim), 0.5), n_iterations=20))
        pool.add([Explanation(added=added, posterior=posterior, modes=modes, evidence=laplace(posterior, modes))])
    return pool


def copied(pool: Pool) -> Pool:
    again = Pool(run=pool.run)
    again.add(pool.plain.values())
    return again


def test_a_superfluous_effect_is_seen_to_be_so(with_two: Pool) -> None:
    """Each effect of the best is left out once: without the gain the fit is as good, and the prior does the rest."""
    pool = copied(with_two)
    assert pool.ranked()[0].names == {"sensor_bias", "sensor_gain"}
    pool.add(building.left_out(pool.ranked()[0], pool.plain, pool.run))
    assert pool.ranked()[0].names == {"sensor_bias"}
    assert pool.beliefs.names["sensor_gain"] < 0.5 < 0.99 < pool.beliefs.names["sensor_bias"]
    one_each = {one.names: one for one in pool.plain.values()}
    alone = one_each[frozenset({"sensor_gain"})]
    assert alone.evidence.log_evidence < pool.ranked()[0].evidence.log_evidence - 40.0
    # What was left out once is not fitted again, and one effect alone is not left out.
    assert list(building.left_out(pool.ranked()[0], pool.plain, pool.run)) == []


def spoilt(one: Explanation) -> Explanation:
    """A law that leaves noise, it is said, at a place from which its optimum is far."""
    start = np.full((1, one.posterior.n_dim), 0.02)
    modes = distinct(*polish(one.posterior, start, n_iterations=1))
    result = one.with_modes(modes)
    result.__dict__["is_noise"] = True
    return result


def test_several_laws_that_leave_noise_are_searched_from_all_over_their_priors(
    with_two: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A loss of stiffness beside a Maxwell branch left noise 64 nats below its optimum, and a pinch was named."""
    known, given = copied(with_two), with_two.plain[frozenset()]
    known.add(building.left_out(known.ranked()[0], known.plain, known.run))
    right = [one for one in known.ranked() if "sensor_bias" in one.names]
    alone, both = Pool(run=with_two.run), Pool(run=with_two.run)
    alone.add([given, spoilt(right[0])])
    both.add([given, *map(spoilt, right)])
    monkeypatch.setattr(Pool, "weigh", lambda _, **__: None)
    monkeypatch.setattr(Pool, "count", lambda _: False)
    for pool in (alone, both):
        searching._search_anew(pool, pool.run)
    of_alone, of_both = (pool.plain[right[0].effects_key].evidence.log_evidence for pool in (alone, both))
    assert of_alone < right[0].evidence.log_evidence - 10.0
    assert of_both == pytest.approx(right[0].evidence.log_evidence, abs=0.5)
    other = both.plain[right[1].effects_key].evidence.log_evidence
    assert other == pytest.approx(right[1].evidence.log_evidence, abs=0.5)


def test_a_form_that_was_best_alone_gives_way_once_the_others_are_there() -> None:
    """Friction by a hyperbolic tangent, and a biased sensor that had hidden which form it is."""
    plain = ShearBuilding(
        masses=[2.0], storey=BoucWen(k=Normal(60.0, 3.0), c=0.4, alpha=0.15, beta=12.0, gamma=2.0, n=1.3)
    )
    rubs = plain.with_effect(CoulombFriction(F_c=0.4, v0=0.1), storeys=[1])
    clean = Reference(rtol=1e-9).simulate(rubs, np.array([[60.0]]), GROUND, CHANNELS[:1]).values[0, 0]
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(clean))
    record = GROUND.with_channels({CHANNELS[0]: clean + 0.1 + noise})
    present = Posterior(model=plain, record=record, engine=ENGINE, noise=default_noise(record))
    centre = np.full((1, 1), 0.5)
    run = run_of(effects=(SensorBias, CoulombFriction))
    scales = scales_of(present, centre[0])
    run.consider(hypotheses(plain, scales, measured=CHANNELS[:1], effects=run.settings.effects))
    by_symbol = {one.symbols[0]: one for one in run.considered_first}
    bias, wrong = by_symbol["bias"], by_symbol["F_ratio"]
    pool, given = Pool(run=run), cast(Any, SimpleNamespace(is_specimen=False, model=plain))
    for added in ((), rebuilt(given, (bias,), run), rebuilt(given, (wrong, bias), run)):
        posterior = present.with_model(added[-1].model if added else plain)
        starts = np.full((8, posterior.n_dim), 0.5) + 0.1 * np.random.default_rng(4).random((8, posterior.n_dim))
        modes = distinct(*polish(posterior, starts, n_iterations=40))
        pool.add([Explanation(added=added, posterior=posterior, modes=modes, evidence=laplace(posterior, modes))])
    before = pool.ranked()[0]
    assert [one.symbols[0] for one in before.added] == ["F_ratio", "bias"]
    searching._change_forms(pool, run)
    best = pool.ranked()[0]
    assert {one.symbols[0] for one in best.added} == {"F_c", "bias"}
    assert best.evidence.log_evidence > before.evidence.log_evidence + 3.0
    # What every form was tried on stands, and one effect alone has been tried in all of its forms.
    n_tried = len(pool.plain)
    searching._change_forms(pool, run)
    assert len(pool.plain) == n_tried


def test_an_effect_without_which_nothing_can_be_solved_stays(with_two: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a damper that holds a storey which snaps through."""

    def fail(view: Posterior, points: Floats, **_: object) -> tuple[Floats, Linearisation]:
        local = view.linearise(points)
        return points, replace(local, log_likelihood=np.full(len(points), -np.inf))

    pool = copied(with_two)
    monkeypatch.setattr(building, "polish", fail)
    assert list(building.left_out(pool.ranked()[0], pool.plain, pool.run)) == []
    assert pool.ranked()[0].names == {"sensor_bias", "sensor_gain"}


def test_of_two_fits_of_the_same_effects_the_better_stays() -> None:
    pool = Pool(run=run_of())
    worse, better = (explanation({"a": value}, ALPHABET[0]) for value in (10.0, 12.0))
    pool.add([worse, better, worse])
    (kept,) = pool.plain.values()
    assert kept is better
    # One fitted again stands without the unnamed force of the fit that it replaced.
    key = better.effects_key
    pool.unnamed[key, (1,)] = replace(better, unnamed=(1,))
    best = explanation({"a": 13.0}, ALPHABET[0])
    pool.add([cast(Explanation, best)])
    assert pool.plain[key] is best
    assert not pool.unnamed


def friction_in_three_storeys() -> tuple[ShearBuilding, Run]:
    storey = BoucWen(k=Normal(60.0, 3.0), c=0.4, alpha=0.15, beta=12.0, gamma=2.0, n=1.3)
    plain = ShearBuilding(masses=[2.0, 1.0, 1.0], storey=storey)
    record = GROUND.with_channels({"acceleration_3": GROUND.excitation})
    present = Posterior(model=plain, record=record, engine=ENGINE, noise=default_noise(record))
    run = run_of(effects=(CoulombFriction,))
    scales = scales_of(present, np.full(1, 0.5))
    run.consider(hypotheses(plain, scales, measured=("acceleration_3",), effects=run.settings.effects))
    return plain, run


def tried_elsewhere(best: Any, base: Any, run: Run, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any]]:
    """First symbols and places."""
    tried: list[tuple[str, Any]] = []
    monkeypatch.setattr(
        building, "in_forms", lambda _, every, __: tried.extend((one.symbols[0], one.storeys) for one in every) or ()
    )
    list(building.in_other_forms(best, {base.effects_key: base, best.effects_key: best}, run))
    return sorted(tried)


@pytest.mark.parametrize("is_free", [False, True])
def test_an_effect_found_before_the_others_is_tried_at_other_places_too(
    is_free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In its own form there, in every form where it stands; in a free shape in every form everywhere.

    Not where an effect of its kind is already.
    """
    plain, run = friction_in_three_storeys()
    at = {(one.symbols[0], one.storeys): one for one in run.considered_first}
    first, second = at["F_ratio", (1,)], at["F_root", (2,)]
    if is_free:
        (first, *_) = first.free_shapes
    own = first.symbols[0]
    added = (second,)
    base: Any = SimpleNamespace(
        added=added, effects_key=key_of(added), model=plain.with_effect(second.effect, storeys=[2])
    )
    best: Any = SimpleNamespace(added=(first, second), effects_key=key_of([first, second]))
    tried = tried_elsewhere(best, base, run, monkeypatch)
    usual = ("F_c", "F_dahl", "F_ratio", "F_root")
    elsewhere = (own, *usual) if is_free else (own,)
    here = [(form, (1,)) for form in usual if form != own]
    assert tried == sorted([*here, *((form, (3,)) for form in elsewhere)])


def test_one_effect_in_a_free_shape_is_tried_in_it_at_other_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring in storey 1 looked most like cubic ones in all, which then took its shape, and a loss with them."""
    plain, run = friction_in_three_storeys()
    usual = next(one for one in run.considered_first if one.storeys == (2,))
    (free, *_) = usual.free_shapes
    base: Any = SimpleNamespace(added=(), effects_key=frozenset(), model=plain)
    best: Any = SimpleNamespace(added=(free,), effects_key=key_of([free]))
    own = free.symbols[0]
    assert tried_elsewhere(best, base, run, monkeypatch) == [(own, (1,)), (own, (1, 2, 3)), (own, (3,))]
    # A usual form has been tried everywhere.
    best = SimpleNamespace(added=(usual,), effects_key=key_of([usual]))
    assert tried_elsewhere(best, base, run, monkeypatch) == []
