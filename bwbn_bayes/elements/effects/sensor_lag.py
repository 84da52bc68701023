"""A floor's accelerometer is late."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

from bwbn_bayes.elements.law import Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class SensorLag(Effect):
    """The accelerometer of a floor shows at time t what happened at ``t - lag``.

    Parameters
    ----------
    lag : float, Prior or PerStorey
        How late it is. [s]
    """

    lag: Value

    name: ClassVar[str] = "sensor_lag"
    level: ClassVar[str] = "observation"
    summary: ClassVar[str] = "an accelerometer that is late"
    source: ClassVar[str] = "clock error of a sensor"
    residual: ClassVar[str] = "proportional to the rate of that channel"
    confusable: ClassVar[str] = "damping"
    signature: ClassVar[Signature] = Signature(
        measure="lag of the sensor",
        unit="s",
        plain_name="a small correction of the channel's phase",
        reason="half a millisecond: a degree of phase at 5 Hz, which the sensor's own dynamics may turn",
        size=lambda at: at["lag"],
        least=0.0005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="lag", unit="s", neutral=0.0, lower=0.0, description="how late it is", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, sensor_lag=slots.sensor_lag + symbol("lag"))


@guides(SensorLag)
class SensorLagSearch(SearchGuide[SensorLag]):
    """How a search looks for a sensor that lags."""

    @override
    def priors(self, scales: Scales) -> tuple[SensorLag, ...]:
        return (SensorLag(lag=HalfNormal(0.05)),)

    @override
    def starts(self, effect: SensorLag, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"lag": (0.005, 0.02, 0.05)}
