"""The closed problems' answers for a terminal of 80 columns; readable without colour."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements.pose_files import Points, PosePairs, ToolPoses
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.poses.json import (
    FRAMES,
    asked_for,
    origin_std,
    quaternion,
    rpy_deg,
    verdict_on,
)
from suta_calib.units import text
from suta_calib.words import listed

MOST_OUTLIERS: Final = 10
MOST_POSTS: Final = 12
MOST_TARGETS: Final = 20


def pivot_tables(found: PivotCalibration, data: ToolPoses) -> RenderableType:
    """Tip, posts, fit and verdict."""
    posts = "post" if len(found.posts) == 1 else "posts"
    table = number_table(f"Tip in the tool, {posts} in the tracker, mm", "", *"xyz")
    table.add_row("tip", *_with_std(found.tip, found.tip_std), style="bold")
    for name in list(found.posts)[:MOST_POSTS]:
        label = "post" if data.point is None else f"post {name}"
        row = _with_std(found.posts[name], found.post_std(name))
        table.add_row(Text(label), *row)
    if len(found.posts) > MOST_POSTS:
        table.caption = f"and {len(found.posts) - MOST_POSTS} more posts: --json has them"
    fit = (
        f"rms {text(found.rms, 'm', with_unit=True)} (3-D); "
        f"the tool was turned by {np.degrees(found.turn):.0f}° RMS"
    )
    return Group(
        table,
        _fit(fit, "pose", found.inliers, data.lines),
        "",
        *verdict_lines(verdict_on(found, data)),
    )


def hand_eye_tables(found: HandEyeCalibration, data: PosePairs) -> RenderableType:
    """X, and Z where it was asked for, fit and verdict."""
    names = asked_for(found)
    tables = [_pose(n, found.setup, getattr(found, n), found.std[n]) for n in names]
    fit = (
        f"rms {text(found.rms, 'm', with_unit=True)} (3-D), "
        f"{text(found.rms_angle, 'rad', with_unit=True)}"
    )
    lost = _fit(fit, "pair", found.inliers, data.lines)
    return Group(*tables, lost, "", *verdict_lines(verdict_on(found, data)))


def register_tables(
    found: Registration, a: Points, targets: Points | None = None, *, b: Points | None = None
) -> RenderableType:
    """``T_b_a``, fit, the error to expect at the targets, verdict."""
    table = _pose_table("T_b_a: frame a in frame b")
    _pose_rows(table, found.matrix, origin_std(found), "b's axes")
    centre = np.sqrt(np.trace(found.covariance[:3, :3]))
    fit = (
        f"rms {text(found.rms, 'm', with_unit=True)} (3-D, fiducial registration error); "
        f"in the middle of the points ± {text(float(centre), 'm', with_unit=True)} (3-D)"
    )
    parts: list[RenderableType] = [table, _fit(fit, "point", found.inliers, a.lines)]
    if targets is not None:
        parts += ["", _targets(found, targets)]
    return Group(*parts, "", *verdict_lines(verdict_on(found, a, b, targets)))


def _targets(found: Registration, targets: Points) -> Table:
    table = number_table("Targets in frame b, mm", "row", *"xyz", "error")
    moved, error = found.act(targets.position), found.target_error(targets.position)
    for row in range(min(len(moved), MOST_TARGETS)):
        table.add_row(str(row), *(text(v, "m") for v in moved[row]), text(error[row], "m"))
    left = len(moved) - MOST_TARGETS
    table.caption = "error: target registration error to expect (RMS, 3-D)" + (
        f"; and {left} more: --json has them" if left > 0 else ""
    )
    return table


def _pose(name: str, setup: str, pose: FloatArray, std: FloatArray) -> Table:
    frames = FRAMES[setup][name].split("_")
    table = _pose_table(f"{name} = {'_'.join(frames)}: the {frames[2]} in the {frames[1]}, {setup}")
    _pose_rows(table, pose, std, f"the {frames[2]}'s axes")
    return table


def _pose_table(title: str) -> Table:
    return number_table(title, "", "", "", "")


def _pose_rows(table: Table, pose: FloatArray, std: FloatArray, axes: str) -> None:
    rows: dict[str, Iterable[str]] = {
        "position x y z, mm": (text(v, "m") for v in pose[:3, 3]),
        "  ± std": (text(v, "m") for v in std[:3]),
        "roll pitch yaw, deg": (text(np.radians(v), "rad") for v in rpy_deg(pose)),
        f"  ± turn about {axes}": (text(v, "rad") for v in std[3:]),
        "quaternion x y z w": (f"{round(v, 6) + 0.0:.6f}" for v in quaternion(pose)),
    }
    for label, cells in rows.items():
        table.add_row(label, *cells)


def _with_std(values: FloatArray, std: FloatArray) -> list[str]:
    return [f"{text(v, 'm')} ± {text(s, 'm')}" for v, s in zip(values, std, strict=True)]


def _fit(figures: str, what: str, inliers: BoolArray, lines: Sequence[int]) -> Group:
    """How well the rows agree, and which do not."""
    count, lost = len(inliers), [int(row) for row in np.flatnonzero(~inliers)]
    parts = [Text(figures), Text(f"{count - len(lost)} of {count} {what}s fitted")]
    if lost:
        rows = listed([f"{row} (line {lines[row]})" for row in lost], MOST_OUTLIERS)
        outliers = "outlier" if len(lost) == 1 else "outliers"
        parts[-1].append(f"; {len(lost)} {outliers}: row{'s' * (len(lost) > 1)} {rows}")
    return Group(*parts)
