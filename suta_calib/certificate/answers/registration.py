"""A registration of corresponding points on paper."""

from __future__ import annotations

from suta_calib.certificate.answer import (
    CertifiedAnswer,
    Record,
    budgets,
    factor_of,
    judged_budgets,
    judged_rms,
    scale_of,
)
from suta_calib.certificate.content import Content, ValueTable
from suta_calib.certificate.poses import pose_of


class RegistrationOnPaper(CertifiedAnswer):
    """What ``register`` wrote."""

    name = "register"
    mark = "T_b_a"

    def content(self, record: Record) -> Content:
        """The pose between two sets of points."""
        found = budgets(record)
        references = (
            scale_of(
                "points", record["scale_ppm"], "factor between the lengths of both sets", "error"
            ),
        )
        counts = record["counts"]
        rows = pose_of(record["T_b_a"], record["std"], factor_of(found))
        return Content(
            title="Registration of corresponding points",
            measurand="Rigid transform T_b_a from the frame of the first points to the second's.",
            method=(
                "Robust least squares of the distances between corresponding points, from a closed "
                "form. Standard uncertainties follow from the scatter of the points and the stated "
                "uncertainty of the scale, combined by JCGM 100:2008 (GUM)."
            ),
            groups=(ValueTable("T_b_a", rows),),
            budgets=found,
            checked=(
                ("points that were used", f"{counts['inliers']} of {counts['rows']}"),
                ("residuals, RMS (3-D)", f"{record['rms_mm']:.3f} mm"),
            ),
            judged={**judged_budgets(found, references), **judged_rms(record)},
            references=references,
            notes=tuple(record["verdict"]["notes"]),
        )
