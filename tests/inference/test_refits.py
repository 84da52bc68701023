"""Fits to variants of a record, against least squares in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.base import Response
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.refits import refitted
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

N, SD = 160, 0.3
DESIGN = 0.02 * np.random.default_rng(5).standard_normal((N, 2))
MODEL = Specimen(storey=BoucWen(k=Uniform(0, 1000), c=Uniform(0, 1000), alpha=0.2, beta=20.0, gamma=5.0, n=1.0))


class Linear:
    """An engine whose response is linear in the parameters, but for a bend on request."""

    name = "linear"

    def __init__(self, bend: float = 0.0) -> None:
        self.bend = bend

    def simulate(self, _: Any, draws: Floats, record: Record, *__: Any) -> Response:
        bent = draws + self.bend * np.square(draws)
        values = (bent @ DESIGN.T)[:, None]
        return Response(channels=tuple(record.channels), values=values, status=np.zeros(len(draws), dtype=np.int64))

    def sensitivities(self, model: Any, draws: Floats, record: Record, **_: Any) -> tuple[Response, Floats]:
        slopes = (1.0 + 2.0 * self.bend * draws)[:, :, None] * DESIGN.T
        return self.simulate(model, draws, record), slopes[:, :, None]


def case(bend: float = 0.0) -> tuple[Posterior, Floats, Floats]:
    """A posterior, its optimum and what was measured over the noise; the truth is 600 and 400."""
    truth = np.array([600.0, 400.0])
    measured = DESIGN @ (truth + bend * np.square(truth)) + SD * np.random.default_rng(7).standard_normal(N)
    record = Record(
        name="drawn",
        time_step=0.1,
        excitation=np.ones(N),
        channels={"force": measured},
        excitation_kind="displacement",
    )
    engine: Any = Linear(bend)
    posterior = Posterior(model=MODEL, record=record, engine=engine, noise=KnownNoise(sd=(SD,)))
    best = np.linalg.lstsq(DESIGN, measured)[0]
    if bend:
        best = (np.sqrt(1.0 + 4.0 * bend * best) - 1.0) / (2.0 * bend)
    return posterior, best / 1000.0, measured


def test_one_step_is_exact_for_a_linear_model() -> None:
    posterior, point, measured = case()
    slopes = Slopes.at(posterior, point)
    errors = np.random.default_rng(8).standard_normal((3, 1, N))
    counts = np.ones((3, 1, N))
    counts[1, :, :50], counts[2, :, 60:90] = 0.0, 0.0
    found = refitted(posterior, slopes, np.tile(point, (3, 1)), 1, counts=counts, errors=errors)
    for own, error, count, values in zip(found.points, errors[:, 0], counts[:, 0], found.values[:, 0], strict=True):
        expected = np.linalg.lstsq(DESIGN[count > 0], (measured + SD * error)[count > 0])[0]
        np.testing.assert_allclose(1000.0 * own, expected, rtol=1e-6)
        np.testing.assert_allclose(values, DESIGN @ expected, atol=1e-5)


def test_a_bent_model_is_followed() -> None:
    """The same in a parameter's bent coordinate: further steps reach what closed form gives."""
    posterior, point, measured = case(bend=5e-3)
    slopes = Slopes.at(posterior, point)
    errors = 40.0 * np.random.default_rng(8).standard_normal((5, 1, N))
    found = refitted(posterior, slopes, np.tile(point, (5, 1)), 8, errors=errors)
    for own, error in zip(found.points, errors[:, 0], strict=True):
        straight = np.linalg.lstsq(DESIGN, measured + SD * error)[0]
        expected = (np.sqrt(1.0 + 4.0 * 5e-3 * straight) - 1.0) / (2.0 * 5e-3)
        np.testing.assert_allclose(1000.0 * own, expected, rtol=1e-4)


def test_what_is_not_free_stays() -> None:
    posterior, point, measured = case()
    found = refitted(posterior, Slopes.at(posterior, point), point[None] + 0.01, 2, free=np.array([True, False]))
    assert found.points[0, 1] == point[1] + 0.01
    left = measured - 1000.0 * found.points[0, 1] * DESIGN[:, 1]
    assert 1000.0 * found.points[0, 0] == pytest.approx(float(np.linalg.lstsq(DESIGN[:, :1], left)[0][0]), rel=1e-6)


def test_a_variant_that_cannot_be_solved_stays_where_it_was() -> None:
    posterior, point, _ = case()
    slopes = Slopes.at(posterior, point)
    broken: Any = SimpleNamespace(
        name="broken",
        simulate=posterior.engine.simulate,
        sensitivities=lambda model, draws, record: (
            Linear().simulate(model, np.where(draws > 590.0, np.nan, draws), record),
            Linear().sensitivities(model, draws, record)[1],
        ),
    )
    start = np.tile(point - 0.05, (1, 1))
    found = refitted(posterior.with_engine(broken), slopes, start, 1)
    np.testing.assert_array_equal(found.points, start)
