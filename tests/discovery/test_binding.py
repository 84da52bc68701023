"""Priors of the user's own that bind: told, and widened before an effect is named to stand in for one."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes import (
    CubicStiffness,
    DiscoverySettings,
    Oscillator,
    as_force,
    discover,
    multisine,
    simulate,
)
from bwbn_bayes.discovery import workflow
from bwbn_bayes.discovery.binding import Binding
from bwbn_bayes.discovery.run import Run
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import Asymmetry
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Normal, PerStorey, Prior, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

RECORD = Record(name="still", time_step=0.01, excitation=np.ones(40), channels={"acceleration_2": np.ones(40)})
TRUNCATED = Normal(0.2, 0.1).truncated(0.1, 0.3)


Fitted = tuple[Posterior, Mode]
"""Of the model as given, and its best fit."""


def fitted(*, unseen: str = "", **at: float) -> Fitted:
    """A model of two storeys whose best fit lies in the middle of every prior but where said otherwise."""
    storey = BoucWen(
        k=PerStorey(Uniform(20, 60)), c=Uniform(0.1, 1.0), alpha=TRUNCATED, beta=Normal(5.0, 1.0), gamma=2.0,
        n=Uniform(1.0, 3.0),
    )  # fmt: skip
    model = ShearBuilding(masses=[1.0, 1.0], storey=storey)
    posterior = Posterior(model=model, record=RECORD, engine=Lanes(), noise=KnownNoise(sd=(1.0,)))
    names = posterior.space.names
    seen = np.array([0.0 if name == unseen else 1e4 for name in names])
    point = np.array([at.get(name, 0.5) for name in names])
    return posterior, Mode(point=point, log_likelihood=0.0, gradient=np.zeros(len(names)), information=np.diag(seen))


def binding_sentences(posterior: Posterior, best: Mode, *, hardens: bool = False) -> tuple[str, ...]:
    return Binding(given=posterior, best=best).sentences(hardens=hardens)


def widened(given: Fitted) -> Structure | None:
    return Binding(given=given[0], best=given[1]).widened


def let_harden(posterior: Posterior, best: Mode) -> Structure | None:
    return Binding(given=posterior, best=best).hardening


def priors_of(given: Fitted) -> dict[str, Prior]:
    wider = widened(given)
    assert wider is not None
    return {p.name: p.prior for p in wider.space.parameters}


def test_nothing_binds_inside_a_prior() -> None:
    given = fitted(**{"k[1]": 0.99, "c": 0.01})
    assert binding_sentences(*given) == ()
    assert widened(given) is None


@pytest.mark.parametrize(
    ("name", "at", "end", "expected"),
    [
        ("k[2]", 0.9999, "upper", Uniform(20, 100)),
        ("k[1]", 0.0001, "lower", Uniform(0, 60)),  # by its own width: to -20, but no spring pushes
        ("c", 0.0001, "lower", Uniform(0, 1)),
        ("n", 0.9999, "upper", Uniform(1, 5)),
    ],
)
def test_a_uniform_prior_is_widened_by_its_width_where_the_law_admits_it(
    name: str, at: float, end: str, expected: Uniform
) -> None:
    given = fitted(**{name: at})
    (sentence,) = binding_sentences(*given)
    assert sentence.startswith(f"The prior of {name}, Uniform(")
    assert sentence.endswith(
        f"binds: the best fit of the model as given lies at its {end} end. The prior was widened to {expected}."
    )
    before = {p.name: p.prior for p in given[0].space.parameters}
    assert priors_of(given) == {**before, name: expected}


def test_where_the_law_itself_ends_no_prior_binds() -> None:
    """A sharpness of one is the least there is: the end is physics, not the user's guess."""
    given = fitted(n=0.0001)
    assert binding_sentences(*given) == ()


def test_a_prior_without_ends_binds_nothing() -> None:
    assert binding_sentences(*fitted(beta=0.9999)) == ()


def test_a_prior_cut_off_by_its_user_is_told_and_kept() -> None:
    given = fitted(alpha=0.9999)
    (sentence,) = binding_sentences(*given)
    assert str(TRUNCATED) in sentence
    assert "widened" not in sentence
    assert widened(given) is None


def test_of_what_the_record_says_little_about_no_prior_is_said_to_bind() -> None:
    """Of an elastic specimen four priors bound what its report said the record tells nothing of."""
    (sentence,) = binding_sentences(*fitted(unseen="n", n=0.9999))
    assert sentence == (
        "The best fit of the model as given lies at the upper end of the prior of n, Uniform(1, 3), though the record "
        "says little about it. The prior was widened to Uniform(1, 5)."
    )


def held_by_no_hardening(gradient: float, *, effects: tuple[Effect, ...] = ()) -> Fitted:
    """A storey whose best fit lies where ``beta + gamma`` is all but zero, and would go on along gamma."""
    storey = BoucWen(k=Uniform(20, 60), c=0.5, alpha=0.1, beta=2.0, gamma=Uniform(-8, 8), n=1.0)
    model = ShearBuilding(masses=[1.0, 1.0], storey=storey)
    for effect in effects:
        model = model.with_effect(effect)
    posterior = Posterior(model=model, record=RECORD, engine=Lanes(), noise=KnownNoise(sd=(1.0,)))
    mode = Mode(
        point=np.array([0.5, 0.3751]), log_likelihood=0.0, gradient=np.array([0.0, gradient]),
        information=np.diag([1e4, 1e4]),
    )  # fmt: skip
    return posterior, mode


