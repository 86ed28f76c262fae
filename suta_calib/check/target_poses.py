"""Samples of pictures as samples of where the target was: each picture's own pose of the board."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements import Board, Camera, Samples, read_corners
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.terms import MeasuredPoses
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.camera_row import with_corners

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
    images = np.array(table.cells("image", "the name of the picture taken at each row"))
    count = len(images)
    blank = Samples.from_arrays(
        [], np.zeros((count, 0)), labels={"image": images}, origin=[str(k) for k in range(count)]
    )
    poses = MeasuredPoses(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), blank)
    seen = with_corners(poses, read_corners(corners), board).samples
    assert seen.pixels is not None
    rotation, position = BoardPictures(board, camera, seen.pixels).poses
    there = np.flatnonzero(np.isfinite(position).all(axis=1))
    if not len(there):
        expected = "pictures from which the pose of the board follows"
        raise SamplesError("too few corners in every picture", expected, file=corners)
    rows = [int(seen.origin[k]) for k in there.tolist()]
    numbers = np.hstack([position[there], quaternion_from_rotation(rotation[there])])
    kept = [name for name in table.columns if name not in POSE]
    out = folder / samples.name
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*kept, *POSE])
        for row, pose in zip(rows, numbers.tolist(), strict=True):
            writer.writerow([*(table.columns[name][row] for name in kept), *map(repr, pose)])
    return out
