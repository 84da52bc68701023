"""An analysis of OpenSees, as oracles of structures set one up."""

from __future__ import annotations

from typing import Any


def analysis(ops: Any, kind: str, *integrator: object) -> None:
    """Begin one of a kind, ``"Static"`` or ``"Transient"``, in the place of what was there, for the module ``ops``."""
    ops.wipeAnalysis()
    ops.system("FullGeneral")
    ops.numberer("Plain")
    ops.constraints("Plain")
    ops.test("NormDispIncr", 1e-12, 50)
    ops.algorithm("Newton")
    ops.integrator(*integrator)
    ops.analysis(kind)
