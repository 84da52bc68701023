"""Priors of the user's own that bind: told, and widened before an effect is named to stand in for one."""

import numpy as np
import pytest

from bwbn_bayes.discovery.binding import binding_sentences, with_wider_priors
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.parameters import Floats, Normal, PerStorey, Prior, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

RECORD = Record(name="still", time_step=0.01, excitation=np.ones(40), channels={"acceleration_2": np.ones(40)})
TRUNCATED = Normal(0.2, 0.1).truncated(0.1, 0.3)


Fitted = tuple[Posterior, Floats]
"""Of the model as given, and its best fit."""


def fitted(**at: float) -> Fitted:
    """A model of two storeys whose best fit lies in the middle of every prior but where said otherwise."""
    storey = BoucWen(
        k=PerStorey(Uniform(20, 60)), c=Uniform(0.1, 1.0), alpha=TRUNCATED, beta=Normal(5.0, 1.0), gamma=2.0,
        n=Uniform(1.0, 3.0),
    )  # fmt: skip
    model = ShearBuilding(masses=[1.0, 1.0], storey=storey)
    posterior = Posterior(model=model, record=RECORD, engine=Lanes(), noise=KnownNoise(sd=(1.0,)))
    return posterior, np.array([at.get(name, 0.5) for name in posterior.space.names])


def priors_of(given: Fitted) -> dict[str, Prior]:
    wider = with_wider_priors(*given)
    assert wider is not None
    return {p.name: p.prior for p in wider.space.parameters}


def test_nothing_binds_inside_a_prior() -> None:
    given = fitted(**{"k[1]": 0.99, "c": 0.01})
    assert binding_sentences(*given) == ()
    assert with_wider_priors(*given) is None


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
    assert sentence.endswith(f"binds: the best fit of the model as given lies at its {end} end.")
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
    assert with_wider_priors(*given) is None
