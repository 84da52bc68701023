"""The No-U-Turn sampler in coordinates in which the posterior is nearly standard normal.

They come from the fit (:mod:`~bwbn_bayes.inference.pymc.coordinates`), so that nothing but the length of a step is
adapted, and chains start at draws of the normal. The density is one operator that Python evaluates: of the graph of a
``pm.Model``, compiling alone would take longer than sampling. The log likelihood has kinks where a drift rate changes
sign or a slip begins: where they matter the sampler diverges, and the result says so.

References
----------
.. [1] M. D. Hoffman and A. Gelman, "The No-U-Turn Sampler", J. Machine Learning Research 15, 2014.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
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

from bwbn_bayes.inference.pymc.smc import quiet
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

    def log_density(self, x: Floats) -> tuple[float, Floats]:
        """Log density and its gradient ``(n_dim,)`` at coordinates ``(n_dim,)``."""


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

    Chains of PyMC run one after another in this process, those of nutpie on threads, each from a start of its own.
    Nothing is forked.

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
    tree = sample(counted, draws, tune, chains, seed)
    statistics = tree["sample_stats"].dataset
    return NutsRun(
        coordinates=np.asarray(tree["posterior"]["x"].values),
        n_divergences=int(statistics["diverging"].sum()),
        n_solves=counted.n_asked,
    )


def convergence(draws: Floats, names: Sequence[str]) -> tuple[float, float]:
    """Worst R-hat and least effective sample size, rank-normalised, bulk, of draws ``(n_chains, n_draws, n_dim)``."""
    columns = xr.Dataset({name: (("chain", "draw"), draws[..., i]) for i, name in enumerate(names)})
    r_hat, ess = arviz_stats.rhat(columns), arviz_stats.ess(columns)
    return max(float(value) for value in r_hat.values()), min(float(value) for value in ess.values())


class _Counted:
    """A density that counts how often it is asked, from whatever thread."""

    def __init__(self, density: Density) -> None:
        self._density, self._lock = density, threading.Lock()
        self.n_dim, self.n_asked = density.n_dim, 0

    def log_density(self, x: Floats) -> tuple[float, Floats]:
        with self._lock:
            self.n_asked += 1
        return self._density.log_density(x)


class _LogDensity(Op):
    """A density and its gradient as an operator."""

    __props__ = ()

    def __init__(self, log_density: Callable[[Floats], tuple[float, Floats]]) -> None:
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


def _pymc(density: Density, draws: int, tune: int, chains: int, seed: int) -> xr.DataTree:
    with pm.Model(), quiet():
        x = pm.Flat("x", shape=density.n_dim)
        pm.Potential("density", _LogDensity(density.log_density)(x)[0])
        interpreted = {"mode": Mode(linker="py", optimizer="fast_compile")}
        step = pm.NUTS(
            potential=QuadPotentialDiag(np.ones(density.n_dim)),
            target_accept=_TARGET_ACCEPTANCE,
            step_scale=_STEP * density.n_dim**0.25,  # PyMC divides by it
            compile_kwargs=interpreted,
        )
        tree: xr.DataTree = pm.sample(
            draws=draws,
            tune=tune,
            chains=chains,
            cores=1,
            step=step,
            initvals=[{"x": start} for start in _starts(density, chains, seed)],
            random_seed=seed,
            progressbar=False,
            compute_convergence_checks=False,
            compile_kwargs=interpreted,
        )
    return tree


def _nutpie(density: Density, draws: int, tune: int, chains: int, seed: int) -> xr.DataTree:
    # Imported here: it is an extra of its own, with 170 MB of pyarrow.
    import nutpie
    from nutpie.compiled_pyfunc import from_pyfunc

    compiled = from_pyfunc(
        density.n_dim,
        lambda: density.log_density,
        lambda *_: lambda x: {"x": x},
        [np.dtype(np.float64)],
        [(density.n_dim,)],
        ["x"],
        make_initial_point_fn=lambda seed: np.random.default_rng(seed).standard_normal(density.n_dim),
    )
    tree: xr.DataTree = nutpie.sample(
        compiled,
        draws=draws,
        tune=tune,
        chains=chains,
        cores=chains,
        seed=seed,
        progress_bar=False,
        save_warmup=False,
    )
    return tree
