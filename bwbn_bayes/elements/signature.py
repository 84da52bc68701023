"""What an effect does to a loop or to a building in an engineer's measure, and from which size it deserves its name.

Evidence says that a law helps; it does not say that the loop is pinched. A law that helps without its signature is kept
and called by its plain name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.elements.loops import large_half_cycles
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import path_of


@dataclass(frozen=True, kw_only=True)
class PlaceResponse:
    """One response of a model, as it is at the place of an effect.

    Attributes
    ----------
    histories : mapping of str to array
        Observed kinds ``(n_times,)`` of the storey; of an effect of the whole building ``(n_storeys, n_times)``.
    parameters : mapping of str to float
        Every parameter of the law there, by symbol, the storey's own included.
    scales : Scales
        Sizes at the place.
    joints : tuple of (int, int), optional
        The nodes that each row of an effect of the whole building joins, the ground being 0; storeys one on another
        where left out.
    """

    histories: Mapping[str, Floats]
    parameters: Mapping[str, float]
    scales: Scales
    joints: tuple[tuple[int, int], ...] = ()

    def __getitem__(self, symbol: str) -> float:
        """A parameter by symbol."""
        return self.parameters[symbol]

    def peak(self, kind: str) -> float:
        """Largest magnitude of a history; at least 1e-12, as in the scales."""
        return max(float(np.max(np.abs(self.histories[kind]))), 1e-12)

    @property
    def base_shear(self) -> Floats:
        """Force ``(n_times,)`` [N] of all that stands on the ground, of an effect of the whole building."""
        force = self.histories["restoring_force"]
        on_ground = [row for row, (lower, _) in enumerate(self._joints(len(force))) if lower == 0]
        return np.asarray(np.sum(force[on_ground], axis=0))

    @property
    def bending_drifts(self) -> Floats:
        """Of each storey that others stand on, or that stands on one, the drifts that differ from its own, summed up.

        ``(n_storeys, n_times)``, of an effect of the whole building. [m]
        """
        drift = self.histories["drift"]
        result = np.zeros_like(drift)
        for row, (lower, upper) in enumerate(self._joints(len(drift))):
            if lower > 0 and upper == row + 1:  # links carry the nodes in order; a brace carries none
                apart = drift[row] - drift[lower - 1]
                result[row] += apart
                result[lower - 1] -= apart
        return result

    def _joints(self, n: int) -> tuple[tuple[int, int], ...]:
        return self.joints or tuple((row, row + 1) for row in range(n))

    @property
    def energy(self) -> float:
        """Work [J] on the hysteretic spring by the end."""
        return float(self.histories["hysteretic_energy"][-1])

    @property
    def largest_energy(self) -> float:
        """Most work [J] that was on the hysteretic spring: what grows with it comes back out with what was elastic."""
        return float(np.max(self.histories["hysteretic_energy"]))

    @property
    def path(self) -> float:
        """Drift [m] gone through by the end."""
        return float(path_of(self.histories["drift"])[-1])

    @property
    def loop(self) -> tuple[Floats, Floats]:
        """Drift [m] and storey force [N]."""
        return self.histories["drift"], self.histories["restoring_force"]

    @property
    def omega(self) -> float:
        """Angular frequency [1/s] of the first mode."""
        return 2.0 * np.pi / self.scales.period

    def damping_ratio(self, damping: float) -> float:
        """Share of critical damping that a storey's viscous coefficient [N s/m] is worth at the first mode.

        ``c omega / (2 k)``: that of the first mode, were all storeys damped alike.
        """
        return 0.5 * damping * self.omega / self.scales.stiffness

    def per_cycle(self, kept: float) -> float:
        """Share that each cycle loses where a share is kept in the end, every large cycle taken to lose as much."""
        n_cycles = max(0.5 * len(large_half_cycles(self.histories["drift"])), 1.0)
        return float(1.0 - max(kept, 0.0) ** (1.0 / n_cycles))


Measure = Callable[[PlaceResponse], float]


@dataclass(frozen=True, kw_only=True)
class Signature:
    """An engineer's measure of an effect.

    Attributes
    ----------
    measure, unit : str
        What is measured, in words, and in which unit. No words: the effect has no measure and is always nameable.
    plain_name : str
        What the law is called where it helps without this signature.
    reason : str
        From which size the effect's name is engineering language, and why, in one sentence.
    size : callable, optional
        What the name is judged by, of a response with the effect: zero at neutral values.
    least : float
        Magnitude of the size from which the name is given.
    of_loop : callable, optional
        The measure, of histories of drift [m] and force [N], identified or measured; the size itself where left out,
        which no record shows without a model.
    needs : str
        What a loop must have for that measure to be read off it, in words.
    readable : float
        Of that measure, what a reading of a test tells: an effect that changes a test's loop by less does not do there
        what its name says.
    is_genuine : callable, optional
        What else the response must show.
    is_shown : callable, optional
        What a measured loop, drift [m] and force [N], must show: where a test measures the loop itself, a name says
        what is in the record, not what a law makes of it.
    """

    measure: str = ""
    unit: str = ""
    plain_name: str = ""
    reason: str = ""
    size: Measure | None = None
    least: float = 0.0
    of_loop: Callable[[Floats, Floats], float] | None = None
    needs: str = ""
    readable: float = 0.0
    is_genuine: Callable[[PlaceResponse], bool] | None = None
    is_shown: Callable[[Floats, Floats], bool] | None = None

    def of_response(self, response: PlaceResponse) -> float:
        """The measure of a model's response, with the effect or without; NaN where it cannot be told."""
        if self.of_loop is not None:
            return self.of_loop(*response.loop)
        return np.nan if self.size is None else float(self.size(response))

    def of_measured(self, drift: Floats, force: Floats) -> float | None:
        """The measure of a record's drift [m] and storey force [N]; None where only a model has it, or none is told."""
        found = np.nan if self.of_loop is None else self.of_loop(drift, force)
        return float(found) if np.isfinite(found) else None

    def is_in_loop(self, drift: Floats, force: Floats) -> bool:
        """Whether a measured loop ``(n_times,)`` [m], [N], off which the measure can be read, shows the effect."""
        return self.is_shown is None or self.is_shown(drift, force)

    def is_engineering(self, response: PlaceResponse) -> bool:
        """Whether the effect has the size that its name stands for, in a response of the model that holds it."""
        if self.size is not None and abs(self.size(response)) < self.least:
            return False
        return self.is_genuine is None or self.is_genuine(response)


NO_SIGNATURE = Signature()
"""Of an effect that does not say what it does to the loop: always nameable."""
