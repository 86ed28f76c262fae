"""Axes of charts: where values lie, and what stands beside them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from suta_calib.plotting.chart import Axis, Boxes, Chart, Lines, Points, Steps, Words, ends
from suta_calib.plotting.errors import grouped_errors
from suta_calib.plotting.on_axes import draw_chart


def test_places_go_from_the_first_value_to_the_last() -> None:
    values = np.array([-np.inf, 1.0, 10.0, 100.0, np.inf])
    log = Axis("", 1.0, 100.0, log=True).place(values)
    np.testing.assert_allclose(log, [0.0, 0.0, 0.5, 1.0, 1.0])
    down = Axis("", 100.0, 0.0).place(values)
    np.testing.assert_allclose(down, [1.0, 0.99, 0.9, 0.0, 0.0])


@given(
    ends=st.tuples(*4 * [st.floats(-1e3, 1e3)]).filter(
        lambda each: min(abs(each[0] - each[1]), abs(each[2] - each[3])) > 1e-3
    ),
    shape=st.floats(0.1, 10.0),
)
def test_equal_axes_are_widened_to_their_panel_about_the_same_middle(
    ends: tuple[float, float, float, float], shape: float
) -> None:
    chart = Chart([], Axis("", *ends[:2]), Axis("", *ends[2:]), equal=True)
    fitted = chart.fitted(100.0 * shape, 100.0)
    spans = []
    for before, after in ((chart.x, fitted.x), (chart.y, fitted.y)):
        assert after.first + after.last == pytest.approx(before.first + before.last, abs=1e-6)
        spans.append((after.last - after.first) / (before.last - before.first))
    assert min(spans) == pytest.approx(1.0)
    across, up = (abs(axis.last - axis.first) for axis in (fitted.x, fitted.y))
    assert across == pytest.approx(shape * up)


@given(
    low=st.floats(-1e6, 1e6),
    span=st.floats(1e-6, 1e6),
    most=st.integers(2, 12),
    whole=st.booleans(),
)
def test_numbers_on_an_axis_are_few_and_say_where_they_stand(
    low: float, span: float, most: int, whole: bool
) -> None:
    span = max(span, 1e-9 * abs(low), 1.0 if whole else 0.0)
    marks = Axis("", low, low + span, whole=whole).marks(most)
    assert 0 < len(marks) + whole <= most + 2
    assert len({text for _, text in marks}) == len(marks)
    for value, text in marks:
        assert low - 1e-6 * span <= value <= low + span * (1 + 1e-6)
        # To the last digit that tells it from the next.
        assert float(text.replace("−", "-")) == pytest.approx(value, abs=0.01 * span, rel=1e-9)
        assert not whole or float(text.replace("−", "-")).is_integer()


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (0.013, 21.0, ["0.1", "1", "10"]),
        (1.3, 7.1, ["2", "5"]),
        (0.9, 6.0, ["1", "2", "5"]),
        (1e-6, 2e3, ["1e-06", "0.0001", "0.01", "1", "100"]),
    ],
)
def test_decades(low: float, high: float, said: list[str]) -> None:
    axis = Axis("", low, high, log=True)
    marks = axis.marks(6)
    assert [text for _, text in marks] == said
    assert all(float(text) == pytest.approx(value) for value, text in marks)
    assert all(low <= each <= high for each in axis.minor())


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("values", [[3.0], [1e-3, 5.0], [2.0, 2.0]])
def test_ends_leave_room(values: list[float], log: bool) -> None:
    low, high = ends(np.array(values), log=log)
    assert low < min(values) <= max(values) < high
    assert ends(np.array(values), log=log, least=1e-4)[0] == pytest.approx(1e-4)


def test_whiskers_end_within_one_and_a_half_boxes() -> None:
    # Quartiles 2, 3, 4: beyond 7 is a point.
    chart = grouped_errors({"a": 1e-3 * np.array([1.0, 2.0, 3.0, 4.0, 9.0])}, "point")
    box, thin, middle, beyond = chart.marks
    assert isinstance(box, Boxes)
    assert isinstance(thin, Lines)
    assert isinstance(middle, Lines)
    assert isinstance(beyond, Points)
    np.testing.assert_allclose((*box.left, *box.right), [2.0, 4.0])
    np.testing.assert_allclose(thin.x, [[1.0, 2.0], [4.0, 4.0], [1.0, 1.0], [4.0, 4.0]])
    np.testing.assert_allclose(middle.x, [[3.0, 3.0]])
    np.testing.assert_allclose(beyond.x, [9.0])


def test_matplotlib_draws_every_mark_between_the_same_ends() -> None:
    one = np.ones(1)
    chart = Chart(
        [
            Boxes(one, 2 * one, one, 3 * one, ["#ff0000"], label="box"),
            Steps(np.array([1.0, 2.0]), one, edge="#000000", hatched=True, label="steps"),
            Lines(np.array([[-np.inf, np.inf]]), np.ones((1, 2)), dash="dashed", label="line"),
            Points(one, one, label="point"),
            Words(one, one, ["word"], ["#000000"], haloed=True),
            Points(2 * one, one, np.array([3.0]), "cross"),
            Points(3 * one, one, 4.0, fill=["#00ff00"]),
        ],
        Axis("x, mm", 0.5, 4.0, log=True),
        Axis("y", 3.5, 0.0, names=[(1.0, "one"), (2.0, "two")], grid=True),
        title="title",
        bare=True,
    )
    axes = Figure().subplots()
    draw_chart(axes, chart)
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["box", "steps", "line", "point"]
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.5, 4.0), (3.5, 0.0))
    assert (axes.get_xlabel(), axes.get_xscale()) == ("x, mm", "log")
    assert [text.get_text() for text in axes.get_yticklabels()] == ["one", "two"]
    np.testing.assert_allclose(axes.collections[0].get_segments(), [[[0.5, 1.0], [4.0, 1.0]]])
    assert [text.get_text() for text in axes.texts] == ["word"]
    assert axes.collections[1].get_sizes() == pytest.approx([9.0])
    assert axes.collections[2].get_sizes() == pytest.approx([16.0])
    np.testing.assert_allclose(axes.collections[2].get_facecolor(), [[0.0, 1.0, 0.0, 1.0]])
    assert axes.get_title() == "title"
    assert not any(each.get_visible() for each in axes.spines.values())


def test_an_equal_chart_is_drawn_on_axes_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    figure = Figure()
    axes = figure.subplots()
    draw_chart(axes, Chart([], Axis("", 0.0, 4.0), Axis("", 0.0, 1.0), equal=True))
    figure.draw_without_rendering()
    assert not caplog.records
    assert axes.get_xlim() == (0.0, 4.0)
    assert axes.bbox.width == pytest.approx(4.0 * axes.bbox.height)
