"""Effects on floors, base, ground and sensors: neutral, independent, in every engine, with their derivatives."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import independent_surroundings
import numpy as np
import pytest
from independent_surroundings import OF_THE_BUILDING
from laboratory import NO_DRAW, finer, nrmse, shaking, with_everything
from laboratory import storey as element
from surroundings import BASES, KINDS, OTHERS, SIZES, building, placed, together

from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects.sliding_base import SlidingBase
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import guide_of
from bwbn_bayes.engines.base import Engine, Status
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lane_laws import kernel_of
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, PerStorey, Prior, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import WHOLE_BUILDING, Structure

MASSES = [1.0, 1.4]
CHANNELS = ["acceleration_1", "acceleration_2", "displacement_1", "displacement_2"]
TOLERANCE = 1e-6
"""Of the NRMSE, at 64 steps between samples; with a lag, 12-point interpolation adds its own."""
ENGINES: dict[str, Engine] = {
    "lanes": Lanes(substeps=64, n_threads=1),
    "scalar": ScalarRk4(substeps=64),
    "cvodes": Cvodes(rtol=1e-10, atol=1e-12),
    "stiff": Cvodes(rtol=1e-9, atol=1e-11, method="bdf"),
}

FREE: dict[str, dict[str, Prior | PerStorey]] = {
    "mass_error": {"e_m": PerStorey(Uniform(-0.2, 0.4))},
    "mass_damping": {"c_m": Uniform(0.1, 0.6)},
    "appendage": {"mu_t": PerStorey(Uniform(0.02, 0.2)), "f_t": Uniform(0.4, 1.0), "zeta_t": Uniform(0.01, 0.06)},
    "base_flexibility": {"compliance": Uniform(0.01, 0.05), "m_b": Uniform(0.8, 2.0), "c_b": Uniform(0.1, 1.0)},
    "sliding_base": {
        "inv_mu": Uniform(8.0, 20.0),
        "R_s": Uniform(1.0, 3.0),
        "m_s": Uniform(0.8, 2.0),
        "W_s": Uniform(20.0, 30.0),
        "Y_s": Uniform(0.02, 0.05),
        "n_s": Uniform(1.5, 6.0),
        "r_mu": Uniform(0.2, 0.7),
        "a_s": Uniform(1.0, 6.0),
    },
    "storey_coupling": {"k_bend": Uniform(1.0, 6.0)},
    "input_scale": {"s_g": Uniform(0.7, 1.4)},
    "sensor_gain": {"gain": PerStorey(Uniform(0.7, 1.2))},
    "sensor_bias": {"bias": PerStorey(Uniform(-0.4, 0.5))},
    "sensor_lag": {"lag": PerStorey(Uniform(0.02, 0.2))},
}


def ours(model: Structure, record: Record | None = None) -> dict[str, np.ndarray]:
    response = ENGINES["lanes"].simulate(model, NO_DRAW, record or shaking(4.0), CHANNELS)
    assert response.status.tolist() == [Status.OK]
    return dict(zip(CHANNELS, response.values[0], strict=True))


def theirs(names: list[str], floors: list[int]) -> dict[str, np.ndarray]:
    record = shaking(4.0)
    values = {symbol: value for name in names for symbol, value in SIZES[name].items()}
    whole = {symbol: value for symbol, value in values.items() if symbol in OF_THE_BUILDING}
    own = {symbol: value for symbol, value in values.items() if symbol not in OF_THE_BUILDING}
    solution = independent_surroundings.Building(
        MASSES,
        [OTHERS] * len(MASSES),
        [own if i + 1 in floors else {} for i in range(len(MASSES))],
        whole,
        record.excitation,
        record.time_step,
    ).respond()
    return {f"{kind}_{i + 1}": rows[i] for kind, rows in solution.items() for i in range(len(MASSES))}


@cache
def without() -> dict[str, np.ndarray]:
    return ours(building(MASSES, OTHERS))


def test_every_such_effect_is_tried_here():
    names = {effect.name for effect in registered() if effect.level != "link"}
    assert names == set(KINDS) == set(SIZES) == set(FREE)


@pytest.mark.parametrize("base", BASES)
def test_neutral_or_carried_changes_nothing(base: str):
    bare = ours(with_everything(ShearBuilding(masses=MASSES, storey=element()), OTHERS))
    carried = everywhere = building(MASSES, OTHERS, base)
    for name in together(base):
        everywhere = placed(everywhere, name, {}, [1, 2])
    responses = [ours(model) for model in (carried, everywhere)]
    for channel in CHANNELS:
        assert nrmse(responses[0][channel], bare[channel]) < 1e-12
        np.testing.assert_array_equal(responses[1][channel], responses[0][channel])


def test_a_building_stands_on_one_base():
    with pytest.raises(UserError, match="on a base that moves: leave one of them out"):
        placed(building(MASSES, OTHERS), "sliding_base", SIZES["sliding_base"], None)


PLACES = [
    (name, floors)
    for name, kind in KINDS.items()
    for floors in ([[1, 2]] if kind.level in WHOLE_BUILDING else [[1], [2], [1, 2]])
]


@pytest.mark.parametrize(("name", "floors"), PLACES)
def test_agrees_with_the_independent_implementation(name: str, floors: list[int]):
    mine, other = ours(placed(building(MASSES, OTHERS, name), name, SIZES[name], floors)), theirs([name], floors)
    errors = {channel: nrmse(mine[channel], other[channel]) for channel in CHANNELS}
    assert max(errors.values()) < (1e-4 if name == "sensor_lag" else TOLERANCE), errors
    changes = [nrmse(mine[channel], without()[channel]) for channel in CHANNELS]
    assert max(changes) > 1e-2


@pytest.mark.parametrize("base", BASES)
def test_all_together_agree_with_the_independent_implementation(base: str):
    model, names = building(MASSES, OTHERS, base), together(base)
    for name in names:
        model = placed(model, name, SIZES[name], [2])
    mine, other = ours(model), theirs(names, [2])
    for channel in CHANNELS:
        assert nrmse(mine[channel], other[channel]) < (1e-4 if channel == "acceleration_2" else TOLERANCE), channel


@pytest.mark.parametrize("base", BASES)
def test_energy_put_in_is_kept_stored_or_lost_above_and_below(base: str):
    """Work of the ground's inertia: kinetic, elastic, viscous, on the hysteretic springs, in the base and its losses.

    The share of friction that a contact has reached is no output: it is followed from the slab's speed. Quadrature at
    1/2000 s, and a speed that is a difference of displacements, leave 1e-6 of the work.
    """
    record, size = finer(shaking(4.0), 80), SIZES[base]
    kinds = ("drift", "drift_rate", "hysteretic_energy")
    names = ["displacement_1", *(f"{kind}_{i}" for kind in kinds for i in (1, 2))]
    model = placed(building(MASSES, OTHERS, base, alpha=0.1, c=0.1), base, size, None)
    x, *rows = Lanes(substeps=4, n_threads=1).simulate(model, NO_DRAW, record, names).values[0]
    u, v, eps = np.reshape(rows, (3, 2, -1))
    slab = x - u[0]
    slab_rate = np.gradient(slab, record.time_step, edge_order=2)
    mass, rates = np.array([size.get("m_b", size.get("m_s")), *MASSES]), slab_rate + np.cumsum([0.0 * x, *v], axis=0)
    if base == "sliding_base":
        stored = 0.5 * size["W_s"] / size["R_s"] * slab**2
        force = size["W_s"] * friction_of(size, slab_rate) * mobilised(size, slab_rate, record.time_step)
    else:
        stored = 0.5 / size["compliance"] * slab**2
        force = size["c_b"] * slab_rate

    def work(power: Floats) -> Floats:
        return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * record.time_step])

    lost = work(force * slab_rate)
    held = 0.5 * mass @ rates**2 + 0.5 * 0.1 * 10.0 * np.sum(u**2, axis=0) + stored
    supplied = work(-record.excitation * (mass @ rates))
    spent = lost + np.sum(eps, axis=0) + work(np.sum(0.1 * v**2, axis=0))
    np.testing.assert_allclose(held + spent, supplied, atol=1e-5 * np.max(supplied))
    assert lost[-1] > 0.01 * np.max(supplied)


def friction_of(size: dict[str, float], rate: Floats) -> Floats:
    return (1.0 - size["r_mu"] * np.exp(-size["a_s"] * np.abs(rate))) / size["inv_mu"]


def mobilised(size: dict[str, float], rate: Floats, time_step: float) -> Floats:
    """Share of the friction ``(n_times,)`` that the contact has reached, of the slab's speed at the samples."""
    drift, n = size["Y_s"], size["n_s"]

    def slope(share: float, speed: float) -> float:
        return (1.0 - (abs(share) ** n if share * speed > 0.0 else 0.0)) * speed / drift

    share, found = 0.0, [0.0]
    for start, end in pairwise(rate.tolist()):
        middle = 0.5 * (start + end)
        one = slope(share, start)
        two = slope(share + 0.5 * time_step * one, middle)
        three = slope(share + 0.5 * time_step * two, middle)
        four = slope(share + time_step * three, end)
        share += time_step * (one + 2.0 * two + 2.0 * three + four) / 6.0
        found.append(share)
    return np.array(found)


