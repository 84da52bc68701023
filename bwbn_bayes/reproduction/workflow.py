"""Run the paper's tables again: finished cases are kept, a page, a CSV and figures are written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from bwbn_bayes.engines.journal import forget
from bwbn_bayes.errors import UNREADABLE_ARRAYS, UserError, replace_file, writing
from bwbn_bayes.reproduction.cases import Case, MethodName, cases_of
from bwbn_bayes.reproduction.comparison import comparison, write_csv
from bwbn_bayes.reproduction.figures import draw_all
from bwbn_bayes.reproduction.measure import Histories, Outcome, run_case
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.reproduction.page import render
from bwbn_bayes.reproduction.printed import TABLES
from bwbn_bayes.results import finite
from bwbn_bayes.versions import version_of

_CACHE = "cases"
_SETTINGS_OF: Mapping[str, MethodName] = {"particles": "TMCMC", "generations": "GA", "growing": "GA"}
"""Options that only one method sees."""


@dataclass(frozen=True, kw_only=True)
class Files:
    """What a reproduction wrote."""

    html: Path
    csv: Path
    figures: tuple[Path, ...]
    n_run: int
    n_kept: int


def reproduce(
    directory: Path,
    *,
    tables: Sequence[int] = TABLES,
    options: Options | None = None,
    cases: Sequence[Case] | None = None,
    say: Callable[[str], None] | None = None,
) -> Files:
    """Run every case of the tables that is not finished yet, and write the page.

    Parameters
    ----------
    directory : Path
        Where the page, the CSV, the figures and ``cases/`` go; cases finished there under the same options are kept.
    tables : sequence of int
        Printed tables to reproduce, from 1 to 7.
    options : Options, optional
        Assumptions and sizes.
    cases : sequence of Case, optional
        Only these of the tables' cases.
    say : callable, optional
        Told what is being done.

    Returns
    -------
    Files

    Raises
    ------
    UserError
        If a table does not exist.
    """
    options = options or Options()
    unknown = [table for table in tables if table not in TABLES]
    if unknown or not tables:
        raise UserError(f"table {', '.join(map(str, unknown)) or '(none)'} is not in the paper: choose from 1 to 7")
    wanted = tuple(dict.fromkeys(case for table in tables for case in cases_of(table)))
    if cases is not None:
        wanted = tuple(case for case in wanted if case in set(cases))
    outcomes: list[Outcome] = []
    n_run = 0
    for i, case in enumerate(wanted):
        for job in _jobs(case, options):
            path = job.path(directory)
            if not path.exists():
                if say is not None:
                    say(f"case {i + 1} of {len(wanted)}: {case.key}, seed {job.seed}")
                _run(job, path)
                n_run += 1
            outcomes.append(_read(path))
    rows = comparison(tables, outcomes)
    drawings = draw_all(rows, _histories(directory, options, wanted))
    page = render(tables, rows, outcomes, drawings, options)
    csv_path, html = directory / "reproduction.csv", directory / "reproduction.html"
    paths = tuple(directory / f"{name}.png" for name, _ in drawings)
    with _writing(directory):
        directory.mkdir(parents=True, exist_ok=True)  # tables of what the paper assumes need no case
        write_csv(rows, csv_path)
        for path, (_, png) in zip(paths, drawings, strict=True):
            replace_file(path, png)
        replace_file(html, page.encode())
    return Files(html=html, csv=csv_path, figures=paths, n_run=n_run, n_kept=len(outcomes) - n_run)


@dataclass(frozen=True, kw_only=True)
class _Job:
    """A case as it is run: under its own size, with or without a prediction."""

    case: Case
    options: Options
    seed: int
    predicts: bool

    def path(self, directory: Path) -> Path:
        """Where it is kept."""
        name = fingerprint(self.options, self.case.method, predicts=self.predicts)
        return directory / _CACHE / name / f"{self.case.key}_seed{self.seed}.json"


def _jobs(case: Case, options: Options) -> tuple[_Job, ...]:
    """The options' own seed in full; further ones with fewer particles and without a prediction."""
    many = case.method == "TMCMC" and case.group == 1 and case.snr != "inf"
    smaller = replace(options, particles=options.further_particles)
    further = range(options.seed + 1, options.seed + options.seeds) if many else ()
    return (
        _Job(case=case, options=options, seed=options.seed, predicts=case.group == 1),
        *(_Job(case=case, options=smaller, seed=seed, predicts=False) for seed in further),
    )


def fingerprint(options: Options, method: MethodName, *, predicts: bool) -> str:
    """A short name for what a method was run under; more seeds or other methods' settings keep what is finished."""
    aside = {"seed", "seeds", "quick", *(name for name, owner in _SETTINGS_OF.items() if owner != method)}
    plain: dict[str, object] = {name: value for name, value in asdict(options).items() if name not in aside}
    plain |= {"predicts": predicts, "version": version_of()}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:12]


def _run(job: _Job, path: Path) -> None:
    """Run a case; what it has solved is kept beside it until it is finished."""
    meanwhile = path.with_suffix("")
    _finish(path, *run_case(job.case, job.options, job.seed, predicts=job.predicts, checkpoint=meanwhile))
    forget(meanwhile)


def _finish(path: Path, outcome: Outcome, histories: Histories) -> None:
    """Write arrays first, facts last and at once: a case with its JSON is whole."""
    thin = {name: values.astype(np.float32) for name, values in asdict(histories).items()}
    with _writing(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path.with_suffix(".npz"), allow_pickle=False, **thin)
        text = json.dumps(finite(outcome.as_json()), indent=1, allow_nan=False)
        replace_file(path, f"{text}\n".encode())


def _writing(directory: Path) -> AbstractContextManager[None]:
    return writing(str(directory), "finished cases are kept; make room and run again")


def _read(path: Path) -> Outcome:
    try:
        data = json.loads(path.read_text(encoding="utf-8"), object_hook=_with_nan)
        return Outcome.from_json(data)
    except (ValueError, TypeError, KeyError) as error:
        raise UserError(f"{path} is not a finished case ({error}): remove it and run again") from error


def _with_nan(mapping: dict[str, object]) -> dict[str, object]:
    return {key: float("nan") if value is None else value for key, value in mapping.items()}


def _histories(directory: Path, options: Options, cases: Sequence[Case]) -> dict[Case, Histories]:
    found = {}
    for case in cases:
        path = _jobs(case, options)[0].path(directory).with_suffix(".npz")
        if case.group == 1 and case.snr == "inf" and path.exists():
            try:
                with np.load(path, allow_pickle=False) as arrays:
                    found[case] = Histories(**{name: arrays[name] for name in arrays.files})
            except UNREADABLE_ARRAYS as error:
                raise UserError(
                    f"{path} holds no histories ({error}): remove it and its JSON, and run again"
                ) from error
    return found
