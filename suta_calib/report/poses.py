"""What the answers on poses share: rows that were fitted, poses in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import quaternion_from_rotation, rpy_from_rotation
from suta_calib.model.parameters import PLACEMENT
from suta_calib.report.document import File, Text
from suta_calib.report.listing import Column, Json, Listing, Row, Table, csv_text, plain, shown_as
from suta_calib.units import Unit, deg, key, mm, text
from suta_calib.words import listed

if TYPE_CHECKING:
    from suta_calib.pose_calibration import robust_answer
    from suta_calib.pose_calibration.eye_poses import PoseBetween
    from suta_calib.pose_calibration.optimality import Optimality
    from suta_calib.pose_calibration.undetermined import NotFound

MOST_OUTLIERS: Final = 10


# ── rows ─────────────────────────────────────────────────────────────────────────────────────
def residuals_file(
    inliers: BoolArray,
    names: Mapping[str, Sequence[str] | Sequence[int]],
    slides: FloatArray,
    turns: FloatArray | None = None,
    numbers: IntArray | None = None,
) -> File:
    """``residuals.csv``: names, slides (n, 3), m, and turns (n, 3), rad, of every row.

    ``numbers`` (n,) of the rows in their file are 0, 1, … by default.
    """
    number = int if numbers is None else lambda k: int(numbers[k])
    columns = [Column[int]("row", value=number)]
    columns += [Column(name, value=cells.__getitem__) for name, cells in names.items()]
    vectors: list[tuple[str, Unit, FloatArray]] = [("", "m", slides)]
    vectors += [] if turns is None else [("r", "rad", turns)]
    for prefix, unit, vector in vectors:
        parts = [*vector.T, np.linalg.norm(vector, axis=1)]
        keys = (*(f"{prefix}{axis}" for axis in "xyz"), "norm")
        for name, part in zip(keys, parts, strict=True):
            columns.append(Column(name, value=part.__getitem__, unit=unit))
    columns.append(Column("status", value=lambda k: "inlier" if inliers[k] else "outlier"))
    rows = Listing("", *columns)
    # of residuals in files
    return File("residuals.csv", lambda: csv_text(rows, range(len(inliers)), 6))


def fitted_rows(answer: robust_answer.FittedRows, lines: Sequence[int]) -> Json:
    """Outliers and counts, and what is proven where that was asked, for JSON."""
    count, lost, optimality = len(answer.inliers), answer.outliers, answer.optimality
    proven = {} if optimality is None else {"optimality": optimality_record(optimality)}
    return {
        **proven,
        "outliers": list(lost),
        "outlier_lines": [lines[row] for row in lost],
        "suspects": list(answer.rows_in_file(answer.suspects)),
        "counts": {"rows": count, "inliers": count - len(lost), "outliers": len(lost)},
    }


def fit_texts(
    figures: str, what: str, answer: robust_answer.FittedRows, lines: Sequence[int]
) -> list[Text]:
    """How well the rows agree, and which do not."""
    count, lost = len(answer.inliers), answer.outliers
    fitted = f"{count - len(lost)} of {count} {what}s fitted"
    if lost:
        rows, s = listed([f"{row} (line {lines[row]})" for row in lost], MOST_OUTLIERS), "s"
        fitted += f"; {len(lost)} outlier{s * (len(lost) > 1)}: row{s * (len(lost) > 1)} {rows}"
    optimality = answer.optimality
    # What is not proven stands with the verdict.
    proven = [Text(optimality.sentence)] if optimality and optimality.certified else []
    return [Text(figures), Text(fitted), *proven]


def optimality_record(optimality: Optimality) -> Json:
    """What is proven of an answer, as JSON has it; gaps are relative to the cost."""
    return {
        "certified": optimality.certified,
        "method": optimality.method,
        "gap": optimality.gap,
        "answer_gap": optimality.answer_gap,
        "reached": optimality.reached,
        "moved_mm": mm(optimality.moved),
        "moved_deg": None if optimality.turned is None else deg(optimality.turned),
    }


def not_found_record(one: NotFound) -> Json:
    """An eye, a camera or a target without a pose, as JSON has it."""
    return {
        "usable": False,
        "rows": one.rows,
        "undetermined": list(one.directions),
        "because": one.sentence,
    }


# ── poses ────────────────────────────────────────────────────────────────────────────────────
# Of a label and four texts.
_CELLS: Final[list[Callable[[tuple[str, ...]], str]]] = [itemgetter(k) for k in range(5)]
_POSE: Final = Listing("", Column("", "", _CELLS[0]), *(shown_as("", c) for c in _CELLS[1:]))


def pose_table(title: str, pose: FloatArray, std: FloatArray, axes: str) -> Table:
    """A pose (4, 4), m, in words: position, roll pitch yaw, quaternion.

    ``std`` (6,) is of its position, m, and of a small turn about ``axes``, rad.
    """
    rpy, quaternion = rpy_from_rotation(pose[:3, :3]), quaternion_from_rotation(pose[:3, :3])
    rows = (
        ("position x y z, mm", *(text(v, "m") for v in pose[:3, 3]), ""),
        ("  ± std", *(text(v, "m") for v in std[:3]), ""),
        ("roll pitch yaw, deg", *(text(v, "rad") for v in rpy), ""),
        (f"  ± turn about {axes}", *(text(v, "rad") for v in std[3:]), ""),
        ("quaternion x y z w", *(f"{round(v, 6) + 0.0:.6f}" for v in quaternion.tolist())),
    )
    return _POSE.of(rows, title)


def axes_with_std(
    position: Callable[[Row], FloatArray], std: Callable[[Row], FloatArray]
) -> tuple[Column[Row], ...]:
    """Columns x, y, z that show each coordinate of a row's place ± its standard deviation, mm."""

    def cell(k: int) -> Callable[[Row], str]:
        return lambda row: f"{text(position(row)[k], 'm')} ± {text(std(row)[k], 'm')}"

    return tuple(shown_as(axis, cell(k)) for k, axis in enumerate("xyz"))


def pose_record(pose: FloatArray, prefix: str = "") -> Json:
    """A pose (4, 4), m, as JSON has it beside the matrix."""
    R = pose[:3, :3]
    return {
        f"{prefix}position_mm": plain(pose[:3, 3], "m"),
        f"{prefix}rpy_deg": plain(rpy_from_rotation(R), "rad"),
        f"{prefix}quaternion_xyzw": plain(quaternion_from_rotation(R)),
    }


def pose_std_record(std: FloatArray) -> Json:
    """Standard deviations (6,) of a pose, m and rad, as JSON has them."""
    units: tuple[Unit, ...] = ("m", "m", "m", "rad", "rad", "rad")
    return {
        key(name, unit): plain(value, unit)
        for name, unit, value in zip(PLACEMENT, units, std, strict=True)
    }


def between_record(poses: Sequence[PoseBetween]) -> list[Json]:
    """Poses between eyes as JSON has them."""
    return [
        {
            "eye": one.name,
            "in_eye": one.inside,
            "T": one.pose,
            "std": pose_std_record(one.std6),
        }
        for one in poses
    ]


def covariance_record(matrix: FloatArray, order: Sequence[str], unit: str) -> Json:
    """A covariance as JSON has it."""
    return {"order": list(order), "unit": unit, "matrix": plain(matrix)}
