"""What log probability and gradient of one point cost: ``to_pymc`` beside a scan in PyTensor, at equal error.

``python -m benchmarks.gradients --model models/sdof.py --duration 10 --json FILE``
``python -m benchmarks.gradients --model models/plain_three_storey.py --duration 10``
``python -m benchmarks.gradients --model models/sdof.py --duration 10 --nuts 500``

The scan is what a PyMC user would write: classical Runge-Kutta steps of the equation of motion, differentiated by
PyTensor, compiled by its default linker. Both gradients are compared with that of the reference engine. The scan takes
as many steps between samples as bring its error down to that of the scheme that ``to_pymc`` chooses. Times are of the
processor, the shortest of several rounds. sunode and ``pm.ode`` are not measured.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt
from rich.console import Console
from rich.table import Table

from bwbn_bayes import Record, Settings, el_centro, identify, simulate, to_pymc
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.likelihood import default_noise
from bwbn_bayes.inference.pymc.model import observations
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.structure import Structure

_SUBSTEPS = (1, 2, 4, 8)
_ROUNDS, _LEAST_S = 7, 0.1
_TINY = 1e-12
"""Keeps powers of z differentiable where it is zero."""
_LAW = ("k", "c", "alpha", "beta", "gamma", "n", "delta_nu", "delta_eta")


def scan_misfit(model: Structure, record: Record, values: pt.TensorVariable, substeps: int) -> pt.TensorVariable:
    """Squared residuals ``(n_channels,)`` of a chain under a ground motion, by a scan over samples."""
    table, masses = model.table, np.array(model.masses)
    symbols = [parameter.symbol for parameter in model.parameters]
    law = {}
    for name in _LAW:
        if name not in symbols:
            law[name] = pt.zeros(len(masses))
            continue
        column = symbols.index(name)
        own = [
            values[index] if index >= 0 else pt.constant(fixed)
            for index, fixed in zip(table.index[:, column], table.fixed[:, column], strict=True)
        ]
        law[name] = pt.stack(own)
    k, c, alpha, beta, gamma, n, delta_nu, delta_eta = (law[name] for name in _LAW)
    elastic, hysteretic = alpha * k, (1.0 - alpha) * k

    def total(u: Any, v: Any, z: Any) -> Any:
        force = c * v + elastic * u + hysteretic * z
        return (pt.concatenate([force[1:], pt.zeros(1)]) - force) / masses

    def rates(state: Any, ground: Any) -> Any:
        u, v, z, epsilon = state[0], state[1], state[2], state[3]
        floors = total(u, v, z)
        size = pt.abs(z) + _TINY
        dissipated = beta * pt.abs(v) * size ** (n - 1.0) * z + gamma * v * size**n
        rate = (v - (1.0 + delta_nu * epsilon) * dissipated) / (1.0 + delta_eta * epsilon)
        return pt.stack([v, floors - pt.concatenate([ground[None], floors[:-1]]), rate, hysteretic * z * v])

    h = record.time_step / substeps

    def between(now: Any, rise: Any, state: Any) -> Any:
        for step in range(substeps):
            begin, middle, end = (now + rise * (step + share) / substeps for share in (0.0, 0.5, 1.0))
            k1 = rates(state, begin)
            k2 = rates(state + 0.5 * h * k1, middle)
            k3 = rates(state + 0.5 * h * k2, middle)
            k4 = rates(state + h * k3, end)
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return state, total(state[0], state[1], state[2])

    ground = record.excitation
    _, response = pytensor.scan(
        between,
        sequences=[pt.constant(ground[:-1]), pt.constant(np.diff(ground))],
        outputs_info=[pt.zeros((4, len(masses))), None],
        return_updates=False,
    )
    floors = [floor - 1 for floor in record.floors]
    first = np.sum(np.square(record.measured[:, 0]))  # at rest
    rest = pt.constant(record.measured[:, 1:].T) - response[:, floors]
    return pt.sum(pt.square(rest), axis=0) + first


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


def compared(model: Structure, record: Record, values: Floats) -> dict[str, Any]:
    """Times and errors of both, and the ratio at equal error."""
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
    for substeps in _SUBSTEPS:
        misfit = scan_misfit(model, record, point, substeps)
        value = -pt.sum((1.0 + 0.5 * record.n_times) * pt.log1p(0.5 * misfit / scale))
        both = pytensor.function([point], [value, pt.grad(value, point)])
        both.trust_input = True
        found = {"ms": timed(lambda both=both: both(values)), "error": error(both(values)[1])}  # type: ignore[misc]
        rows[f"scan, {substeps} steps"] = found
        if found["error"] <= own_error:
            break
    return {"scheme": problem.engine.scheme, "rows": rows, "ratio": rows["to_pymc"]["ms"] / found["ms"]}


def parsed(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/sdof.py"))
    parser.add_argument("--duration", type=float, default=10.0, help="of the record [s]")
    parser.add_argument("--nuts", type=int, metavar="DRAWS", help="sample by NUTS in the place of timing gradients")
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
        facts |= compared(model, record, values)
        table = Table("what", "ms", "relative error of the gradient", title=f"{file.name}, {record.n_times} samples")
        for name, row in facts["rows"].items():
            table.add_row(name, f"{row['ms']:.2f}", f"{row['error']:.1e}")
        console.print(table)
        console.print(f"to_pymc takes {facts['ratio']:.2f} of the scan's time at equal error ({facts['scheme']}).")
    if options.json is not None:
        options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
