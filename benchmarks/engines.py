"""Work and precision of the engines on the three-storey case, and how their cost grows.

``python -m benchmarks.engines --json FILE``

Every engine solves the same generated right-hand side: 150 s at 0.02 s, three storeys with degradation, sudden damage
and a slip of width sigma. The work is one ``misfit``: solve and sum the squared residuals of three accelerations. Lanes
solve 64 different draws around the truth in one call, as a sampler asks for them; the others two of them, singly.
Time is processor time of one thread, the best of several rounds in which the engines take turns, so that other load on
the machine does not favour one. Error is the NRMSE of the accelerations of the two draws against the reference engine.
Times at equal error are interpolated in logarithms between the efficient settings of an engine; where its coarsest
setting is better than asked for, that one counts; an error that it does not reach gives no time. ``scalar`` is the
scheme of the lanes with the same refinement, ``scalar, equal steps`` the same without it. LSODA counts with the faster
of its two ways through SciPy.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.integrate import odeint, solve_ivp

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock, StiffnessDegradation, StrengthDegradation, SuddenDamage
from bwbn_bayes.engines.base import Engine, Response, Status
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.kernel import Functions
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reduction import Reduction
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import Carried, ScalarProblem, ScalarRk4, Wanted, in_rows, scalar_problems, solve_each
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.parameters import Floats, PerStorey, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

TIME_STEP = 0.02
DURATION = 150.0
ERRORS = (1e-3, 1e-4)
SIGMAS = (0.01, 0.1)
N_DRAWS = 64
N_JUDGED = 2
REFINED = ((1, 0.0), (1, 0.7), (1, 0.5), (1, 0.35), (1, 0.25), (1, 0.125), (2, 0.125), (2, 0.06), (4, 0.06), (8, 0.03))
"""Steps per sample and resolution."""
EQUAL = (1, 2, 4, 8)
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
LANES, SCALAR, EQUAL_STEPS = "lanes", "scalar", "scalar, equal steps"
CVODES, ODEINT, SOLVE_IVP = "cvodes", "SciPy odeint", "SciPy solve_ivp LSODA"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One engine at one setting."""

    engine: str
    setting: str
    sigma: float
    nrmse: float
    ms_per_solve: float


@dataclass(frozen=True, kw_only=True)
class Lsoda(Reduction):
    """SciPy's LSODA with the compiled right-hand side; restarted at events, samples come from its interpolation.

    Parameters
    ----------
    rtol : float
        Relative tolerance; the absolute one is a hundredth of it.
    through_odeint : bool
        ``odeint``, whose loop is compiled; otherwise ``solve_ivp``.
    """

    rtol: float
    through_odeint: bool

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        return solve_each(scalar_problems(model, draws, record, names, _WANTED), self._solve)[0]

    def _solve(self, problem: ScalarProblem, draw: int, carried: Carried, out: Floats) -> Status:
        kernel, dt, n_times = problem.kernel, problem.time_step, problem.n_times
        data, slack, rows = carried.data, 1e-9 * dt, in_rows(out)
        y, room, none = carried.state[0], np.zeros(problem.n_states), np.zeros((0, problem.n_states))
        kernel.prepare(data)
        kernel.strike(slack, 0.0, y, none, room, room, data)
        now, first = 0.0, 0
        while first < n_times:
            event = kernel.next_event(data)
            last = min(int(np.ceil((min(event, n_times * dt) - slack) / dt)), n_times)
            samples = np.arange(first, last) * dt
            times = np.unique([now, *samples, event if last < n_times else samples[-1]])
            states = self._carry(kernel, y, times, data)
            own = states[np.searchsorted(times, samples)]
            kernel.observed(own, *problem.channel_arrays, data, room, rows, first)
            y, now, first = states[-1].copy(), event, last
            kernel.strike(event + slack, 0.0, y, none, room, room, data)
        return Status.OK

    def _carry(self, kernel: Functions, y: Floats, times: Floats, data: Floats) -> Floats:
        at, dy = np.empty_like(y), np.empty_like(y)
        rhs = kernel.rhs.given(at, dy, data)

        def rates(t: float, state: Floats) -> Floats:
            at[:] = state
            rhs(t)
            return dy

        if self.through_odeint:
            result = odeint(rates, y, times, tfirst=True, rtol=self.rtol, atol=self.rtol / 100, mxstep=10_000)
            return np.ascontiguousarray(result)
        ends = (float(times[0]), float(times[-1]))
        solved = solve_ivp(
            lambda t, state: rates(t, state).copy(),
            ends,
            y,
            method="LSODA",
            t_eval=times,
            rtol=self.rtol,
            atol=self.rtol / 100,
        )
        return np.ascontiguousarray(solved.y.T)


# Samples are observed in a compiled loop, so that SciPy does not pay for Python outside its solver.
_OBSERVED = """

def observed(states: floats_2d, starts: integers, row: integers, coefficient: floats, ground_part: floats, data: floats,
             rate: floats, out: floats_2d, first: int):
    for i in range(states.shape[0]):
        j = first + i
        rates(states[i], ground_at(j * data[1], data), rate, data)
        see(states[i], starts, row, coefficient, ground_part, data, out[j], j)
"""
_WANTED = Wanted(entries=("prepare", "strike", "next_event", "rhs", "observed"), further=_OBSERVED)