@cache
def differences(name: str) -> tuple[Structure, Floats, Floats, Floats]:
    """Model, draw, and the reference's response and derivatives by finite differences, two seconds long."""
    model = placed(building(MASSES, OTHERS, name, k=Uniform(5, 15)), name, FREE[name], [1, 2])
    draw = model.space.from_unit(np.full((1, model.space.n_dim), 0.413))
    response, slopes = Reference().sensitivities(model, draw, shaking(2.0), CHANNELS)
    return model, draw, response.values, slopes


@pytest.mark.parametrize(
    ("engine", "name"),
    [
        # The sliding base has a law of its own, which takes CVODES' callbacks half a minute to compile.
        pytest.param(engine, name, marks=pytest.mark.slow if (engine, name) == ("cvodes", "sliding_base") else ())
        for engine in ENGINES
        for name in FREE
    ],
)
def test_every_engine_and_its_derivatives_agree_with_the_reference(engine: str, name: str):
    model, draw, values, slopes = differences(name)
    response, own = ENGINES[engine].sensitivities(model, draw, shaking(2.0), CHANNELS)
    assert response.status.tolist() == [Status.OK]
    assert nrmse(response.values, values) < 1e-5
    for k, parameter in enumerate(model.space.names):
        assert np.any(slopes[:, k] != 0.0), parameter
        assert nrmse(own[:, k], slopes[:, k]) < 1e-3, parameter


