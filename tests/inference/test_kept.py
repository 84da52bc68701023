"""Fits that are kept whole: the same bits, of the same question, with the same count of solves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inference_cases import ENGINE, recorded, sdof_model

from bwbn_bayes import UserError
from bwbn_bayes.engines.journal import Journal
from bwbn_bayes.inference import modes
from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior, SolveCount, default_noise
from bwbn_bayes.inference.modes import climb, find_modes, polish

RECORD = recorded(1).until(6.0)
POSTERIOR = Posterior(model=sdof_model(), record=RECORD, engine=ENGINE, noise=default_noise(RECORD))
STARTS = np.random.default_rng(1).uniform(0.3, 0.7, (5, POSTERIOR.n_dim))
HELD = np.arange(POSTERIOR.n_dim) < 2


@pytest.fixture
def n_fitted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Starts of every fit that is not read but made."""
    own, made = modes._climb, []

    def count(view, points, local, **options):  # type: ignore[no-untyped-def]
        made.append(len(points))
        return own(view, points, local, **options)

    monkeypatch.setattr(modes, "_climb", count)
    return made


def everything(view: Posterior) -> tuple[list[np.ndarray], int]:
    """Numbers of a search, a fit and a climb, and solves that were counted."""
    view = replace(view, solves=SolveCount())
    found = find_modes(view, np.random.default_rng(1), n_starts=64, n_first=4)
    points, local = polish(view, STARTS, n_iterations=3, held=HELD, reach=50.0)
    climbed, reached = climb(view, STARTS, n_iterations=2)
    arrays = [points, local.log_likelihood, local.gradient, local.information, climbed, reached]
    return [*arrays, *(mode.point for mode in found), *(mode.information for mode in found)], view.solves.total


def test_what_is_kept_is_the_same_to_the_last_bit(tmp_path: Path, n_fitted: list[int]) -> None:
    expected, n_solves = everything(POSTERIOR)
    n_fits = len(n_fitted)
    for n_made in (2 * n_fits, 2 * n_fits):  # made once more, then read
        with Journal.opened(tmp_path / "run") as journal:
            found, n = everything(replace(POSTERIOR, journal=journal))
        assert n == n_solves
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)
        assert len(n_fitted) == n_made


def _fit(journal: Journal, view: Posterior, starts: np.ndarray = STARTS, reach: float = 50.0) -> None:
    polish(replace(view, journal=journal), starts, n_iterations=2, reach=reach)


def test_another_question_has_another_answer(tmp_path: Path, n_fitted: list[int]) -> None:
    """Threads are no part of it; model, record, scheme, noise, starts and options are."""
    noise = POSTERIOR.noise
    assert isinstance(noise, IntegratedNoise)
    coloured = [
        POSTERIOR.with_noise(replace(noise, correlation=Correlation(coefficients=(np.array([share]),))))
        for share in (0.5, 0.5 + 1e-15)
    ]
    others = [
        POSTERIOR.until(5.0),
        POSTERIOR.with_model(replace(sdof_model(), masses=(1.5,))),
        POSTERIOR.with_engine(replace(ENGINE, substeps=2)),
        *coloured,
    ]
    with Journal.opened(tmp_path / "run") as journal:
        _fit(journal, POSTERIOR)
        _fit(journal, POSTERIOR.with_engine(replace(ENGINE, n_threads=1)))
        assert len(n_fitted) == 1
        for other in others:
            _fit(journal, other)
        _fit(journal, POSTERIOR, starts=np.nextafter(STARTS, 1.0))
        _fit(journal, POSTERIOR, reach=51.0)
        assert len(n_fitted) == 1 + len(others) + 2


def test_an_answer_that_is_not_so_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Journal._append

    def bettered(self, question, answer):  # type: ignore[no-untyped-def]
        points, reached, *rest = answer
        own(self, question, (points, reached + 5.0, *rest))

    monkeypatch.setattr(Journal, "_append", bettered)
    with Journal.opened(tmp_path / "run") as journal:
        _fit(journal, POSTERIOR)
        with pytest.raises(UserError, match=r"not what is solved here; delete .*run\.solves"):
            _fit(journal, POSTERIOR)


def test_what_is_asked_after_the_run_is_solved(tmp_path: Path, n_fitted: list[int]) -> None:
    with Journal.opened(tmp_path / "run") as journal:
        pass
    _fit(journal, POSTERIOR)
    assert n_fitted == [5]
    assert replace(POSTERIOR, journal=journal).misfit(STARTS).shape == (5, len(RECORD.channels))
