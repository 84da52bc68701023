"""A synthetic result to render: a small degrading, pinching building integrated here in plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.figures import draw_all
from bwbn_bayes.results import (
    Check,
    Equation,
    Facts,
    ParameterFacts,
    Result,
    StageFacts,
)
from bwbn_bayes.structures.quantities import engineering_quantities, landmarks_of
from bwbn_bayes.structures.shear_building import ShearBuilding

PLAIN = ShearBuilding(masses=[1.0], storey=BoucWen(k=1.0, c=0.0, alpha=0.1, beta=1.0, gamma=1.0, n=1.0))
"""Its law changes no parameter in time."""
SUBSTEPS = 4
SIGMA = 0.03
UNITS = {"k": "N/m", "c": "N s/m", "alpha": "", "beta": "1/m^n", "gamma": "1/m^n", "n": "",
         "delta_nu": "1/J", "delta_eta": "1/J", "delta_s": "m/J"}  # fmt: skip
PRIORS = {"k": Uniform(5, 60), "c": Uniform(0, 0.5), "alpha": Uniform(0.001, 0.3), "beta": Uniform(0.1, 8),
          "gamma": Uniform(-4, 8), "n": Uniform(1, 4), "delta_nu": Uniform(0, 3), "delta_eta": Uniform(0, 3),
          "delta_s": Uniform(0, 0.3)}  # fmt: skip
TRUTH = {"k": 20.0, "c": 0.05, "alpha": 0.03, "beta": 2.0, "gamma": 2.0, "n": 1.5,
         "delta_nu": 0.6, "delta_eta": 0.8, "delta_s": 0.02}  # fmt: skip
PER_STOREY = ("k", "c")


def rates(state, p, ground, masses):
    """Rates of (drift, drift rate, z, energy), each (n_draws, n_storeys), and the floor accelerations."""
    u, v, z, energy = state
    nu, eta = 1 + p["delta_nu"] * energy, 1 + p["delta_eta"] * energy
    f = (1 - nu * np.abs(z) ** p["n"] * (p["beta"] * np.sign(z * v) + p["gamma"])) / eta
    bell = np.sqrt(2 / np.pi) / SIGMA * np.exp(-(z**2) / (2 * SIGMA**2))
    spring = (1 - p["alpha"]) * p["k"] * z
    force = p["alpha"] * p["k"] * u + spring + p["c"] * v
    above = np.concatenate([force[:, 1:], np.zeros_like(force[:, :1])], axis=1)
    acceleration = (above - force) / masses
    relative = np.diff(acceleration - ground, axis=1, prepend=0.0)
    return np.stack([v, relative, f * v / (1 + p["delta_s"] * energy * bell * f), spring * v]), acceleration, force


def integrate(p, ground, dt, masses):
    """Classical Runge-Kutta with linear ground acceleration; histories of every state, (n_draws, n_storeys, n_time)."""
    state = np.zeros((4, *p["k"].shape))
    frames = []
    for i, now in enumerate(ground):
        _, acceleration, force = rates(state, p, now, masses)
        frames.append(np.stack([*state, acceleration, force]))
        slope = (ground[min(i + 1, len(ground) - 1)] - now) / SUBSTEPS
        h = dt / SUBSTEPS
        for sub in range(SUBSTEPS):
            a, b = now + slope * sub, now + slope * (sub + 1)
            k1 = rates(state, p, a, masses)[0]
            k2 = rates(state + h / 2 * k1, p, (a + b) / 2, masses)[0]
            k3 = rates(state + h / 2 * k2, p, (a + b) / 2, masses)[0]
            k4 = rates(state + h * k3, p, b, masses)[0]
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    names = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy", "acceleration", "restoring_force")
    return dict(zip(names, np.stack(frames, axis=-1), strict=True))


def response_dataset(histories, time, prefix):
    storeys = np.arange(1, histories["drift"].shape[-2] + 1)
    data = {
        name: ((*prefix, "floor" if name == "acceleration" else "storey", "time"), values)
        for name, values in histories.items()
    }
    return xr.Dataset(data, coords={"storey": storeys, "floor": storeys, "time": time})


def ground_motion(time, rng):
    white = rng.standard_normal(time.size)
    smooth = np.convolve(white, np.ones(5) / 5, mode="same") + 0.4 * np.sin(2.4 * time)
    return 2.2 * smooth * (time / 4.0) ** 2 * np.exp(2.0 - 2.0 * (time / 4.0)) + 0.15 * smooth


def draw_parameters(n_draws, n_storeys, rng):
    """Posterior draws by symbol, (n_draws,) or (n_draws, n_storeys), around the truth; gamma crowds its upper bound."""
    draws = {}
    common = rng.standard_normal(n_draws)
    for symbol, true in TRUTH.items():
        shape = (n_draws, n_storeys) if symbol in PER_STOREY else (n_draws,)
        scale = 0.012 * true * (4.0 if symbol in ("c", "delta_nu", "beta") else 1.0)
        shared = common if len(shape) == 1 else common[:, None]
        draws[symbol] = true + scale * (0.7 * rng.standard_normal(shape) + (0.7 if symbol != "k" else -0.7) * shared)
    draws["gamma"] = 8.0 - np.abs(0.5 * common + 0.2 * rng.standard_normal(n_draws))
    return draws


def spread(draws, n_storeys):
    return {s: (v if v.ndim == 2 else np.repeat(v[:, None], n_storeys, axis=1)) for s, v in draws.items()}


def parameter_facts(draws, truth):
    facts = []
    for symbol, values in draws.items():
        columns = values.T if values.ndim == 2 else values[None]
        for i, column in enumerate(columns, start=1):
            name = f"{symbol}[{i}]" if values.ndim == 2 else symbol
            low, high = np.percentile(column, [5, 95])
            facts.append(ParameterFacts(
                name=name, symbol=symbol, unit=UNITS[symbol], prior=str(PRIORS[symbol]), mean=float(column.mean()),
                sd=float(column.std()), hdi90=(float(low), float(high)),
                true=TRUTH[symbol] if truth and symbol != "gamma" else None,
                flag={"gamma": "prior-bound", "delta_s": "unidentified"}.get(symbol, ""),
            ))  # fmt: skip
    return tuple(facts)


def parameter_group(draws, n_chains, n_storeys):
    data = {}
    for symbol, values in draws.items():
        dims = ("chain", "draw", "storey")[: values.ndim + 1]
        data[symbol] = (dims, values.reshape(n_chains, -1, *values.shape[1:]))
    return xr.Dataset(data, coords={"storey": np.arange(1, n_storeys + 1)})


def build_facts(draws, nrmse, noise, truth, stages, n_storeys):
    history = tuple(
        StageFacts(stage=i, tempering_parameter=10.0 ** (i - 8), acceptance=0.3, effective_sample_size=1000.0 + i,
                   n_solves=2000 * i, log_evidence=-4000.0 / i, elapsed_s=1.2 * i)
        for i in range(1, 9)
    )  # fmt: skip
    derivative = "<mfrac><mrow><mi>d</mi><mi>z</mi></mrow><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>"
    return Facts(
        method="tmcmc", model="three_storey_el_centro", record="El Centro 1940, RSN6 180 <S00E & W>", engine="lanes",
        seed=1, parameters=parameter_facts(draws, truth), log_evidence=1234.567, log_evidence_se=0.043, nrmse=nrmse,
        noise_sd=noise, n_solves=41500, n_stages=8, elapsed_s=58.4, effective_sample_size=1180.0, storeys=n_storeys,
        verdict=(("The building's 13 parameters were identified from three floor accelerations: the model explains "
                 "99.9 % of the measured motion, down to the noise."),
                 "All checks passed but one: gamma leans on the upper end of its prior."),
        identifiability=("The record sees every combination of the parameters at least 10 times better than the prior.",
                         "beta and gamma are seen mainly through their sum."),
        checks=(Check(name="whiteness", value=0.4, limit=0.01, passed=True,
                      sentence="The residuals are white at the 1 % level on every floor."),
                Check(name="pareto k", value=0.83, limit=0.7, passed=False,
                      sentence="The importance weights have a heavy tail: TMCMC was run instead.")),
        stages=history if stages else (),
        equations=(Equation(caption="rate of the hysteretic displacement",
                            mathml=f"<mrow>{derivative}<mo>=</mo><mi>f</mi><mi>v</mi></mrow>"),),
        assumptions=("SNR is in dB of mean square.", "Masses are known & fixed."),
        discretisation={"scheme": "rk4, 2 substeps", "joint_shift_sd": 0.12, "log_likelihood_shift": 0.031,
                        "nrmse": 1.2e-5},
        restoring_force={str(i): {"nrmse": 0.0031, "correlation_time": 0.99997, "correlation_drift": 0.99996}
                         for i in range(1, n_storeys + 1)} if truth else {},
        evidences={"tmcmc (bridge)": (1234.567, 0.043), "importance": (1234.61, 0.02)},
        provenance={"bwbn_bayes": "0.1.0", "numpy": "2.5.5", "data sha256": "a3f5" * 16},
    )  # fmt: skip


STATISTICS = ["mean", "lower", "upper"]


def statistics(draws):
    return np.stack([draws.mean(axis=0), *np.percentile(draws, [5, 95], axis=0)])


def build_result(
    *, n_storeys=3, n_time=400, dt=0.05, n_draws=200, n_chains=1, truth=True, forces=True, stages=True, quantities=True
):
    rng = np.random.default_rng(7)
    time = np.arange(n_time) * dt
    masses = np.ones(n_storeys)
    ground = ground_motion(time, rng)
    draws = draw_parameters(n_draws, n_storeys, rng)
    by_storey = spread(draws, n_storeys)
    response_values = integrate(by_storey | {"gamma": np.full((n_draws, n_storeys), 2.0)}, ground, dt, masses)
    true_parameters = {symbol: np.full((1, n_storeys), value) for symbol, value in TRUTH.items()}
    true_values = {name: values[0] for name, values in integrate(true_parameters, ground, dt, masses).items()}
    signal = true_values["acceleration"]
    noise_sd = 0.0316 * np.sqrt(np.mean(signal**2, axis=1))
    measured = signal + noise_sd[:, None] * rng.standard_normal(signal.shape)
    predictive = response_values["acceleration"] + noise_sd[:, None] * rng.standard_normal((n_draws, *signal.shape))
    channels = [f"acceleration_{i}" for i in range(1, n_storeys + 1)]
    response = response_dataset(response_values, time, ("draw",))
    # What a law holds at a fixed value has its column too.
    in_law = by_storey | {"A": np.ones((n_draws, n_storeys))}
    storeys = xr.Dataset({s: (("draw", "storey"), v) for s, v in in_law.items()})
    constant = xr.Dataset({"ground_acceleration": ("time", ground)}, coords={"time": time})
    if forces:
        sums = -np.cumsum((masses[:, None] * measured)[::-1], axis=0)[::-1]
        constant["measured_storey_force"] = (("storey", "time"), sums)
    n_prior = 1000
    prior = {symbol: PRIORS[symbol].quantile(rng.random((n_prior, *draws[symbol].shape[1:]))) for symbol in draws}
    groups = {
        "posterior": parameter_group(draws, n_chains, n_storeys),
        "prior": parameter_group(prior, 1, n_storeys),
        "sample_stats": xr.Dataset({"lp": (("chain", "draw"), np.zeros((n_chains, n_draws // n_chains)))}),
        "observed_data": xr.Dataset(
            {"measured": (("channel", "time"), measured)}, coords={"channel": channels, "time": time}
        ),
        "constant_data": constant,
        "posterior_predictive": xr.Dataset(
            {"measured": (("chain", "draw", "channel", "time"), predictive[None])},
            coords={"channel": channels, "time": time},
        ),
        "predictive_bands": xr.Dataset(
            {name: (("statistic", "time"), statistics(predictive[:, i])) for i, name in enumerate(channels)},
            coords={"time": time, "statistic": STATISTICS},
        ),
        "response": response,
        "response_bands": response_dataset(
            {name: statistics(values) for name, values in response_values.items()}, time, ("statistic",)
        ).assign_coords(statistic=STATISTICS),
        "parameters_by_storey": storeys,
    }
    if truth:
        groups["true_response"] = response_dataset(true_values, time, ())
    if quantities:
        groups["quantities"] = engineering_quantities(
            landmarks_of(response, PLAIN.law, storeys), storeys, masses, PLAIN.law
        )
    residual = np.sqrt(np.mean((measured - response_values["acceleration"].mean(0)) ** 2, axis=1))
    nrmse = {name: float(residual[i] / np.sqrt(np.mean(measured[i] ** 2))) for i, name in enumerate(channels)}
    noise = {name: float(noise_sd[i]) for i, name in enumerate(channels)}
    facts = build_facts(draws, nrmse, noise, truth, stages, n_storeys)
    return Result(tree=xr.DataTree.from_dict(groups), facts=facts)


@pytest.fixture(scope="session")
def make_result():
    """The builder itself, for tests that want a variant."""
    return build_result


@pytest.fixture(scope="session")
def result(make_result):
    """Three storeys, 400 points, 200 draws, 13 parameters, truth known."""
    return make_result()


@pytest.fixture(scope="session")
def drawings(result):
    """Every figure of that result."""
    return draw_all(gather(result))


@pytest.fixture(scope="session")
def bare_result(make_result):
    """A result with as little in it as a method may leave: no truth, forces, stages, quantities or verdict."""
    bare = make_result(n_storeys=1, truth=False, forces=False, stages=False, quantities=False, n_draws=50)
    facts = replace(
        bare.facts, verdict=(), identifiability=(), checks=(), equations=(), assumptions=(), discretisation={},
        evidences={}, provenance={},
    )  # fmt: skip
    return replace(bare, facts=facts)


@pytest.fixture(scope="session")
def pushed() -> Record:
    """A specimen's displacement in a testing machine: 8 s of growing cycles."""
    times = 0.02 * np.arange(401)
    return Record(
        name="cyclic test",
        time_step=0.02,
        excitation=0.02 * times * np.sin(np.pi * times),
        excitation_kind="displacement",
    )
