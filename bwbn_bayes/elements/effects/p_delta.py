"""P-Delta: the weight above a storey pushes it on as it drifts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import DRIFT, Effect, Slots, symbol
from bwbn_bayes.parameters import Parameter, Value


@dataclass(frozen=True, kw_only=True)
class PDelta(Effect):
    """The force ``-k_geo u``, ``k_geo = P / h`` for the weight P of all floors above and the height h of the storey.

    It takes no part in discovery: a Bouc-Wen storey with ``alpha k - k_geo`` in the place of ``alpha k`` answers in the
    same way, and so does a linear one with ``k - k_geo``. No record tells it from them; weight and height do.

    Parameters
    ----------
    k_geo : float, Prior or PerStorey
        Geometric stiffness, mostly known. [N/m]

    References
    ----------
    .. [1] A. K. Chopra, "Dynamics of Structures", 4th ed., 2012, section 22.2.2.
    """

    k_geo: Value

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen", "linear")
    name: ClassVar[str] = "p_delta"
    title: ClassVar[str] = "P-Delta"
    summary: ClassVar[str] = "the weight above pushes a storey on as it drifts"
    source: ClassVar[str] = "Chopra 2012"
    residual: ClassVar[str] = "a stiffness that is too large, most of all after yield"
    confusable: ClassVar[str] = "k and alpha of the storey, exactly: discover leaves it out"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="k_geo", unit="N/m", neutral=0.0, lower=0.0, description="weight above over height", source=source
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force - symbol("k_geo") * DRIFT)
