"""A specimen in a testing machine: the displacement is given, the force is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, override

from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class Specimen(Structure):
    """One link driven by a displacement history that is straight between samples.

    Parameters
    ----------
    storey : BoucWen
        The element; its drift is the displacement.
    """

    excitation_kind: ClassVar[str] = "displacement"

    @property
    @override
    def n_storeys(self) -> int:
        return 1
