"""The improved model's file: read back, it is the same model, for every effect of the catalogue."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bwbn_bayes
from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses
from bwbn_bayes.discovery.improved_model import improved_model_source
from bwbn_bayes.discovery.outcome import Added, SignatureFacts
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects import SlipLock, StiffnessDegradation
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.engines.available import engine
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, LogNormal, Normal, PerStorey, Uniform
from bwbn_bayes.records.excitation import sine
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

BASE = ShearBuilding(
    masses=[1.0, 1.0 / 3.0],
    storey=BoucWen(
        k=PerStorey([Uniform(5, 60), Normal(20.0, 3.0)]),
        c=PerStorey(LogNormal(0.1, 0.5)),
        alpha=HalfNormal(0.1).truncated(0.001, 0.3),
        beta=Uniform(0.1, 8),
        gamma=0.7,
    ),
)
SCALES = Scales(
    drift=0.2, path=8.0, drift_rate=1.0, hysteretic_displacement=0.15, energy=8.0, force=4.0, stiffness=25.0,
    damping=0.1, alpha=0.05, beta=2.0, gamma=1.0, n=1.5, mass=1.0, acceleration=1.0,
    ground_acceleration=1.0, period=1.3, onset=1.0, duration=20.0, total_mass=3, time_step=0.02,
)  # fmt: skip
CHANNELS = ("acceleration_1", "acceleration_2")
LINEAR = ShearBuilding(masses=[1.0, 2.0], storey=Linear(k=PerStorey(Uniform(5, 60)), c=0.2))
EVERY = [
    *hypotheses(BASE, [SCALES, SCALES], measured=CHANNELS),
    *(h for h in hypotheses(LINEAR, [SCALES, SCALES], measured=CHANNELS) if h.name == "hysteresis"),
]
ONE_PLACE = [h for h in EVERY if h.storeys in ((), (2,))]


def found(hypothesis: Hypothesis) -> Added:
    return Added(
        hypothesis=hypothesis,
        probability=0.998,
        place_probability=0.99,
        log_bayes_factor=321.25,
        log_bayes_factor_se=0.2,
        equivalent=(),
        equivalent_places=(),
        signature=None,
        borne_out=1.0,
        moments=dict.fromkeys(hypothesis.brought, (0.12345678, 0.01)),
    )


def read_back(source: str, directory: Path) -> Structure:
    path = directory / "improved_model.py"
    path.write_text(source, encoding="utf-8")
    return load_model_file(path).model


def test_every_registered_effect_is_among_the_hypotheses() -> None:
    assert {h.name for h in ONE_PLACE} == {effect.name for effect in registered()} - {"p_delta"}


@pytest.mark.parametrize("hypothesis", ONE_PLACE, ids=lambda h: h.label)
def test_the_file_gives_the_same_model(hypothesis: Hypothesis, tmp_path: Path) -> None:
    """Names, places and known values exactly; the priors that discovery chose to four digits."""
    model = replace(hypothesis.model, carried=())
    again = read_back(improved_model_source(model, [found(hypothesis)]), tmp_path)
    assert again.space.names == model.space.names
    assert again.element == model.element
    assert [one.storeys for one in again.effects] == [one.storeys for one in model.effects]
    assert np.array_equal(again.table.index, model.table.index)
    np.testing.assert_allclose(again.table.fixed, model.table.fixed, rtol=1e-3)
    for mine, theirs in zip(again.space.parameters, model.space.parameters, strict=True):
        assert type(mine.prior) is type(theirs.prior)
        np.testing.assert_allclose(
            mine.prior.quantile(np.array([0.01, 0.3, 0.9])),
            theirs.prior.quantile(np.array([0.01, 0.3, 0.9])),
            rtol=2e-3,
        )
    # The same law with the same values: the same response.
    assert (again.law, again.sensors, again.conditions) == (model.law, model.sensors, model.conditions)


def test_without_discovery_the_file_gives_the_model_exactly() -> None:
    """A user's own numbers keep every digit: the dataclasses compare equal, one third included."""
    model = BASE.with_effect(SlipLock(delta_s=Uniform(0.0, 1.0 / 3.0), sigma=0.05), storeys=[1])
    model = model.with_effect(StiffnessDegradation(delta_eta=PerStorey(HalfNormal(0.1))))
    names: dict[str, object] = {}
    exec(improved_model_source(model), names)
    assert names["model"] == model


def test_storey_heights_are_kept(tmp_path: Path) -> None:
    model = replace(BASE, heights=[3.2] * BASE.n_floors)
    assert read_back(improved_model_source(model), tmp_path) == model


def test_a_specimen(tmp_path: Path) -> None:
    model = Specimen(storey=BoucWen(k=Uniform(1e3, 1e5), beta=100.0, gamma=-20.0)).with_effect(
        SlipLock(delta_s=HalfNormal(0.01), sigma=Uniform(0.001, 0.01))
    )
    again = read_back(improved_model_source(model), tmp_path)
    assert again == model


