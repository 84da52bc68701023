"""The page: complete, well formed, self-contained, escaped."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from bwbn_bayes import (
    BoucWen,
    Linear,
    Settings,
    ShearBuilding,
    Specimen,
    Uniform,
    el_centro,
    identify,
    simulate,
)
from bwbn_bayes.report import write_report
from bwbn_bayes.report.content import gather
from bwbn_bayes.results import ParameterFacts, Result

VOID = {"meta", "img", "br", "hr", "link", "input"}


class Balance(HTMLParser):
    """Counts open elements, and remembers what the tests look at."""

    def __init__(self):
        super().__init__()
        self.open, self.seen, self.images, self.headings, self.text = [], [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        if tag == "img":
            self.images.append(dict(attrs))
        if re.fullmatch(r"h\d", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data):
        self.text.append(data)


def parsed(page):
    balance = Balance()
    balance.feed(page)
    balance.close()
    assert balance.open == []
    return balance


@pytest.fixture(scope="module")
def written(result, drawings, tmp_path_factory):
    """The whole page, with the figures that ``test_figures`` looks at."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bwbn_bayes.report.figures.draw_all", lambda _: drawings)
        return write_report(result, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def page(written):
    return written.html.read_text(encoding="utf-8")


def test_files_lie_beside_the_page(written):
    assert written.html.name == "report.html"
    names = {path.stem for path in written.figures}
    assert names >= {"acceleration", "hysteresis", "posterior", "pairs", "quantities", "stages"}
    for path in written.figures:
        assert path.read_bytes().startswith(b"\x89PNG")


def test_page_is_balanced_and_its_headings_are_in_order(page):
    found = parsed(page)
    assert found.headings[0] == 1
    assert found.headings.count(1) == 1
    assert all(b - a <= 1 for a, b in zip(found.headings, found.headings[1:], strict=False))
    assert page.startswith("<!DOCTYPE html>")
    assert '<html lang="en">' in page


def test_every_parameter_stands_in_the_table_with_its_numbers(page, result):
    text = "".join(parsed(page).text)
    for parameter in result.facts.parameters:
        assert f">{parameter.name}</span>" in page
        assert parameter.prior in text
    k1 = result.facts.parameters[0]
    assert f"{k1.mean:.2f}" in text and f"{k1.sd:.2f}" in text
    assert "prior-bound" in text and "unidentified" in text


def test_page_needs_nothing_from_outside(page):
    """Only data addresses, and no scripts."""
    found = parsed(page)
    assert "script" not in found.seen and "link" not in found.seen
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:)", page)
    assert not re.search(r"url\(|@import", page)
    addresses = set(re.findall(r"https?://[^\s\"'<]+", page))
    assert addresses <= {"http://www.w3.org/1998/Math/MathML", "http://www.w3.org/2000/svg"}


def test_figures_are_embedded_with_alternative_texts(page, written):
    images = parsed(page).images
    assert len(images) == len(written.figures)
    for image in images:
        assert image["src"].startswith("data:image/png;base64,")
        assert len(image["alt"]) > 20


def test_texts_are_escaped_and_equations_are_not(page):
    assert "RSN6 180 &lt;S00E &amp; W&gt;" in page
    assert "<S00E" not in page
    assert '<math display="block"><mrow><mfrac>' in page


def test_everything_the_facts_say_is_printed(page, result):
    text = re.sub(r"\s+", " ", "".join(parsed(page).text))
    facts = result.facts
    sentences = (
        *facts.verdict,
        *facts.identifiability,
        *facts.assumptions,
        *(check.sentence for check in facts.checks),
    )
    for sentence in (*sentences, *facts.provenance.values(), *facts.evidences):
        assert sentence in text


def test_wide_tables_scroll_inside_their_own_container(page):
    for match in re.finditer(r"<table>", page):
        assert 'class="wide"' in page[: match.start()].rsplit("<div", 1)[1]


