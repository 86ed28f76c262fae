"""A pivot calibration on paper."""

from __future__ import annotations

from suta_calib.certificate.answer import (
    CertifiedAnswer,
    Record,
    budgets,
    factor_of,
    judged_budgets,
    judged_rms,
    quantities,
    scale_of,
)
from suta_calib.certificate.content import Content, ValueTable
from suta_calib.certificate.poses import AXES


class PivotOnPaper(CertifiedAnswer):
    """What ``pivot`` wrote."""

    name = "pivot"
    mark = "tip_mm"

    def content(self, record: Record) -> Content:
        """The tip in the tool, and where it rested."""
        found = budgets(record)
        factor = factor_of(found)
        tip = tuple(quantities(AXES, record["tip_mm"], record["tip_std_mm"], "m", factor))
        post = tuple(quantities(AXES, record["post_mm"], record["post_std_mm"], "m", factor))
        references = (scale_of("tracker", record["scale_ppm"]),)
        counts = record["counts"]
        return Content(
            title="Pivot calibration of a tracked tool",
            measurand="Position of the tip in the frame of the tool that the tracker reports.",
            method=(
                "The tool was turned about its resting tip. Tip and post by robust linear least "
                "squares (Yaniv 2015, doi:10.1117/12.2081348). Standard uncertainties follow from "
                "the scatter of the poses and the stated uncertainty of the tracker's scale, "
                "combined by JCGM 100:2008 (GUM)."
            ),
            groups=(ValueTable("Tip in the tool", tip), ValueTable("Post in the tracker", post)),
            budgets=found,
            checked=(
                ("poses that were used", f"{counts['inliers']} of {counts['rows']}"),
                ("residuals, RMS (3-D)", f"{record['rms_mm']:.3f} mm"),
                ("turn of the tool, RMS in the worst direction", f"{record['turn_deg']:.1f} deg"),
            ),
            judged={**judged_budgets(found, references), **judged_rms(record)},
            references=references,
            notes=tuple(record["verdict"]["notes"]),
        )