def building(n_storeys: int, sigma: float) -> Structure:
    """The paper's storey, with slip of width sigma and three storeys' times of damage."""
    storey = BoucWen(
        k=PerStorey(Uniform(5, 15)),
        c=PerStorey(Uniform(0.01, 0.1)),
        alpha=Uniform(0.001, 0.02),
        beta=Uniform(0.1, 4),
        gamma=Uniform(0.1, 4),
        n=Uniform(1, 2),
    )
    times = PerStorey([(30.0, 60.0, 100.0)[i % 3] for i in range(n_storeys)])
    effects = (
        StrengthDegradation(delta_nu=Uniform(0, 0.1)),
        StiffnessDegradation(delta_eta=Uniform(0, 0.1)),
        SlipLock(delta_s=Uniform(0.01, 0.1), sigma=sigma),
        SuddenDamage(parameter="delta_nu", jump=Uniform(0.1, 3), time=times),
        SuddenDamage(parameter="delta_eta", jump=Uniform(0.1, 3), time=times),
    )
    model = ShearBuilding(masses=[1.0] * n_storeys, storey=storey)
    for effect in effects:
        model = model.with_effect(effect)
    return model


TRUTH = {
    "k": 10.0,
    "c": 0.05,
    "alpha": 0.01,
    "beta": 2.0,
    "gamma": 2.0,
    "n": 1.5,
    "delta_nu": 0.0,
    "delta_eta": 0.0,
    "delta_s": 0.05,
    "delta_nu_jump": 1.5,
    "delta_eta_jump": 1.5,
}


def draws_around_truth(model: Structure) -> Floats:
    """Draws ``(64, n_parameters)`` within some per cent of the truth, the truth itself first."""
    truth = np.array([TRUTH[parameter.symbol] for parameter in model.space.parameters])
    spread = np.random.default_rng(1).normal(size=(N_DRAWS, len(truth)))
    spread[0] = 0.0
    return np.asarray(truth * (1.0 + 0.02 * np.clip(spread, -2, 2)), dtype=np.float64)


def sine_record(n_storeys: int, duration: float) -> Record:
    """A sine of 0.5 m/s^2 at 0.2 Hz. The measured channels are zero, which costs as much as any."""
    times = np.arange(round(duration / TIME_STEP) + 1) * TIME_STEP
    channels = {f"acceleration_{i + 1}": np.zeros_like(times) for i in range(n_storeys)}
    ground = 0.5 * np.sin(2.0 * np.pi * 0.2 * times)
    return Record(name="sine", time_step=TIME_STEP, excitation=ground, channels=channels)


def contestants() -> list[tuple[str, str, Engine | Lsoda, int]]:
    """Name, setting, engine and number of draws of each contestant."""
    result: list[tuple[str, str, Engine | Lsoda, int]] = []
    for substeps, resolution in REFINED:
        setting = f"{substeps} steps, resolution {resolution:g}"
        lanes = Lanes(substeps=substeps, resolution=resolution, n_threads=1)
        result.append((LANES, setting, lanes, N_DRAWS))
        result.append((SCALAR, setting, ScalarRk4(substeps=substeps, resolution=resolution), N_JUDGED))
    result += [(EQUAL_STEPS, f"{n} steps", ScalarRk4(substeps=n), N_JUDGED) for n in EQUAL]
    for rtol in TOLERANCES:
        setting = f"rtol {rtol:g}"
        result.append((CVODES, setting, Cvodes(rtol=rtol, atol=rtol / 100), N_JUDGED))
        result.append((ODEINT, setting, Lsoda(rtol=rtol, through_odeint=True), N_JUDGED))
        result.append((SOLVE_IVP, setting, Lsoda(rtol=rtol, through_odeint=False), N_JUDGED))
    return result


def seconds(work: Callable[[], object]) -> float:
    """Processor time in s that a piece of work takes this thread."""
    start = time.thread_time()
    work()
    return time.thread_time() - start


def work_precision(sigma: float, n_rounds: int) -> list[Row]:
    """Error and time of every engine at every setting."""
    model, record = building(3, sigma), sine_record(3, DURATION)
    draws = draws_around_truth(model)
    exact = Reference().simulate(model, draws[:N_JUDGED], record).values
    field = contestants()
    errors = [_nrmse(engine.simulate(model, draws[:N_JUDGED], record).values, exact) for _, _, engine, _ in field]
    best = np.full(len(field), np.inf)
    for turn in range(n_rounds):
        for i, (name, _, engine, n_draws) in enumerate(field):
            if name in (ODEINT, SOLVE_IVP) and turn >= 2:
                continue  # it takes the most time and varies least
            took = seconds(lambda engine=engine, n=n_draws: engine.misfit(model, draws[:n], record))  # type: ignore[misc]
            best[i] = min(best[i], took / n_draws * 1e3)
    return [
        Row(engine=name, setting=setting, sigma=sigma, nrmse=error, ms_per_solve=float(ms))
        for (name, setting, _, _), error, ms in zip(field, errors, best, strict=True)
    ]


