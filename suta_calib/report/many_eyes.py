"""Report of a hand-eye calibration of several eyes and targets: every pose, and who saw what."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from suta_calib import report
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length, rpy_from_rotation
from suta_calib.measurements.pose_files import PosePairs
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.eye_poses import FRAMES, PoseBetween, Unknown
from suta_calib.pose_calibration.many_eyes import FoundPose, ManyEyesCalibration
from suta_calib.pose_calibration.undetermined import NotFound
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.hand_eye import CALIBRATION, NAME
from suta_calib.report.listing import Column, Json, Listing, Row, Table, components, plain, shown_as
from suta_calib.report.poses import (
    between_record,
    covariance_record,
    fit_texts,
    fitted_rows,
    not_found_record,
    pose_record,
    pose_std_record,
    residuals_file,
)
from suta_calib.report.uncertainty import budget_record
from suta_calib.units import text
from suta_calib.words import listed

# Names of partners in one cell.
NAMED: Final = 8


def _pose_columns(pose: Callable[[Row], FloatArray]) -> tuple[Column[Row], ...]:
    """Position and roll, pitch, yaw of a pose (4, 4), each with its ± over three axes."""
    known: Callable[[Row], tuple[float, float]] = attrgetter("displaced_turned")
    return (
        *components(("x, mm", "y, mm", "z, mm"), lambda row: pose(row)[:3, 3], "m"),
        Column("", "±, mm", lambda row: known(row)[0], "m"),
        *components(
            ("roll, deg", "pitch", "yaw"),
            lambda row: rpy_from_rotation(pose(row)[:3, :3]),
            "rad",
            form=".3f",
        ),
        Column("", "±, deg", lambda row: known(row)[1], "rad", form=".3f"),
    )


FOUND: Final = Listing[FoundPose]("", Column("name", ""), *_pose_columns(lambda one: one.pose))
FITTED: Final = Listing[FoundPose](
    "How well they agree",
    Column("name", ""),
    shown_as("fitted", lambda one: f"{one.inliers} of {len(one.rows)}"),
    Column("rms", "RMS, mm", unit="m"),
    Column("rms", "RMS, deg", lambda one: one.rms_angle, "rad"),
    Column("", "seen with", lambda one: listed([*one.partners], NAMED)),
)


@dataclass(frozen=True, eq=False)
class SeenPair:
    """Rows in which one eye saw one target.

    Attributes:
        eye, target: their names.
        rows: how many there are.
        inliers: how many of them were fitted.
        rms, rms_angle: of these, m and rad; None of none.
    """

    eye: str
    target: str
    rows: int
    inliers: int
    rms: float | None
    rms_angle: float | None


PAIRS: Final = Listing[SeenPair](
    "Who saw what",
    Column("eye", "eye"),
    Column("target", "target"),
    Column("rows", "rows"),
    Column("inliers", "fitted"),
    Column("rms", "RMS, mm", unit="m"),
    Column("rms", "RMS, deg", lambda pair: pair.rms_angle, "rad"),
    key="pairs",
)


BETWEEN: Final = Listing[PoseBetween]("", Column("name", ""), *_pose_columns(lambda row: row.pose))


def many_eyes_document(calibration: ManyEyesCalibration, data: PosePairs) -> Document:
    """Every X and every Z, with standard deviations; ``residuals.csv``."""
    frames, sight = FRAMES[calibration.setup], calibration.sight
    between = [*_between(calibration)]
    fit = (
        f"rms {text(calibration.rms, 'm', with_unit=True)} (3-D), "
        f"{text(calibration.rms_angle, 'rad', with_unit=True)}"
    )
    lines = [data.lines[row] for row in calibration.rows_in_file(calibration.inliers | True)]
    labels = {
        "eye": [sight.eyes[k] for k in sight.together.eye],
        "target": [sight.targets[k] for k in sight.together.target],
    }
    residuals, turns = calibration.residuals, calibration.rotation_residuals
    parts: list[Part] = [
        *found_tables(calibration),
        *([BETWEEN.of(between, f"The other eyes in eye {sight.eyes[0]}")] if between else []),
        FITTED.of((*calibration.eyes, *calibration.targets), place="detail"),
        PAIRS.of(_pairs(calibration), place="detail"),
        *fit_texts(fit, "pair", calibration, data.lines),
        *([] if calibration.noise is None else [Text(_noise_text(calibration))]),
        residuals_file(
            *(calibration.inliers, {"line": lines, **labels}, residuals, turns),
            calibration.numbers,
        ),
        Figure(lambda: report.many_eyes_plot(calibration)),
    ]
    sides = {"X": calibration.eyes, "Z": calibration.targets}
    usable, noise = calibration.assessment.usable, calibration.noise
    order = [
        f"{side}[{one.name}].{key}"
        for side, poses in sides.items()
        for one in poses
        for key in PLACEMENT
    ]
    record: Json = {
        "setup": calibration.setup,
        "model": "AX=ZB",
        **{
            side: {**{one.name: one.pose for one in poses}, **_nothing(calibration, side)}
            for side, poses in sides.items()
        },
        "frames": {name: frames[name] for name in calibration.unknowns},
        "std": {
            side: {
                **{one.name: pose_std_record(one.std6) for one in poses},
                **_nothing(calibration, side),
            }
            for side, poses in sides.items()
        },
        **{
            part: {
                **{one.name: {"usable": usable, **_record(one)} for one in sides[side]},
                **{one.name: not_found_record(one) for one in _lost(calibration, side)},
            }
            for part, side in (("eyes", "X"), ("targets", "Z"))
        },
        "between_eyes": between_record(between),
        **CALIBRATION.record(calibration),
        **({} if noise is None else {"hand_noise": _noise_record(noise[0].tolist())}),
        **fitted_rows(calibration, data.lines),
        "covariance": covariance_record(calibration.covariance, order, "m, rad"),
        "uncertainty": [budget_record(budget) for budget in calibration.budgets],
        "input": str(data.path),
    }
    about = NAME, "Hand-eye calibration of several eyes and targets", calibration.assessment
    return Document(*about, parts, record, "result", calibration.in_a_line)


def found_tables(calibration: ManyEyesCalibration) -> Iterator[Table]:
    """All X, then all Z, in words."""
    frames = FRAMES[calibration.setup]
    sides: tuple[tuple[Unknown, tuple[FoundPose, ...]], ...] = (
        ("X", calibration.eyes),
        ("Z", calibration.targets),
    )
    for name, poses in sides:
        _, base, what = frames[name].split("_")
        title = f"{name} = {frames[name]}: each {what} in the {base}, {calibration.setup}"
        yield FOUND.of(poses, title)


def _record(one: FoundPose) -> Json:
    noise = {} if one.noise is None else _noise_record(one.noise)
    return {
        **pose_record(one.pose),
        **noise,
        "rows": len(one.rows),
        "inliers": one.inliers,
        "rms_mm": plain(one.rms, "m"),
        "rms_deg": plain(one.rms_angle, "rad"),
        "seen_with": list(one.partners),
    }


def _noise_text(calibration: ManyEyesCalibration) -> str:
    """What hand and eyes err by, in words."""
    assert calibration.noise is not None
    names = ["the hand", *(f"eye {one.name}" for one in calibration.eyes)]
    sizes = [
        f"{name} {text(place, 'm', with_unit=True)} and {text(turn, 'rad', with_unit=True)}"
        for name, (place, turn) in zip(names, calibration.noise.tolist(), strict=True)
    ]
    return f"noise (one component): {listed(sizes, NAMED)}"


def _lost(calibration: ManyEyesCalibration, side: str) -> list[NotFound]:
    """Eyes (side X) or targets (side Z) that were not found."""
    role = "eye" if side == "X" else "target"
    return [one for one in calibration.not_found if one.role == role]


def _nothing(calibration: ManyEyesCalibration, side: str) -> Json:
    """No number for them."""
    return {one.name: None for one in _lost(calibration, side)}


def _noise_record(noise: Sequence[float]) -> Json:
    """Scatter of one component, m and rad."""
    return {"noise_mm": plain(noise[0], "m"), "noise_deg": plain(noise[1], "rad")}


def _between(calibration: ManyEyesCalibration) -> Iterator[PoseBetween]:
    """Every eye in the first one."""
    first, *rest = calibration.sight.eyes
    for other in rest:
        yield PoseBetween(other, first, *calibration.relative(first, other))


def _pairs(calibration: ManyEyesCalibration) -> Iterator[SeenPair]:
    """Every eye with every target that it saw, in their order."""
    sight, good = calibration.sight, calibration.inliers
    for eye, target, rows in sorted(sight.together.edges, key=lambda edge: edge[:2]):
        fitted = rows[good[rows]]
        yield SeenPair(
            sight.eyes[eye],
            sight.targets[target],
            len(rows),
            len(fitted),
            rms_length(calibration.residuals[fitted]) if len(fitted) else None,
            rms_length(calibration.rotation_residuals[fitted]) if len(fitted) else None,
        )
