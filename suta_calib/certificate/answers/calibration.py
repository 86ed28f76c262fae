"""The calibration of an arm on paper."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from suta_calib.certificate.answer import (
    CertifiedAnswer,
    Record,
    budgets,
    factor_of,
    rms_value,
    scales,
    si,
)
from suta_calib.certificate.content import CertifiedValue, Content, ValueTable
from suta_calib.certificate.poses import pose_quantities
from suta_calib.units import Unit, key, text
from suta_calib.words import listed


class CalibrationOfArm(CertifiedAnswer):
    """What ``calibrate`` wrote."""

    name = "calibrate"
    mark = "parameters"

    def content(self, record: Record) -> Content:
        """Parameters, poses beside the arm, the tip's uncertainty and the validation errors."""
        found = budgets(record)
        factor = factor_of(found)
        estimated = {n: p for n, p in record["parameters"].items() if p["std"] is not None}
        # Those of a pose stand with it.
        posed = tuple(f"{name}." for name in record.get("external_poses") or ())
        parameters = tuple(
            _parameter(name, entry, factor)
            for name, entry in estimated.items()
            if not name.startswith(posed)
        )
        references = scales(record)
        # Pairs share touches, and corners a picture: rows tell no more than the scatter of the fit.
        freedom = min((p.freedom for b in found for p in b.contributions), default=math.inf)
        judged = dict(_judged(record, tuple(one.name for one in references), freedom))
        if found:
            tip = found[0].expanded
            judged[key("tip", found[0].unit)] = CertifiedValue(
                *("U of the tip, from the calibration alone", tip, found[0].unit),
                rests_on=tuple(one.name for one in references),
                is_uncertainty=True,
            )
        kinds = sorted({row["kind"] for row in record["noise"]})
        starts = len(record["solver"]["starts"])
        return Content(
            title="Calibration of a kinematic chain",
            measurand=(
                f"{len(estimated)} parameters of the kinematic model of the chain and of what it "
                "was measured with, and the position of its tip that follows from them. "
                f"{_undetermined(len(record['unidentified']))}"
            ),
            method=(
                f"All parameters were estimated at once by robust least squares from observations "
                f"of the kind {listed(kinds)}; number of starting points: {starts} (solver: "
                f"{record['solver']['name']}). Standard uncertainties follow from the scatter of "
                "independent measurements (cluster-robust covariance) and from the stated "
                "uncertainties of the reference standards, combined by JCGM 100:2008 (GUM)."
            ),
            groups=(
                *_tip_group(record),
                *_poses(record, factor),
                ValueTable(
                    "Parameters",
                    parameters,
                    "By joint, in the convention of a URDF: x, y, z and rx, ry, rz of its origin, "
                    f"offset of its reading. {_kept(record)}",
                ),
            ),
            budgets=found,
            checked=tuple(_validation(record)),
            judged=judged,
            references=references,
            notes=tuple(_notes(record)),
        )


def _notes(record: Record) -> Iterator[str]:
    notes = record["verdict"]["notes"]
    yield from notes
    if any("rows left out of the fit falls" in note for note in notes):
        yield (
            "Errors of rows left out that these notes compare are robust: no outlier counts beyond "
            "its Huber threshold. They are less than the figures under Validation, where outliers "
            "count in full."
        )


def _undetermined(count: int) -> str:
    if not count:
        return "The data determine all of them."
    s = "s" * (count > 1)
    return f"{count} parameter{s} that these data cannot determine kept the nominal value{s}."


def _kept(record: Record) -> str:
    """Which parameters kept their nominal values."""
    kept = sorted(record["unidentified"])
    return f"Nominal values were kept for {', '.join(kept)}." if kept else ""


def _parameter(name: str, entry: Record, factor: float) -> CertifiedValue:
    unit: Unit = entry["unit"]
    remark = "mostly from its prior" if entry["state"] == "prior" else ""
    return CertifiedValue(name, float(entry["value"]), unit, float(entry["std"]), factor, remark)


def _tip_group(record: Record) -> Iterator[ValueTable]:
    for budget in budgets(record):
        about = (
            "This is not the accuracy of a single position: see Validation for that. It is the "
            "uncertainty that the calibration alone adds to a position, relative to the other "
            "positions; the scatter of a single use of the arm comes on top, and an error that "
            "moves all positions alike is left out."
        )
        tip = CertifiedValue(budget.of, math.nan, budget.unit, budget.std, budget.factor)
        yield ValueTable("Tip", (tip,), about)


def _poses(record: Record, factor: float) -> Iterator[ValueTable]:
    for name, pose in (record.get("external_poses") or {}).items():
        rows = pose_quantities(
            pose["position_mm"],
            pose["position_std_mm"],
            pose.get("rpy_deg"),
            pose.get("rotation_std_deg"),
            factor,
        )
        yield ValueTable(f"Pose of {name} in the {pose['within']}", tuple(rows))


def _errors(record: Record) -> Iterator[tuple[str, Mapping[str, float | None], Unit]]:
    for name in ("validation", "calibration"):
        after = (record["metrics"].get(name) or {}).get("after") or {}
        if after.get("count"):
            yield name, after, "m" if "rms_mm" in after else "rad" if "rms_deg" in after else "px"


def _validation(record: Record) -> Iterator[tuple[str, str]]:
    for name, after, unit in _errors(record):
        label = "left out of the fit (validation)" if name == "validation" else "used in the fit"
        figures = ", ".join(
            f"{what} {text(si(after, part, unit), unit, with_unit=True)}"
            for what, part in (("RMS", "rms"), ("mean", "mean"), ("largest", "max"))
        )
        yield f"errors of {after['count']:,} rows {label}, outliers in full", figures
    for row in record.get("held_out") or ():
        if row["count"]:
            yield (
                f"{row['count']:,} validation errors of {row['kind']}",
                f"{row['within_68_pct']:.0f} % within one predicted standard deviation, "
                f"{row['within_95_pct']:.0f} % within two",
            )


def _judged(
    record: Record, rests_on: tuple[str, ...], most: float
) -> Iterator[tuple[str, CertifiedValue]]:
    """Validation errors. Their uncertainty is how well so many rows tell a root mean square."""
    for name, after, unit in _errors(record):
        if name == "validation":
            rms, count = si(after, "rms", unit), min(float(after["count"] or 1), most)
            yield (
                key("validation_rms", unit),
                rms_value("RMS validation error", rms, unit, count, rests_on),
            )
            largest = si(after, "max", unit)
            yield (
                key("validation_max", unit),
                CertifiedValue("largest validation error", largest, unit, rests_on=rests_on),
            )
