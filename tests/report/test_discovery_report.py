"""The page of a discovery, for every verdict: complete, self-contained, and saying what was found."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from nameless import force_without_a_name

from bwbn_bayes.discovery.held_out import HeldOut
from bwbn_bayes.discovery.outcome import SignatureFacts, UnnamedForce, UnnamedReading
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.sentences import probability_in_words
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import capital
from bwbn_bayes.elements.effects import CubicStiffness, SensorGain, StrengthDegradation
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.report import discovery_tables as tables
from bwbn_bayes.report import write_discovery
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.discovery_content import gather_discovery
from bwbn_bayes.report.discovery_text import discovery_in_words
from bwbn_bayes.report.figures import draw_all
from bwbn_bayes.report.numbers import NOTHING
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

MODEL = ShearBuilding(
    masses=[2.0],
    heights=[3.0],
    storey=BoucWen(k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=0.15, beta=12.0, gamma=2.0, n=1.3),
)


@pytest.fixture(scope="module")
def found():
    """A short discovery of a cubic spring, with held-out data; the model's name needs escaping."""
    hidden = MODEL.with_effect(CubicStiffness(k3=900.0))
    record, held_out = (
        replace(simulate(hidden, el_centro(version, duration=8.0), {"k": 60.0, "c": 0.4}, snr_db=30.0), truth={})
        for version in ("chopra", "rsn6_180")
    )
    settings = DiscoverySettings(effects=(CubicStiffness, SensorGain), particles=200, n_workers=1)
    return discover(MODEL, record, held_out=held_out, settings=settings, name="a <frame> & more")


def variants(found):
    """The same discovery under every verdict, and without held-out data."""
    drift = found.histories["after"]["drift"][0]
    unnamed = force_without_a_name(
        0.97, 0.12, any_probability=0.98, place="storey <1>", state=drift, force=np.sin(40.0 * drift)
    )
    reading = UnnamedReading(
        channel="acceleration_1", probability=0.97, any_probability=0.98, share=0.12,
        function="of what the sensor shows", shown=drift, error=drift**3,
    )  # fmt: skip
    beside = replace(found.gap, nameless=found.gap.after)
    alone = replace(found.gap, held_out=None)
    step = replace(found.steps[0], sentence="Nothing <more> was found.")
    given = {"added": (), "improved": found.model, "after": found.before}
    return {
        "effects_found": found,
        "partly_explained": replace(found, verdict="partly_explained", unnamed=unnamed),
        "unexplained": replace(found, verdict="unexplained", unnamed=reading, gap=beside, **given),
        "no_missing_effect": replace(
            found, verdict="no_missing_effect", gap=alone, held_out=None, steps=(step,), limits=(), **given
        ),
    }


@pytest.fixture(scope="module")
def identified(found):
    """Figures of the report in ``identify/``, which is that of the same result under every verdict."""
    return draw_all(gather(found.result))