def test_the_response_is_the_same(tmp_path: Path) -> None:
    hypothesis = next(h for h in ONE_PLACE if h.name == "cubic_stiffness")
    model = replace(hypothesis.model, carried=())
    again = read_back(improved_model_source(model, [found(hypothesis)]), tmp_path)
    record = sine(amplitude=1.5, frequency_hz=0.8, duration=3.0, time_step=0.02)
    draw = model.space.from_unit(np.full((1, model.space.n_dim), 0.6))
    mine, theirs = (engine("reference").simulate(m, draw, record, CHANNELS).values for m in (again, model))
    assert np.array_equal(mine, theirs)
    assert float(np.std(mine)) > 0.0


def test_the_comment_of_a_plain_name_claims_no_other() -> None:
    """It said of a law that pinches nothing that the joint slips, with the probability of the law."""
    signature = SignatureFacts.of_none("pinching index", "", "it takes a motion that comes back through zero")
    one = replace(found(next(h for h in ONE_PLACE if h.name == "slip_lock")), signature=signature)
    text = " ".join(line.lstrip("# ") for line in improved_model_source(one.hypothesis.model, [one]).splitlines())
    assert "the shape of the reloading branch (Baber and Noori's law) in storey 2: what the law of slip-lock" in text
    assert "the joint slips" not in text
    assert "Probability 0.998, log Bayes factor 321.2 +- 0.2." in text


def test_the_comment_says_what_and_how_much() -> None:
    hypothesis = next(h for h in ONE_PLACE if h.name == "slip_lock")
    source = improved_model_source(hypothesis.model, [found(hypothesis)], name="my_frame")
    text = " ".join(line.lstrip("# ") for line in source.splitlines())
    assert source.startswith('"""my_frame with what discovery found missing: slip-lock pinching in storey 2.')
    assert "Probability 0.998, log Bayes factor 321.2 +- 0.2." in text
    assert "delta_s[2] = 0.1235 +- 0.01 m/J" in text
    assert "storeys=[2]" in source
    assert max(map(len, source.splitlines())) <= 120


def test_the_record_is_read_from_beside_the_file() -> None:
    source = improved_model_source(BASE, record_files=["record.csv"])
    assert 'record = read_record(Path(__file__).with_name("record.csv"))' in source
    assert "from pathlib import Path" in source


OWN = """
from dataclasses import dataclass, replace
from typing import ClassVar
from bwbn_bayes import BoucWen, ShearBuilding, SlipLock, Uniform
from bwbn_bayes.parameters import Uniform

@dataclass(frozen=True)
class Wide(Uniform):
    pass

model = ShearBuilding(masses=[1.0], storey=BoucWen(k=Wide(5, 60), beta=1.0, gamma=1.0))
"""


def test_a_class_of_the_users_own_comes_from_the_given_file(tmp_path: Path) -> None:
    given = tmp_path / "given.py"
    given.write_text(OWN, encoding="utf-8")
    model = load_model_file(given).model
    with pytest.raises(UserError, match="Wide is not part of the package"):
        improved_model_source(model)
    again = read_back(improved_model_source(model, origin=given), tmp_path)
    assert again.space.names == ("k",)
    assert again.space.parameters[0].prior.support == (5.0, 60.0)
    assert type(again.space.parameters[0].prior).__name__ == "Wide"


def test_what_a_file_may_need_is_public() -> None:
    needed = {"Specimen", "ShearBuilding", "BoucWen", "Uniform", "Normal", "HalfNormal", "LogNormal", "PerStorey"}
    assert needed | {effect.__name__ for effect in registered()} <= set(bwbn_bayes.__all__)


@pytest.mark.parametrize(
    "hostile",
    [
        "two\nlines",
        'a "quote"',
        '"""',
        "\\",
        "ends in \\",
        "\x1b[31mred",
        "\x00",
        "\r",
        "\u2028",
        "\ud800",
        "{braces} %s",
    ],
)
def test_what_a_user_calls_things_stays_text(hostile: str, tmp_path: Path) -> None:
    """A newline or quotes in an assumption or a name made a file that was no Python, or other Python."""
    source = improved_model_source(BASE, name=hostile, record_files=[hostile], assumptions=[hostile])
    path = tmp_path / "improved_model.py"
    path.write_text(source, encoding="utf-8")
    names: dict[str, object] = {}
    exec(compile(source.split("\nrecord = ")[0], "improved_model.py", "exec"), names)
    assert names["model"] == BASE
    module = ast.parse(source)
    (assumptions,) = (node.value for node in module.body if isinstance(node, ast.Assign) and "assum" in ast.dump(node))
    assert ast.literal_eval(assumptions) == [hostile]
    assert all(each.isprintable() or each == "\n" for each in source)
