"""Figures show something, stay small and leave Matplotlib as it was."""

import re
from dataclasses import replace
from io import BytesIO

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from bwbn_bayes.report import content as content_module
from bwbn_bayes.report import figures
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.figures import draw_all
from bwbn_bayes.results import POINTS

NAMES = {"acceleration.png", "acceleration_zoom.png", "residual.png", "hysteresis.png", "drift.png", "quantities.png",
         "posterior.png", "learned.png", "pairs.png", "stages.png"}  # fmt: skip


def only(content, **kept):
    """The content with nothing to draw but what is kept."""
    nothing = dict.fromkeys(("traces", "loops", "histories", "marginals", "pairs"), ())
    facts = replace(content.facts, stages=())
    return replace(content, **(nothing | {"period": None, "facts": facts} | kept))


def has_blue(drawing):
    """Share of pixels that are clearly blue: the identified colour."""
    pixels = np.asarray(Image.open(BytesIO(drawing.png)).convert("RGB")).astype(int)
    return np.mean((pixels[..., 2] - pixels[..., 0]) > 60)


def test_every_figure_is_drawn_small_and_shows_the_identified_colour(drawings):
    assert {drawing.name for drawing in drawings} == NAMES
    for drawing in drawings:
        assert 5_000 < len(drawing.png) < 150_000, drawing.name
        assert Image.open(BytesIO(drawing.png)).size == (drawing.width, drawing.height)
        assert drawing.alt and drawing.caption
        if drawing.name != "residual.png":
            assert has_blue(drawing) > 0.001, drawing.name


def test_the_measured_force_adds_grey_to_the_loops(make_result):
    """Grey pixels in the loops come from the measured force alone."""
    greys = []
    for forces in (True, False):
        small = make_result(n_storeys=1, n_draws=20, forces=forces)
        small.tree["constant_data"] = small.tree["constant_data"].to_dataset() * (3.0 if forces else 1.0)
        (loops,) = draw_all(only(gather(small), loops=gather(small).loops))
        assert loops.name == "hysteresis.png"
        pixels = np.asarray(Image.open(BytesIO(loops.png)).convert("RGB")).astype(int)
        greys.append(np.sum((np.ptp(pixels, axis=-1) < 8) & (np.abs(pixels[..., 0] - 0xBD) < 8)))
    assert greys[0] > 2 * greys[1]


def test_drifts_of_very_different_size_have_units_of_their_own(result, monkeypatch):
    """In metres the labels of storeys above an isolator, some millimetres, ran into one another."""
    content, told = gather(result), []

    def noted(figure, name, *words):
        told.append([axis.get_xlabel() for axis in figure.axes])
        return finished(figure, name, *words)

    finished = figures.finished
    monkeypatch.setattr(figures, "finished", noted)
    sizes = [shrunk / np.abs(content.loops[i].drift).max() for i, shrunk in enumerate((0.2, 0.002))]
    loops = [replace(loop, drift=size * loop.drift) for loop, size in zip(content.loops[:2], sizes, strict=True)]
    draw_all(only(content, loops=tuple(loops)))
    assert told == [["drift [m]", "drift [mm]"]]


def test_chains_are_ranked_only_where_there_are_several(make_result, drawings):
    content = gather(make_result(n_storeys=1, n_draws=40, n_time=50, n_chains=2))
    names = {d.name for d in draw_all(only(content, marginals=content.marginals[:2]))}
    assert "chains.png" in names
    assert "chains.png" not in {d.name for d in drawings}


def test_settings_of_matplotlib_are_restored(result):
    before = dict(mpl.rcParams)
    content = gather(result)
    draw_all(only(content, pairs=content.pairs))
    assert dict(mpl.rcParams) == before


@pytest.mark.usefixtures("drawings")
def test_no_figure_stays_open():
    assert plt.get_fignums() == []


def test_a_path_without_time_is_drawn_against_its_points(make_result, monkeypatch):
    """They stood against seconds, one to a point, and the strongest 5 s were five points."""
    told = []

    def noted(figure, name, *words):
        told.append((name, figure.axes[-1].get_xlabel(), *words))
        return finished(figure, name, *words)

    finished = figures.finished
    monkeypatch.setattr(figures, "finished", noted)
    monkeypatch.setattr(content_module, "MAX_LOOP_POINTS", 300)
    path = make_result(n_storeys=1, n_draws=20, dt=1.0)
    for group in path.tree.children.values():
        if "time" in group.coords:
            group.coords["time"].attrs["units"] = POINTS
    content = gather(path)
    assert (content.has_time, content.traces[0].time[0], content.traces[0].time[-1]) == (False, 1.0, 400.0)
    draw_all(replace(content, period=None))
    histories = {"acceleration.png", "acceleration_zoom.png", "residual.png", "drift.png", "quantities.png"}
    assert {name for name, label, *_ in told if label == "point"} == histories
    words = " ".join(" ".join(one) for one in told)
    assert "against time" not in words and "time [s]" not in words and not re.search(r"\d s\b", words)
    assert re.search(r"The strongest part, points (\d+) to (\d+)\. Dots", words)
    assert re.search(r"Only the strongest part is drawn, points \d+ to \d+\.", words)


def test_a_record_with_time_is_drawn_against_seconds(result):
    content = gather(result)
    assert (content.has_time, content.order_label, content.stretch_in_words(1.0, 6.0)) == (True, "time [s]", "1 to 6 s")
