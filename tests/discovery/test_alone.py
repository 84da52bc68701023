"""The law that predicts, built by itself, on scripted evidences."""

from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import alone, build
from bwbn_bayes.discovery.explanation import SPECIMEN, Explanation, Key, key_of
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run

Script = Mapping[str, float]
"""Log evidence by the effects' letters, in the order of the alphabet; what is not listed has -1000 nats."""
BESIDE = {"": 1000.0, "a": 1010.0, "b": 1005.0}
"""The same beside the force, where the search was."""


def letter(name: str) -> Any:
    effect = SimpleNamespace(level="link")
    return SimpleNamespace(
        name=name, symbols=(name,), storeys=(1,), label=name, n_brought=1, free_shapes=(), effect=effect
    )


ALPHABET = {name: letter(name) for name in "abcdef"}


def explanation(script: Script, names: str, *, unnamed: Any = None, is_noise: bool = False) -> Explanation:
    evidence: Any = SimpleNamespace(log_evidence=script.get("".join(sorted(names)), -1000.0), method="importance")
    nothing: Any = SimpleNamespace(record=SimpleNamespace(excitation_kind="displacement", blocks=()))
    added = tuple(ALPHABET[name] for name in names)
    result = Explanation(added=added, posterior=nothing, modes=(), evidence=evidence, unnamed=unnamed)
    result.__dict__["is_noise"] = is_noise
    result.__dict__.update(residual=np.zeros((1, 1)), over_noise=lambda _: 0.0)  # no law errs by what others explain
    return result


def built(script: Script, monkeypatch: pytest.MonkeyPatch, *, is_noise: bool = False) -> tuple[list[str], Pool]:
    """Which laws were built upon, in order, and the pool."""
    parents: list[str] = []

    def built_upon(parent: Explanation, _: Run) -> list[Explanation]:
        own = "".join(one.name for one in parent.added)
        parents.append(own)
        return [explanation(script, own + name) for name in ALPHABET if name not in own]

    def left_out(best: Explanation, known: Mapping[Key, Explanation], _: Run) -> Iterator[Explanation]:
        for spare in best.added:
            kept = [one for one in best.added if one is not spare]
            if key_of(kept) not in known:
                yield explanation(script, "".join(one.name for one in kept))

    def leave_alone(pool: Pool, *, also: Any) -> None:
        assert list(also) == []
        pool.add_alone(explanation(script, name, is_noise=is_noise) for name in BESIDE)

    def let_compete(pool: Pool, laws: list[Explanation]) -> None:
        pool.add(explanation(BESIDE, "".join(one.name for one in own.added), unnamed=SPECIMEN) for own in laws)

    monkeypatch.setattr(alone, "built_upon", built_upon)
    monkeypatch.setattr(alone, "left_out", left_out)
    monkeypatch.setattr(Pool, "leave_alone", leave_alone)
    monkeypatch.setattr(Pool, "let_compete", let_compete)
    run = Run(DiscoverySettings(), np.random.default_rng(1), None)
    force: Any = ("its functions", 1.0)
    pool = Pool(run=run, _force=force)
    pool.plain[frozenset()] = explanation(script, "")
    pool.add(explanation(BESIDE, name, unnamed=SPECIMEN) for name in BESIDE)
    alone.build_alone(pool, run)
    return parents, pool


def test_a_law_grows_as_long_as_its_evidence_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the force nothing but `a` is worth its parameters; by itself a law needs three effects more."""
    script = {"": 0.0, "a": 50.0, "b": 10.0, "ac": 90.0, "acd": 140.0, "acde": 170.0, "ace": 120.0}
    parents, pool = built(script, monkeypatch)
    assert parents[:3] == ["a", "ac", "acd"]
    assert {one.name for one in pool.alone[0].added} == set("acde")
    assert pool.beliefs.best.label.startswith("a + a force")  # what it is called is decided as before


def test_it_ends_after_two_laws_of_which_nothing_better_came(monkeypatch: pytest.MonkeyPatch) -> None:
    parents, _ = built({"": 0.0, "a": 50.0, "b": 49.0}, monkeypatch)
    assert parents == ["a", "b"]
    assert alone.MOST_FAILURES == 2


def test_what_later_effects_make_superfluous_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    script = {"": 0.0, "a": 50.0, "ac": 90.0, "acd": 140.0, "cd": 150.0}
    _, pool = built(script, monkeypatch)
    assert {one.name for one in pool.alone[0].added} == set("cd")


def test_the_best_laws_compete_beside_the_force(monkeypatch: pytest.MonkeyPatch) -> None:
    script = {"": 0.0, "a": 50.0, "ac": 90.0, "acd": 140.0}
    _, pool = built(script, monkeypatch)
    assert {one.effects_key for one in pool.alone[: alone.N_BESIDE]} <= set(pool.searched)


def test_a_law_that_leaves_noise_predicts_as_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    parents, pool = built({"": 0.0, "a": 50.0, "ac": 90.0}, monkeypatch, is_noise=True)
    assert parents == []
    assert pool.alone[0].label == "a"


def test_a_building_has_its_laws_by_themselves_anyway(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pool, "leave_alone", lambda *_, **__: pytest.fail("nothing is to be fitted"))
    run = Run(DiscoverySettings(), np.random.default_rng(1), None)
    alone.build_alone(Pool(run=run), run)


def test_a_model_as_given_is_built_upon_with_the_hypotheses_of_the_first_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though laws with effects were built upon before it: their hypotheses stand on models with other parameters."""
    raced: list[tuple[Any, ...]] = []
    monkeypatch.setattr(build, "race", lambda _, every, *_args, **_options: raced.append(every) or ())
    monkeypatch.setattr(build, "hypotheses_of", lambda *_: ("of a law with an effect",))
    monkeypatch.setattr(build, "on_one_thread", lambda posterior: posterior)
    run = Run(DiscoverySettings(n_workers=1), np.random.default_rng(1), None)
    run.considered_first = cast(Any, ("of the first round",))
    for added in ((), ("an effect",), ()):
        parent: Any = SimpleNamespace(added=added, is_quiet=False, is_specimen=True, posterior=None, fits=None)
        assert build.built_upon(parent, run) == []
    assert raced == [("of the first round",), ("of a law with an effect",), ("of the first round",)]
