"""Report of a registration: the transform, fit of the points, expected error at targets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib import report
from suta_calib.arrays import FloatArray
from suta_calib.measurements.pose_files import PointSet
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, Table, components, written
from suta_calib.report.poses import (
    covariance_record,
    fit_texts,
    fitted_rows,
    pose_record,
    pose_std_record,
    pose_table,
    residuals_file,
)
from suta_calib.report.uncertainty import budget_record
from suta_calib.units import std_text, text

NAME: Final = "register"
REGISTRATION: Final = Listing[Registration](
    "", *written("rms", "sigma", "centre", unit="m"), *written("scale", "scale_std")
)
STATED: Final = Listing[Registration](
    "",
    Column("sigma", value=lambda row: row.stated, unit="m"),
    Column("factor", value=lambda row: row.agreement and row.agreement.factor),
    Column("chance", value=lambda row: row.agreement and row.agreement.chance),
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
    *components("xyz", lambda row: row.b, "m"),
    Column("std", unit="m"),
    Column("error", "error", unit="m"),
)


def register_document(
    registration: Registration, a: PointSet, b: PointSet, targets: PointSet | None = None
) -> Document:
    """``T_b_a``, fit, the error to expect at the targets; ``residuals.csv``.

    In JSON ``std`` is that of the position of a's origin in b, and of a turn about b's axes;
    ``std_at_centre`` that of the middle of the points, where it is least. ``stated`` is there where
    the files state standard deviations: that of a typical row, how many times as large the
    residuals are, and the chance of it.
    """
    most_targets = 20
    at: list[Target] = []
    if targets is not None:
        given = targets.position
        std = np.sqrt(np.diagonal(registration.target_covariance(given), axis1=1, axis2=2))
        moved, error = registration.act(given), registration.target_error(given).tolist()
        at = [
            Target(k, line, given[k], moved[k], std[k], error[k])
            for k, line in enumerate(targets.lines)
        ]
    centre = float(np.sqrt(np.trace(registration.covariance[:3, :3])))
    fit = (
        f"rms {text(registration.rms, 'm', with_unit=True)} (3-D, fiducial registration error); "
        f"in the middle of the points ± {std_text(centre, 'm')} (3-D)"
    )
    if registration.stated is not None and registration.agreement is not None:
        fit += (
            f"; residuals {registration.agreement.factor:.2g} times the stated σ (typically "
            f"{text(registration.stated, 'm', with_unit=True)})"
        )
    lines = {"line_a": a.lines, "line_b": b.lines}
    parts: list[Part] = [
        transform_table(registration),
        *fit_texts(fit, "point", registration, a.lines),
        residuals_file(registration.inliers, lines, registration.residuals),
        Figure(lambda: report.register_plot(registration, b)),
        TARGETS.of(at[:most_targets]),
    ]
    if at:
        more = len(at) - most_targets
        left = f"; and {more} more: use --json" if more > 0 else ""
        parts.append(Text(f"error: target registration error to expect (RMS, 3-D){left}"))
    data: Json = {
        "T_b_a": registration.matrix,
        **pose_record(registration.matrix),
        **REGISTRATION.record(registration),
        "std": pose_std_record(registration.origin_std),
        "std_at_centre": pose_std_record(np.sqrt(np.diag(registration.covariance))),
        **fitted_rows(registration, a.lines),
        "covariance": covariance_record(
            registration.covariance, PLACEMENT, "m, rad; at the centre, axes of b"
        ),
        "uncertainty": [budget_record(budget) for budget in registration.budgets],
        "input": {"a": str(a.path), "b": str(b.path)},
    }
    if registration.stated is not None:
        data["stated"] = STATED.record(registration)
    if targets is not None:
        data["targets"] = TARGETS.records(at)
    return Document(
        NAME, "Registration", registration.assessment, parts, data, "result", registration.in_a_line
    )


def transform_table(registration: Registration) -> Table:
    """``T_b_a`` in words with its standard deviations."""
    title = "T_b_a: frame a in frame b"
    return pose_table(title, registration.matrix, registration.origin_std, "b's axes")
