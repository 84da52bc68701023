"""The ground moved more, or less, than the record says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Normal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class InputScale(Effect):
    """The ground acceleration is ``s_g`` times the recorded one; floors feel, and their sensors show, the true one.

    Parameters
    ----------
    s_g : float or Prior
        True over recorded ground acceleration.
    """

    s_g: Value

    name: ClassVar[str] = "input_scale"
    title: ClassVar[str] = "wrong scale of the excitation"
    level: ClassVar[str] = "excitation"
    summary: ClassVar[str] = "the recorded excitation has a wrong scale"
    source: ClassVar[str] = "a gain error of the ground's sensor"
    residual: ClassVar[str] = "proportional to the input everywhere"
    confusable: ClassVar[str] = "one sensor_gain shared by all floors, until something yields"
    signature: ClassVar[Signature] = Signature(
        measure="error of the excitation's scale",
        plain_name="a small correction of the excitation's size",
        reason="half a per cent: what calibrations of accelerometers promise",
        size=lambda at: at["s_g"] - 1.0,
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="s_g", unit="", neutral=1.0, lower=0.0, description="true over recorded excitation", source=source
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, ground_factor=slots.ground_factor * symbol("s_g"))


@guides(InputScale)
class InputScaleSearch(SearchGuide[InputScale]):
    """How a search looks for a wrong scale of the excitation."""

    @override
    def priors(self, scales: Scales) -> tuple[InputScale, ...]:
        return (InputScale(s_g=Normal(1.0, 0.3)),)

    @override
    def starts(self, effect: InputScale, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"s_g": (0.85, 1.15)}
