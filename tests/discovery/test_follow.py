"""Looking for what has no name: beside what, in which order, each once, and when it ends."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.discovery import unnamed
from bwbn_bayes.discovery.explanation import Explanation, Place
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run

ONE: Any = SimpleNamespace(excitation_kind="ground_acceleration", has_time=True, parts=(object(),), blocks=())
TWO: Any = SimpleNamespace(excitation_kind="ground_acceleration", has_time=True, parts=(object(), object()), blocks=())
KINDS = ("errors", "links", "to first order", "of a state")


def letter(name: str) -> Any:
    effect = SimpleNamespace(moves_base=False)
    return SimpleNamespace(
        name=name, symbols=(name,), storeys=(1,), label=name, n_brought=1, free_shapes=(), effect=effect
    )


A, B = letter("a"), letter("b")


def explanation(log_evidence: float, *added: Any, record: Any = ONE, is_noise: bool = False) -> Explanation:
    evidence: Any = SimpleNamespace(log_evidence=log_evidence)
    posterior: Any = SimpleNamespace(record=record)
    found = Explanation(added=added, posterior=posterior, modes=(), evidence=evidence, n_places=4)
    found.__dict__["is_noise"] = is_noise
    return found


def asked_by(
    act: Callable[[Pool, Run], None], monkeypatch: pytest.MonkeyPatch, record: Any = ONE, explains: str = ""
) -> list[tuple[str, str]]:
    """What was asked, in order, of which explanation; one kind may explain all beside the model as given."""
    asked: list[tuple[str, str]] = []

    def kind(name: str) -> Callable[[Any], list[Explanation]]:
        def ask(one: Any) -> list[Explanation]:
            asked.append((name, one[0].label))
            if name != explains or one[0].added:
                return []
            place: Place = (1,)
            found = replace(explanation(900.0, is_noise=True), unnamed=place)
            found.__dict__["is_noise"] = True
            return [found]

        return ask

    kinds = {kind(name): name for name in KINDS}
    monkeypatch.setattr(unnamed, "_KINDS", kinds)
    monkeypatch.setattr(unnamed, "_with_reading_errors", next(iter(kinds)))
    monkeypatch.setattr(unnamed, "_to_first_order", list(kinds)[2])
    run = Run(DiscoverySettings(n_workers=1), np.random.default_rng(1), None)
    pool = Pool(run=run)
    pool.add(explanation(gained, *added, record=record) for gained, added in ((0.0, ()), (50.0, (A,)), (100.0, (A, B))))
    act(pool, run)
    return asked


ALL = ("the model as given", "a + b", "a")


def test_every_kind_is_asked_beside_the_best_what_lacks_an_effect_of_it_and_the_model_as_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What lacks `a` alone was never fitted."""
    found = asked_by(unnamed.follow, monkeypatch)
    assert found == [(kind, label) for kind in KINDS for label in ALL]


def test_nothing_is_asked_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    def twice(pool: Pool, run: Run) -> None:
        unnamed.follow(pool, run)
        unnamed.follow(pool, run)
        unnamed.weigh_to_first_order(pool, run, 6.0)

    assert len(asked_by(twice, monkeypatch)) == len(KINDS) * len(ALL)


@pytest.mark.parametrize("number", range(4))
def test_what_explains_all_beside_the_model_as_given_ends_it(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def act(pool: Pool, run: Run) -> None:
        unnamed.follow(pool, run)
        unnamed.weigh_to_first_order(pool, run, 6.0)

    found = asked_by(act, monkeypatch, explains=KINDS[number])
    before = [(kind, label) for kind in KINDS[:number] for label in ALL]
    assert found == [*before, (KINDS[number], "the model as given")]


def test_of_several_records_no_sensor_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert {name for name, _ in asked_by(unnamed.follow, monkeypatch, record=TWO)} == set(KINDS[1:])


def test_a_better_fit_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def act(pool: Pool, run: Run) -> None:
        unnamed.follow(pool, run)
        pool.add([explanation(60.0, A)])
        unnamed.follow(pool, run)

    found = asked_by(act, monkeypatch)
    assert found[len(KINDS) * len(ALL) :] == [(kind, "a") for kind in KINDS]


def test_for_each_name_the_best_without_it_is_asked_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A softened stop with cubic stiffness beside it was compared, beside a force, with a hard stop alone."""
    soft = letter("a")
    soft.symbols, soft.label = ("soft",), "soft a"

    def act(pool: Pool, run: Run) -> None:
        pool.add([explanation(90.0, soft)])
        unnamed.weigh_to_first_order(pool, run, 6.0)

    found = asked_by(act, monkeypatch)
    assert ("to first order", "soft a") in found  # the best without b, 10 nats behind
    assert {label for _, label in found} == {*ALL, "soft a"}