def test_priors_without_loops_that_harden_bind_and_are_widened() -> None:
    """Cubic stiffness was named in their place, with certainty."""
    given = held_by_no_hardening(-1e3)
    (sentence,) = binding_sentences(*given, hardens=True)
    assert sentence == (
        "The priors bind where beta + gamma >= 0 cuts them: the best fit of the model as given lies there. They were "
        "widened to loops that harden (hardens=True)."
    )
    assert binding_sentences(*given) == (sentence[: sentence.index(" They were")],)
    assert widened(given) is None
    freed = let_harden(*given)
    assert freed is not None
    assert freed.space.constraints == ()
    assert freed.space.names == given[0].space.names


def test_where_an_effect_needs_the_bound_it_is_told_and_kept() -> None:
    given = held_by_no_hardening(-1e3, effects=(Asymmetry(phi=0.01),))
    (sentence,) = binding_sentences(*given)
    assert "binds" not in sentence and sentence.endswith("the best fit of the model as given lies there.")
    assert let_harden(*given) is None


@pytest.mark.parametrize("gradient", [-100.0, 1e3])
def test_a_fit_that_gains_little_or_inwards_is_not_held_back(gradient: float) -> None:
    """Half a nat is chance."""
    given = held_by_no_hardening(gradient)
    assert binding_sentences(*given) == ()
    assert let_harden(*given) is None


def test_a_loop_kept_from_hardening_is_not_answered_with_cubic_stiffness() -> None:
    """The model as given explains all once it may harden."""
    spring = BoucWen(k=80.0, c=0.5, alpha=0.5, beta=8.0, gamma=-11.0, hardens=True)
    force = as_force(multisine(np.random.default_rng(1), (0.3, 4.0), 600, 0.01, rms=20.0))
    record = simulate(Oscillator(mass=2.0, spring=spring), force, {}, channels=["displacement_1"], snr_db=50.0)
    given = BoucWen(
        k=Uniform(20, 200), c=Uniform(0, 5), alpha=Uniform(0, 1), beta=Uniform(-20, 60), gamma=Uniform(-80, 60)
    )
    settings = DiscoverySettings(effects=(CubicStiffness,), most_rounds=1, particles=200, n_workers=1)
    found = discover(Oscillator(mass=2.0, spring=given), record, settings=settings)
    assert found.verdict == "no_missing_effect"
    assert found.added == ()
    assert "The priors bind where beta + gamma >= 0 cuts them" in " ".join(found.sentences)


@pytest.mark.parametrize(
    ("quiet", "asked", "kept"),
    [
        ({"hardening"}, ["hardening"], "hardening"),  # the prior was wrong, and nothing is missing
        ({"lacking"}, ["as it is"], "as it is"),  # what is missing made the loop press on the condition
        (set(), ["as it is", "hardening"], "hardening"),  # the likelier of two that leave more than noise
        ({"far ahead"}, ["as it is", "hardening"], "as it is"),
    ],
)
def test_loops_harden_where_what_the_model_lacks_is_no_better_reason(
    monkeypatch: pytest.MonkeyPatch, quiet: set[str], asked: list[str], kept: str
) -> None:
    """A pinch has no place beside loops that may harden: with these alone 40 dB of one had no name after 300 s."""
    found: list[str] = []

    def search(given: Any, run: Run) -> Any:
        found.append(given.name)
        assert run.steps == []
        run.steps.append(given.name)
        if given.name == "hardening":
            run.stopped, run.cut_short = True, ("The search was stopped.",)
        best = SimpleNamespace(is_noise="lacking" in quiet and given.name == "as it is")
        joint = [{"as it is": 3.0 if "far ahead" in quiet else 1.0, "hardening": 2.0}[given.name]]
        return SimpleNamespace(
            laws=SimpleNamespace(best=best), compared=SimpleNamespace(log_joint=joint), run=run, name=given.name
        )

    monkeypatch.setattr(workflow, "search", search)
    plain, hardening = (SimpleNamespace(name=n, is_noise=n in quiet) for n in ("as it is", "hardening"))
    binding: Any = SimpleNamespace(sentences=lambda hardens=False: ("widened",) if hardens else ("binds",))
    given = workflow._Given(as_it_is=cast(Any, plain), hardening=cast(Any, hardening), binding=binding)
    pool: Any = workflow._searched(given, Run(DiscoverySettings(), np.random.default_rng(1), None))
    assert found == asked
    assert pool.name == kept
    assert pool.run.stopped == ("hardening" in asked)
    assert bool(pool.run.cut_short) == pool.run.stopped
    assert pool.run.binding == (("binds",) if kept == "as it is" else ("widened",))
