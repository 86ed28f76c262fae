"""Charts as SVG: everything where its numbers say, nothing beyond the edge, ids of its own."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from lxml import etree

from suta_calib.plotting.chart import Axis, Boxes, Chart, Lines, Points, Steps, Words
from suta_calib.plotting.look import BLUE, ORANGE
from suta_calib.report.chart_svg import Row, chart_svg, rows_svg
from suta_calib.report.page import themed

NS = "{http://www.w3.org/2000/svg}"
X = Axis("length, mm", 0.0, 10.0)
Y = Axis("height", 0.0, 4.0)


def drawn(*charts: Chart, **options: Any) -> Any:
    return etree.fromstring(chart_svg(charts, "plot", "What <it> shows", 100.0, **options))


def paths(root: Any, style: str) -> list[str]:
    return [str(each.get("d")) for each in root.iter(f"{NS}path") if style in each.get("style")]


def numbers(path: str) -> list[float]:
    return [float(each) for each in re.findall(r"-?\d+\.?\d*", path)]


def test_marks_lie_where_their_numbers_say() -> None:
    width = 300.0
    box = Boxes(np.array([2.0]), np.array([5.0]), np.array([1.0]), np.array([3.0]), BLUE)
    rule = Lines(np.array([[-np.inf, np.inf]]), np.array([[2.0, 2.0]]), colour=ORANGE)
    root = drawn(Chart([box, rule], X, Y), widths=[width])
    left, top, right, bottom, _ = numbers(paths(root, BLUE)[0])
    begin, up, end, again = numbers(paths(root, ORANGE)[0])
    assert end - begin == pytest.approx(width, abs=0.11)
    assert up == again
    assert (left - begin, right - begin) == pytest.approx((0.2 * width, 0.5 * width), abs=0.11)
    # Half of the panel's 100 points is 2 of 4.
    assert (top - up, bottom - up) == pytest.approx((-25.0, 25.0), abs=0.11)


def test_everything_is_within_the_figure_and_described() -> None:
    name = "a.long.name.of.a.joint<&>"
    rows = Axis("joint", 1.5, -0.5, names=[(0.0, name), (1.0, "b")], size=7.0)
    columns = Axis("", -0.5, 1.5, names=[(0.0, name), (1.0, "b")], size=7.0)
    at = np.arange(2.0)
    marks = [
        Points(at, at, shape="square", fill=BLUE, label="square"),
        Points(at, at[::-1], shape="triangle", label="triangle"),
        Words(at, at, ["+", "−"], ["#000000"] * 2),
        Lines(np.array([[0.0, 9.0]]), np.array([[0.0, -9.0]]), dash="dotted"),
    ]
    root = drawn(Chart(marks, columns, rows), Chart([], X, Y), note="held: a")
    _, _, width, height = map(float, root.get("viewBox").split())
    assert width == pytest.approx(72 * 7.2, abs=0.1)
    assert root.get("aria-label") == "What <it> shows"
    texts = {each.text: each for each in root.iter(f"{NS}text")}
    assert {name, "b", "joint", "length, mm", "square", "triangle", "held: a", "−"} <= set(texts)
    for text, each in texts.items():
        x, y = float(each.get("x")), float(each.get("y"))
        size = numbers(each.get("style"))[0]
        long = 0.6 * size * len(text)
        anchor = re.search(r"anchor: (\w+)", each.get("style"))
        assert anchor is not None
        before = {"start": 0.0, "middle": long / 2, "end": long}[anchor[1]]
        along, end = (height - y, height) if each.get("transform") else (x, width)
        assert -1.0 <= along - before <= along - before + long <= end + 1.0, text
        assert size <= y <= height
    for path in root.iter(f"{NS}path"):
        begin = numbers(path.get("d"))[:2]
        assert 0 <= begin[0] <= width
        assert 0 <= begin[1] <= height


def test_hatches_are_the_figures_own_and_colours_those_of_the_page() -> None:
    edges = np.array([0.0, 4.0, 10.0])
    steps = Steps(edges, np.array([3.0, 1.0]), edge=ORANGE, hatched=True, label="before")
    svg = chart_svg([Chart([steps], X, Y)], "plot", "A plot", 100.0)
    root = etree.fromstring(svg)
    ids = [each.get("id") for each in root.iter() if each.get("id")]
    assert ids == ["plot", "plot-0-hatch-0"]
    assert len(paths(root, "url(#plot-0-hatch-0)")) == 2  # the mark, and its sample
    page = themed(svg)
    assert "var(--amber)" in page
    assert not re.search(r"#[0-9a-fA-F]{6}", page)
    mapped = Chart([Boxes(*np.array([[1.0], [2.0], [1.0], [2.0]]), ["#08306b"])], X, Y)
    assert "data-mapped" in themed(chart_svg([mapped], "map", "A map", 100.0))


@pytest.mark.parametrize("log", [False, True])
def test_a_chart_without_marks_is_one(log: bool) -> None:
    none = np.zeros(0)
    empty = [Boxes(none, none, none, none, BLUE, label="none (0)"), Points(none, none)]
    drawn(Chart(empty, Axis("x", 0.1, 10.0, log=log), Y))


def test_rows_stand_below_each_other_and_share_the_page() -> None:
    line = Lines(np.array([[0.0, 10.0]]), np.array([[0.0, 4.0]]), colour=ORANGE)
    chart = Chart([line], X, Y, title="Two\nlines")
    root = etree.fromstring(
        rows_svg([Row([chart, chart], 80.0, (2.0, 1.0)), Row([chart], 50.0)], "plot", "A plot")
    )
    _, _, width, height = map(float, root.get("viewBox").split())
    assert width == pytest.approx(72 * 7.2, abs=0.1)
    first, second, third = (numbers(each) for each in paths(root, ORANGE))
    wide, narrow = first[2] - first[0], second[2] - second[0]
    assert wide == pytest.approx(2 * narrow, abs=0.2)
    assert first[2] < second[0]
    assert first[1] - first[3] == pytest.approx(80.0, abs=0.11)
    assert third[1] - third[3] == pytest.approx(50.0, abs=0.11)
    titles = [float(each.get("y")) for each in root.iter(f"{NS}text") if each.text == "lines"]
    assert len(titles) == 3
    assert titles[0] < first[3]
    assert first[1] < titles[2] < third[3] < third[1] < height


def test_a_circle_is_round_on_a_panel_of_any_shape() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = Lines(np.cos(turn)[None], np.sin(turn)[None], colour=ORANGE)
    chart = Chart([ring], Axis("", -1.0, 1.0), Axis("", -1.0, 1.0), equal=True, bare=True)
    for width in (70.0, 400.0):
        path = np.reshape(numbers(paths(drawn(chart, widths=[width]), ORANGE)[0]), (-1, 2))
        span = np.ptp(path, axis=0)
        assert span == pytest.approx(min(width, 100.0), rel=0.01)


def test_marks_have_sizes_of_their_own() -> None:
    x = np.array([2.0, 5.0, 8.0])
    for shape in ("circle", "square", "triangle", "cross"):
        mark = Points(x, x / 4, np.array([2.0, 4.0, 8.0]), shape, BLUE, ORANGE)
        found = paths(drawn(Chart([mark], X, Y)), BLUE)
        assert len(found) == 3
    corners = [np.reshape(numbers(each), (-1, 2)) for each in found]
    assert [np.ptp(each[:, 0]) for each in corners] == pytest.approx([2.0, 4.0, 8.0], abs=0.11)


def test_marks_have_colours_of_their_own() -> None:
    x, colours = np.array([2.0, 5.0, 8.0]), [BLUE, ORANGE, "#123456"]
    for size in (4.0, np.array([4.0, 5.0, 6.0])):
        root = drawn(Chart([Points(x, x / 4, size, fill=colours, label="marks")], X, Y))
        found = [paths(root, f"fill: {colour}") for colour in colours]
        # The legend's sample has the first one's.
        assert [len(each) for each in found] == [2, 1, 1]
        lefts = [numbers(each[0])[0] for each in found]
        assert lefts == sorted(lefts)


def test_of_many_marks_those_are_drawn_that_are_seen() -> None:
    random = np.random.default_rng(0)
    x = np.concatenate([random.normal(5.0, 0.01, 100_000), [1.0, 9.0]])
    path = paths(drawn(Chart([Points(x, np.full(x.shape, 2.0), fill=BLUE)], X, Y)), BLUE)[0]
    places = [numbers(each)[0] for each in path.split("M")[1:]]
    assert len(places) < 100
    few = numbers(paths(drawn(Chart([Points(x[-2:], x[-2:] / 9, fill=BLUE)], X, Y)), BLUE)[0])
    assert min(places) == few[0]
