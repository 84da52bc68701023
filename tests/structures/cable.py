"""An element of a user's own, by the Protocol alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes import Linear
from bwbn_bayes.elements.law import DRIFT, Addition, Slots, symbol
from bwbn_bayes.parameters import Parameter, Value

TENSION = Parameter(symbol="k_t", unit="N/m", neutral=0.0, description="stiffness where it pulls", source="test")


@dataclass(frozen=True)
class _Pulls:
    """``F + k_t max(u, 0)``."""

    parameters: ClassVar[tuple[Parameter, ...]] = (TENSION,)

    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("k_t") * (DRIFT + sp.Abs(DRIFT)) / 2)


@dataclass(frozen=True, kw_only=True)
class Cable(Linear):
    """A spring and a dashpot with a cable beside them that only pulls."""

    k_t: Value

    adds: ClassVar[tuple[Addition, ...]] = (_Pulls(),)
    parameters: ClassVar[tuple[Parameter, ...]] = (*Linear.parameters, TENSION)

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return {**super().values, "k_t": self.k_t}
