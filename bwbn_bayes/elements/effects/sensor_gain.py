"""A floor's accelerometer has a wrong gain."""

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
class SensorGain(Effect):
    """The accelerometer of a floor shows ``gain`` times what it should.

    Parameters
    ----------
    gain : float, Prior or PerStorey
        Shown over true acceleration.
    """

    gain: Value

    name: ClassVar[str] = "sensor_gain"
    title: ClassVar[str] = "wrong sensor gain"
    level: ClassVar[str] = "observation"
    summary: ClassVar[str] = "an accelerometer with a wrong gain"
    source: ClassVar[str] = "calibration error of a sensor"
    residual: ClassVar[str] = "proportional to that channel"
    confusable: ClassVar[str] = "mass_error; all gains together: input_scale"
    signature: ClassVar[Signature] = Signature(
        measure="error of the sensor's gain",
        plain_name="a small correction of the channel's size",
        reason="half a per cent: what calibrations of accelerometers promise",
        size=lambda at: at["gain"] - 1.0,
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="gain", unit="", neutral=1.0, description="shown over true acceleration", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, sensor_gain=slots.sensor_gain * symbol("gain"))


@guides(SensorGain)
class SensorGainSearch(SearchGuide[SensorGain]):
    """How a search looks for a wrong gain of a sensor."""

    @override
    def priors(self, scales: Scales) -> tuple[SensorGain, ...]:
        return (SensorGain(gain=Normal(1.0, 0.2)),)

    @override
    def starts(self, effect: SensorGain, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"gain": (0.9, 1.1)}
