"""A radial basis network: centres and widths without supervision, output weights by regularised least squares.

References
----------
.. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, eqs. 11 to 13.
.. [2] J. Moody and C. J. Darken, "Fast Learning in Networks of Locally-Tuned Processing Units", Neural Computation 1,
   1989, doi:10.1162/neco.1989.1.2.281 (k-means centres, widths from neighbouring centres).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans
from scipy.spatial.distance import cdist

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats

_N_BLOCKS = 25
_VALIDATED = 5
"""Every fifth of 25 blocks of neighbouring samples is kept for validation: neighbours alone would be too easy."""
_MOST_CLUSTERED = 1500
"""Samples that k-means sees, evenly chosen."""


@dataclass(frozen=True, kw_only=True)
class NetworkSettings:
    """What the validation chooses from.

    Parameters
    ----------
    sizes : tuple of int
        Numbers of hidden neurons; the paper used 20.
    widths : tuple of float
        Widths as multiples of the distance to the nearest other centre.
    least_width : float
        Smallest width, in standard deviations of the inputs; the paper's smallest training spread.
    ridges : tuple of float
        Weight penalties, as shares of the largest eigenvalue of the normal matrix.

    Raises
    ------
    UserError
        If a list is empty or a number is not positive.
    """

    sizes: tuple[int, ...] = (10, 20, 40)
    widths: tuple[float, ...] = (1.0, 3.0, 10.0)
    least_width: float = 0.9
    ridges: tuple[float, ...] = (1e-13, 1e-10, 1e-7, 1e-4)

    def __post_init__(self) -> None:
        for name in ("sizes", "widths", "ridges"):
            values: tuple[float, ...] = getattr(self, name)
            if not values or min(values) <= 0:
                raise UserError(f"network: {name} are {values}, they must be positive numbers, at least one")
        if self.least_width <= 0.0:
            raise UserError(f"network: least_width is {self.least_width:g}, it must be positive")


@dataclass(frozen=True, kw_only=True)
class Network:
    """A trained network ``y = offset + scale * sum_j w_j exp(-|s - c_j|^2 / width_j^2)``, s the standardised inputs.

    Attributes
    ----------
    centres : (n_neurons, n_inputs) array
    widths, weights : (n_neurons,) arrays
    shift, stretch : (n_inputs,) arrays
        Mean and standard deviation of each input, in its unit.
    lowest, highest : (n_inputs,) arrays
        Range of the training inputs; inputs outside it are clipped, because Gaussians say nothing there.
    offset, scale : float
        Mean and standard deviation of the output, in its unit.
    validation_error : float
        Root mean square error over root mean square output on the samples kept back.
    """

    centres: Floats
    widths: Floats
    weights: Floats
    shift: Floats
    stretch: Floats
    lowest: Floats
    highest: Floats
    offset: float
    scale: float
    validation_error: float

    def __call__(self, inputs: Floats) -> Floats:
        """Outputs ``(n_samples,)`` for inputs ``(n_samples, n_inputs)`` in their own units."""
        standard = (np.clip(inputs, self.lowest, self.highest) - self.shift) / self.stretch
        return self.offset + self.scale * (hidden(standard, self.centres, self.widths) @ self.weights)


def hidden(inputs: Floats, centres: Floats, widths: Floats) -> Floats:
    """Outputs of the hidden units, eq. 11: ``exp(-|x - c_j|^2 / width_j^2)``.

    Parameters
    ----------
    inputs : (n_samples, n_inputs) array
        Standardised.
    centres : (n_neurons, n_inputs) array
    widths : (n_neurons,) array

    Returns
    -------
    (n_samples, n_neurons) array
    """
    return np.asarray(np.exp(-cdist(inputs, centres, "sqeuclidean") / np.square(widths)))


def train(inputs: Floats, output: Floats, rng: np.random.Generator, settings: NetworkSettings | None = None) -> Network:
    """Train a network; size, width and penalty are those with the smallest error on blocks kept back.

    Parameters
    ----------
    inputs : (n_samples, n_inputs) array
        In order of time.
    output : (n_samples,) array
        What the network should return.
    rng : numpy.random.Generator
        Starts the k-means.
    settings : NetworkSettings, optional
        What to choose from.

    Returns
    -------
    Network
        Its weights use all samples.

    Raises
    ------
    UserError
        If an input does not vary.
    """
    settings = settings or NetworkSettings()
    shift, stretch, scale = np.mean(inputs, axis=0), np.std(inputs, axis=0), float(np.std(output))
    if np.any(stretch == 0.0) or scale == 0.0:
        raise UserError("the network cannot learn from a signal that does not vary: mend the record or drop the floor")
    standard, offset = (inputs - shift) / stretch, float(np.mean(output))
    target = (output - offset) / scale
    kept = np.arange(len(target)) * _N_BLOCKS // len(target) % _VALIDATED == _VALIDATED - 1
    best, choice = np.inf, None
    for size in settings.sizes:
        centres = _centres(standard[~kept], size, rng)
        for factor in settings.widths:
            widths = np.maximum(factor * _nearest(centres), settings.least_width)
            layer = hidden(standard, centres, widths)
            for ridge, weights in zip(settings.ridges, _weights(layer[~kept], target[~kept], settings), strict=True):
                error = float(np.sqrt(np.mean(np.square(layer[kept] @ weights - target[kept]))))
                if error < best:
                    best, choice = error, (centres, widths, ridge)
    assert choice is not None
    centres, widths, ridge = choice
    (weights,) = _weights(hidden(standard, centres, widths), target, replace(settings, ridges=(ridge,)))
    return Network(
        centres=centres,
        widths=widths,
        weights=weights,
        shift=shift,
        stretch=stretch,
        lowest=np.min(inputs, axis=0),
        highest=np.max(inputs, axis=0),
        offset=offset,
        scale=scale,
        validation_error=best * scale / float(np.sqrt(np.mean(np.square(output[kept])))),
    )


def _centres(samples: Floats, size: int, rng: np.random.Generator) -> Floats:
    chosen = samples[:: max(1, len(samples) // _MOST_CLUSTERED)]
    centres, _ = kmeans(chosen, min(size, len(chosen)), iter=1, rng=rng)
    return np.asarray(centres, dtype=np.float64)


def _nearest(centres: Floats) -> Floats:
    distances: NDArray[np.float64] = cdist(centres, centres)
    np.fill_diagonal(distances, np.inf)
    nearest = np.min(distances, axis=1)
    return np.where(np.isfinite(nearest), nearest, 1.0)


def _weights(layer: Floats, target: Floats, settings: NetworkSettings) -> list[Floats]:
    """Ridge solutions for each penalty, from one eigendecomposition of the normal matrix."""
    values, vectors = np.linalg.eigh(layer.T @ layer)
    right = vectors.T @ (layer.T @ target)
    return [vectors @ (right / (np.maximum(values, 0.0) + ridge * values[-1])) for ridge in settings.ridges]
