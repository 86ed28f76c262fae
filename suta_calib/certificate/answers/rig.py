"""Poses between cameras on paper."""

from __future__ import annotations

from suta_calib.certificate.answer import (
    CertifiedAnswer,
    Record,
    budgets,
    factor_of,
    judged_budgets,
    scale_of,
)
from suta_calib.certificate.content import Content, ValueTable
from suta_calib.certificate.poses import camera_tables, pose_of


class RigOnPaper(CertifiedAnswer):
    """What ``rig`` wrote."""

    name = "rig"
    mark = "instants"

    def content(self, record: Record) -> Content:
        """Every other camera in the first one, and the intrinsics."""
        found = budgets(record)
        factor = factor_of(found)
        references = (scale_of("board", record["scale_ppm"]),)
        poses = [
            ValueTable(
                f"Camera {one['eye']} in camera {one['in_eye']}",
                pose_of(one["T"], one["std"], factor),
            )
            for one in record["between_eyes"]
        ]
        return Content(
            title="Calibration of cameras on one body",
            measurand="Poses between cameras that took pictures of one board at the same instants.",
            method=(
                "Least squares of the reprojection errors in all pictures at once. Standard "
                "uncertainties follow from the scatter of the pictures and the stated uncertainty "
                "of the board's size, combined by JCGM 100:2008 (GUM)."
            ),
            groups=(*poses, *camera_tables(record["cameras"], factor)),
            budgets=found,
            checked=(
                ("instants at which cameras saw the board together", f"{record['instants']}"),
                ("reprojection, RMS", f"{record['reprojection_rms_px']:.3f} px"),
            ),
            references=references,
            judged=judged_budgets(found, references),
            notes=tuple(record["verdict"]["notes"]),
        )
