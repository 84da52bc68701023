"""A floor's accelerometer is offset."""

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
class SensorBias(Effect):
    """The accelerometer of a floor shows ``bias`` too much, all the time.

    Parameters
    ----------
    bias : float, Prior or PerStorey
        Added to what it shows. [m/s^2]
    """

    bias: Value

    name: ClassVar[str] = "sensor_bias"
    title: ClassVar[str] = "sensor offset"
    level: ClassVar[str] = "observation"
    summary: ClassVar[str] = "an accelerometer with an offset"
    source: ClassVar[str] = "zero error of a sensor"
    residual: ClassVar[str] = "constant"
    confusable: ClassVar[str] = "asymmetry in force and drift records, hardly in accelerations"
    signature: ClassVar[Signature] = Signature(
        measure="offset over the channel's root mean square",
        plain_name="a small correction of the channel's zero",
        reason="half a per cent of the channel's root mean square: less disappears when a record's mean is taken off",
        size=lambda at: at["bias"] / at.scales.acceleration,
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="bias", unit="m/s^2", neutral=0.0, description="added to the acceleration", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, sensor_bias=slots.sensor_bias + symbol("bias"))


@guides(SensorBias)
class SensorBiasSearch(SearchGuide[SensorBias]):
    """How a search looks for an offset of a sensor."""

    @override
    def priors(self, scales: Scales) -> tuple[SensorBias, ...]:
        return (SensorBias(bias=Normal(0.0, 0.2 * scales.acceleration)),)

    @override
    def starts(self, effect: SensorBias, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"bias": (-0.05 * scales.acceleration, 0.05 * scales.acceleration)}
