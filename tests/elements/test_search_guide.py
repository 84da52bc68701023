"""How an effect gets the object that searches look for it by."""

from __future__ import annotations

from collections.abc import Mapping
from typing import override

import pytest

from bwbn_bayes.discovery.candidates import hypotheses
from bwbn_bayes.elements import search_guide
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, PDelta
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import NOMINAL, Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guide_of, guides, is_sought
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Normal
from bwbn_bayes.structures.specimen import Specimen

SPECIMEN = Specimen(storey=BoucWen(k=20.0, alpha=0.1, beta=2.0, gamma=1.0, n=1.5))


class Stiffening(CubicStiffness):
    """An effect that nothing is told of but its physics."""


class OfThree(SearchGuide[Stiffening]):
    @override
    def priors(self, scales: Scales) -> tuple[Stiffening, ...]:
        return (Stiffening(k3=Normal(0.0, 3.0 * scales.force)),)

    @override
    def starts(self, effect: Stiffening, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"k3": (-scales.force, scales.force)}


@pytest.fixture(autouse=True)
def own_guides(monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of the guides that the test may change."""
    monkeypatch.setattr(search_guide, "_GUIDES", dict(search_guide._GUIDES))


def test_an_effect_is_looked_for_once_it_has_a_guide() -> None:
    assert hypotheses(SPECIMEN, [NOMINAL], measured=("force",), effects=[Stiffening]) == ()
    guides(Stiffening)(OfThree)
    (found,) = hypotheses(SPECIMEN, [NOMINAL], measured=("force",), effects=[Stiffening])
    assert found.effect == Stiffening(k3=Normal(0.0, 3.0))
    starts = found.model.space.from_unit(found.starts(SPECIMEN.space.to_unit(SPECIMEN.draws({}))))
    assert starts[:, 0] == pytest.approx([-1.0, 1.0])
    assert found.free_shapes == ()


def test_a_form_of_free_shape_is_fitted_by_its_own_guide() -> None:
    (cubic,) = hypotheses(SPECIMEN, [NOMINAL], measured=("force",), effects=[CubicStiffness])
    (free,) = cubic.free_shapes
    assert free.effect.form == "free shape"
    assert set(free.brought) == {"F_h", "p_h"} == set(free.guide.starts(free.effect, NOMINAL))
    assert (free.base, free.storeys, free.scales) == (cubic.base, cubic.storeys, cubic.scales)


def test_an_effect_without_a_guide_is_told_by_name() -> None:
    assert not is_sought(PDelta)
    with pytest.raises(UserError, match="effect PDelta: no search looks for it: write @guides"):
        guide_of(PDelta)


def test_a_guide_without_starts_is_refused_where_it_is_written() -> None:
    class Halfway(SearchGuide[Stiffening]):
        @override
        def priors(self, scales: Scales) -> tuple[Stiffening, ...]:
            return ()

    with pytest.raises(UserError, match="Halfway: its method starts is missing"):
        guides(Stiffening)(Halfway)


def test_the_physics_of_an_effect_holds_nothing_of_a_search() -> None:
    """A law is used where nothing is sought, and a search may be tuned without touching a law."""
    told = {name for name in dir(SearchGuide) if not name.startswith("_")}
    assert told == {"family", "free_shapes", "priors", "starts"}
    assert not told & set(dir(Effect))
