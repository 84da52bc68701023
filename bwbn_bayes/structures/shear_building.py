"""The base-excited shear building; one storey makes a single-degree-of-freedom oscillator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, override

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class ShearBuilding(Structure):
    """Floors that move sideways only: ``m_i (x_i'' + a_g) = -F_i + F_{i+1}``, x relative to the ground.

    It starts at rest; ``a_g`` is linear between samples. Floor i measures the total acceleration ``x_i'' + a_g``.

    Parameters
    ----------
    masses : sequence of float
        Floor masses from the ground up, one per storey. [kg]
    storey : BoucWen
        The element of every storey.
    effects : tuple of PlacedEffect
        Use :meth:`with_effect` rather than this field.

    Raises
    ------
    UserError
        If a mass is not positive, or a value lies outside its admissible range.
    """

    masses: Sequence[float]

    excitation_kind: ClassVar[str] = "ground_acceleration"

    def __post_init__(self) -> None:
        try:
            masses = tuple(float(mass) for mass in self.masses)
        except (TypeError, ValueError):
            masses = ()
        if not masses or not all(np.isfinite(m) and m > 0.0 for m in masses):
            raise UserError(f"masses = {self.masses!r}: give a list with one positive number of kg for each storey")
        object.__setattr__(self, "masses", masses)
        super().__post_init__()

    @property
    @override
    def n_storeys(self) -> int:
        return len(self.masses)
