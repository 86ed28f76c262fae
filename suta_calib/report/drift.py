"""Drift, told: held-out errors over time, and when to calibrate again."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from suta_calib.analysis.study import DriftPoint, DriftStudy
from suta_calib.plotting.look import BLUE, GREY, WIDTH
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Listing
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import deg, mm, shown, text

NAME: Final = "drift"
POINTS: Final = Listing[DriftPoint](
    "Held-out errors as parameters walk",
    Column("days", "days", form=".3g"),
    Column("rms", "RMS", unit="m"),
    Column("low", "5 % below", unit="m"),
    Column("high", "5 % above", unit="m"),
)


def drift_document(study: DriftStudy) -> Document:
    """Errors by the day, the limit, and the interval between calibrations.

    In JSON ``interval_days`` is null where nearly no walk exceeds the limit in the time.
    """
    options = study.options
    rates = (
        f"{options.trials} walks of every estimated parameter: "
        f"{text(options.angle_rate, 'rad')} deg and {text(options.length_rate, 'm')} mm after one "
        "day, growing with the root of time."
    )
    interval = study.interval
    data = {
        "walk_deg": deg(options.angle_rate),
        "walk_mm": mm(options.length_rate),
        "trials": options.trials,
        "seed": options.seed,
        "tolerance_pct": shown(options.tolerance, "%"),
        "now_mm": mm(study.now),
        "limit_mm": mm(study.limit),
        "interval_days": interval if np.isfinite(interval) else None,
        "points": POINTS.records(study.points),
    }
    parts: list[Part] = [Text(rates), Figure(partial(drift_plot, study)), POINTS.of(study.points)]
    return Document(NAME, "When to calibrate again", study.assessment, parts, data)


def drift_plot(study: DriftStudy) -> str:
    """An SVG: held-out RMS over time with the band of nine walks in ten, and the limit."""
    days = np.array([0.0, *(point.days for point in study.points)])
    rms, low, high = (
        mm(np.array([study.now, *(getattr(point, key) for point in study.points)]))
        for key in ("rms", "low", "high")
    )
    with picture(NAME, (WIDTH, 3.2)) as figure:
        axes = figure.subplots()
        axes.fill_between(days, low, high, color=BLUE, alpha=0.2, lw=0, label="nine walks in ten")
        axes.plot(days, rms, ".-", color=BLUE, label="all walks")
        axes.axhline(mm(study.limit), color=GREY, ls="--", lw=1.2, label="limit")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("days since the calibration")
        axes.set_ylabel("held-out RMS, mm")
        axes.legend(fontsize=8)
        return svg_text(figure, NAME, "Held-out error as parameters walk")
