"""Checks of input arrays, and errors that name the file of the data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError, SamplesError
from suta_calib.geometry.numbers import are_rotations


def checked_points(points: ArrayLike, where: str) -> FloatArray:
    """(n, 3) finite numbers; `SamplesError` for anything else."""
    return _checked(points, (3,), where)


def checked_sigmas(sigma: ArrayLike | None, count: int, where: str) -> FloatArray | None:
    """(n, 3) positive numbers for ``count`` points, or None; `SamplesError` for anything else."""
    if sigma is None:
        return None
    sigmas = checked_points(sigma, where)
    if len(sigmas) != count:
        raise SamplesError(f"{len(sigmas)} rows", f"{count}, as there are points", where=where)
    for index in np.argwhere(sigmas <= 0.0):
        raise SamplesError(
            f"{sigmas[tuple(index)]:g}", "a length greater than 0", where=f"{where}{index}"
        )
    return sigmas


def checked_poses(
    rotation: ArrayLike, position: ArrayLike, where: str
) -> tuple[FloatArray, FloatArray]:
    """Finite rotations (n, 3, 3) and positions (n, 3) of the same n; `SamplesError` else."""
    R, p = _checked(rotation, (3, 3), where), _checked(position, (3,), where)
    if len(R) != len(p):
        raise SamplesError(
            f"{len(R)} rotations and {len(p)} positions", "the same number of both", where=where
        )
    for row in np.flatnonzero(~are_rotations(R)):
        raise SamplesError(
            "a matrix that is not a rotation", "orthonormal, right-handed", where=f"{where}[{row}]"
        )
    return R, p


def _checked(values: ArrayLike, shape: tuple[int, ...], where: str) -> FloatArray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as problem:
        raise SamplesError(f"no array of numbers ({problem})", where=where) from None
    if array.shape[1:] != shape:
        expected = ", ".join(map(str, ("n", *shape)))
        raise SamplesError(f"shape {array.shape}", f"({expected})", where=where)
    for index in np.argwhere(~np.isfinite(array)):
        raise SamplesError("a number that is not finite", "finite numbers", where=f"{where}{index}")
    return array


@contextmanager
def error_context(file: Path | None = None, where: str = "") -> Iterator[None]:
    """Say in which file, and where in it, the data are that an `InputError` speaks of.

    Args:
        file: the file; an error that names one already keeps it.
        where: put before the place the error names, such as ``frame 3``.
    """
    try:
        yield
    except InputError as error:
        raise SamplesError(
            error.found,
            error.expected,
            file=error.file or file,
            line=error.line,
            where=": ".join(filter(None, (where, error.where))),
            hint=error.hint,
        ) from error
