"""A loss that grows with work, with the path, or with excursions: without end, up to a limit, or freely.

What degradation of stiffness and of strength share; each adds the loss to a factor of its own, ``eta`` or ``nu``.

References
----------
.. [1] T. T. Baber and Y.-K. Wen, "Random Vibration of Hysteretic, Degrading Systems", J. Eng. Mech. Div. 107(6), 1981:
   the linear loss ``delta epsilon``.
.. [2] G. C. Foliente, "Hysteresis Modeling of Wood Joints and Structural Systems", J. Struct. Eng. 121(6), 1995: the
   depth of the pinch, ``zeta_s (1 - exp(-p epsilon))``. The saturating loss is this function of the work, given here
   to ``nu`` and ``eta``, for which Foliente keeps the linear one.
.. [3] M. Pelliciari et al., "A degrading Bouc-Wen model for the hysteresis of reinforced concrete structural elements",
   Struct. Infrastruct. Eng., 2019, doi:10.1080/15732479.2019.1674893: stiffness and strength that fall exponentially
   with a damage index, in another form than ours (known from the manual of its OpenSees material, not consulted).
.. [4] W. Weibull, "A Statistical Distribution Function of Wide Applicability", J. Appl. Mech. 18, 1951: the stretched
   exponential ``1 - exp(-(x/x_0)^m)`` (cited from memory, not consulted); that wear follows it is our use.
.. [5] M.-L. Wang and S. P. Shah, "Reinforced Concrete Hysteresis Model Based on the Damage Concept", Earthquake Eng.
   Struct. Dyn. 15(8), 1987: damage by the displacement that has been gone through (cited from memory, not consulted);
   that it is lost in proportion is our use.
.. [6] H. Krawinkler and M. Zohrei, "Cumulative Damage in Steel Structures Subjected to Earthquake Ground Motions",
   Computers & Structures 16(1-4), 1983: damage as a sum over excursions of a power of their size, after Coffin, Manson
   and Miner (cited from memory, not consulted); what is lost by it, and that it grows along each excursion, is our use.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, ENERGY, PATH, AddedState, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import PlaceResponse
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal, Parameter, Value

DEGRADATION = "a loss of strength or stiffness"
"""What both are; loops that lose the one look much like loops that lose the other."""
LINEAR_SOURCE = "Baber and Wen 1981"
SATURATING_SOURCE = "Foliente 1995 (the work's function in the depth of the pinch)"
STRETCHED_SOURCE = "Weibull 1951 (the stretched exponential)"
PATH_SOURCE = "Wang and Shah 1987 (damage by the displacement gone through)"
FATIGUE_SOURCE = "Krawinkler and Zohrei 1983 (damage by a power of each excursion)"


@dataclass(frozen=True, kw_only=True)
class Driver:
    """What a loss grows with.

    Attributes
    ----------
    name, unit : str
        In words, and its unit.
    state : Symbol
        The state that it is.
    form : str
        What the form of a loss that grows with it is called, after its shape.
    source : str
        Of the loss in proportion to it.
    by_the_end : callable
        How far it has come by the end of a response.
    of_scales : callable
        The same under the model as given.
    """

    name: str
    unit: str
    state: sp.Symbol
    form: str
    source: str
    by_the_end: Callable[[PlaceResponse], float]
    of_scales: Callable[[Scales], float]


WORK = Driver(
    name="work",
    unit="J",
    state=ENERGY,
    form="",
    source=LINEAR_SOURCE,
    by_the_end=attrgetter("energy"),
    of_scales=attrgetter("energy"),
)
DRIFT_PATH = Driver(
    name="path",
    unit="m",
    state=PATH,
    form=", with the path",
    source=PATH_SOURCE,
    by_the_end=attrgetter("path"),
    of_scales=attrgetter("path"),
)
"""With every cycle, whether the spring yields in it or not."""


@dataclass(frozen=True, kw_only=True)
class LinearLoss:
    """``delta x``, where x is the work or the path.

    Attributes
    ----------
    what : str
        What is lost.
    delta : str
        Symbol of the loss per unit of work [1/J] or path [1/m].
    driver : Driver
        What it grows with.
    """

    what: str
    delta: str
    driver: Driver = WORK
    states: ClassVar[tuple[AddedState, ...]] = ()

    @property
    def form(self) -> str:
        """The form's name."""
        return f"linear{self.driver.form}"

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The loss per unit of work or path."""
        source = self.driver.source
        told = f"loss of {self.what} per unit of {self.driver.name}"
        unit = f"1/{self.driver.unit}"
        return (Parameter(symbol=self.delta, unit=unit, neutral=0.0, lower=0.0, description=told, source=source),)

    @property
    def expression(self) -> sp.Expr:
        """What is added to the factor."""
        return symbol(self.delta) * self.driver.state

    def reached(self, at: PlaceResponse) -> float:
        """The loss by the end of a response."""
        return at[self.delta] * self.driver.by_the_end(at)


@dataclass(frozen=True, kw_only=True)
class SaturatingLoss:
    """``limit (1 - exp(-rate x))``, where x is the work or the path.

    Attributes
    ----------
    what : str
        What is lost.
    limit, rate : str
        Symbols of the loss in the long run [1], and of the rate at which it comes [1/J] or [1/m].
    driver : Driver
        What it grows with.
    """

    what: str
    limit: str
    rate: str
    driver: Driver = WORK
    states: ClassVar[tuple[AddedState, ...]] = ()

    @property
    def form(self) -> str:
        """The form's name."""
        return f"saturating{self.driver.form}"

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The limit and the rate."""
        name = self.driver.name
        told = (
            (self.limit, "", 0.0, f"loss of {self.what} after much {name}"),
            (self.rate, f"1/{self.driver.unit}", 1.0, f"rate with {name} at which the loss of {self.what} comes"),
        )
        return tuple(
            Parameter(symbol=s, unit=unit, neutral=neutral, lower=0.0, description=text, source=SATURATING_SOURCE)
            for s, unit, neutral, text in told
        )

    @property
    def expression(self) -> sp.Expr:
        """What is added to the factor."""
        return symbol(self.limit) * (1 - sp.exp(-symbol(self.rate) * self.driver.state))

    def reached(self, at: PlaceResponse) -> float:
        """The loss by the end of a response."""
        return at[self.limit] * -math.expm1(-at[self.rate] * self.driver.by_the_end(at))


_OFFSET = 1e-5
"""Added to ``x/X`` and taken off again after the power, whose slope at zero is infinite below one."""


def risen(share: Any, bend: Any, power: Any) -> Any:
    """``W(share) / W(1)`` with ``W(x) = 1 - exp(-bend x^power)``: how far wear has come, of numbers or symbols."""

    def worn(x: Any) -> Any:
        return 1 - sp.exp(-bend * _raised(x, power, _OFFSET))

    return worn(share) / worn(sp.S.One)


@dataclass(frozen=True, kw_only=True)
class StretchedLoss:
    """``loss W(x) / W(X)`` with ``W(x) = 1 - exp(-bend (x/X)^power)``, where x is the work or the path.

    With power one it is the saturating loss, of limit ``loss / W(X)`` and rate ``bend / X``; with a small bend a power
    of the work, the first of which is the linear loss. Measured at ``X``, the loss says the same whatever the shape.

    Attributes
    ----------
    what : str
        What is lost.
    loss, bend, power, at : str
        Symbols of the loss by X [1], of how far it has saturated by then, of the power, and of X, which is known [J] or
        [m].
    driver : Driver
        What it grows with.
    """

    what: str
    loss: str
    bend: str
    power: str
    at: str
    driver: Driver = WORK
    states: ClassVar[tuple[AddedState, ...]] = ()

    @property
    def form(self) -> str:
        """The form's name."""
        return f"free shape{self.driver.form}"

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The loss, its bend and power, and the work or path that it is measured at."""
        driver = self.driver
        told = (
            (self.loss, "", 0.0, 0.0, f"loss of {self.what} by a known {driver.name}"),
            (self.bend, "", 1.0, 1e-6, f"how far the loss of {self.what} has saturated by then"),
            (self.power, "", 1.0, 0.1, f"power of the {driver.name} in the loss of {self.what}"),
            (self.at, driver.unit, 1.0, 1e-12, f"{driver.name} at which the loss of {self.what} is measured, known"),
        )
        return tuple(
            Parameter(symbol=s, unit=unit, neutral=neutral, lower=lower, description=text, source=STRETCHED_SOURCE)
            for s, unit, neutral, lower, text in told
        )

    @property
    def expression(self) -> sp.Expr:
        """What is added to the factor."""
        loss, bend, power, at = (symbol(s) for s in (self.loss, self.bend, self.power, self.at))
        return loss * risen(sp.Abs(self.driver.state) / at, bend, power)

    def reached(self, at: PlaceResponse) -> float:
        """The loss by the end of a response."""
        share = abs(self.driver.by_the_end(at)) / at[self.at]
        return at[self.loss] * float(risen(share, at[self.bend], at[self.power]))


_TINY = 1e-24
"""The same of excursions, whose power may be small: where the largest alone count, each of them is many of half its
size."""


@dataclass(frozen=True, kw_only=True)
class FatigueLoss:
    """``loss (x/N)^(power/(exponent + 1))`` with excursions ``x``, each of which counts by a power of its size.

    ``dx/dt = (exponent + 1) |v|/reach (|u|/reach)^exponent``, so that one way from zero to the drift ``reach``, or
    back, counts as one, and one to half of it as ``2^-(exponent + 1)``: low-cycle fatigue. An exponent of zero counts
    the path; with a large one the largest drifts alone count, as if damage came of their first time. The loss by a
    first excursion grows with the ``power`` of its drift, by further ones of its size with less.

    Attributes
    ----------
    what : str
        What is lost.
    loss, power, exponent, at, reach : str
        Symbols of the loss by N excursions [1], of the powers of the drift in the loss by a first excursion and in what
        each of them counts for, of N, which is known [1], and of the drift that counts as one, which is known [m].
    state : Symbol
        The excursions.
    """

    what: str
    loss: str
    power: str
    exponent: str
    at: str
    reach: str
    state: sp.Symbol
    form: ClassVar[str] = "with the amplitude"

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The loss, its two powers, and the excursions and the drift that it is measured by."""
        what = self.what
        told = (
            (self.loss, "", 0.0, 0.0, f"loss of {what} by a known number of excursions"),
            (self.power, "", 1.0, 0.05, f"power of the drift in the loss of {what} by a first excursion"),
            (self.exponent, "", 1.0, 0.1, "power of the drift by which further excursions count, less one"),
            (self.at, "", 1.0, 1e-6, f"excursions at which the loss of {what} is measured, known"),
            (self.reach, "m", 1.0, 1e-12, "drift of an excursion that counts as one, known"),
        )
        return tuple(
            Parameter(symbol=s, unit=unit, neutral=neutral, lower=lower, description=text, source=FATIGUE_SOURCE)
            for s, unit, neutral, lower, text in told
        )

    @property
    def states(self) -> tuple[AddedState, ...]:
        """The excursions, as a state of the link."""
        exponent, reach = symbol(self.exponent), symbol(self.reach)
        share = (sp.Abs(DRIFT) / reach + _TINY) ** exponent
        return (AddedState(state=self.state, rate=(exponent + 1) * sp.Abs(DRIFT_RATE) / reach * share),)

    @property
    def expression(self) -> sp.Expr:
        """What is added to the factor."""
        share = sp.Abs(self.state) / symbol(self.at)
        return symbol(self.loss) * _grown(share, symbol(self.power), symbol(self.exponent))

    def reached(self, at: PlaceResponse) -> float:
        """The loss by the end of a response."""
        excursions = _excursions(at.histories["drift"], at[self.reach], at[self.exponent])
        return at[self.loss] * float(_grown(excursions / at[self.at], at[self.power], at[self.exponent]))


