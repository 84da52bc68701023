"""The linear link: a spring and a dashpot side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import sympy as sp

from bwbn_bayes.elements.bouc_wen import BOUNDLESS, SPRING_AND_DASHPOT
from bwbn_bayes.elements.law import Addition, Definition, symbol
from bwbn_bayes.parameters import Parameter, Value

_KNOWN = {"alpha": 1, "A": 1, **BOUNDLESS, "n": 1}


@dataclass(frozen=True, kw_only=True)
class Linear:
    """The force ``F = k u + c v``: a Bouc-Wen link none of whose stiffness yields.

    Parameters
    ----------
    k : float, Prior or PerStorey
        Stiffness. [N/m]
    c : float, Prior or PerStorey
        Viscous damping coefficient. [N s/m]
    """

    k: Value
    c: Value = 0.0

    name: ClassVar[str] = "linear"
    constraints: ClassVar[tuple[sp.Basic, ...]] = ()
    adds: ClassVar[tuple[Addition, ...]] = ()
    parameters: ClassVar[tuple[Parameter, ...]] = SPRING_AND_DASHPOT
    derived: ClassVar[tuple[Definition, ...]] = tuple(
        Definition(caption="linear spring", subject=symbol(name), expression=sp.Integer(value))
        for name, value in _KNOWN.items()
    )

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {"k": self.k, "c": self.c}
