"""Report of cameras on one body: every camera in the first one, and a camchain of kalibr."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from suta_calib.errors import InputError
from suta_calib.exchange.writers.camera_info import camchain_entry
from suta_calib.measurements.camera import camera_text
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.pose_calibration.rig import NAMED, RigCalibration, RigCamera
from suta_calib.report.detect import CAMERA, camera_record, intrinsics_of
from suta_calib.report.document import Document, File, Part, Text
from suta_calib.report.listing import Column, Json, Listing, shown_as
from suta_calib.report.many_eyes import BETWEEN
from suta_calib.report.poses import between_record, pose_record
from suta_calib.report.uncertainty import budget_record
from suta_calib.words import listed

NAME: Final = "rig"

FITTED: Final = Listing[RigCamera](
    "How well they agree",
    Column("name", "camera"),
    Column("pictures", "pictures"),
    Column("rms", "RMS, px", unit="px"),
    Column("alone", "alone, px", unit="px"),
    shown_as("left out", lambda one: listed(one.left_out, NAMED)),
)


def rig_document(calibration: RigCalibration) -> Document:
    """Every camera in the first one with its ±, the intrinsics, and files of all of them."""
    first = calibration.cameras[0].name
    parts: list[Part] = [
        BETWEEN.of(calibration.others, f"T_{first}_camera: the other cameras in camera {first}"),
        FITTED.of(calibration.cameras),
    ]
    for one in calibration.cameras:
        title = f"Camera {one.name} ({one.camera.lens.called})"
        parts.append(CAMERA.of(intrinsics_of(one.camera), title, place="detail"))
        if one.camera.covariance is not None:
            parts.append(File(f"camera-{one.name}.yaml", partial(camera_text, one.camera)))
    try:
        chain = camchain_text(calibration)
    except InputError as problem:
        parts.append(Text(f"No camchain.yaml is written: {problem}"))
    else:
        parts.append(File("camchain.yaml", lambda: chain))
    record: Json = {
        "cameras": {
            one.name: {
                **camera_record(one.camera),
                **pose_record(one.T_first, "T_first_"),
                "T_first": one.T_first,
                "pictures": one.pictures,
                "reprojection_rms_px": one.rms,
                "camera_alone_rms_px": one.alone,
                "left_out": list(one.left_out),
            }
            for one in calibration.cameras
        },
        "between_eyes": between_record(calibration.others),
        "instants": calibration.instants,
        "scale_ppm": 1e6 * calibration.scale,
        "reprojection_rms_px": calibration.rms,
        "uncertainty": [budget_record(b) for one in calibration.others for b in one.budgets],
    }
    title = "Poses between cameras"
    return Document(NAME, title, calibration.assessment, parts, record, "result")


def camchain_text(calibration: RigCalibration) -> str:
    """A camchain of kalibr: ``T_cn_cnm1`` is the pose of the camera before in each camera.

    Raises:
        InputError: a lens that kalibr does not have.
    """
    chain: dict[str, Any] = {}
    for k, one in enumerate(calibration.cameras):
        entry = camchain_entry(one.camera, None)
        if k:
            before = calibration.cameras[k - 1].T_first
            entry["T_cn_cnm1"] = (np.linalg.inv(one.T_first) @ before).tolist()
        chain[f"cam{k}"] = entry
    return yaml_text(chain)
