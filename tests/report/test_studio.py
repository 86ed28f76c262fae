"""Pictures that a process beside draws are those that this one would draw."""

from __future__ import annotations

import os

import numpy as np
import pytest

from suta_calib.report.studio import Drawing, Studio, drawn

PLOTS = "suta_calib.report.calibration_plots"
VALUES = PLOTS, "singular_values", np.array([1e3, 1.0, 0.0]), 10.0, ["a.z"], "s"


class OnlyHere:
    """Of a module that the studio cannot import."""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_without_a_studio_pictures_are_drawn_here() -> None:
    draw = drawn(*VALUES)
    assert isinstance(draw, Drawing)
    assert draw().startswith("<svg")


def test_a_studio_draws_the_same_and_ends_with_it() -> None:
    with Studio(PLOTS) as studio:
        pid = studio.process.pid
        # More than a pipe holds, there and back, and nobody reads yet.
        many = [drawn(PLOTS, "grouped_errors", {"a" * 20_000: np.ones(9000)}, "g", "g")] * 3
        ordered = [drawn(*VALUES), *many, drawn(*VALUES)]
        assert not any(isinstance(draw, Drawing) for draw in ordered)
        beside = [draw() for draw in ordered]
        assert alive(pid)
    assert not alive(pid)
    assert beside[0] == beside[-1] == drawn(*VALUES)()
    assert isinstance(drawn(*VALUES), Drawing)


def test_what_the_studio_cannot_draw_is_drawn_here() -> None:
    with Studio("suta_calib.no_such_module") as studio:
        assert drawn(*VALUES)() == Drawing(PLOTS, "singular_values", VALUES[2:])()
        assert studio.process.wait(20) is not None
        # Neither does one that is gone by now stop anybody.
        assert drawn(*VALUES)().startswith("<svg")
        with pytest.raises(AttributeError, match="no_such_picture"):
            drawn(PLOTS, "no_such_picture")()


def test_who_orders_what_the_studio_cannot_read_does_not_wait_for_it() -> None:
    with Studio(PLOTS) as studio:
        draw = studio.order(Drawing(PLOTS, "singular_values", (OnlyHere(), *VALUES[3:])))
        with pytest.raises(AttributeError, match="OnlyHere"):
            draw()
        assert drawn(*VALUES)().startswith("<svg")


def test_what_cannot_be_sent_is_drawn_here() -> None:
    class Local(list[str]):
        """Of no module."""

    with Studio(PLOTS):
        assert drawn(*VALUES[:-2], Local(["a.z"]), "s")() == drawn(*VALUES)()