@pytest.fixture(scope="module", params=list(range(4)))
def case(request, found, identified, tmp_path_factory):
    name, discovery = list(variants(found).items())[request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bwbn_bayes.report.figures.draw_all", lambda _: identified)
        files = write_discovery(discovery, tmp_path_factory.mktemp("page") / "new")
    return name, discovery, files, files.html.read_text(encoding="utf-8")


class Reader(HTMLParser):
    """Open elements, images and text."""

    def __init__(self):
        super().__init__()
        self.open, self.images, self.words = [], [], []

    def handle_starttag(self, tag, attributes):
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        if tag == "img":
            self.images.append(dict(attributes))

    def handle_startendtag(self, tag, attributes):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def read(page):
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    return reader, re.sub(r"\s+", " ", "".join(reader.words))


def test_every_verdict_renders_with_its_sentences_and_figures(case):
    name, discovery, files, page = case
    reader, text = read(page)
    for sentence in (*discovery.sentences, *(step.sentence for step in discovery.steps)):
        assert sentence in text
    names = {path.name for path in files.figures}
    assert {"history_fitted.png", "gap.png", "where_time.png", "where_state.png", "hysteresis.png"} <= names
    assert ("history_held_out.png" in names) == (discovery.held_out is not None)
    assert len(reader.images) == len(files.figures)
    assert all(len(image["alt"]) > 20 for image in reader.images)
    assert ("posterior.png" in names) == bool(discovery.added)
    assert ("The equations that changed" in text) == bool(discovery.added)
    for kind, title, figure in (
        (UnnamedForce, "The force of no known law", "unnamed_force.png"),
        (UnnamedReading, "The error of no known kind", "unnamed_reading.png"),
    ):
        assert (title in text) == (figure in names) == isinstance(discovery.unnamed, kind)
    sure = "the probability that it is there is 0.97, that anything without a name is part of the model 0.98"
    assert (sure in text) == (discovery.unnamed is not None)
    laws = {s for one in discovery.added if one.hypothesis.effect.level == "link" for s in one.hypothesis.storeys}
    assert ("hysteresis_named.png" in names) == (0 < len(laws) < discovery.model.n_links)
    assert "explanations.png" in names
    assert ("No held-out record" in text) == (discovery.held_out is None)
    assert (files.html.parent / "identify" / "report.html").is_file()
    assert name == discovery.verdict


def test_the_page_needs_nothing_from_outside_and_escapes_names(case):
    *_, page = case
    assert "<script" not in page
    assert set(re.findall(r"(?:src|href)\s*=\s*[\"'](?!data:)([^\"']*)", page)) == {"identify/report.html"}
    assert not re.search(r"url\(|@import", page)
    assert "a &lt;frame&gt; &amp; more" in page
    assert "<frame>" not in page
    assert "storey <1>" not in page and "<more>" not in page


@pytest.mark.usefixtures("undrawn")
def test_what_was_found_stands_in_the_page(found, tmp_path):
    page = write_discovery(found, tmp_path).html.read_text(encoding="utf-8")
    _, text = read(page)
    (added,) = found.added
    mean, sd = added.moments["k3"]
    assert "cubic stiffness in storey 1" in text
    assert "overwhelming" in text
    assert "probability of the name" in text and "probability that it is part of the model" not in text
    assert f"{added.log_bayes_factor:.0f} nats" in text
    assert f"{100 * found.gap.before.nrmse:.1f}" in text and f"{100 * found.gap.after.nrmse:.1f}" in text
    signature = added.signature
    assert f"<td>{signature.mean:.2g}</td><td>{signature.low:.2g} to {signature.high:.2g}</td>" in page
    assert f"<td>{mean:.0f}</td><td>{float(f'{sd:.1e}'):.0f}</td>" in page


def test_the_probability_beside_a_title_is_that_of_the_title(found):
    """Tile and table said "overwhelming", "below 0.01" of a plain name: that was the probability of the other one."""
    (added,) = found.added
    plain = replace(added, signature=replace(added.signature, deserved=0.001))
    assert plain.title == "the curvature of the force over drift (Duffing's law) in storey 1"
    one = replace(found, added=(plain,))
    sure = probability_in_words(added.law_probability)
    tile = tables.discovery_key_figures(one)[0]
    assert (tile.value, tile.label.startswith(f"{plain.title}: overwhelming evidence")) == (sure, True)
    assert tables.effects_table((plain,)).rows[0][:3] == (capital(plain.title), "overwhelming", sure)
    (note,) = tables.effect_notes((plain,))
    assert "what the law of cubic stiffness does here, which has not earned that name" in note
    assert "It deserves the name cubic stiffness from a least size on: " in note


def test_a_signature_that_could_not_be_measured_has_dashes(found):
    (added,) = found.added
    unknown = SignatureFacts.of_none("pinching index", "", "it takes a motion that comes back through zero")
    ((*_, deserved),) = tables.signatures_table((replace(added, signature=unknown),)).rows
    assert deserved == NOTHING


@pytest.mark.usefixtures("undrawn")
def test_drifts_are_told_as_ratios_of_the_storey_height(found, tmp_path):
    (ratio,) = gather_discovery(found).drift_ratios
    drift = found.result.tree["quantities"]["peak_drift"]
    np.testing.assert_allclose(ratio.band.middle, 100.0 * drift.mean("draw") / 3.0, rtol=1e-6)  # single precision
    np.testing.assert_allclose(found.result.tree["constant_data"]["height"], [3.0])
    files = write_discovery(found, tmp_path)
    for page in (files.html, tmp_path / "identify" / "report.html"):
        assert "peak drift ratio [%]" in page.read_text(encoding="utf-8")


def test_what_a_brace_lacks_is_told_without_a_measured_force():
    """No equilibrium of floors tells the force of a brace, or of a storey beside one; the page of a discovery broke."""
    braced = two_storeys().with_link(BoucWen(**STIFF_BRACE), joins=(0, 2))
    hidden = braced.with_effect(StrengthDegradation(delta_nu=2.0), storeys=[3])
    ground = el_centro("chopra", duration=8.0)
    record = replace(simulate(hidden, ground, {"k[1,2]": 60.0}, snr_db=40.0), truth={})
    settings = DiscoverySettings(effects=(StrengthDegradation,), particles=50, n_workers=1)
    found = discover(braced, record, settings=settings)
    assert [(one.hypothesis.name, one.hypothesis.storeys) for one in found.added] == [("strength_degradation", (3,))]
    assert found.added[0].signature.measured is None
    loops = gather_discovery(found).loops
    assert [loop.title for loop in loops] == ["Storey 1", "Storey 2", "Ground to floor 2"]
    assert all(loop.measured is None for loop in loops)


def two_storeys():
    storey = BoucWen(k=Uniform(20, 120), c=0.4, alpha=0.15, beta=12.0, gamma=2.0, n=1.3)
    return ShearBuilding(masses=[2.0, 1.0], storey=storey)


STIFF_BRACE = {"k": 40.0, "c": 0.0, "alpha": 0.05, "beta": 200.0, "gamma": 100.0, "n": 1.3}


def test_old_and_new_equations_are_those_that_differ(found):
    content = gather_discovery(found)
    assert [e.caption for e in content.old_equations] == [e.caption for e in content.new_equations]
    assert all(old.mathml != new.mathml for old, new in zip(content.old_equations, content.new_equations, strict=True))
    assert 1 <= len(content.new_equations) <= 2
    # The report of the final model shows them, and nothing else that was searched.
    final = [e.mathml for e in structure_equations(found.improved)]
    assert [e.mathml for e in found.result.facts.equations] == final


def test_bars_are_the_explanations_best_first_and_the_improved_model_is_marked(found):
    content = gather_discovery(found)
    bars = content.explanations
    assert [bar.probability for bar in bars] == sorted((bar.probability for bar in bars), reverse=True)
    assert bars[0].log_odds == 0.0
    (added,) = found.added
    assert {bar.chosen for bar in bars if added.hypothesis.label in bar.label} == {True}
    assert {bar.chosen for bar in bars if bar.label == "the model as given"} <= {False}


def test_the_words_for_the_terminal(found):
    lines = discovery_in_words(found)
    assert lines[0] == "verdict: effects_found"
    assert any(line.startswith("Cubic stiffness in storey 1: overwhelming evidence (") for line in lines)
    assert any(line.strip().startswith("k3 = ") and line.endswith("N/m^3") for line in lines)
    assert any(line.startswith("The next best set of laws, ") and line.endswith(" behind.") for line in lines)
    assert sum("noise alone leaves" in line for line in lines) == 2
    none = discovery_in_words(variants(found)["no_missing_effect"])
    assert none == ("verdict: no_missing_effect", *found.sentences)


def test_a_prediction_that_runs_away_is_told_in_words(found, tmp_path):
    """The page said 1.3e14 % of a specimen's held-out end, and drew nothing else in that scale."""
    assert found.gap.held_out is not None
    lost = replace(found.gap.held_out.before, nrmse=1.3e12, nrmse_se=1e12, runs_away_after="t = 5 s",
                   values=1e12 * found.gap.held_out.before.values)  # fmt: skip
    away = replace(found, gap=replace(found.gap, held_out=replace(found.gap.held_out, before=lost)))
    _, text = read(write_discovery(away, tmp_path).html.read_text(encoding="utf-8"))
    assert "as given, away after t = 5 s" in text
    assert not re.search(r"e\+1\d|10¹|\d{6,} %", text)
    assert gather_discovery(away).gaps[1].before.error_in_words == "the prediction runs away after t = 5 s"


@pytest.mark.usefixtures("undrawn")
def test_a_held_out_end_is_called_so_everywhere(found, tmp_path):
    label = "held-out end, after 6.2 s"
    apart = HeldOut(record=found.record, after_s=6.2)
    ends = {
        name: replace(getattr(found.gap, name), values=getattr(found.gap, name).values[:, apart.first :])
        for name in ("before", "after")
    }
    ended = replace(found, held_out=apart, gap=replace(found.gap, held_out=replace(found.gap, **ends)))
    assert [gap.label for gap in gather_discovery(ended).gaps] == ["fitted record", label]
    _, text = read(write_discovery(ended, tmp_path).html.read_text(encoding="utf-8"))
    assert f"{label}: {found.record.name}" in text
    assert f"error on the {label}; noise alone" in text
    assert "held-out record" not in text
    assert ended.as_json()["gap"]["held_out"]["after_s"] == 6.2


def test_a_specimen_is_not_called_a_building(pushed, tmp_path):
    specimen = Specimen(storey=BoucWen(k=Uniform(20, 120), alpha=0.15, beta=12.0, gamma=2.0, n=1.3))
    hidden = specimen.with_effect(CubicStiffness(k3=2000.0))
    record = replace(simulate(hidden, pushed, {"k": 60.0}, channels=["force"], snr_db=30.0), truth={})
    discovery = discover(specimen, record, settings=DiscoverySettings(effects=(CubicStiffness,), particles=100))
    lines = discovery_in_words(discovery)
    page = write_discovery(discovery, tmp_path).html.read_text(encoding="utf-8")
    assert discovery.verdict == "effects_found"
    assert any(line.startswith("Cubic stiffness: overwhelming evidence (") for line in lines)
    assert "a specimen, 1 channel, 8 s" in page
    assert (tmp_path / "loops_by_cycle.png").is_file() and (tmp_path / "error_by_cycle.png").is_file()
    for word in ("storey 1", "Storey 1", "floors above", "accelerations) over"):
        assert word not in page
