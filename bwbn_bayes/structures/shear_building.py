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
    heights : sequence of float, optional
        Storey heights from the ground up; with them drifts are told as ratios too. [m]
    effects : tuple of PlacedEffect
        Use :meth:`with_effect` rather than this field.

    Raises
    ------
    UserError
        If a mass or a height is not positive, the heights are not one per storey, or a value lies outside its
        admissible range.
    """

    masses: Sequence[float]
    heights: Sequence[float] | None = None

    excitation_kind: ClassVar[str] = "ground_acceleration"

    def __post_init__(self) -> None:
        masses = _positive(self.masses)
        if not masses:
            raise UserError(f"masses = {self.masses!r}: give a list with one positive number of kg for each storey")
        object.__setattr__(self, "masses", masses)
        if self.heights is not None:
            heights = _positive(self.heights)
            if len(heights) != len(masses):
                raise UserError(
                    f"heights = {self.heights!r}: give a list with one positive number of m for each of the "
                    f"{len(masses)} storeys, or leave them out"
                )
            object.__setattr__(self, "heights", heights)
        super().__post_init__()

    @property
    @override
    def n_storeys(self) -> int:
        return len(self.masses)


def _positive(values: object) -> tuple[float, ...]:
    """The numbers of a list, none where one of them is no positive number."""
    try:
        numbers = tuple(float(value) for value in values)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        return ()
    return numbers if all(np.isfinite(one) and one > 0.0 for one in numbers) else ()
