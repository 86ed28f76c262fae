"""A hand-eye calibration on paper: from pairs, pictures, a depth camera or a line scanner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from suta_calib.certificate.answer import (
    CertifiedAnswer,
    Record,
    budgets,
    factor_of,
    judged_budgets,
    judged_rms,
    not_stated,
    quantities,
    scale_of,
)
from suta_calib.certificate.content import CertifiedValue, Content, Reference, ValueTable
from suta_calib.certificate.poses import AXES, camera_tables, pose_of
from suta_calib.units import stored, text


class HandEyeOnPaper(CertifiedAnswer):
    """What ``hand-eye`` wrote."""

    name = "hand-eye"
    mark = "setup"

    def content(self, record: Record) -> Content:
        """Every X, every Z that was asked for, and what else was found with them."""
        found = budgets(record)
        factor = factor_of(found)
        references = tuple(_references(record))
        poses = [
            ValueTable(title, pose_of(pose, std, factor)) for title, pose, std in _poses(record)
        ]
        every = record.get("cameras") or {"": record}
        cameras = {name: entry.get("camera") for name, entry in every.items()}
        return Content(
            title="Hand-eye calibration",
            measurand=(
                f"Pose of a camera, scanner or tracked body, {record['setup']}, by the model "
                f"{record.get('model', 'AX=ZB')}. X is {record['frames']['X']}."
            ),
            method=(
                f"{_method(record)} Standard uncertainties follow from scatter and from what is "
                "stated of the lengths, combined by JCGM 100:2008 (GUM)."
            ),
            groups=(*poses, *_others(record, factor), *camera_tables(cameras, factor)),
            budgets=found,
            checked=tuple(_fit(record)),
            judged={**judged_budgets(found, references), **judged_rms(record)},
            references=references,
            notes=(*_lost(record), *record["verdict"]["notes"]),
        )


def _poses(record: Record) -> Iterator[tuple[str, Any, Record]]:
    """Title, matrix and standard deviations of every pose that was found."""
    for name, frame in record["frames"].items():
        pose, std = record[name], record["std"][name]
        if not isinstance(pose, Mapping):
            yield f"{name} = {frame}", pose, std
            continue
        for label, one in pose.items():
            if one is not None:
                yield f"{name} of {label} = {frame}", one, std[label]


def _lost(record: Record) -> Iterator[str]:
    """Of eyes and targets that were not found."""
    for part in ("eyes", "targets", "cameras"):
        for entry in (record.get(part) or {}).values():
            if "because" in entry:
                yield str(entry["because"])


def _method(record: Record) -> str:
    if "profiles" in record:
        return (
            "Least squares of profiles of a ball or a plane, weighed by the noise of the hand and "
            "of the scanner that all of them show (restricted maximum likelihood)."
        )
    if "camera_noise" in record:
        return (
            "Least squares of planes or points that a depth camera saw, weighed by the noise of "
            "the hand and of the camera that all pictures show (restricted maximum likelihood). "
            "One factor on all lengths of the camera is estimated too."
        )
    if "reprojection_rms_px" in record:
        return (
            "Reprojection errors of the corners of a board, weighed by the noise of the corners "
            "and of the hand that all pictures show (restricted maximum likelihood); the camera's "
            f"intrinsics were {record.get('intrinsics', 'free')}."
        )
    return (
        "Robust least squares of all pairs of poses, from a closed-form start and a consensus of "
        "the pairs."
    )


def _others(record: Record, factor: float) -> Iterator[ValueTable]:
    """Balls, planes and points that were found beside X, and the camera's lengths."""
    places = [("Ball in the base", record.get("ball_mm"), record.get("ball_std_mm"))]
    points = record.get("points") or {}
    places += [(f"Point {name}", p["position_mm"], p["std_mm"]) for name, p in points.items()]
    for title, place, std in places:
        if place is not None and std is not None:
            yield ValueTable(title, tuple(quantities(AXES, place, std, "m", factor)))
    lengths = list[CertifiedValue]()
    if (radius := record.get("sphere_radius_mm")) is not None:
        spread = record["sphere_radius_std_mm"] or None
        lengths += quantities(["radius of the ball"], [radius], [spread], "m", factor)
    for name, plane in (record.get("planes") or {}).items():
        lengths += quantities(
            [f"distance of plane {name} from the origin"],
            *([plane["distance_mm"]], [plane["distance_std_mm"]], "m", factor),
        )
    if lengths:
        yield ValueTable("Lengths", tuple(lengths))
    if record.get("scale_std_ppm") is not None:
        by, std = (1e-6 * float(record[key]) for key in ("scale_ppm", "scale_std_ppm"))
        about = "Positive: the camera shows lengths too long. X allows for it."
        scale = CertifiedValue("error of all lengths of the camera", by, "%", std, factor)
        yield ValueTable("Scale of the camera", (scale,), about)


def _fit(record: Record) -> Iterator[tuple[str, str]]:
    counts = record["counts"]
    total = counts.get("images", counts["rows"])
    what = "pictures" if "images" in counts else "rows"
    yield f"{what} that were used", f"{counts['inliers']} of {total}"
    if record.get("reprojection_rms_px") is not None:
        yield "reprojection, RMS", f"{record['reprojection_rms_px']:.3f} px"
        if record.get("reprojection_left_out_rms_px") is not None:
            left_out = f"{record['reprojection_left_out_rms_px']:.3f} px"
            yield "reprojection in pictures left out in turn, RMS", left_out
        return
    for key, unit, what in (("rms_mm", "m", "position"), ("rms_deg", "rad", "angle")):
        if record.get(key) is not None:
            number = float(stored(float(record[key]), unit))  # type: ignore[arg-type]
            yield f"residuals in {what}, RMS", text(number, unit, with_unit=True)  # type: ignore[arg-type]


def _references(record: Record) -> Iterator[Reference]:
    """What gave the lengths their unit, and what of it is in the results."""
    if "profiles" in record:
        yield not_stated("scanner", "lengths of the scanner")
        if record.get("sphere_radius_mm") is not None and not record.get("sphere_radius_std_mm"):
            yield not_stated("ball", "radius of the ball")
    elif "camera_noise" in record:
        ppm = record.get("assumed_scale_ppm")
        yield scale_of(
            *("camera", ppm, "depth camera"),
            more=" as far as the measurement leaves it",
        )
    elif "reprojection_rms_px" in record:
        yield not_stated("board", "size of the board")
    else:
        name = "lengths that the camera or tracker reports"
        yield scale_of("target", record.get("scale_ppm"), name)
