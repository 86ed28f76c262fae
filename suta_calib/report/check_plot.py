"""Picture of the checks of a calibration so far."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from suta_calib.check.history import EarlierCheck
from suta_calib.plotting.look import BLUE, GREY, ORANGE, WIDTH
from suta_calib.report.svg import picture, svg_text

NAME: Final = "check_history"


def check_history_plot(history: Sequence[EarlierCheck]) -> str:
    """An SVG: how certain each check was that something changed, and what did."""
    # A chance below which it does not matter how small.
    least = 1e-8
    certain = -np.log10(np.maximum([check.p for check in history], least))
    number = np.arange(1, len(history) + 1)
    changed = np.array([not check.unchanged for check in history])
    with picture(NAME, (WIDTH, 3.0)) as figure:
        axes = figure.subplots()
        axes.plot(number, certain, color=GREY, lw=0.8)
        axes.plot(number[~changed], certain[~changed], "o", color=BLUE, ms=5, label="unchanged")
        axes.plot(number[changed], certain[changed], "s", color=ORANGE, ms=6, label="changed")
        for k in np.flatnonzero(changed)[-6:]:
            names = ", ".join(history[k].changed)
            axes.annotate(
                *(names, (number[k], certain[k]), (0, 7)),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        for k, (earlier, later) in enumerate(pairwise(history), 1):
            if earlier.result != later.result:
                axes.axvline(k + 0.5, color=GREY, lw=1, ls=":")
                axes.annotate(
                    "calibrated again",
                    (k + 0.5, 1),
                    (3, -4),
                    ("data", "axes fraction"),
                    "offset points",
                    rotation=90,
                    va="top",
                    fontsize=8,
                    color=GREY,
                )
        axes.set_ylim(0, 1.25 * max(float(certain.max()), 2.0))
        axes.set_xlabel(f"check ({history[0].time:%Y-%m-%d} to {history[-1].time:%Y-%m-%d})")
        axes.set_ylabel("evidence of a change, −log₁₀ p")
        axes.locator_params(axis="x", integer=True)
        axes.grid()
        axes.legend(loc="upper left", fontsize=8)
        return svg_text(figure, NAME, "Evidence of a change in every check so far")
