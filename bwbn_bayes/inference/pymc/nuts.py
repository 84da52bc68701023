"""The No-U-Turn sampler in coordinates in which the posterior is nearly standard normal.

They come from the fit (:mod:`~bwbn_bayes.inference.pymc.coordinates`), so that nothing but the length of a step is
adapted, and chains start at draws of the normal. The density is one operator that Python evaluates: of the graph of a
``pm.Model``, compiling alone would take longer than sampling. The log likelihood has kinks where a drift rate changes
sign or a slip begins: where they matter the sampler diverges, and the result says so.

An engine that solves many draws at once has room beside one point and its derivatives: chains go in lockstep, and what
all of them ask for is one call.

References
----------
.. [1] M. D. Hoffman and A. Gelman, "The No-U-Turn Sampler", J. Machine Learning Research 15, 2014.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import arviz_stats
import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pymc.step_methods.hmc.quadpotential import QuadPotentialDiag
from pytensor.compile.mode import Mode
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.op import Op

from bwbn_bayes.inference.pymc.lockstep import Ask, in_lockstep
from bwbn_bayes.parameters import Floats

Sampler = Literal["pymc", "nutpie"]
_TARGET_ACCEPTANCE = 0.8
_STEP = 1.0
"""Length of the first step: in a standard normal, one that is accepted. It is adapted."""


class Density(Protocol):
    """What is sampled: a density that is nearly standard normal."""

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""

    def log_density(self, x: Floats) -> tuple[Floats, Floats]:
        """Log densities ``(n,)`` and their gradients ``(n, n_dim)`` at coordinates ``(n, n_dim)``."""


@dataclass(frozen=True, kw_only=True)
class NutsRun:
    """Draws of NUTS and what they say of themselves.

    Attributes
    ----------
    coordinates : (n_chains, n_draws, n_dim) array
    n_divergences : int
        Trajectories whose energy error exploded.
    n_solves : int
        Densities evaluated, each with its gradient, warm-up among them.
    """

    coordinates: Floats
    n_divergences: int
    n_solves: int


def sample_nuts(
    density: Density, *, sampler: Sampler = "pymc", draws: int = 1000, tune: int = 200, chains: int = 2, seed: int
) -> NutsRun:
    """Sample with PyMC's own NUTS under a metric of one, or with nutpie, which adapts a metric of its own.

    Chains of PyMC run side by side, the densities that they ask for evaluated together; those of nutpie run on threads,
    each by itself. Each has a start and random numbers of its own, whatever their number. Nothing is forked.

    Parameters
    ----------
    density : Density
        Such as :class:`~bwbn_bayes.inference.pymc.coordinates.NormalCoordinates`.
    sampler : {"pymc", "nutpie"}
        Whose implementation.
    draws, tune, chains : int
        Draws kept and warm-up draws of each chain, number of chains.
    seed : int
        The run is a function of it.
    """
    sample = _nutpie if sampler == "nutpie" else _pymc
    counted = _Counted(density)
    coordinates, n_divergences = sample(counted, draws, tune, chains, seed)
    return NutsRun(coordinates=coordinates, n_divergences=n_divergences, n_solves=counted.n_asked)


def convergence(draws: Floats, names: Sequence[str]) -> tuple[float, float]:
    """Worst R-hat and least effective sample size, rank-normalised, bulk, of draws ``(n_chains, n_draws, n_dim)``."""
    columns = xr.Dataset({name: (("chain", "draw"), draws[..., i]) for i, name in enumerate(names)})
    r_hat, ess = arviz_stats.rhat(columns), arviz_stats.ess(columns)
    return max(float(value) for value in r_hat.values()), min(float(value) for value in ess.values())


class _Counted:
    """A density that counts the points that it is asked for, from whatever thread."""

    def __init__(self, density: Density) -> None:
        self._density, self._lock = density, threading.Lock()
        self.n_dim, self.n_asked = density.n_dim, 0

    def log_density(self, x: Floats) -> tuple[Floats, Floats]:
        with self._lock:
            self.n_asked += len(x)
        return self._density.log_density(x)

    def at_one(self, x: Floats) -> tuple[float, Floats]:
        """At one point ``(n_dim,)``."""
        value, gradient = self.log_density(x[None])
        return float(value[0]), gradient[0]


class LogDensity(Op):
    """A density and its gradient as an operator."""

    __props__ = ()

    def __init__(self, log_density: Ask) -> None:
        self._log_density = log_density

    def make_node(self, x: Variable) -> Apply:
        """The coordinates ``(n_dim,)``."""
        return Apply(self, [x], [pt.dscalar(), pt.dvector()])

    def perform(self, node: Apply, inputs: Sequence[np.ndarray], output_storage: list[list[object]]) -> None:
        """Evaluate both."""
        value, gradient = self._log_density(inputs[0])
        output_storage[0][0], output_storage[1][0] = np.asarray(value), gradient

    def pullback(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable], cotangents: Sequence[Variable]
    ) -> list[Variable]:
        """The gradient of the density; that of the gradient is not known."""
        return [cotangents[0] * outputs[1]]


def _starts(density: Density, chains: int, seed: int) -> Floats:
    return np.random.default_rng(seed).standard_normal((chains, density.n_dim))


def _pymc(density: _Counted, draws: int, tune: int, chains: int, seed: int) -> tuple[Floats, int]:
    rngs = np.random.default_rng(seed).spawn(chains)
    starts = _starts(density, chains, seed)
    each = [Chain(*own, draws=draws, tune=tune) for own in zip(starts, rngs, strict=True)]
    kept, diverged = zip(*in_lockstep([chain.sample for chain in each], density.log_density), strict=True)
    return np.stack(kept), sum(diverged)


class Chain:
    """A chain of PyMC's NUTS; it is compiled before it runs.

    Parameters
    ----------
    start : (n_dim,) array
    rng : Generator
    draws, tune : int
    """

    def __init__(self, start: Floats, rng: np.random.Generator, *, draws: int, tune: int) -> None:
        self._start, self._rng, self._draws, self._tune = start, rng, draws, tune
        n_dim = len(start)
        with pm.Model():
            x = pm.Flat("x", shape=n_dim)
            pm.Potential("density", LogDensity(self._log_density)(x)[0])
            self._step = pm.NUTS(
                potential=QuadPotentialDiag(np.ones(n_dim)),
                target_accept=_TARGET_ACCEPTANCE,
                step_scale=_STEP * n_dim**0.25,  # PyMC divides by it
                compile_kwargs={"mode": Mode(linker="py", optimizer="fast_compile")},
            )

    def sample(self, ask: Ask) -> tuple[Floats, int]:
        """Draws ``(n_draws, n_dim)`` after those of the warm-up, and how many of them diverged."""
        self._ask = ask
        step, kept, n_divergences = self._step, np.empty((self._draws, len(self._start))), 0
        step.setup_chain(self._rng, self._tune, self._draws)
        step.reset_tuning()
        point = {"x": self._start}
        for i in range(-self._tune, self._draws):
            if i == 0:
                step.stop_tuning()
            point, (statistics,) = step.step(point)
            if i >= 0:
                kept[i] = point["x"]
                n_divergences += bool(statistics["diverging"])
        return kept, n_divergences

    def _log_density(self, x: Floats) -> tuple[float, Floats]:
        return self._ask(x)


def _nutpie(density: _Counted, draws: int, tune: int, chains: int, seed: int) -> tuple[Floats, int]:
    # Imported here: it is an extra of its own, with 170 MB of pyarrow.
    import nutpie
    from nutpie.compiled_pyfunc import from_pyfunc

    compiled = from_pyfunc(
        density.n_dim,
        lambda: density.at_one,
        lambda *_: lambda x: {"x": x},
        [np.dtype(np.float64)],
        [(density.n_dim,)],
        ["x"],
        make_initial_point_fn=lambda seed: np.random.default_rng(seed).standard_normal(density.n_dim),
    )
    tree = nutpie.sample(
        compiled,
        draws=draws,
        tune=tune,
        chains=chains,
        cores=chains,
        seed=seed,
        progress_bar=False,
        save_warmup=False,
    )
    diverging = tree["sample_stats"].dataset["diverging"]
    return np.asarray(tree["posterior"]["x"].values), int(diverging.sum())
