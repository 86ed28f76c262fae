"""Which corners were seen from which pose: pictures and poses matched by the image's name."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import SamplesError
from suta_calib.measurements import Board, Corners
from suta_calib.measurements.csv_table import SutaCalibWarning
from suta_calib.terms.poses import PoseSource
from suta_calib.words import listed

# Names of images that an error quotes.
_QUOTED: Final = 3


def with_corners(poses: PoseSource, corners: Corners, board: Board) -> PoseSource:
    """Poses whose samples hold the corners that were seen in their pictures.

    Args:
        poses: with the label ``image``.
        corners: of any pictures; those of others are left out.
        board: whose points they are.

    Returns:
        The poses of pictures that have corners.

    Warns:
        SutaCalibWarning: some pictures have none.

    Raises:
        SamplesError: no picture has any.
    """
    images: NDArray[np.str_] = poses.samples.labels["image"]
    there = np.isin(images, corners.image)
    if not there.any():
        raise SamplesError(
            f"images {_quoted(images)} in the samples and {_quoted(corners.image)} in the corners",
            "the same names in both",
            file=corners.path,
            where="column 'image'",
        )
    if not there.all():
        lost = images[~there]
        warnings.warn(
            f"{corners.path}: no corners of {len(lost)} of {len(images)} images "
            f"({_quoted(lost)}): they are left out",
            SutaCalibWarning,
            stacklevel=2,
        )
        poses, images = poses.take(there), images[there]
    numbers = {number: k for k, number in enumerate(board.points)}
    table = np.full((len(images), len(numbers), 2), np.nan)
    columns = np.array([numbers[int(number)] for number in corners.point], dtype=np.intp)
    for row, image in enumerate(images):
        mine = corners.image == image
        table[row, columns[mine]] = corners.pixel[mine]
    return poses.with_samples(replace(poses.samples, pixels=table))


def _quoted(names: NDArray[np.str_]) -> str:
    """The first few different ones."""
    different = list(dict.fromkeys(names.tolist()))
    quoted = different[:_QUOTED]
    return listed(quoted) if len(different) == len(quoted) else ", ".join([*quoted, "…"])
