"""A link that a building lacks: whether it is found between the right nodes, with its stiffness, of either sign."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.inference.residuals import leaves_noise
from bwbn_bayes.inference.unnamed.further_link import Span, further_links, spans
from bwbn_bayes.parameters import Floats, PerStorey, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

STEP = 0.02
TIMES = STEP * np.arange(700)
GROUND = 2.5 * np.sin(2.0 * np.pi * 0.8 * TIMES) * np.minimum(TIMES / 4.0, 1.0) + np.sin(11.0 * TIMES)
NOISE = 0.01
MODEL = ShearBuilding(
    masses=(1.0, 1.0, 1.0),
    storey=BoucWen(k=PerStorey(Uniform(30.0, 120.0)), c=0.5, alpha=Uniform(0.05, 0.9), beta=2.0, gamma=2.0, n=1.0),
)


def record_of(stiffness: dict[tuple[int, int], float], bending: float = 0.0) -> Record:
    """Floor accelerations by SciPy: springs between any two nodes, and one against the drifts of storeys 1 and 2."""
    k, c, alpha, beta, gamma = np.array([70.0, 60.0, 50.0]), 0.5, 0.3, 2.0, 2.0

    def rates(t: float, y: Floats) -> Floats:
        x, rate, z = y[0:3], y[3:6], y[6:9]
        u, v = x.copy(), rate.copy()
        u[1:] -= x[:-1]
        v[1:] -= rate[:-1]
        force = c * v + alpha * k * u + (1.0 - alpha) * k * z
        force[:2] += bending * (u[0] - u[1]) * np.array([1.0, -1.0])
        floors = -force
        floors[:-1] += force[1:]
        for (lower, upper), own in stiffness.items():
            pull = own * (x[upper - 1] - (x[lower - 1] if lower else 0.0))
            floors[upper - 1] -= pull
            if lower:
                floors[lower - 1] += pull
        return np.concatenate(
            [rate, floors - np.interp(t, TIMES, GROUND), v - beta * np.abs(v) * z - gamma * v * np.abs(z)]
        )

    found = solve_ivp(rates, (0.0, TIMES[-1]), np.zeros(9), t_eval=TIMES, rtol=1e-9, atol=1e-11, max_step=0.01)
    total = np.array([rates(t, y)[3:6] for t, y in zip(TIMES, found.y.T, strict=True)]).T + GROUND
    shown = total + NOISE * np.random.default_rng(4).standard_normal(total.shape)
    channels = {f"acceleration_{i}": own for i, own in enumerate(shown, start=1)}
    return Record(name="shaken", time_step=STEP, excitation=GROUND, channels=channels)


def fitted(record: Record) -> tuple[Posterior, tuple[Mode, ...]]:
    noise = IntegratedNoise(shape=1.0, scale=(NOISE**2,) * 3)
    posterior = Posterior(model=MODEL, record=record, engine=Lanes(substeps=4, n_threads=1), noise=noise)
    starts = np.random.default_rng(2).uniform(0.2, 0.8, (8, posterior.space.n_dim))
    return posterior, distinct(*polish(posterior, starts, n_iterations=30))[:3]


def evidences(record: Record) -> tuple[float, dict[Span, tuple[float, float, bool]]]:
    """Log evidence of the model alone; by link, with it, its stiffness, and whether noise is left."""
    posterior, modes = fitted(record)
    found = {}
    for one in further_links(posterior, np.array([mode.point for mode in modes])):
        evidence = laplace(one.posterior, one.modes)
        is_noise = leaves_noise(one.posterior, one.modes[0].point)
        found[one.span] = (evidence.log_evidence, evidence.means["k[4]"], is_noise)
    return laplace(posterior, modes).log_evidence, found


def test_links_are_tried_where_there_is_none() -> None:
    assert spans(MODEL) == (Span(0, 2), Span(1, 3), Span(0, 3))
    braced = MODEL.with_link(BoucWen(k=5.0, c=0.0, alpha=0.3, beta=2.0, gamma=2.0, n=1.0), joins=(1, 3))
    assert spans(braced) == (Span(0, 2), Span(0, 3))


@pytest.mark.parametrize("span", [Span(0, 2), Span(1, 3)])
def test_a_brace_past_a_floor_is_found_with_its_stiffness(span: Span) -> None:
    alone, found = evidences(record_of({(span.lower, span.upper): 12.0}))
    best = max(found, key=lambda one: found[one][0])
    assert best == span
    log_evidence, stiffness, is_noise = found[span]
    assert log_evidence > alone + 100.0
    assert stiffness == pytest.approx(12.0, rel=0.05)
    assert is_noise


def test_bending_at_one_floor_is_a_negative_link_past_it() -> None:
    """The energy of a difference of drifts: twice that of either storey less that of the link past the floor."""
    _, found = evidences(record_of({}, bending=8.0))
    best = max(found, key=lambda one: found[one][0])
    assert best == Span(0, 2)
    assert found[best][1] == pytest.approx(-8.0, rel=0.15)


def test_where_no_link_is_missing_none_pays() -> None:
    alone, found = evidences(record_of({}))
    assert all(log_evidence < alone - 1.0 for log_evidence, *_ in found.values())
