"""Several records of one structure: their likelihood, noise of each, and what a sequence knows that one does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inference_cases import ENGINE

from bwbn_bayes import (
    BoucWen,
    GeneticSettings,
    HalfNormal,
    IntegratedNoise,
    KnownNoise,
    Record,
    SampledNoise,
    Settings,
    ShearBuilding,
    StrengthDegradation,
    Uniform,
    UserError,
    el_centro,
    identify,
    join_records,
    simulate,
    write_report,
)
from bwbn_bayes.inference.likelihood import Noise, Posterior, default_noise
from bwbn_bayes.records.joined import JoinedRecord
from bwbn_bayes.results import Result

TRUTH = {"k": 40.0, "beta": 30.0, "delta_nu": 0.2}
STOREY = BoucWen(k=Uniform(20, 60), c=0.2, alpha=0.1, A=1.0, beta=Uniform(1, 80), gamma=15.0, n=1.3)
MODEL = ShearBuilding(masses=[1.0], storey=STOREY).with_effect(StrengthDegradation(delta_nu=Uniform(0, 2)))
GROUND = el_centro("chopra", duration=16.0)
FIRST = replace(GROUND.between(0.0, 7.0), name="first")
SECOND = replace(GROUND.between(1.0, 9.0), name="second", excitation=0.8 * GROUND.between(1.0, 9.0).excitation)


def measured(*, in_sequence: bool, snr_db: float = 25.0) -> JoinedRecord:
    """Both records by the reference engine, the second with noise of its own level."""
    clean = simulate(MODEL, join_records([FIRST, SECOND], in_sequence=in_sequence), TRUTH)
    rng = np.random.default_rng(5)
    parts = []
    for part, times in zip(clean.parts, (1.0, 4.0), strict=True):
        signal = part.channels["acceleration_1"]
        sd = times * 10.0 ** (-snr_db / 20.0) * np.sqrt(np.mean(signal**2))
        noisy = {"acceleration_1": signal + sd * rng.normal(size=part.n_times)}
        parts.append(part.with_channels(noisy, noise_sd={"acceleration_1": sd}))
    return join_records(parts, in_sequence=in_sequence)


VIRGIN = measured(in_sequence=False)
SEQUENCE = measured(in_sequence=True)
LABELS = ("acceleration_1 of first", "acceleration_1 of second")


def posterior(record: Record, noise: Noise | None = None) -> Posterior:
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=noise or default_noise(record))


KINDS: dict[str, tuple[Noise, tuple[Noise, Noise]]] = {
    "integrated": (
        IntegratedNoise(shape=1.5, scale=(0.02, 0.3), correlation_samples=(1.0, 2.0)),
        (
            IntegratedNoise(shape=1.5, scale=(0.02,)),
            IntegratedNoise(shape=1.5, scale=(0.3,), correlation_samples=2.0),
        ),
    ),
    "known": (KnownNoise(sd=(0.1, 0.4)), (KnownNoise(sd=(0.1,)), KnownNoise(sd=(0.4,)))),
    "default": (default_noise(VIRGIN), tuple(default_noise(part) for part in VIRGIN.parts)),  # type: ignore[dict-item]
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_likelihood_of_virgin_records_is_the_sum_of_theirs(kind: str) -> None:
    together, apart = KINDS[kind]
    points = posterior(VIRGIN).sample_prior(np.random.default_rng(1), 6)
    whole = posterior(VIRGIN, together).linearise(points)
    each = [posterior(part, noise).linearise(points) for part, noise in zip(VIRGIN.parts, apart, strict=True)]
    for field in ("log_likelihood", "gradient", "information"):
        np.testing.assert_allclose(getattr(whole, field), sum(getattr(one, field) for one in each), rtol=1e-9)


def test_sampled_noise_has_a_scale_for_each_record() -> None:
    noise = SampledNoise(channels=LABELS, priors=(HalfNormal(0.5), HalfNormal(0.5)))
    assert [p.name for p in noise.parameters] == [f"noise_sd[{label}]" for label in LABELS]
    target, rng = posterior(VIRGIN, noise), np.random.default_rng(2)
    points = 0.3 + 0.4 * rng.random((4, 5))
    known = [
        posterior(VIRGIN, KnownNoise(sd=tuple(sd))).log_likelihood(point[None, :3])[0]
        for point, sd in zip(points, target.split(points)[1].tolist(), strict=True)
    ]
    np.testing.assert_allclose(target.log_likelihood(points), known, rtol=1e-10)
    local, step = target.linearise(points), 1e-5
    for column in (3, 4):
        up, down = points.copy(), points.copy()
        up[:, column] += step
        down[:, column] -= step
        slope = (target.log_likelihood(up) - target.log_likelihood(down)) / (2.0 * step)
        np.testing.assert_allclose(local.gradient[:, column], slope, rtol=1e-4)


def test_the_first_seconds_know_nothing_of_the_second_record() -> None:
    """Its noise scales stay, and say nothing."""
    points = posterior(SEQUENCE).sample_prior(np.random.default_rng(1), 4)
    noise = default_noise(SEQUENCE)
    assert isinstance(noise, IntegratedNoise)
    alone = replace(noise, scale=noise.scale[:1])
    early = posterior(SEQUENCE, noise).until(FIRST.duration).linearise(points)
    first = posterior(SEQUENCE.parts[0], alone).linearise(points)
    np.testing.assert_allclose(early.log_likelihood, first.log_likelihood, rtol=1e-10)
    np.testing.assert_allclose(early.information, first.information, rtol=1e-9)


@pytest.fixture(scope="module")
def identified() -> dict[str, Result]:
    settings = Settings(particles=500, seed=1)
    return {
        "virgin": identify(MODEL, VIRGIN, settings=settings),
        "in sequence": identify(MODEL, SEQUENCE, settings=settings),
    }


@pytest.mark.parametrize("kind", ["virgin", "in sequence"])
def test_both_are_identified_with_the_noise_of_each(identified: dict[str, Result], kind: str) -> None:
    result = identified[kind]
    record = {"virgin": VIRGIN, "in sequence": SEQUENCE}[kind]
    assert result.facts.grade == "explains"
    for parameter in result.facts.parameters:
        assert abs(parameter.mean - TRUTH[parameter.name]) < 4.0 * parameter.sd
    assert tuple(result.facts.nrmse) == tuple(result.facts.noise_sd) == LABELS
    for label, part in zip(LABELS, record.parts, strict=True):
        assert result.facts.noise_sd[label] == pytest.approx(part.noise_sd["acceleration_1"], rel=0.15)
    assert result.tree["posterior"]["noise_sd"].coords["channel"].values.tolist() == list(LABELS)
    observed = result.tree["observed_data"]["measured"].values[0]
    np.testing.assert_array_equal(observed, record.measured[0])


def test_a_sequence_tells_more_of_damage_than_two_virgin_records(identified: dict[str, Result]) -> None:
    virgin, sequence = (
        next(p.sd for p in identified[kind].facts.parameters if p.name == "delta_nu")
        for kind in ("virgin", "in sequence")
    )
    assert sequence < virgin


def test_a_sequence_taken_for_virgin_records_is_not_explained() -> None:
    wrong = join_records(SEQUENCE.parts)
    result = identify(MODEL, wrong, settings=Settings(particles=200, seed=1))
    assert result.facts.grade == "refused"


def test_where_nothing_was_measured_nothing_is_counted_nor_drawn(tmp_path: Path) -> None:
    """A pause between the records: no likelihood, no observed data; the report draws the rest."""
    pause = Record(name="pause", time_step=0.02, excitation=np.zeros(50))
    first = VIRGIN.parts[0]
    record = join_records([first, pause, first], in_sequence=True)
    result = identify(MODEL, record, settings=Settings(particles=200, seed=1, alternatives=False))
    observed = result.tree["observed_data"]["measured"].values[0]
    density = result.tree["log_likelihood"]["measured"].values
    n = first.n_times
    assert np.all(np.isnan(observed[n : n + 50]))
    assert np.all(np.isfinite(observed[:n]))
    assert density.shape[-1] == 2 * n
    assert np.all(density != 0.0)
    write_report(result, tmp_path)


@pytest.mark.parametrize("method", ["ga", "ipv"])
def test_baselines_take_one_record(method: str) -> None:
    options = GeneticSettings() if method == "ga" else None
    with pytest.raises(UserError, match="joins 2 records"):
        identify(MODEL, VIRGIN, settings=Settings(method=method), options=options)


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        (KnownNoise(sd=(0.1,)), "1 scales for 2 channels"),
        (IntegratedNoise(shape=1.0, scale=(0.1, 0.1), correlation_samples=(1.0, 0.5)), "or one for each channel"),
        (SampledNoise(channels=("acceleration_1",), priors=(HalfNormal(1.0),)), "acceleration_1 of second"),
    ],
)
def test_noise_of_another_number_of_records_is_refused(noise: Noise, message: str) -> None:
    with pytest.raises(UserError, match=message):
        identify(MODEL, VIRGIN, noise=noise)