def _raised(share: Any, power: Any, offset: float) -> Any:
    """A share to a power, of numbers or symbols, with a slope at zero."""
    return (share + offset) ** power - offset**power


def _grown(excursions: Any, power: Any, exponent: Any) -> Any:
    """What such excursions over those at which a loss is measured have done of it, of numbers or symbols."""
    by_number = power / (exponent + 1)
    return _raised(excursions, by_number, _TINY) / (1 - _TINY**by_number)


def _excursions(drift: Floats, reach: float, exponent: float) -> float:
    """How many excursions to ``reach`` [m] a drift ``(n_times,)`` [m] has done the damage of, there and back alike."""
    done = np.sign(drift) * np.abs(drift / reach) ** (exponent + 1.0)
    return float(np.sum(np.abs(np.diff(done))))


Loss = LinearLoss | SaturatingLoss | StretchedLoss | FatigueLoss


def share_left(factor: float, *, power: float = 1.0) -> float:
    """What is left of a strength or stiffness that is divided by a factor to a power.

    A factor that fell to zero, of a loss that is negative, leaves it without bound.
    """
    return float(factor**-power) if factor > 0.0 else math.inf


_GROWN = 3.0
"""By how much the factor may have grown by the end, as the standard deviation of a prior: a quarter is then left."""

