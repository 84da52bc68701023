"""What the catalogue does not explain: the missing storey force, learned by a radial basis network, and near misses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.baselines.network import NetworkSettings, train
from bwbn_bayes.discovery.name import THRESHOLD, Candidate
from bwbn_bayes.discovery.where import missing_forces, storey_in_words
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.residuals import noise_floors, residual_of, whiteness_probability
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Booleans, Floats

N_MAP = 24
"""Bins of drift and of drift rate."""
N_NEAREST = 5
_N_BLOCKS, _HELD_OUT = 20, 4
"""Every fourth of 20 stretches of time is never shown to the network."""
_NETWORK = NetworkSettings(sizes=(3, 6, 12, 24), widths=(1.0, 3.0, 10.0), ridges=(1e-7, 1e-5, 1e-3, 1e-2, 1e-1))
"""Small and smooth: where the missing force is no function of the state, the network must learn nothing."""
_INPUTS = ("drift", "drift_rate", "hysteretic_displacement")


@dataclass(frozen=True, kw_only=True)
class MissingForce:
    """The force that a storey's law lacks, measured minus modelled, as a network learned it.

    Attributes
    ----------
    storey : int
    place : str
        In words.
    share : float
        Of the missing force's energy beyond the noise, what the network explains on stretches of the record it never
        saw; 0 where it explains nothing.
    noise_share : float
        Of the missing force's energy there, what noise alone would have.
    n_neurons : int
    drift, drift_rate : (n_map,) arrays
        Middles of the bins. [m], [m/s]
    force : (n_map, n_map) array
        Learned, mean over the samples in each bin of drift (rows) and drift rate (columns); NaN where there are none.
        [N]
    """

    storey: int
    place: str
    share: float
    noise_share: float
    n_neurons: int
    drift: Floats
    drift_rate: Floats
    force: Floats


@dataclass(frozen=True, kw_only=True)
class NearShape:
    """A catalogued effect that comes near, and why it is not the answer.

    Attributes
    ----------
    label : str
        Effect, form and place.
    share : float
        Of the residual energy beyond the noise, what it explains.
    correlation : float
        Of what it leaves with itself one sample later, largest over the channels: near 0 for white noise.
    log_odds : float
        Against the present model.
    sentence : str
    """

    label: str
    share: float
    correlation: float
    log_odds: float
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """What is known of a disagreement without a name.

    Attributes
    ----------
    forces : tuple of MissingForce
        Of every storey whose force is measured.
    nearest : tuple of NearShape
        Best first.
    """

    forces: tuple[MissingForce, ...]
    nearest: tuple[NearShape, ...]

    def as_json(self) -> dict[str, Any]:
        """``unexplained`` of ``discovery.json``."""
        return {
            "missing_force": [
                {
                    "storey": force.storey,
                    "share": force.share,
                    "noise_share": force.noise_share,
                    "neurons": force.n_neurons,
                }
                for force in self.forces
            ],
            "nearest": [
                {
                    "label": near.label,
                    "share": near.share,
                    "correlation": near.correlation,
                    "log_odds": near.log_odds,
                    "sentence": near.sentence,
                }
                for near in self.nearest
            ],
        }


def unexplained(
    posterior: Posterior, point: Floats, candidates: Sequence[Candidate], rng: np.random.Generator
) -> Unexplained:
    """Look at what a fit leaves that no effect explains.

    Parameters
    ----------
    posterior : Posterior
        Of the final model.
    point : (n_dim,) array
        Its best fit, in the unit cube.
    candidates : sequence of Candidate
        Weighed against this model, best first.
    rng : numpy.random.Generator
        Starts the network's centres.
    """
    residual = residual_of(posterior, point)
    noise = noise_floors(posterior.record)
    values, _ = posterior.split(point[None])
    rows = {k: h[0] for k, h in observe(posterior.engine, posterior.model, values, posterior.record).items()}
    forces = tuple(
        _learned(
            storey,
            storey_in_words(posterior.model, storey),
            np.stack([rows[kind][storey - 1] for kind in _INPUTS], axis=1),
            force,
            sd,
            rng,
        )
        for storey, force, sd in missing_forces(posterior, residual, noise)
    )
    nearest = tuple(_near(posterior, residual, noise, candidate) for candidate in _distinct(candidates)[:N_NEAREST])
    return Unexplained(forces=forces, nearest=nearest)


def _learned(
    storey: int, place: str, inputs: Floats, force: Floats, sd: float, rng: np.random.Generator
) -> MissingForce:
    """Train on most of the record, judge on the rest; size, width and penalty come from train's own validation."""
    kept_out = np.arange(len(force)) * _N_BLOCKS // len(force) % _HELD_OUT == _HELD_OUT // 2
    network = train(inputs[~kept_out], force[~kept_out], rng, _NETWORK)
    energy = float(np.mean(np.square(force[kept_out])))
    left = float(np.mean(np.square(force[kept_out] - network(inputs[kept_out]))))
    beyond = energy - sd**2
    learned = network(inputs)
    drift, rate, mapped = _map(inputs, learned)
    return MissingForce(
        storey=storey,
        place=place,
        share=float(np.clip((energy - left) / beyond, 0.0, 1.0)) if beyond > 0.0 else 0.0,
        noise_share=min(sd**2 / energy, 1.0) if energy > 0.0 else 1.0,
        n_neurons=len(network.centres),
        drift=drift,
        drift_rate=rate,
        force=mapped,
    )


