"""A registration, told: the transform, which points fit, and the error to expect at targets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.arrays import FloatArray
from suta_calib.measurements.pose_files import Points
from suta_calib.model.parameters import PLACEMENT
from suta_calib.plotting.factor import round_down
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, Table, components, written
from suta_calib.report.poses import (
    INLIER,
    LARGE,
    OUTLIER,
    ROUNDING,
    covariance_record,
    draw_residuals,
    fit_texts,
    fitted_rows,
    pose_record,
    pose_std_record,
    pose_table,
    residuals_file,
)
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import mm, text

NAME: Final = "register"
MOST_TARGETS: Final = 20
# The longest arrow, as a part of the points' extent.
ARROW: Final = 0.25
REGISTRATION: Final = Listing[Registration](
    "", *written("rms", "sigma", "centre", unit="m"), *written("scale", "scale_std")
)


@dataclass(frozen=True, eq=False)
class Target:
    """A point of frame a, and where it comes to lie in frame b; (3,), m.

    Attributes:
        row: from 0.
        line: in its file.
        a, b: the point in either frame.
        std: standard deviation of each coordinate in b.
        error: target registration error to expect, RMS, 3-D.
    """

    row: int
    line: int
    a: FloatArray
    b: FloatArray
    std: FloatArray
    error: float


TARGETS: Final = Listing[Target](
    "Targets in frame b, mm",
    Column("row", "row", form="d"),
    Column("line"),
    *written("a", "b", unit="m"),
    *components("xyz", lambda each: each.b, "m"),
    Column("std", unit="m"),
    Column("error", "error", unit="m"),
)


def register_document(
    found: Registration, a: Points, b: Points, targets: Points | None = None
) -> Document:
    """``T_b_a``, fit, the error to expect at the targets; ``residuals.csv``.

    In JSON ``std`` is that of the position of a's origin in b, and of a turn about b's axes;
    ``std_at_centre`` that of the middle of the points, where it is least.
    """
    at: list[Target] = []
    if targets is not None:
        given = targets.position
        std = np.sqrt(np.diagonal(found.target_covariance(given), axis1=1, axis2=2))
        moved, error = found.act(given), found.target_error(given).tolist()
        at = [
            Target(k, line, given[k], moved[k], std[k], error[k])
            for k, line in enumerate(targets.lines)
        ]
    centre = float(np.sqrt(np.trace(found.covariance[:3, :3])))
    fit = (
        f"rms {text(found.rms, 'm', with_unit=True)} (3-D, fiducial registration error); "
        f"in the middle of the points ± {text(centre, 'm', with_unit=True)} (3-D)"
    )
    lines = {"line_a": a.lines, "line_b": b.lines}
    parts: list[Part] = [
        transform_table(found),
        *fit_texts(fit, "point", found, a.lines),
        residuals_file(found.inliers, lines, found.residuals),
        Figure(partial(register_plot, found, b)),
        TARGETS.of(at[:MOST_TARGETS]),
    ]
    if at:
        more = len(at) - MOST_TARGETS
        left = f"; and {more} more: --json has them" if more > 0 else ""
        parts.append(Text(f"error: target registration error to expect (RMS, 3-D){left}"))
    data: Json = {
        "T_b_a": found.matrix,
        **pose_record(found.matrix),
        **REGISTRATION.record(found),
        "std": pose_std_record(found.origin_std),
        "std_at_centre": pose_std_record(np.sqrt(np.diag(found.covariance))),
        **fitted_rows(found, a.lines),
        "covariance": covariance_record(
            found.covariance, PLACEMENT, "m, rad; at the centre, axes of b"
        ),
        "input": {"a": str(a.path), "b": str(b.path)},
    }
    if targets is not None:
        data["targets"] = TARGETS.records(at)
    return Document(NAME, "Registration", found.assessment, parts, data, "result")


def transform_table(found: Registration) -> Table:
    """``T_b_a`` in words with its standard deviations."""
    title = "T_b_a: frame a in frame b"
    return pose_table(title, found.matrix, found.origin_std, "b's axes")


def register_plot(found: Registration, b: Points) -> str:
    """An SVG: residuals by point, and as arrows at the points, seen from two sides."""
    with picture("register", (LARGE, 6.4)) as figure:
        panels = figure.subplot_mosaic("NN;PA", height_ratios=(1, 1.5))
        top = panels["N"]
        draw_residuals(top, found.residuals, found.inliers, found.rms, "m", "point (row, from 0)")
        top.set_title("Residuals", pad=24)
        top.set_ylabel("distance, mm")
        _arrow_views(panels["P"], panels["A"], found, b.position)
        return svg_text(figure, "register", "Registration: residuals by point and as vectors")


def _arrow_views(first: Axes, second: Axes, found: Registration, points: FloatArray) -> None:
    """Residuals in the plane that the points come nearest to, and across it."""
    inliers = found.inliers
    centred = points - points[inliers].mean(axis=0)
    principal = np.linalg.svd(centred[inliers])[2]
    places, vectors = centred @ principal.T, found.residuals @ principal.T
    longest = float(np.linalg.norm(vectors[inliers], axis=1).max())
    extent = float(np.ptp(places[inliers], axis=0).max())
    factor = round_down(ARROW * extent / longest) if mm(longest) >= ROUNDING else 1.0
    views = ((first, 1, "2nd", "in the points' plane"), (second, 2, "3rd", "across it"))
    for axes, other, name, where in views:
        fitted, astray = (mm(places[which][:, [0, other]].T) for which in (inliers, ~inliers))
        axes.plot(*fitted, **INLIER)
        axes.plot(*astray, **OUTLIER)
        # An outlier's arrow would only hide the others.
        arrows = mm(factor * vectors[inliers][:, [0, other]].T)
        axes.quiver(*fitted, *arrows, angles="xy", scale_units="xy", scale=1.0, width=0.006)
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.15)
        axes.grid()
        axes.set_title(f"Residuals {where}, enlarged {factor:g} times")
        axes.set_xlabel("along the points' 1st principal axis, mm")
        axes.set_ylabel(f"along their {name}, mm")