def test_a_page_with_little_in_it_renders(bare_result, tmp_path):
    files = write_report(bare_result, tmp_path / "new" / "directory")
    text = "".join(parsed(files.html.read_text(encoding="utf-8")).text)
    assert "stages.png" not in {path.name for path in files.figures}
    assert "delta_eta" in text
    assert "What an engineer asks next" in text
    assert "How far to trust it" not in text
    assert "true value" not in text


def test_a_posterior_alone_renders(bare_result, tmp_path):
    tree = bare_result.tree.copy()
    for group in list(tree.children):
        if group != "posterior":
            del tree[group]
    files = write_report(Result(tree=tree, facts=replace(bare_result.facts, nrmse={}, noise_sd={})), tmp_path)
    parsed(files.html.read_text(encoding="utf-8"))
    assert {path.name for path in files.figures} == {"posterior.png", "pairs.png"}


def test_a_parameter_with_a_hostile_name_is_escaped(bare_result, tmp_path):
    odd = ParameterFacts(name="<b>$x^[2]", symbol="<b>$x^", unit="<i>", prior="<u>", mean=1.0, sd=0.0, hdi90=(1.0, 1.0))
    tree = bare_result.tree.copy()
    tree["posterior"] = tree["posterior"].to_dataset().assign({odd.name: tree["posterior"]["n"]})
    facts = replace(bare_result.facts, parameters=(*bare_result.facts.parameters, odd))
    page = write_report(Result(tree=tree, facts=facts), tmp_path).html.read_text(encoding="utf-8")
    parsed(page)
    assert "&lt;b&gt;$x^[2]" in page
    assert "<u>" not in page


@pytest.mark.usefixtures("undrawn")
def test_window_labels_replace_a_tempering_history_that_is_not_there(make_result, tmp_path):
    """Importance runs find modes on growing windows: their stages have labels and no tempering parameter."""
    result = make_result(n_storeys=1, n_draws=20)
    stages = tuple(
        replace(stage, label=f"{5 * stage.stage} s window", tempering_parameter=float("nan"), acceptance=float("nan"))
        for stage in result.facts.stages
    )
    files = write_report(replace(result, facts=replace(result.facts, method="importance", stages=stages)), tmp_path)
    text = "".join(parsed(files.html.read_text(encoding="utf-8")).text)
    assert "15 s window" in text
    assert "tempering parameter" not in text
    assert "importance sampling" in text


def test_a_brace_is_called_by_the_nodes_that_it_joins(tmp_path):
    braced = ShearBuilding(masses=[1.0, 1.0], storey=Linear(k=Uniform(20, 60), c=0.3))
    braced = braced.with_link(Linear(k=Uniform(5, 40), c=0.1), joins=(0, 2))
    ground = el_centro("chopra", duration=4.0)
    channels = ["acceleration_1", "acceleration_2"]
    record = simulate(braced, ground, {"k[1,2]": 40.0, "k[3]": 15.0}, channels=channels, snr_db=30.0)
    result = identify(braced, record, settings=Settings(particles=100, alternatives=False))
    result.save(tmp_path / "result")
    loaded = Result.load(tmp_path / "result")
    assert gather(loaded).places == ("storey 1", "storey 2", "ground to floor 2")
    page = write_report(loaded, tmp_path / "page").html.read_text(encoding="utf-8")
    assert ", 2 storeys and 1 further link, engine" in page
    assert "storey 3" not in page.lower()


def test_a_specimen_is_not_called_a_building(pushed, tmp_path):
    specimen = Specimen(storey=BoucWen(k=Uniform(20, 120), alpha=Uniform(0, 0.5), beta=12.0, gamma=2.0, n=1.3))
    record = simulate(specimen, pushed, {"k": 60.0, "alpha": 0.15}, channels=["force"], snr_db=30.0)
    identified = identify(specimen, record, settings=Settings(particles=100))
    content = gather(identified)
    assert [loop.place for loop in content.loops] == ["the specimen"]
    np.testing.assert_array_equal(content.loops[0].measured_force, record.channels["force"])
    page = write_report(identified, tmp_path).html.read_text(encoding="utf-8")
    assert ", a specimen, engine" in page
    for word in ("storey 1", "Storey 1", "floors above", "building", "per storey"):
        assert word not in page