def _map(inputs: Floats, learned: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean learned force over the bins of drift and drift rate."""
    middles, bins = [], []
    for column in inputs.T[:2]:
        peak = float(np.max(np.abs(column)))
        edges = np.linspace(-peak, peak, N_MAP + 1)
        middles.append(0.5 * (edges[1:] + edges[:-1]))
        bins.append(np.clip(np.searchsorted(edges, column, side="right") - 1, 0, N_MAP - 1))
    count, total = np.zeros((N_MAP, N_MAP)), np.zeros((N_MAP, N_MAP))
    place: tuple[NDArray[np.int64], ...] = tuple(bins)
    np.add.at(count, place, 1.0)
    np.add.at(total, place, learned)
    visited: Booleans = count > 0
    return middles[0], middles[1], np.where(visited, total / np.maximum(count, 1.0), np.nan)


def _distinct(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best place and form of each effect."""
    best: dict[str, Candidate] = {}
    for candidate in candidates:
        best.setdefault(candidate.hypothesis.name, candidate)
    return list(best.values())


def _near(posterior: Posterior, residual: Floats, noise: Floats, candidate: Candidate) -> NearShape:
    hypothesis = candidate.hypothesis
    view = posterior.with_model(hypothesis.model)
    values = np.array([[candidate.evidence.means[name] for name in view.space.names]])
    left = residual_of(view, view.space.to_unit(values)[0])
    before, after = (_beyond(rest, noise) for rest in (residual, left))
    share = float(np.clip(1.0 - after / before, 0.0, 1.0)) if before > 0.0 else 0.0
    white = min(whiteness_probability(rest) for rest in left)
    correlation = max((_correlation(rest) for rest in left), key=abs)
    return NearShape(
        label=hypothesis.label,
        share=share,
        correlation=correlation,
        log_odds=candidate.log_odds,
        sentence=_why(hypothesis.label, share, correlation, white, candidate.log_odds),
    )


def _beyond(residual: Floats, noise: Floats) -> float:
    """Energy beyond the noise's, over the channels, each in units of its noise."""
    return float(np.sum(np.maximum(np.mean(np.square(residual / noise[:, None]), axis=1) - 1.0, 0.0)))


def _correlation(residual: Floats) -> float:
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0


def _why(label: str, share: float, correlation: float, white: float, log_odds: float) -> str:
    what = f"{label} explains {100.0 * share:.0f} % of the residual energy beyond the noise"
    colour = f"a coloured residual (correlation of neighbouring samples {correlation:.2f})" if white < 0.01 else "noise"
    odds = "" if log_odds > THRESHOLD else f"; its log odds, {log_odds:.1f}, do not reach {THRESHOLD:.0f}"
    return f"{what} and leaves {colour}{odds}."
