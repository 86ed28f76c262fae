"""Charts of errors: what is drawn where, whatever the numbers are."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from suta_calib.plotting.errors import draw_grouped_errors, draw_histogram
from suta_calib.plotting.style import thinned


def test_whiskers_end_within_one_and_a_half_boxes() -> None:
    # Quartiles 2, 3, 4: beyond 7 is a point.
    axes = Figure().subplots()
    errors = 1e-3 * np.array([1.0, 2.0, 3.0, 4.0, 9.0])
    draw_grouped_errors(axes, {"better": errors / 2, "worse": errors}, "point")
    box = axes.patches[0]
    assert (box.get_x(), box.get_x() + box.get_width()) == pytest.approx((2.0, 4.0))
    whiskers = np.array([line[:, 0] for line in axes.collections[0].get_segments()])
    np.testing.assert_allclose(whiskers[[0, 2]], [[1.0, 2.0], [4.0, 4.0]])
    medians = [line[0, 0] for line in axes.collections[1].get_segments()]
    assert medians == pytest.approx([3.0, 1.5])
    np.testing.assert_allclose(np.asarray(axes.lines[1].get_xdata()), [9.0])
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["worse  (5)", "better  (5)"]


def test_the_legend_of_a_histogram_tells_rms_and_mean_in_the_readers_unit() -> None:
    axes = Figure().subplots()
    draw_histogram(axes, np.array([3e-3, 4e-3]), np.array([0.0, 1e-5]), "m", "distance")
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        *("before", "RMS before 3.54 mm", "mean before 3.5 mm"),
        *("after", "RMS after 0.00707 mm", "mean after 0.005 mm"),
    ]
    # Far apart: a log axis, whose first bar takes what is almost zero.
    assert axes.get_xscale() == "log"
    assert "the first bar" in axes.get_xlabel()


def test_of_many_marks_those_are_drawn_that_are_seen() -> None:
    random = np.random.default_rng(0)
    x = np.concatenate([random.normal(5.0, 0.01, 100_000), [1.0, 9.0]])
    rows = thinned(x, np.full(x.shape, 2.0))
    assert len(rows) < 100
    assert {100_000, 100_001} <= set(rows)
    assert len(thinned(x[:2000], x[:2000])) == 2000
