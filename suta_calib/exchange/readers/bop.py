"""BOP: ``scene_gt.json``, poses of objects in a camera, by picture."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_json
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given
from suta_calib.exchange.pose_series import PoseSeries, imported_series
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS


class BopReader(Reader):
    """``T_camera_object`` of every object (``cam_R_m2c``, ``cam_t_m2c``), in mm."""

    name = "bop"
    summary = "BOP scene_gt.json: poses of objects in the camera frame, by picture"
    example = "scene_gt.json --format bop --body object_1 --out poses.csv"
    options = (*BODY_OPTIONS, UNIT)
    suffixes = (".json",)
    signature = re.compile(r'"cam_R_m2c"')

    def read(self, path: Path, given: Given) -> ImportedRows:
        """The poses of one object, a row a picture in which it is."""
        series: dict[str, list[tuple[int, Any]]] = {}
        for picture, objects in read_json(path).items():
            for pose in objects if isinstance(objects, list) else ():
                numbers = _numbers(path, picture, pose)
                series.setdefault(f"object_{pose.get('obj_id', '')}", []).append(
                    (int(picture), numbers)
                )
        if not series:
            raise ForeignFileError("no objects", "objects with cam_R_m2c and cam_t_m2c", file=path)
        by_name = {
            name: PoseSeries(
                np.stack([numbers for _, numbers in poses]), [k for k, _ in poses], [1] * len(poses)
            )
            for name, poses in series.items()
        }
        return imported_series(path, self.name, by_name, given, unit="mm")


def _numbers(path: Path, picture: str, pose: Any) -> Any:
    """(3, 4) of an object in a picture."""
    try:
        rotation = np.array(pose["cam_R_m2c"], float).reshape(3, 3)
        numbers = np.column_stack([rotation, np.array(pose["cam_t_m2c"], float).reshape(3)])
        int(picture)
    except (KeyError, TypeError, ValueError):
        numbers = np.full((3, 4), np.nan)
    if not np.isfinite(numbers).all():
        expected = "a number, with cam_R_m2c (9 numbers) and cam_t_m2c (3 numbers)"
        raise ForeignFileError("a different picture", expected, file=path, where=picture)
    return numbers
