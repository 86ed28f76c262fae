"""Report of a depth camera on the hand or beside it: its pose, and what it saw."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib import report
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.depth_camera import DepthCameraCalibration, SeenThing
from suta_calib.pose_calibration.eye_poses import FRAMES
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
from suta_calib.units import deg, mm, text

CALIBRATION: Final = Listing[DepthCameraCalibration](
    "",
    Column("rms", unit="m"),
    Column("hand_noise", unit="m"),
    Column("hand_turn_noise", unit="rad"),
    Column("camera_noise"),
)


def _normal(row: SeenThing) -> str:
    if row.normal is None:
        return ""
    return f"({' '.join(f'{part:.4f}' for part in row.normal)}) ± {deg(row.tilt_std):.3f}"


_THINGS: Final = Listing[SeenThing](
    "",
    Column("", "", lambda row: f"{row.kind} {row.name}".strip()),
    *axes_with_std(lambda row: row.place, lambda row: row.std),
    Column("", "normal, ± tilt in deg", _normal),
)


def depth_camera_document(calibration: DepthCameraCalibration, data: HandPoses) -> Document:
    """X, what was seen, and which pictures agree; with ``residuals.csv``."""
    names, setup = calibration.images.tolist(), calibration.setup
    every = np.ones_like(calibration.inliers)
    lines = [data.lines[k] for k in calibration.rows_in_file(every)]
    frames = FRAMES[setup]
    outside = "base" if setup == "eye-in-hand" else "hand"
    # As many of many points as a reader looks at; the file has all.
    shown = calibration.things[:12]
    more = len(calibration.things) - len(shown)
    scale, scale_std = (f"{100 * part:.2f}" for part in (calibration.scale, calibration.scale_std))
    parts: list[Part] = [
        pose_table(
            f"X = {frames['X']}: the camera in the {'hand' if outside == 'base' else 'base'}",
            *(calibration.X, calibration.std, "the camera's axes"),
        ),
        _THINGS.of(shown, f"Seen, in the {outside}, mm (of a plane its point next to the origin)"),
        *([Text(f"and {more} more, in result.json")] if more else []),
        Text(f"scale of the camera's lengths: {scale} ± {scale_std} % too long; X allows for it"),
        *fit_texts(
            f"rms {text(calibration.rms, 'm', with_unit=True)} (3-D); the hand seems to err by "
            f"{text(calibration.hand_noise, 'm', with_unit=True)} and "
            f"{deg(calibration.hand_turn_noise):.3f}° per axis, the camera by "
            f"{calibration.camera_noise:.2g} times what is stated",
            *("picture", calibration, data.lines),
        ),
        residuals_file(
            calibration.inliers,
            {"image": names, "line": lines},
            calibration.residuals,
            numbers=calibration.numbers,
        ),
        Figure(lambda: report.depth_camera_plot(calibration)),
    ]
    board = next((thing for thing in calibration.things if thing.pose is not None), None)
    record: Json = {
        "setup": setup,
        "model": "AX=ZB",
        "X": calibration.X,
        **pose_record(calibration.X, "X_"),
        **({} if board is None else {"Z": board.pose}),
        "frames": {"X": frames["X"], **({} if board is None else {"Z": frames["Z"]})},
        "std": {
            "X": pose_std_record(calibration.std),
            **({} if board is None else {"Z": pose_std_record(board.std)}),
        },
        "planes": {t.name: _plane_record(t) for t in calibration.things if t.kind == "plane"},
        "points": {
            t.name: {"position_mm": plain(t.place, "m"), "std_mm": plain(t.std, "m")}
            for t in calibration.things
            if t.kind == "point"
        },
        **CALIBRATION.record(calibration),
        "scale_ppm": 1e6 * calibration.scale,
        "scale_std_ppm": 1e6 * calibration.scale_std,
        **fitted_rows(calibration, data.lines),
        "outlier_images": calibration.images[~calibration.inliers].tolist(),
        "covariance": covariance_record(
            calibration.covariance, [f"X.{key}" for key in PLACEMENT], "m, rad"
        ),
        "uncertainty": [budget_record(budget) for budget in calibration.budgets],
        "input": str(data.path),
    }
    verdict, title = calibration.assessment, "Hand-eye calibration of a depth camera"
    return Document(NAME, title, verdict, parts, record, "result", calibration.in_a_line)


def _plane_record(row: SeenThing) -> Json:
    assert row.normal is not None
    return {
        "normal": plain(row.normal),
        "distance_mm": mm(float(row.place @ row.normal)),
        "distance_std_mm": mm(row.distance_std),
        "tilt_std_deg": deg(row.tilt_std),
    }
