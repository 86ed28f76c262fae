"""COLMAP: poses of a camera in ``images.txt``, two lines a picture."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import numbers_of, read_foreign_text, rows_of_text
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given
from suta_calib.exchange.pose_series import PoseSeries, imported_series
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS
from suta_calib.exchange.truncated import COMPLETE, check_last_line


class ColmapReader(Reader):
    """``T_camera_world`` of every picture: with ``--invert`` the camera's pose in the world.

    The model has no unit of length unless somebody scaled it.
    """

    name = "colmap"
    summary = "COLMAP images.txt: pose of the world in the camera frame of each picture"
    example = "images.txt --format colmap --out poses.csv"
    options = (*BODY_OPTIONS, UNIT, COMPLETE)
    suffixes = (".txt",)
    signature = re.compile(r"IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID")

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Every second line that is no comment, the others are the picture's points."""
        text = read_foreign_text(path)
        check_last_line(path, text, given)
        rows = rows_of_text(path, text, " ")
        # IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
        cells = 10
        pictures = [row for row in rows if len(row.cells) == cells and not row.cells[9].isdigit()]
        if not pictures:
            raise ForeignFileError(
                "no pictures", "lines of ten cells, with a name at the end", file=path
            )
        lines = [row.line for row in pictures]
        numbers = numbers_of(path, pictures, range(1, 8))
        rotation = rotations_from("wxyz", numbers[:, :4], path, lines)
        poses = np.concatenate([rotation, numbers[:, 4:, None]], axis=2)
        names = [row.cells[9] for row in pictures]
        series = {"camera": PoseSeries(poses, names, lines)}
        return imported_series(path, self.name, series, given)
