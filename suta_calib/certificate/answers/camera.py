"""A camera that was calibrated from pictures of a board, on paper."""

from __future__ import annotations

import math

from suta_calib.certificate.answer import (
    CertifiedAnswer,
    Record,
    budgets,
    factor_of,
    judged_budgets,
    not_stated,
    rms_value,
)
from suta_calib.certificate.content import CertifiedValue, Content, ValueTable
from suta_calib.certificate.poses import camera_tables


class CameraOnPaper(CertifiedAnswer):
    """What ``detect`` wrote of a camera that it calibrated."""

    name = "detect"
    mark = "projection_std_px"

    def content(self, record: Record) -> Content:
        """The intrinsics, and how sure the place is where a point is seen."""
        found = budgets(record)
        factor = factor_of(found)
        camera, sure = record["camera"], record["projection_std_px"]
        used = sum(not row["left_out"] for row in record["pictures"])
        places = tuple(
            CertifiedValue(f"{where} of the picture (2-D)", math.nan, "px", float(std), factor)
            for where, std in (("middle", sure["middle"]), ("least sure part", sure["worst"]))
        )
        rms, corners = float(record["rms_px"]), int(record["corners"])
        return Content(
            title="Calibration of a camera",
            measurand=(
                "Focal lengths, principal point and distortion of a camera for pictures of "
                f"{camera['width']} × {camera['height']} px."
            ),
            method=(
                "Least squares of the reprojection errors of the corners of a board, whose pose in "
                "each picture is unknown too (Zhang 2000, doi:10.1109/34.888718). No intrinsics "
                "depend on the size of the board. Standard "
                "uncertainties follow from the scatter of the corners (JCGM 100:2008, GUM), each "
                "of which has an error of its own."
            ),
            groups=(
                *camera_tables({"": camera}, factor),
                ValueTable(
                    "Place where a far point is seen",
                    places,
                    "By all intrinsics together; a turn of the camera is left out.",
                ),
            ),
            budgets=found,
            checked=(
                ("pictures that were used", f"{used} of {record['images']}"),
                ("corners that were found", f"{corners:,}"),
                ("reprojection, RMS (2-D)", f"{rms:.3f} px"),
                ("part of the picture with corners", f"{100.0 * float(record['covered']):.0f} %"),
            ),
            judged={
                **judged_budgets(found, ()),
                "rms_px": rms_value("reprojection, RMS (2-D)", rms, "px", corners),
                "U_projection_px": CertifiedValue(
                    "U of the least sure place in the picture",
                    factor * float(sure["worst"]),
                    "px",
                    rests_on=("board",),
                    is_uncertainty=True,
                ),
            },
            references=(
                not_stated(
                    "board", "shape of the board (flat, its corners where its file has them)"
                ),
            ),
            notes=tuple(record["verdict"]["notes"]),
        )