@pytest.mark.parametrize("engine", ENGINES)
def test_a_jump_at_an_unknown_time_reaches_floors_and_base(engine: str):
    jump = {**OTHERS, "k_jump": -4.0, "k_time": Uniform(0.5, 1.5)}
    model = building(MASSES, jump)
    for name in ("mass_damping", "appendage", "base_flexibility"):
        model = placed(model, name, SIZES[name], [2])
    draw = np.array([[1.013]])
    values, slopes = (Reference().sensitivities(model, draw, shaking(2.0), CHANNELS)[i] for i in (0, 1))
    response, own = ENGINES[engine].sensitivities(model, draw, shaking(2.0), CHANNELS)
    assert nrmse(response.values, values.values) < 1e-5
    assert nrmse(own, slopes) < 1e-3


def test_normal_equations_are_the_explicit_sums_where_sensors_act():
    model = placed(building(MASSES, OTHERS, k=Uniform(5, 15)), "sensor_gain", FREE["sensor_gain"], [1, 2])
    model = placed(model, "sensor_lag", FREE["sensor_lag"], [2])
    draws = model.space.from_unit(np.random.default_rng(3).uniform(0.2, 0.8, (19, model.space.n_dim)))
    times = np.arange(shaking(2.0).n_times) * 0.04
    record = shaking(2.0).with_channels({"acceleration_1": np.cos(times), "relative_acceleration_2": np.sin(times)})
    for engine in (Lanes(n_threads=2), ScalarRk4()):
        response, slopes = engine.sensitivities(model, draws, record)
        residual = np.array(list(record.channels.values())) - response.values
        equations = engine.normal_equations(model, draws, record)
        np.testing.assert_allclose(equations.misfit, np.sum(residual**2, axis=2), rtol=1e-10)
        np.testing.assert_allclose(engine.misfit(model, draws, record), equations.misfit, rtol=1e-8)
        gradient = np.einsum("npct,nct->ncp", slopes, residual)
        np.testing.assert_allclose(equations.gradient, gradient, rtol=1e-7, atol=1e-9 * np.max(np.abs(gradient)))
        np.testing.assert_allclose(
            equations.information, np.einsum("npct,nqct->ncpq", slopes, slopes), rtol=1e-7, atol=1e-9
        )


def test_a_bad_sensor_parameter_is_a_status():
    model = placed(building(MASSES, OTHERS), "sensor_lag", {"lag": Uniform(0.0, 0.1)}, [2])
    draws = np.array([[0.03], [np.nan], [0.05]])
    for engine in (Lanes(n_threads=1), ScalarRk4()):
        response = engine.simulate(model, draws, shaking(1.0), CHANNELS)
        assert response.status.tolist() == [Status.OK, Status.NON_FINITE, Status.OK]
        assert np.all(np.isnan(response.values[1]))


def test_models_with_the_same_kinds_share_one_kernel():
    base = building(MASSES, OTHERS)
    one, two = (placed(base, name, SIZES[name], [1]) for name in ("appendage", "input_scale"))
    assert one.law == two.law == base.law
    assert kernel_of(one.law, driven=False) is kernel_of(two.law, driven=False)


