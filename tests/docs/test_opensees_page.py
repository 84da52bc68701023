"""The page's scripts run and come as near as it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pages import run_page

from bwbn_bayes import simulate
from bwbn_bayes.export import Script


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = run_page("opensees.md")
    coarse, fine, limit = names["missed"]  # type: ignore[misc]
    assert 3e-3 < coarse < 7e-3
    assert fine == pytest.approx(0.5 * coarse, rel=0.1)
    assert limit < 1e-4
    fitted = names["fitted"]
    assert isinstance(fitted, Script)
    assert fitted.links[0].error is not None
    assert 0.006 < fitted.links[0].error < 0.04
    ratio = names["ratio"]
    assert isinstance(ratio, xr.DataArray)
    record = simulate(names["unknown"], names["shaking"], {"k": 8e7}, channels=["drift_1", "drift_2"])  # type: ignore[arg-type]
    truth = [100.0 * np.max(np.abs(record.channels[f"drift_{i + 1}"])) / height for i, height in enumerate((3.2, 3.0))]
    assert np.all(np.abs(ratio.mean("draw") - truth) < 4.0 * ratio.std("draw"))
