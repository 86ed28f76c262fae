"""Samples of pictures as samples of where the target was: each picture's own pose of the board."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from suta_calib import vision
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements import Board, Camera, Samples, read_corners
from suta_calib.measurements.corners import Corners
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.terms import MeasuredPoses
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.camera_row import with_corners
from suta_calib.vision.pictures import SUFFIXES

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")


def with_target_poses(
    samples: Path, corners: Path, board: Board, camera: Camera, folder: Path
) -> Path:
    """Write samples with the pose of the board in the camera that each row's picture shows.

    Args:
        samples: with a column ``image``.
        corners: in these pictures.
        board: that is seen.
        camera: that sees it.
        folder: where the file is written, by the name that the samples have.

    Raises:
        SamplesError: no such column, or no picture that tells where the board is.
    """
    table = read_csv_table(samples)
    images = table.cells("image", "the name of the picture taken at each row")
    rows, rotation, position = target_poses(images, read_corners(corners), board, camera)
    numbers = np.hstack([position, quaternion_from_rotation(rotation)])
    columns = [name for name in table.columns if name not in POSE]
    out = folder / samples.name
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*columns, *POSE])
        for row, pose in zip(rows.tolist(), numbers.tolist(), strict=True):
            writer.writerow([*(table.columns[name][row] for name in columns), *map(repr, pose)])
    return out


def target_poses(
    images: Sequence[str], corners: Corners, board: Board, camera: Camera
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Which rows (k,) have a picture that tells where the board is, and its pose in the camera.

    Args:
        images: of each row (n,).
        corners: in these pictures.
        board: that is seen.
        camera: that sees it.

    Raises:
        SamplesError: no picture does.
    """
    count = len(images)
    labels = {"image": np.array(images)}
    numbered = [str(k) for k in range(count)]
    blank = Samples.from_arrays([], np.zeros((count, 0)), labels=labels, origin=numbered)
    poses = MeasuredPoses(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), blank)
    pictured = with_corners(poses, corners, board).samples
    assert pictured.pixels is not None
    rotation, position = BoardPictures(board, camera, pictured.pixels).poses
    there = np.flatnonzero(np.isfinite(position).all(axis=1))
    if not len(there):
        expected = "pictures from which the pose of the board follows"
        raise SamplesError("too few corners in every picture", expected, file=corners.path)
    rows = np.array([int(pictured.origin[k]) for k in there.tolist()], dtype=np.intp)
    return rows, rotation[there], position[there]


def corners_in(pictures: Sequence[Path], board: Board, camera: Camera | None) -> Corners:
    """Corners of a board in pictures (files or folders), as a camera took them.

    Raises:
        SamplesError: the board is in none.
    """
    detection = vision.detect(vision.find_pictures(pictures), board, camera)
    if not len(detection.corners):
        expected = "pictures of the board that was calibrated with"
        raise SamplesError("pictures without a board", expected, file=pictures[0])
    return detection.corners


def is_picture(path: Path) -> bool:
    """Whether it is a picture, or a folder of them."""
    return path.is_dir() or path.suffix.lower() in SUFFIXES