def test_a_rigid_base_is_rigid_and_a_stiff_one_nearly_so():
    """From 0 to the compliance from which the inertia is exact, 1e-4 / m_b, the response changes little by little."""
    size = {"m_b": 1.0, "c_b": 0.3}
    stiff = [
        ours(placed(building(MASSES, OTHERS), "base_flexibility", {"compliance": f, **size}, None))["acceleration_2"]
        for f in (0.0, 2.5e-5, 5e-5, 1e-4)
    ]
    np.testing.assert_array_equal(stiff[0], without()["acceleration_2"])
    changes = [nrmse(response, stiff[0]) for response in stiff[1:]]
    assert 0.0 < changes[0] < changes[1] < changes[2] < 0.02


@pytest.mark.parametrize("sharpness", [2.0, 10.0])
@pytest.mark.parametrize("kind", [Lanes, ScalarRk4])
def test_a_stiff_contact_is_solved_by_few_steps(kind: type[Lanes | ScalarRk4], sharpness: float):
    """Steps foretold from the slab's speed were as long as ever where it stood still, at its turns and when it stuck.

    Its own frequency on the contact is 90 rad/s: two radians lie between samples of a ground that moves at random. The
    error was 2.8 % with an exponent of 2, and with 10, once a step had carried the contact beyond its end, no number.
    """
    stiff = {"inv_mu": 12.0, "R_s": 1.8, "m_s": 1.0, "W_s": 30.0, "Y_s": 3e-4, "n_s": sharpness}
    model = placed(building(MASSES, OTHERS, "sliding_base"), "sliding_base", stiff, None)
    ground = 3.0 * np.random.default_rng(5).standard_normal(301)
    record = Record(name="noise", time_step=0.02, excitation=ground)
    engine = kind(substeps=1, resolution=0.5)
    (values,), (expected,) = (own.simulate(model, NO_DRAW, record, CHANNELS).values for own in (engine, Reference()))
    assert nrmse(values, expected) < 2e-3


def test_a_contact_that_no_step_follows_is_solved():
    """One of 8 um below a slab at half a metre a second: responses ran away, or their derivatives, to 1e157."""
    ground = el_centro("chopra", scale=2.0, duration=6.0)
    sliders = SlidingBase(inv_mu=Uniform(8.0, 14.0), R_s=0.4, m_s=1.7, W_s=39.0, Y_s=8e-6, n_s=1.0, r_mu=0.5, a_s=30.0)
    frame = ShearBuilding(masses=[1.0, 1.0, 1.0], storey=Linear(k=400.0, c=3.0)).with_effect(sliders)
    engines = Lanes(resolution=0.5), Lanes(substeps=8, resolution=0.06)
    coarse, fine = (one.sensitivities(frame, np.array([[10.7]]), ground, CHANNELS[2:]) for one in engines)
    assert nrmse(coarse[0].values[0], fine[0].values[0]) < 0.02
    assert nrmse(coarse[1][0, 0], fine[1][0, 0]) < 0.05


SCALES = Scales(
    drift=0.2, path=8.0, drift_rate=1.0, hysteretic_displacement=0.2, energy=3.0, force=3.0, stiffness=10.0,
    damping=0.05, alpha=0.01, beta=2.0, gamma=2.0, n=1.5, mass=1.0, acceleration=1.2,
    ground_acceleration=1.0, period=2.0, onset=0.5, duration=30.0, total_mass=3, time_step=0.02,
)  # fmt: skip


def test_priors_and_starts_of_discovery():
    """Amplitudes are centred on neutral, starts lie inside the priors, and their number is small."""
    for kind in KINDS.values():
        guide = guide_of(type(kind))
        for form in guide.priors(SCALES):
            grid = guide.starts(form, SCALES)
            assert set(grid) == {s for s, value in form.values.items() if isinstance(value, Prior)}
            assert 2 <= np.prod([len(values) for values in grid.values()]) <= 20
            for symbol, values in grid.items():
                prior = form.values[symbol]
                assert isinstance(prior, Prior)
                assert all(np.isfinite(prior.log_density(value)) for value in values), symbol
            amplitude = form.parameters[0]
            prior = form.values[amplitude.symbol]
            assert isinstance(prior, Prior)
            assert amplitude.neutral in (prior.mean, prior.support[0])


def test_sliders_may_be_stiff_beside_the_drift_without_them():
    """A building shaken on a fixed base drifts by several times what it does on sliders: theirs lay below the prior."""
    (form,) = guide_of(SlidingBase).priors(SCALES)
    prior = form.values["Y_s"]
    assert isinstance(prior, Prior)
    assert np.isfinite(prior.log_density(3e-4 * SCALES.drift))
