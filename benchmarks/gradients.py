"""What log probability and gradient of one point cost: ``to_pymc`` beside other ways, at equal error of the gradient.

``python -m benchmarks.gradients --model models/sdof.py --duration 10 --json FILE``
``python -m benchmarks.gradients --model models/plain_three_storey.py --duration 10``
``python -m benchmarks.gradients --model models/sdof.py --duration 10 --nuts 500``
``python -m benchmarks.gradients --model models/sdof.py --duration 0.7 --ode``

The scan is what a PyMC user would write: classical Runge-Kutta steps of the equation of motion, differentiated by
PyTensor, compiled by its default linker. It takes as many steps between samples as bring its error down to that of the
scheme that ``to_pymc`` chooses. ``pm.ode`` has the tolerances of SciPy's ``odeint``, which cannot be set: its error is
what it is. CVODES, by sundials4py and, where it is installed, by sunode, solves the package's compiled equations with
forward sensitivities, at the loosest tolerance that brings the error down. All gradients are compared with that of the
reference engine. Times are of the processor, the shortest of several rounds.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt
from rich.console import Console
from rich.table import Table

from benchmarks.gradients_of.ode import ode_misfit
from benchmarks.gradients_of.scan import scan_misfit
from bwbn_bayes import Record, Settings, el_centro, identify, simulate, to_pymc
from bwbn_bayes.engines.base import NormalEquations
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.sunode import Sunode
from bwbn_bayes.inference.least_squares import normal_equations
from bwbn_bayes.inference.likelihood import default_noise
from bwbn_bayes.inference.pymc.model import observations
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.structure import Structure

_SUBSTEPS = (1, 2, 4, 8)
_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
_ROUNDS, _LEAST_S, _LONG_S = 7, 0.1, 10.0


def timed(function: Callable[[], object]) -> float:
    """Processor time of a call, the shortest of several rounds. [ms]."""
    function()
    calls, best = 1, np.inf
    for _ in range(_ROUNDS):
        while True:
            began = time.process_time()
            for _ in range(calls):
                function()
            spent = time.process_time() - began
            if spent >= _LEAST_S:
                break
            calls *= 2
        best = min(best, spent / calls)
        if spent > _LONG_S:  # another round would tell little
            break
    return 1e3 * best


def gradient_of(misfit: Floats, slopes: Floats, record: Record, scale: Floats) -> Floats:
    """Of the log likelihood ``(n_parameters,)``, from squared residuals ``(n_channels,)`` and their derivatives."""
    weight = -0.5 * (1.0 + 0.5 * record.n_times) / (scale + 0.5 * misfit)
    return np.asarray(weight @ slopes)


def reference_gradient(model: Structure, record: Record, values: Floats, scale: Floats) -> Floats:
    """The same by the reference engine."""
    response, slopes = Reference().sensitivities(model, values[None], record)
    rest = record.measured - response.values[0]
    return gradient_of(np.sum(rest**2, axis=1), -2.0 * np.einsum("ct,pct->cp", rest, slopes[0]), record, scale)


def by_engine(
    kind: type[Cvodes | Sunode],
    model: Structure,
    record: Record,
    values: Floats,
    judged: Callable[[NormalEquations], float],
    enough: float,
) -> dict[str, Any]:
    """The row of an engine of CVODES at its loosest tolerance with error enough, or what is missing."""
    if kind is Sunode and find_spec("sunode") is None:
        return {kind.name: "not installed"}

    def solved(tolerance: float) -> NormalEquations:
        engine = kind(rtol=tolerance, atol=1e-2 * tolerance)
        found = normal_equations(engine, model, values[None], record, None)
        assert isinstance(found, NormalEquations)
        return found

    for tolerance in _TOLERANCES:
        if judged(solved(tolerance)) <= enough:
            break
    row = {"ms": timed(lambda: solved(tolerance)), "error": judged(solved(tolerance))}
    return {f"{kind.name}, relative tolerance {tolerance:g}": row}


def compared(model: Structure, record: Record, values: Floats, *, ode: bool = False) -> dict[str, Any]:
    """Times and errors of all, of ``pm.ode`` where it is asked for, and the ratio to the scan at equal error."""
    twin = to_pymc(model, record)
    problem = next(iter(observations(twin).values())).problem
    scale = np.asarray(default_noise(record).scale)
    exact = reference_gradient(model, record, values, scale)

    def error(gradient: Floats) -> float:
        return float(np.linalg.norm(gradient - exact) / np.linalg.norm(exact))

    point = pt.vector("values", shape=(model.space.n_dim,))
    whole = problem.squared_residuals_and_slopes(values[None], problem.measured)[0]
    own_error = error(gradient_of(whole[:, 0], whole[:, 1:], record, scale))
    # Model and all: priors and transforms of the variables are part of what a sampler calls.
    own = twin.logp_dlogp_function(ravel_inputs=True)
    own.set_extra_values({})
    start = np.concatenate([np.ravel(value) for value in twin.initial_point().values()])
    rows: dict[str, Any] = {"to_pymc": {"ms": timed(lambda: own(start)), "error": own_error}}

    def judged(found: NormalEquations) -> float:
        return error(gradient_of(found.misfit[0], -2.0 * found.gradient[0], record, scale))

    def by_graph(misfit: pt.TensorVariable) -> dict[str, float]:
        value = -pt.sum((1.0 + 0.5 * record.n_times) * pt.log1p(0.5 * misfit / scale))
        both = pytensor.function([point], [value, pt.grad(value, point)])
        both.trust_input = True
        return {"ms": timed(lambda: both(values)), "error": error(both(values)[1])}

    for substeps in _SUBSTEPS:
        found = rows[f"scan, {substeps} steps"] = by_graph(scan_misfit(model, record, point, substeps))
        if found["error"] <= own_error:
            break
    if ode:
        rows["pm.ode, odeint's own tolerances"] = by_graph(ode_misfit(model, record, point))
    for kind in (Cvodes, Sunode):
        rows |= by_engine(kind, model, record, values, judged, own_error)
    return {"scheme": problem.engine.scheme, "rows": rows, "ratio": rows["to_pymc"]["ms"] / found["ms"]}


def parsed(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/sdof.py"))
    parser.add_argument("--duration", type=float, default=10.0, help="of the record [s]")
    parser.add_argument("--nuts", type=int, metavar="DRAWS", help="sample by NUTS in the place of timing gradients")
    parser.add_argument("--ode", action="store_true", help="pm.ode, too: minutes for a second of record")
    parser.add_argument("--json", type=Path)
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print a table, write JSON."""
    options = parsed(arguments)
    file, console = load_model_file(options.model), Console()
    model = file.model
    motion = (file.excitation or el_centro("chopra")).until(options.duration)
    middle = dict(zip(model.space.names, model.space.from_unit(np.full((1, model.space.n_dim), 0.4))[0], strict=True))
    record = simulate(model, motion, dict(file.truth) or middle, snr_db=30.0, seed=1)
    facts: dict[str, Any] = {"model": file.name, "samples": record.n_times, "processor": processor_name()}
    if options.nuts:
        began = time.process_time()
        result = identify(model, record, settings=Settings(method="nuts", particles=options.nuts, alternatives=False))
        facts |= {"effective": result.facts.effective_sample_size, "s": time.process_time() - began}
        console.print(f"NUTS: {facts['effective']:.0f} effective draws in {facts['s']:.1f} s of processor time")
    else:
        values = np.array([record.truth[name] for name in model.space.names])
        values = model.space.from_unit(0.9 * model.space.to_unit(values[None]) + 0.05)[0]
        facts |= compared(model, record, values, ode=options.ode)
        table = Table("what", "ms", "relative error of the gradient", title=f"{file.name}, {record.n_times} samples")
        for name, row in facts["rows"].items():
            told = (row, "") if isinstance(row, str) else (f"{row['ms']:.2f}", f"{row['error']:.1e}")
            table.add_row(name, *told)
        console.print(table)
        console.print(f"to_pymc takes {facts['ratio']:.2f} of the scan's time at equal error ({facts['scheme']}).")
    if options.json is not None:
        options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
