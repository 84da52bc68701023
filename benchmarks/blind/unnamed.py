"""A smooth force that no law has: what a measured specimen shows beside every law, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.blind.path import Loop
from benchmarks.blind.simulator import Floats

N_WAVES = 80
LENGTHS = (0.35, 0.5, 0.3)
"""Over which it changes: of the largest displacement, of the largest z, of the whole path. Shorter than the features of
a law, longer than a step of the digitiser."""


@dataclass(frozen=True, kw_only=True)
class UnnamedForce:
    """A Gaussian random function of displacement, z and path, without what simple laws have in common with it.

    A constant, ``u`` and ``z`` to the third power, a dip at ``z = 0``, and how each of them grows with the path are
    taken out of it (least squares along the specimen's own loop): an offset, springs, an asymmetry, a pinch and wear
    would show as such.

    Attributes
    ----------
    waves : (3, N_WAVES) array
        Wave numbers in displacement, z and path, each over its scale.
    phases : (N_WAVES,) array
    scales : (3,) array
        Largest displacement, largest z, whole path. [m]
    shares : (n_laws,) array
        Of each simple law, to be taken out.
    size : float
        [N]
    """

    waves: Floats
    phases: Floats
    scales: Floats
    shares: Floats
    size: float

    def along(self, loop: Loop) -> Floats:
        """The force ``(n_points,)`` [N] along a loop, that of another protocol too."""
        return self.size * (self._raw(loop) - _simple_laws(loop, self.scales) @ self.shares)

    def _raw(self, loop: Loop) -> Floats:
        at = _where(loop, self.scales)
        return np.asarray(np.cos(at @ self.waves + self.phases).sum(axis=1))


def unnamed_force(rng: np.random.Generator, loop: Loop, rms: float) -> UnnamedForce:
    """Draw one of a root mean square [N] along a loop."""
    waves = rng.standard_normal((3, N_WAVES)) / np.array(LENGTHS)[:, None]
    phases = rng.uniform(0.0, 2.0 * np.pi, N_WAVES)
    columns = (loop.displacement, loop.hysteretic_displacement, loop.path)
    scales = np.array([np.max(np.abs(column)) for column in columns])
    laws = _simple_laws(loop, scales)
    raw = UnnamedForce(waves=waves, phases=phases, scales=scales, shares=np.zeros(laws.shape[1]), size=1.0)
    values = raw.along(loop)
    shares = np.linalg.lstsq(laws, values)[0]
    left = float(np.sqrt(np.mean(np.square(values - laws @ shares))))
    return UnnamedForce(waves=waves, phases=phases, scales=scales, shares=shares, size=rms / left)


def _where(loop: Loop, scales: Floats) -> Floats:
    return np.stack([loop.displacement, loop.hysteretic_displacement, loop.path], axis=1) / scales


def _simple_laws(loop: Loop, scales: Floats) -> Floats:
    """Shapes ``(n_points, n_laws)`` that a law of the catalogue may have, constant and growing with the path."""
    u, z, path = _where(loop, scales).T
    shapes = np.stack([np.ones_like(u), u, u**2, u**3, z, z**2, z**3, z * np.exp(-((3.0 * z) ** 2))], axis=1)
    return np.concatenate([shapes, path[:, None] * shapes], axis=1)