BEND, POWER = LogNormal(0.5, 2.0).truncated(1e-3, 100.0), LogNormal(1.0, 0.5).truncated(0.3, 3.0)
"""Priors of a free shape: any between an early step and a late one."""
_FATIGUE_POWER = LogNormal(1.5, 1.0).truncated(0.05, 6.0)
"""Of the drift, in the loss by a first excursion: damage goes with the drift itself, or comes early as cracks do, or
late as fracture."""
_FATIGUE_EXPONENT = LogNormal(2.0, 1.0).truncated(0.3, 12.0)
"""By which further excursions count: Krawinkler and Zohrei give 1.5 to 2 as the power of a whole one, this and one;
with a large one the largest drifts alone count."""


def loss_of(effect_name: str, losses: tuple[Loss, ...], given: Mapping[str, Value | None]) -> Loss:
    """The form whose parameters are given.

    Raises
    ------
    UserError
        If they are those of no form, or of more than one.
    """
    present = {s for s, value in given.items() if value is not None}
    for loss in losses:
        if present == {parameter.symbol for parameter in loss.parameters}:
            return loss
    choices = ", or ".join(" and ".join(p.symbol for p in loss.parameters) for loss in losses)
    raise UserError(f"{effect_name}: the form follows from what is given: give {choices}")


