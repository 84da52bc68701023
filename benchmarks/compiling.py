"""Processor time from a law to its kernel: generating its code, compiling it, and reading both from the cache.

``python -m benchmarks.compiling [--json FILE]``

The laws of a storey that degrades and pinches, and of all effects of the catalogue together, at a building and at a
specimen, the largest that `discover` compiles. Each in an empty cache that goes with the process.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bwbn_bayes import BoucWen, ShearBuilding, SlipLock, Specimen, StiffnessDegradation, StrengthDegradation
from bwbn_bayes.discovery.candidates import hypotheses, sharing_laws
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.engines import scalar
from bwbn_bayes.engines.kernel import Kernel
from bwbn_bayes.engines.lane_source import lane_source
from bwbn_bayes.engines.reference import WANTED
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.structures.structure import Structure

STOREY = BoucWen(k=10.0, c=0.1, alpha=0.1, beta=1.0, gamma=1.0, n=1.5)


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """Seconds of processor for one law of so many parameters.

    ``reference_s`` is for what the reference engine calls, ``read_s`` for lane kernels that the cache has.
    """

    law: str
    n_parameters: int
    generate_s: float
    values_s: float
    derivatives_s: float
    reference_s: float
    read_s: float


def with_all_effects(model: Structure) -> Structure:
    """The model that carries the whole catalogue."""
    channels = ("force_1",) if model.is_driven else ("acceleration_1",)
    sizes = (NOMINAL,) * model.n_links
    asked = hypotheses(model, sizes, measured=channels, has_time=True, effects=DiscoverySettings().effects)
    return max((one.model for one in sharing_laws(asked, float("inf"))), key=lambda found: len(found.law.parameters))


def laws() -> Mapping[str, tuple[StoreyLaw, bool]]:
    """What is compiled, and whether its displacement is given."""
    building = ShearBuilding(masses=[1.0], storey=STOREY)
    pinched = building.with_effect(StrengthDegradation(delta_nu=0.1)).with_effect(StiffnessDegradation(delta_eta=0.1))
    return {
        "degrading, pinching storey": (pinched.with_effect(SlipLock(delta_s=0.1, sigma=0.1)).law, False),
        "building, all effects": (with_all_effects(building).law, False),
        "specimen, all effects": (with_all_effects(Specimen(storey=STOREY)).law, True),
    }


def taken(action: Callable[[], object]) -> float:
    """Processor time. [s]."""
    began = time.process_time()
    action()
    return time.process_time() - began


def measure(name: str, law: StoreyLaw, *, driven: bool) -> Compiled:
    """One law, from its symbols on."""
    generate = taken(lambda: scalar.programs_of(law))
    source = lane_source(*scalar.programs_of(law), driven=driven)
    values, derivatives = (taken(lambda entry=entry: Kernel("bench", source).functions(entry)) for entry in ENTRIES)  # type: ignore[misc]
    read = taken(lambda: [Kernel("bench", source).functions(entry) for entry in ENTRIES])
    return Compiled(
        law=name,
        n_parameters=len(law.parameters),
        generate_s=generate,
        values_s=values,
        derivatives_s=derivatives,
        reference_s=taken(lambda: scalar.scalar_kernel(law, driven, WANTED)),
        read_s=read,
    )


ENTRIES = ("run", "run_with_tangents")


def main() -> None:
    """Measure every law, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["BWBN_CACHE_DIR"] = folder
        rows = [measure(name, law, driven=driven) for name, (law, driven) in laws().items()]
    table = Table("law", "parameters", "generate [s]", "values [s]", "derivatives [s]", "reference [s]", "read [s]")
    for row in rows:
        times = (row.generate_s, row.values_s, row.derivatives_s, row.reference_s, row.read_s)
        table.add_row(row.law, str(row.n_parameters), *(f"{one:.2f}" for one in times))
    Console(width=110).print(table)
    if options.json is not None:
        facts = {"processor": processor_name(), "laws": [asdict(row) for row in rows]}
        options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
