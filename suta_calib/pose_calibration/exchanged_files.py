"""Files of two cameras that were exchanged: the pictures of each fit the file of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.measurements import Camera
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.intrinsics import CALIBRATED


def refuse_exchanged_files(labels: Sequence[str], pictures: Sequence[BoardPictures]) -> None:
    """Refuse the files of two cameras that fit the pictures far better once they are exchanged.

    Args:
        labels: of the cameras; one that saw several boards has several.
        pictures: of each, with the camera as its file has it.
    """
    by_label = dict[str, list[BoardPictures]]()
    for label, some in zip(labels, pictures, strict=True):
        by_label.setdefault(label, []).append(_some(some))
    for a, b in combinations(by_label, 2):
        first, second = (by_label[label][0].camera for label in (a, b))
        if not _are_two(first, second):
            continue
        if _fit_better(by_label[a], second) and _fit_better(by_label[b], first):
            raise SamplesError(
                f"pictures of camera {a} that fit the file of camera {b}, and pictures of camera "
                f"{b} that fit the file of camera {a}",
                "the file of each camera",
                where="--camera",
                hint="exchange the files of the two cameras, or their corners, whichever were "
                "exchanged",
            )


def _some(pictures: BoardPictures) -> BoardPictures:
    """A few dozen of them: what is wrong with a file is wrong in all."""
    rows = np.flatnonzero(np.isfinite(pictures.pixels).any(axis=(1, 2)))
    chosen = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), 30)).astype(np.intp))]
    return replace(pictures, pixels=pictures.pixels[chosen])


def _are_two(first: Camera, second: Camera) -> bool:
    """Whether two files differ by more than files of one camera do."""
    if (first.width, first.height) != (second.width, second.height):
        return False
    if first.lens is not second.lens:
        return True
    variance = sum(
        (CALIBRATED.stds(camera) if camera.stds is None else camera.stds)[:4] ** 2
        for camera in (first, second)
    )
    # Standard deviations: chance has one such pair of files in ten thousand.
    return bool(np.any(np.abs(first.intrinsics - second.intrinsics)[:4] > 4.0 * np.sqrt(variance)))


def _fit_better(pictures: Sequence[BoardPictures], other: Camera) -> bool:
    """Whether the pictures fit another camera far better than their own."""
    squares, numbers, poses = np.zeros(2), 0, 0
    for some in pictures:
        errors = np.stack([some.errors, replace(some, camera=other).errors])
        both = np.asarray(np.isfinite(errors).all(axis=3).all(axis=0))
        squares += np.sum(errors[:, both] ** 2, axis=(1, 2))
        numbers, poses = numbers + 2 * int(both.sum()), poses + int(both.any(axis=1).sum())
    freedom = numbers - 6 * poses
    if freedom < 1 or squares[1] == 0.0:
        return freedom > 0 and squares[0] > 0.0
    # Twice the logarithm of the likelihood ratio from which on chance is no explanation: e¹⁴ is a
    # million.
    return bool(squares[0] - squares[1] > 2.0 * 14.0 * squares[1] / freedom)
