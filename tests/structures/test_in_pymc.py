"""Every element, and what joins them, as part of a PyMC model: density and slopes are those of the package's own."""

from __future__ import annotations

import numpy as np
import pytest
from cable import Cable

from bwbn_bayes import (
    BoucWen,
    FrictionPendulum,
    Linear,
    Oscillator,
    Record,
    ShearBuilding,
    StoreyCoupling,
    Uniform,
    simulate,
)
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

WEIGHT = 9.81 * 6.5
PLAIN = ShearBuilding(masses=[2.0, 1.5], storey=Linear(k=Uniform(40.0, 80.0), c=Uniform(0.1, 1.0)))
BRACE = BoucWen(k=25.0, alpha=0.1, beta=Uniform(4.0, 12.0), gamma=4.0, n=1.4)
ISOLATOR = FrictionPendulum(
    W=WEIGHT, R=Uniform(1.0, 3.0), mu_slow=Uniform(0.02, 0.06), mu_fast=Uniform(0.06, 0.12), a_mu=12.0, Y=0.01, c=0.3
)
MODELS: dict[str, Structure] = {
    "a linear frame with a yielding brace, bent": PLAIN.with_link(BRACE, joins=(0, 2)).with_effect(
        StoreyCoupling(k_bend=Uniform(1.0, 10.0))
    ),
    "a slider below linear storeys": ShearBuilding(
        masses=[3.0, 2.0, 1.5], storey=Linear(k=800.0, c=1.2), isolator=ISOLATOR
    ),
    "a user's own element": Oscillator(mass=2.0, spring=Cable(k=Uniform(40.0, 80.0), c=1.0, k_t=Uniform(50.0, 150.0))),
}


def shaking() -> Record:
    times = 0.02 * np.arange(101)
    return Record(name="shaking", time_step=0.02, excitation=2.5 * np.cos(4.0 * times) * np.exp(-0.2 * times))


@pytest.mark.parametrize("name", MODELS)
def test_pymc_has_the_same_density_and_slopes(name: str) -> None:
    pytest.importorskip("pymc")
    from bwbn_bayes import to_pymc

    model = MODELS[name]
    symbols = [parameter.symbol for parameter in model.space.parameters]
    n = len(symbols)
    truth = dict(zip(model.space.names, model.space.from_unit(np.full((1, n), 0.46))[0].tolist(), strict=True))
    record = simulate(model, shaking(), truth, snr_db=30.0, channels=["acceleration_1", "drift_1"])
    engine, noise = Lanes(substeps=8, resolution=0.06, n_threads=1), default_noise(record)
    twin = to_pymc(model, record, noise=noise, engine=engine)
    posterior = Posterior(model=model, record=record, engine=engine, noise=noise)
    log_density, slope = twin.compile_logp(), twin.compile_dlogp()
    start = twin.initial_point()

    def symbol_of(name: str) -> str:
        return name.split("_interval")[0].split("[")[0]

    def at(unit: Floats) -> dict[str, Floats]:
        logit = dict(zip(symbols, np.log(unit / (1.0 - unit)), strict=True))
        return {name: np.full(np.shape(value), logit[symbol_of(name)]) for name, value in start.items()}

    def own(unit: Floats) -> float:
        return float(posterior.log_likelihood(unit[None])[0] + np.sum(np.log(unit * (1.0 - unit))))

    unit, other = np.full(n, 0.48), 0.47 + 0.03 * np.arange(n) / n
    assert float(log_density(at(unit)) - log_density(at(other))) == pytest.approx(own(unit) - own(other), rel=1e-8)
    found = dict(zip(map(symbol_of, start), slope(at(unit)), strict=True))
    assert set(found) == set(symbols)
    for column, symbol in enumerate(symbols):
        step = 1e-5 * np.eye(n)[column]
        expected = (own(unit + step) - own(unit - step)) / 2e-5 * unit[column] * (1.0 - unit[column])
        assert found[symbol] == pytest.approx(expected, rel=0.02), symbol
