"""Models, records and engines that the engine tests share: one storey law, so that each engine compiles once."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec

import numpy as np
from emulated_card import EmulatedCuda

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import (
    FolientePinching,
    SlipLock,
    StiffnessDegradation,
    StrengthDegradation,
    SuddenDamage,
)
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.engines.sunode import Sunode
from bwbn_bayes.parameters import Floats, PerStorey, Uniform, Value
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

ENGINES: dict[str, Engine] = {
    "lanes": Lanes(substeps=16, n_threads=2),
    "cvodes": Cvodes(rtol=1e-10, atol=1e-12),
    "scalar": ScalarRk4(substeps=16),
    "reference": Reference(),
    "cuda": EmulatedCuda(substeps=16, n_threads=2),
}
if find_spec("sunode") is not None:
    ENGINES["sunode"] = Sunode(rtol=1e-10, atol=1e-12)
"""Each engine at settings whose error is below :data:`CONVERGED`; sunode where it is installed, cuda without a card."""

CONVERGED = 1e-5
TIME_STEP = 0.02

KNOWN: dict[str, Value] = {
    "k": 40.0,
    "c": 0.1,
    "alpha": 0.05,
    "beta": 2.0,
    "gamma": 1.0,
    "n": 1.5,
    "delta_nu": 0.05,
    "delta_eta": 0.05,
    "delta_s": 0.1,
    "sigma": 0.05,
    "zeta_s": 0.0,
    "p": 1.0,
    "q": 0.1,
    "psi_0": 0.2,
    "delta_psi": 0.05,
    "lambda_": 0.2,
    "jump": 1.0,
    "time": 1.511,
    "k_jump": 0.0,
    "k_time": 0.0,
}


def building(n_storeys: int, values: Mapping[str, Value] | None = None) -> ShearBuilding:
    """A building with every effect at every storey; ``values`` replaces known values."""
    v = {**KNOWN, **(values or {})}
    storey = BoucWen(k=v["k"], c=v["c"], alpha=v["alpha"], beta=v["beta"], gamma=v["gamma"], n=v["n"])
    effects = (
        StrengthDegradation(delta_nu=v["delta_nu"]),
        StiffnessDegradation(delta_eta=v["delta_eta"]),
        SlipLock(delta_s=v["delta_s"], sigma=v["sigma"]),
        FolientePinching(
            zeta_s=v["zeta_s"],
            p=v["p"],
            q=v["q"],
            psi_0=v["psi_0"],
            delta_psi=v["delta_psi"],
            lambda_=v["lambda_"],
        ),
        SuddenDamage(parameter="delta_nu", jump=v["jump"], time=v["time"]),
        SuddenDamage(parameter="k", jump=v["k_jump"], time=v["k_time"]),
    )
    model = ShearBuilding(masses=[1.0] * n_storeys, storey=storey)
    for effect in effects:
        model = model.with_effect(effect)
    return model


def ground_motion(duration: float, *, seed: int = 7, scale: float = 4.0) -> Floats:
    """Two sines and some noise, growing from zero at rest. [m/s^2]"""
    times = np.arange(round(duration / TIME_STEP) + 1) * TIME_STEP
    noise = np.random.default_rng(seed).normal(size=len(times))
    shape = np.sin(4.1 * times) + 0.6 * np.sin(7.3 * times + 1.0) + 0.1 * noise
    return np.asarray(scale * np.minimum(times, 1.0) * shape, dtype=np.float64)


def record_of(model: ShearBuilding, duration: float = 4.0, channels: tuple[str, ...] | None = None) -> Record:
    """A record whose measured channels are some smooth curves: enough for misfits and sums."""
    excitation = ground_motion(duration)
    names = channels or tuple(f"acceleration_{i + 1}" for i in range(model.n_floors))
    curves = {name: np.cos(np.arange(len(excitation)) * 0.01 * (i + 1)) for i, name in enumerate(names)}
    return Record(name="test", time_step=TIME_STEP, excitation=excitation, channels=curves)


def relative_error(values: Floats, truth: Floats) -> float:
    """Root mean square difference over root mean square truth."""
    return float(np.sqrt(np.mean((values - truth) ** 2) / np.mean(truth**2)))


FREE: dict[str, Value] = {
    "k": PerStorey(Uniform(20, 60)),
    "c": Uniform(0.05, 0.2),
    "alpha": Uniform(0.01, 0.1),
    "beta": Uniform(1, 3),
    "gamma": Uniform(0.5, 1.5),
    "n": Uniform(1, 2),
}
"""Identified parameters of the element."""
