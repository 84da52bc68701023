"""Every registered method behind one interface: it loads, refuses in a sentence what is not its own, is titled."""

from __future__ import annotations

import pytest
from inference_cases import recorded, sdof_model

from bwbn_bayes import GeneticSettings, Settings, UserError, identify
from bwbn_bayes.baselines.by_networks import IpvSettings
from bwbn_bayes.inference.registry import METHODS, method, title_of


@pytest.mark.parametrize("name", METHODS)
def test_every_method_loads_and_refuses_options_that_are_not_its_own(name: str) -> None:
    assert callable(method(name).identify)
    assert title_of(name) == METHODS[name].title
    other = IpvSettings() if name == "ga" else GeneticSettings()
    with pytest.raises(UserError, match="options"):
        identify(sdof_model(), recorded(1), settings=Settings(method=name), options=other)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_refuses_a_record_that_measures_nothing(name: str) -> None:
    with pytest.raises(UserError, match="measures nothing"):
        identify(sdof_model(), recorded(1).with_channels({}), settings=Settings(method=name))


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UserError, match=f"choose one of {', '.join(METHODS)}"):
        Settings(method="guess")
