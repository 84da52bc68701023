"""A small building, its record and its PyMC twin, shared by the tests of ``inference/pymc``."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import xarray as xr
from inference_cases import SDOF, climbed, sdof_model

from bwbn_bayes import LogNormal, Record, ShearBuilding, Uniform, simulate
from bwbn_bayes.elements.effects import StiffnessDegradation, StrengthDegradation
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Noise, Posterior, SampledNoise, default_noise
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats, ParameterSpace

ENGINE = Lanes(substeps=2, n_threads=1)
TRUTH = {"k": 40.0, "beta": 30.0, "delta_eta": 0.4}
FREE = {"k": Uniform(20, 60), "beta": Uniform(1, 80), "delta_eta": Uniform(0, 2)}
_PATIENCE_S = 30.0


def small_model(**values: object) -> ShearBuilding:
    """``models/sdof.py`` with k, beta and delta_eta identified, or what else is given."""
    v = {**SDOF.truth, **FREE, **values}
    storey = replace(sdof_model().element, **{name: v[name] for name in ("k", "c", "alpha", "beta", "gamma", "n")})
    model = ShearBuilding(masses=[1.0], storey=storey)
    model = model.with_effect(StrengthDegradation(delta_nu=v["delta_nu"]))
    return model.with_effect(StiffnessDegradation(delta_eta=v["delta_eta"]))


@cache
def small_record(seed: int = 1, duration: float = 8.0, snr_db: float = 20.0) -> Record:
    """The first seconds of El Centro by the reference engine."""
    assert SDOF.excitation is not None
    return simulate(small_model(), SDOF.excitation.until(duration), TRUTH, snr_db=snr_db, seed=seed)


def small_posterior(record: Record | None = None) -> Posterior:
    """The posterior of the small model."""
    record = record or small_record()
    return Posterior(model=small_model(), record=record, engine=ENGINE, noise=default_noise(record))


def small_mode(posterior: Posterior) -> Mode:
    """Its optimum next to the truth."""
    return climbed(posterior, posterior.model.space.to_unit(np.array([list(TRUTH.values())]))[0])


def within_time[T](function: Callable[[], T]) -> T:
    """What a function returns or raises; a test that would wait for ever fails."""
    found: list[T] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            found.append(function())
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(_PATIENCE_S)
    assert not thread.is_alive(), "it hangs"
    if raised:
        raise raised[0]
    return found[0]


def still_running() -> list[threading.Thread]:
    """Threads of functions that have not ended."""
    return [thread for thread in threading.enumerate() if thread.name == "lockstep"]


NOISES: dict[str, Noise] = {
    "integrated": default_noise(small_record()),
    "known": KnownNoise(sd=(0.2,)),
    "sampled": SampledNoise(channels=("acceleration_1",), priors=(LogNormal(0.2, 0.5),)),
}


def posterior_tree(space: ParameterSpace, n_draws: int) -> xr.DataTree:
    """Two chains of draws close to the truth, as PyMC would store them."""
    rng = np.random.default_rng(1)
    values: Floats = np.array(list(TRUTH.values())) * (1.0 + 0.002 * rng.standard_normal((2, n_draws, space.n_dim)))
    columns = {name: (("chain", "draw"), values[..., i]) for i, name in enumerate(space.names)}
    return xr.DataTree.from_dict({"posterior": xr.Dataset(columns, coords={"chain": [0, 1], "draw": range(n_draws)})})
