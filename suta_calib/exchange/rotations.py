"""Rotations in the forms in which other programs write them, as matrices."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.geometry.numbers import rotation_from_quaternion, rotation_from_vector

_LETTERS: Final = [
    *("".join(order) for order in permutations("xyz")),
    *(a + b + a for a, b in product("xyz", repeat=2) if a != b),
]
# SciPy's names: small letters turn about the fixed axes one after the other, capitals about the
# body's own.
EULER: Final = (*_LETTERS, *(letters.upper() for letters in _LETTERS))
# Numbers of each form; rows and columns say how the nine of a matrix follow each other.
NUMBERS: Final[dict[str, int]] = {
    **{"xyzw": 4, "wxyz": 4, "vector": 3, "rows": 9, "columns": 9},
    **dict.fromkeys(EULER, 3),
}
# How far a length may be from one, and a matrix from a rotation, that was rounded when written.
_ROUNDED: Final = 0.01


def rotations_from(form: str, numbers: FloatArray, path: Path, lines: Sequence[int]) -> FloatArray:
    """Rotation matrices (n, 3, 3) of numbers (n, …) in one of the `NUMBERS` forms, angles in rad.

    Rows with NaN stay NaN. What was rounded when written is made a rotation to rounding.

    Raises:
        ForeignFileError: a quaternion that is not of length 1, a matrix that is no rotation, or an
            angle of thousands of turns; with the line.
    """
    if numbers.shape[1] != NUMBERS[form]:
        problem = f"{numbers.shape[1]} columns of a rotation"
        raise ForeignFileError(problem, f"{NUMBERS[form]} columns, as for {form}", file=path)
    matrices = np.full((len(numbers), 3, 3), np.nan)
    complete = np.flatnonzero(np.isfinite(numbers).all(axis=1))
    if not len(complete):
        return matrices
    values = numbers[complete]

    def check(right: BoolArray, problem: str, expected: str) -> None:
        for row in np.flatnonzero(~right)[:1]:
            line, hint = lines[int(complete[row])], "give their kind with --rotation"
            raise ForeignFileError(problem, expected, file=path, line=line, hint=hint)

    if form in ("xyzw", "wxyz"):
        quaternion = values if form == "xyzw" else np.roll(values, -1, axis=1)
        check(_are_unit(quaternion), "four numbers that are not a quaternion", "length 1")
        matrices[complete] = rotation_from_quaternion(quaternion)
    elif form in ("rows", "columns"):
        matrix = values.reshape(-1, 3, 3)
        matrix = matrix if form == "rows" else matrix.swapaxes(1, 2)
        problem = "nine numbers that are not a rotation matrix"
        check(_error(matrix) < _ROUNDED, problem, "an orthonormal, right-handed matrix")
        # The nearest rotation: what a few written decimals leave of one is not orthonormal.
        left, _, right = np.linalg.svd(matrix)
        matrices[complete] = left @ right
    else:
        # Angles of so many turns are none, and their sines no numbers any more; rad.
        most, most_angle = np.abs(values).max(axis=1), 1e4
        for row in np.flatnonzero(most > most_angle)[:1]:
            problem, line = f"an angle of {most[row]:.3g} rad", lines[int(complete[row])]
            raise ForeignFileError(problem, f"one within {most_angle:g} rad", file=path, line=line)
        vector = form == "vector"
        matrices[complete] = (
            rotation_from_vector(values)
            if vector
            else Rotation.from_euler(form, values).as_matrix()
        )
    return matrices


def are_quaternions(numbers: FloatArray) -> bool:
    """Whether all of (n, 4) numbers have together the length one but for rounding."""
    return bool(_are_unit(numbers).all())


def _are_unit(numbers: FloatArray) -> BoolArray:
    with np.errstate(over="ignore"):
        return np.asarray(np.abs(np.linalg.norm(numbers, axis=1) - 1.0) < _ROUNDED)


def is_rotation(matrix: FloatArray) -> bool:
    """Whether all matrices (n, 3, 3) are rotations but for rounding."""
    return bool(len(matrix) and np.all(_error(matrix) < _ROUNDED))


def _error(matrix: FloatArray) -> FloatArray:
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(matrix @ matrix.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
        off[np.linalg.det(np.where(np.isfinite(matrix), matrix, 0.0)) < 0] = np.inf
    return np.asarray(np.nan_to_num(off, nan=np.inf))
