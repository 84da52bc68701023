"""Priors of the user's own that bind: told, and widened before an effect is named to stand in for one."""

import numpy as np
import pytest

from bwbn_bayes.discovery.binding import binding_sentences, with_wider_priors
from bwbn_bayes.elements.bouc_wen import BoucWen
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


def widened(given: Fitted) -> Structure | None:
    posterior, best = given
    return with_wider_priors(posterior, best.point)


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