def priors_of(loss: Loss, scales: Scales) -> dict[str, Value]:
    """What a search gives the parameters of a loss, by symbol: by the end a quarter may be left, or less."""
    match loss:
        case FatigueLoss():
            return {
                loss.loss: HalfNormal(_GROWN),
                loss.power: _FATIGUE_POWER,
                loss.exponent: _FATIGUE_EXPONENT,
                loss.at: scales.path / scales.drift,
                loss.reach: scales.drift,
            }
        case LinearLoss():
            return {loss.delta: HalfNormal(_GROWN / loss.driver.of_scales(scales))}
        case SaturatingLoss():
            whole = loss.driver.of_scales(scales)
            # Most of it within a tenth to all of the work. With slower rates the loss is the linear one; with faster
            # ones it is there before the first cycle has ended, and the storey's own parameters say the same.
            rate = LogNormal(5.0 / whole, 1.0).truncated(0.5 / whole, 100.0 / whole)
            return {loss.limit: HalfNormal(_GROWN), loss.rate: rate}
        case StretchedLoss():
            return {
                loss.loss: HalfNormal(_GROWN),
                loss.bend: BEND,
                loss.power: POWER,
                loss.at: loss.driver.of_scales(scales),
            }


def starts_of(loss: Loss, scales: Scales) -> Mapping[str, tuple[float, ...]]:
    """Where fits of a loss start, by symbol: small, large, and all but all of it."""
    if isinstance(loss, FatigueLoss):  # with small drifts or with large ones, by all of them or by new ones
        return {loss.loss: (0.2, 2.0), loss.power: (0.7, 1.5, 4.0), loss.exponent: (1.0, 5.0)}
    whole = loss.driver.of_scales(scales)
    match loss:
        case LinearLoss():
            return {loss.delta: (0.1 / whole, 0.6 / whole, 3.0 / whole)}
        case SaturatingLoss():  # early and late
            return {loss.limit: (0.15, 0.8, 3.0), loss.rate: tuple(rate / whole for rate in (2.0, 8.0, 30.0))}
        case StretchedLoss():  # on to the end and ended early, slower and faster at first
            return {loss.loss: (0.2, 2.0), loss.bend: (0.05, 5.0), loss.power: (0.6, 1.0, 1.7)}
