"""Report of a line scanner on the hand: its pose, fit of the scans, profiles in the base."""

from __future__ import annotations

from typing import Final

from suta_calib import report
from suta_calib.measurements.pose_files import ScanPoses
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.line_scanner import LineScannerCalibration
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.hand_eye import NAME
from suta_calib.report.listing import Column, Json, Listing, plain
from suta_calib.report.poses import (
    axes_with_std,
    covariance_record,
    fit_texts,
    fitted_rows,
    pose_record,
    pose_std_record,
    pose_table,
    residuals_file,
)
from suta_calib.report.uncertainty import budget_record
from suta_calib.units import mm, text, with_std

CALIBRATION: Final = Listing[LineScannerCalibration](
    "", Column("rms", unit="m"), Column("spread", unit="m"), Column("hand_noise", unit="m")
)
_TARGET: Final = Listing[LineScannerCalibration](
    "",
    Column("", "", lambda row: row.seen),
    *axes_with_std(lambda row: row.place, lambda row: row.place_std),
)


def line_scanner_document(calibration: LineScannerCalibration, data: ScanPoses) -> Document:
    """X, the ball or the plane, and which scans agree; with ``residuals.csv``."""
    lines = dict(zip(data.scan.tolist(), data.lines, strict=True))
    names = calibration.scans.tolist()
    about = (
        "Ball in the base, mm"
        if calibration.normal is None
        else "Plane in the base: its point next to the origin, mm"
    )
    x, y, z = (text(v, "m") for v in calibration.spread)
    parts: list[Part] = [
        pose_table(
            "X = T_hand_eye: the scanner in the hand",
            *(calibration.X, calibration.std, "the scanner's axes"),
        ),
        _TARGET.of([calibration], about),
        *_of_radius(calibration),
        Text(f"spread of the {calibration.seen} in the base (x, y, z): {x}, {y}, {z} mm"),
        *fit_texts(
            f"rms {text(calibration.rms, 'm', with_unit=True)} (3-D); the hand seems to err by "
            f"{text(calibration.hand_noise, 'm', with_unit=True)} per axis",
            *("scan", calibration, data.lines),
        ),
        residuals_file(
            calibration.inliers,
            {"scan": names, "line": [lines[name] for name in names]},
            calibration.residuals,
        ),
        Figure(lambda: report.line_scanner_plot(calibration)),
    ]
    outliers = {"outlier_scans": calibration.scans[~calibration.inliers].tolist()}
    record: Json = {
        "setup": "eye-in-hand",
        "model": "AX=ZB",
        "X": calibration.X,
        **pose_record(calibration.X, "X_"),
        "frames": {"X": "T_hand_eye"},
        "std": {"X": pose_std_record(calibration.std)},
        **_target_record(calibration),
        **CALIBRATION.record(calibration),
        **fitted_rows(calibration, data.lines),
        **outliers,
        "covariance": covariance_record(
            calibration.covariance, [f"X.{key}" for key in PLACEMENT], "m, rad"
        ),
        "uncertainty": [budget_record(budget) for budget in calibration.budgets],
        "input": str(data.path),
    }
    verdict = calibration.assessment
    title = "Hand-eye calibration of a line scanner"
    return Document(NAME, title, verdict, parts, record, "result", calibration.in_a_line)


def _of_radius(calibration: LineScannerCalibration) -> list[Part]:
    """The radius of a ball that was unknown."""
    if not calibration.radius_std or calibration.radius is None:
        return []
    size = with_std(calibration.radius, calibration.radius_std, "m")
    return [Text(f"radius of the ball: {size}")]


def _target_record(calibration: LineScannerCalibration) -> Json:
    record: Json = {
        f"{calibration.seen}_mm": plain(calibration.place, "m"),
        f"{calibration.seen}_std_mm": plain(calibration.place_std, "m"),
    }
    if calibration.normal is not None:
        return record | {"normal": plain(calibration.normal)}
    assert calibration.radius is not None
    return record | {
        "sphere_radius_mm": mm(calibration.radius),
        "sphere_radius_std_mm": mm(calibration.radius_std),
    }
