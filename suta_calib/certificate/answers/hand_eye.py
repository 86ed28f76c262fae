"""A hand-eye calibration on paper."""

from __future__ import annotations

from suta_calib.certificate.answer import CertifiedAnswer, Record, budgets, factor_of
from suta_calib.certificate.content import Content, ValueTable
from suta_calib.certificate.poses import pose_of
from suta_calib.units import stored, text


class HandEyeOnPaper(CertifiedAnswer):
    """What ``hand-eye`` wrote, of one eye."""

    name = "hand-eye"
    mark = "setup"

    def content(self, record: Record) -> Content:
        """X, and Z where it was asked for."""
        found = budgets(record)
        factor = factor_of(found)
        groups = [
            ValueTable(
                f"{name} = {frame}", pose_of(record, record["std"][name], factor, f"{name}_")
            )
            for name, frame in record["frames"].items()
        ]
        first = groups[0].quantities
        return Content(
            title="Hand-eye calibration",
            measurand=(
                f"Pose of a camera or tracked body, {record['setup']}, by the model "
                f"{record.get('model', 'AX=ZB')}."
            ),
            method=(
                "Robust least squares of all pairs of poses, from a closed-form start and a "
                "consensus of the pairs. Standard uncertainties follow from their scatter and from "
                "the stated uncertainty of the scale, combined by JCGM 100:2008 (GUM)."
            ),
            groups=tuple(groups),
            budgets=found,
            checked=tuple(_fit(record)),
            judged={f"X_{row.name}": row for row in first if row.std is not None},
            standards=_scale(record),
            notes=tuple(record["verdict"]["notes"]),
        )


def _fit(record: Record) -> list[tuple[str, str]]:
    counts = record["counts"]
    used = f"{counts.get('inliers', '?')} of {counts.get('rows', '?')} rows"
    rows = [("rows that were used", used)]
    for key, unit in (("rms_mm", "m"), ("rms_deg", "rad")):
        if record.get(key) is not None:
            number = float(stored(float(record[key]), unit))  # type: ignore[arg-type]
            rows.append(("residuals, RMS", text(number, unit, with_unit=True)))  # type: ignore[arg-type]
    if record.get("reprojection_rms_px") is not None:
        rows.append(("reprojection, RMS", f"{record['reprojection_rms_px']:.3f} px"))
    return rows


def _scale(record: Record) -> tuple[str, ...]:
    if record.get("scale_ppm") is None:
        return ()
    return (f"all seen lengths: standard uncertainty of their scale {record['scale_ppm']:g} ppm",)
