"""Which corners were seen from which pose: pictures and poses matched by the image's name."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.measurements import Board, Corners
from suta_calib.terms.poses import PoseSource
from suta_calib.words import listed


def with_corners(poses: PoseSource, corners: Corners, board: Board) -> PoseSource:
    """Poses with the label ``image`` of pictures that have corners, with these in their samples.

    Corners of other pictures are left out; of pictures without any it is warned. That no picture
    has any, or that one was taken at two postures, is a SamplesError.
    """
    images: NDArray[np.str_] = poses.samples.labels["image"]
    names = list(dict.fromkeys(images.tolist()))
    number = {name: k for k, name in enumerate(names)}
    # Of every corner which of the pictures it is in; one look at each of what may be a million.
    row = np.array([number.get(name, -1) for name in corners.image.tolist()], dtype=np.intp)
    there = np.isin([number[name] for name in images.tolist()], row)
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
            f"{corners.path or 'corners'}: no corners of {len(lost)} of {len(images)} images "
            f"({_quoted(lost)}): they are left out",
            SutaCalibWarning,
            stacklevel=2,
        )
        poses, images = poses.take(there), images[there]
    _check_postures(poses)
    points = np.array(list(board.points), dtype=np.intp)
    order = np.argsort(points)
    column = order[np.searchsorted(points[order], corners.point)]
    table = np.full((len(names), len(points), 2), np.nan)
    table[row[row >= 0], column[row >= 0]] = corners.pixel[row >= 0]
    pixels = table[[number[name] for name in images.tolist()]]
    return poses.with_samples(replace(poses.samples, pixels=pixels))


def _check_postures(poses: PoseSource) -> None:
    """Refuse a picture that is named at two postures; one of them is not its own."""
    images: NDArray[np.str_] = poses.samples.labels["image"]
    if len(np.unique(images)) == len(images):
        return
    first: dict[str, int] = {}
    for row, name in enumerate(images.tolist()):
        before = first.setdefault(name, row)
        if poses.postures[row] != poses.postures[before]:
            origin = poses.samples.origin
            raise SamplesError(
                f"picture {name} at another posture than in {origin[before]}",
                "each picture where it was taken",
                where=origin[row],
            )


def _quoted(names: NDArray[np.str_]) -> str:
    """The first few different ones."""
    different = list(dict.fromkeys(names.tolist()))
    # Names of images that an error quotes.
    quoted = different[:3]
    return listed(quoted) if len(different) == len(quoted) else ", ".join([*quoted, "…"])
