"""The shake-table frame's runs as they are read, what its sliders are worth, how stiff in bending a made-up one is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from benchmarks import frame
from bwbn_bayes import Record, SlidingBase, el_centro, simulate
from bwbn_bayes.parameters import LogNormal, Uniform


def run(name: str, offset: float) -> Record:
    """Forty seconds, strong from the tenth on, with a residual displacement that grows from floor to floor."""
    times = np.arange(2561) / 64
    strong = times >= 10.0
    floors = {f"displacement_{i}": i * (offset + 0.002 * strong) for i in (1, 2, 3)}
    return Record(name=name, time_step=1 / 64, excitation=strong * np.sin(5.0 * times), channels=floors)


@pytest.fixture(autouse=True)
def _made_up_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "read_frame", lambda path: run(path.stem, -0.018 if path.stem == frame.LARGE else 0.0))


def test_a_run_counts_from_rest_for_twenty_seconds() -> None:
    for name in (frame.SMALL, frame.LARGE):
        part = frame.run_of(name)
        assert part.duration == pytest.approx(20.0)
        assert np.flatnonzero(part.excitation)[0] / 64 == pytest.approx(1.0, abs=0.5)
        assert part.channels["displacement_3"][0] == pytest.approx(0.0, abs=1e-12)
        assert part.channels["displacement_3"][-1] == pytest.approx(0.006)


def test_in_sequence_the_second_run_begins_where_the_first_ended() -> None:
    first, second = (frame.run_of(name) for name in (frame.SMALL, frame.LARGE))
    joined = frame.in_sequence(first, second)
    assert joined.is_sequence
    assert [bool(part.channels) for part in joined.parts] == [True, False, True]
    assert joined.parts[2].channels["displacement_2"][0] == pytest.approx(first.channels["displacement_2"][-1])
    errors = frame.missed(frame.LINEAR, frame.LINEAR.space.from_unit(np.full((1, 6), 0.5)), joined)
    assert len(errors) == 2


def test_drifts_add_up_to_the_floors() -> None:
    whole = frame.run_of(frame.SMALL)
    parts = frame.drifts(whole).channels
    assert list(parts) == ["drift_1", "drift_2", "drift_3"]
    np.testing.assert_allclose(sum(parts.values()), whole.channels["displacement_3"])


def test_friction_and_period_are_those_of_the_weight_that_slides() -> None:
    """A slab of twice the mass that the known weight holds: the same force, a smaller coefficient, a longer period."""
    known = frame.GRAVITY * 4.0
    priors = {"inv_mu": LogNormal(20, 1), "R_s": LogNormal(1, 1), "m_s": Uniform(0.1, 9), "r_mu": Uniform(0, 0.9)}
    slides = SlidingBase(**priors, W_s=known, Y_s=0.001, a_s=30.0)
    model = frame.LINEAR.with_effect(slides)
    draws = {"inv_mu": 20.0, "R_s": 0.5, "m_s": 5.0, "r_mu": 0.4}
    posterior = xr.Dataset({name: (("chain", "draw"), np.full((1, 4), value)) for name, value in draws.items()})
    result: Any = SimpleNamespace(tree={"posterior": posterior}, facts=SimpleNamespace(effective_sample_size=3.0))
    found = frame.sliders(model, result)
    assert found["effective_draws"] == 3.0
    assert found["friction_at_speed"] == pytest.approx([0.05 * 4.0 / 8.0] * 3)
    assert found["friction_near_rest"] == pytest.approx([0.6 * 0.05 * 4.0 / 8.0] * 3)
    # 8 kg on a pendulum stiffness of W_s / R_s.
    assert found["period_s"] == pytest.approx([2.0 * np.pi * np.sqrt(8.0 / (known / 0.5))] * 3)


def test_bending_is_that_of_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = {**{f"k[{i}]": 400.0 for i in (1, 2, 3)}, **{f"c[{i}]": 2.0 for i in (1, 2, 3)}, "k_bend": 150.0}
    floors = [f"displacement_{i}" for i in (1, 2, 3)]
    model = frame.LINEAR.with_effect(frame.BENDING)
    shaken = simulate(model, el_centro("chopra", duration=8.0), truth, channels=floors, snr_db=40.0)
    monkeypatch.setattr(frame, "run_of", lambda _: shaken)
    line = frame.bent(frame.SMALL, seed=1, particles=300)
    without, with_it = line["missed_percent"]
    assert line["k_bend"] == pytest.approx(150.0, rel=0.05)
    assert line["gained_nats"] > 100.0
    assert with_it < 0.5 * without
