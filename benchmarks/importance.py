"""Identify many truths by importance sampling: modes found, calibration, cost.

``python -m benchmarks.importance --model models/three_storey_el_centro.py --cases 20 --seed 1 --json FILE``

With ``--checkpoint FILE`` each finished case is a line of that file, and a run that was cut off goes on.

Each case draws a truth from the middle of the prior (the central 60 % of every parameter), records it with the
reference engine and identifies it blind. A case counts as found when the posterior mean is about as likely as the
truth; a miss is silent when every residual check passed all the same.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.running import filed_lines
from bwbn_bayes import Settings, identify, simulate
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.structures.model_file import ModelFile, load_model_file

FINE = Lanes(substeps=8, resolution=0.03)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One truth identified blind."""

    case: int
    method: str
    found: bool
    silent_miss: bool
    z: dict[str, float]
    pareto_k: float
    effective: float
    n_solves: int
    log_evidence: float
    log_evidence_se: float
    joint_shift_sd: float
    elapsed_s: float


def run_case(file: ModelFile, seed: int, case: int, snr_db: float) -> Case:
    """Draw a truth, record it, identify it.

    Parameters
    ----------
    file : ModelFile
        With an excitation.
    seed, case : int
        Choose truth and noise.
    snr_db : float
        Signal-to-noise ratio. [dB]
    """
    assert file.excitation is not None
    space = file.model.space
    rng = np.random.default_rng([seed, case])
    point = 0.2 + 0.6 * space.sample_unit(rng, 1)
    truth = dict(zip(space.names, space.from_unit(point)[0].tolist(), strict=True))
    record = simulate(file.model, file.excitation, truth, snr_db=snr_db, seed=int(rng.integers(2**31)))
    facts = identify(file.model, record, settings=Settings(seed=seed), name=file.name).facts
    judge = Posterior(model=file.model, record=record, engine=FINE, noise=default_noise(record))
    mean = np.array([[p.mean for p in facts.parameters]])
    at_truth, at_mean = judge.log_likelihood(np.concatenate([point, space.to_unit(mean)]))
    # The posterior mean lies about d/2 nats below the mode, the truth d/2 as well: a wrong mode lies thousands below.
    found = bool(at_mean > at_truth - 5.0 * space.n_dim)
    checks = {check.name: check for check in facts.checks}
    noise_like = all(check.passed for name, check in checks.items() if name.startswith("residual"))
    return Case(
        case=case,
        method=facts.method,
        found=found,
        silent_miss=not found and noise_like,
        z={p.name: z for p in facts.parameters if (z := p.z_score) is not None},
        pareto_k=checks["Pareto k"].value,
        effective=facts.effective_sample_size,
        n_solves=facts.n_solves,
        log_evidence=facts.log_evidence,
        log_evidence_se=facts.log_evidence_se,
        joint_shift_sd=float(facts.discretisation["joint_shift_sd"]),
        elapsed_s=facts.elapsed_s,
    )


def finished(path: Path | None) -> dict[str, Case]:
    """Cases kept in a file, by key; a line that a kill cut short is none."""
    entries = filed_lines(path) if path is not None else ()
    return {entry["key"]: Case(**entry["case"]) for entry in entries}


def keep(path: Path | None, key: str, case: Case) -> None:
    """Append a case that is not kept yet, on a line of its own."""
    if path is None or key in finished(path):
        return
    with path.open("a", encoding="utf-8") as file:
        whole = file.tell() == 0 or path.read_bytes().endswith(b"\n")
        file.write(("" if whole else "\n") + json.dumps({"key": key, "case": asdict(case)}) + "\n")


def main() -> None:
    """Run the cases, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/three_storey_el_centro.py"))
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--snr", type=float, default=30.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--checkpoint", type=Path, help="where finished cases are kept")
    options = parser.parse_args()
    file = load_model_file(options.model)
    console = Console()
    cases = []
    for number in range(options.cases):
        key = f"{file.name}, seed {options.seed}, {options.snr:g} dB, case {number}"
        case = finished(options.checkpoint).get(key) or run_case(file, options.seed, number, options.snr)
        keep(options.checkpoint, key, case)
        cases.append(case)
        rms = np.sqrt(np.mean(np.square(list(case.z.values()))))
        console.print(
            f"case {number}: {case.method}, {'found' if case.found else 'MISSED'}, k {case.pareto_k:.2f}, "
            f"{case.effective:.0f} effective of {case.n_solves} solves, log evidence +- {case.log_evidence_se:.3f}, "
            f"z rms {rms:.2f}, {case.elapsed_s:.1f} s",
            highlight=False,
        )
    z = np.array([list(case.z.values()) for case in cases])
    summary = {
        "found": sum(case.found for case in cases),
        "silent_misses": sum(case.silent_miss for case in cases),
        "fell_back": sum(case.method != "importance" for case in cases),
        "z_rms": float(np.sqrt(np.mean(np.square(z)))),
        "median_effective": float(np.median([case.effective for case in cases])),
        "worst_log_evidence_se": max(case.log_evidence_se for case in cases),
        "median_s": float(np.median([case.elapsed_s for case in cases])),
        "worst_s": max(case.elapsed_s for case in cases),
        "processor": processor_name(),
    }
    table = Table("figure", "value", title=f"{file.name}, {options.cases} truths, {options.snr:g} dB")
    for name, value in summary.items():
        table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    console.print(table)
    if options.json is not None:
        options.json.write_text(json.dumps({"summary": summary, "cases": [asdict(c) for c in cases]}, indent=1) + "\n")


if __name__ == "__main__":
    main()
