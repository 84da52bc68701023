"""The tutorial's blocks run in order and find what the page says."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr
from pages import run_page


@pytest.mark.filterwarnings("ignore::UserWarning")  # arviz on the few draws of a page that runs in seconds
def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = run_page("pymc.md")
    truth = names["truth"]
    assert isinstance(truth, dict)
    for tree in (names["tree"], names["heavy"], names["run"].tree):  # type: ignore[attr-defined]
        assert isinstance(tree, xr.DataTree)
        for name, value in truth.items():
            draws = tree["posterior"][name].values
            assert abs(draws.mean() - value) < 4.0 * draws.std(), name
    assert (tmp_path / "smc.nc").is_file()
    # 301 samples: the share inside a 90 % band has standard error 0.017.
    share = names["share"]
    assert isinstance(share, float)
    assert abs(share - 0.9) < 0.07