def _nrmse(values: Floats, exact: Floats) -> float:
    return float(np.sqrt(np.mean((values - exact) ** 2) / np.mean(exact**2)))


def time_at(rows: Sequence[Row], engine: str, sigma: float, error: float) -> float | None:
    """Time per solve in ms of an engine at an achieved error, None where it does not reach it."""
    own = [row for row in rows if row.engine == engine and row.sigma == sigma and np.isfinite(row.nrmse)]
    efficient = [row for row in own if not any(r.nrmse < row.nrmse and r.ms_per_solve < row.ms_per_solve for r in own)]
    efficient.sort(key=lambda row: row.nrmse)
    if not efficient or efficient[0].nrmse > error:
        return None
    logs = np.log([[row.nrmse, row.ms_per_solve] for row in efficient])
    return float(np.exp(np.interp(np.log(error), logs[:, 0], logs[:, 1])))


def ratios_at(rows: Sequence[Row], sigma: float, error: float) -> dict[str, float | None]:
    """How many times longer than the lanes the others take; LSODA is the faster of its two ways."""
    lanes = time_at(rows, LANES, sigma, error)

    def ratio(*engines: str) -> float | None:
        times = [t for t in (time_at(rows, engine, sigma, error) for engine in engines) if t is not None]
        return min(times) / lanes if times and lanes is not None else None

    return {
        "lanes_vs_scalar": ratio(SCALAR),
        "lanes_vs_scalar_equal_steps": ratio(EQUAL_STEPS),
        "lanes_vs_cvodes": ratio(CVODES),
        "lanes_vs_lsoda": ratio(ODEINT, SOLVE_IVP),
    }


def growth(sizes: Sequence[float], cases: Sequence[tuple[Structure, Record]], n_rounds: int) -> dict[str, object]:
    """Cost per solve of the lanes against size, and the exponent of the power law fitted to it.

    Equal steps: how many a refined solve takes depends on how often it slips, which changes along the record.
    """
    engine = Lanes(substeps=1, n_threads=1)
    best = np.full(len(sizes), np.inf)
    for _ in range(n_rounds + 1):  # the first round compiles
        for i, (model, record) in enumerate(cases):
            draws = draws_around_truth(model)
            took = seconds(lambda m=model, d=draws, r=record: engine.misfit(m, d, r))  # type: ignore[misc]
            best[i] = min(best[i], took / N_DRAWS * 1e3)
    exponent = float(np.polyfit(np.log(sizes), np.log(best), 1)[0])
    return {"size": list(sizes), "ms_per_solve": best.tolist(), "exponent": exponent}


def show(
    console: Console, rows: Sequence[Row], ratios: Mapping[float, Mapping[float, Mapping[str, float | None]]]
) -> None:
    """Print the work-precision table and the ratios."""
    table = Table("sigma [m]", "engine", "setting", "NRMSE", "ms per solve")
    for row in rows:
        table.add_row(f"{row.sigma:g}", row.engine, row.setting, f"{row.nrmse:.1e}", f"{row.ms_per_solve:.3f}")
    console.print(table)
    table = Table("sigma [m]", "NRMSE", "lanes [ms]", *next(iter(next(iter(ratios.values())).values())))
    for sigma, at_sigma in ratios.items():
        for error, values in at_sigma.items():
            own = time_at(rows, LANES, sigma, error)
            cells = ["" if value is None else f"{value:.1f}" for value in values.values()]
            table.add_row(f"{sigma:g}", f"{error:g}", "" if own is None else f"{own:.3f}", *cells)
    console.print(table)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="where the figures go")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of which the best counts")
    options = parser.parse_args()
    console = Console()
    rows = [row for sigma in SIGMAS for row in work_precision(sigma, options.rounds)]
    ratios = {sigma: {error: ratios_at(rows, sigma, error) for error in ERRORS} for sigma in SIGMAS}
    storeys, lengths = (1, 3, 10, 50), (37.5, 75.0, 150.0)
    by_storeys = growth(storeys, [(building(n, 0.01), sine_record(n, 30.0)) for n in storeys], options.rounds)
    by_length = growth(lengths, [(building(3, 0.01), sine_record(3, length)) for length in lengths], options.rounds)
    console.print(f"{processor_name()}, one core")
    show(console, rows, ratios)
    for word, measured in (("storeys", by_storeys), ("seconds of record", by_length)):
        console.print(f"lanes, ms per solve for {measured['size']} {word}: {measured['ms_per_solve']}")
        console.print(f"  exponent {measured['exponent']:.2f}")
    if options.json:
        facts = {
            "processor": processor_name(),
            "n_threads": 1,
            "rows": [asdict(row) for row in rows],
            "ratios": {**ratios[SIGMAS[0]][ERRORS[0]], "by_sigma_and_error": ratios},
            "growth": {"storeys": by_storeys, "record_length": by_length},
        }
        options.json.write_text(json.dumps(facts, indent=2) + "\n")


if __name__ == "__main__":
    main()
