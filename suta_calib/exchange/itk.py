"""Poses as ITK's affine transforms, as 3D Slicer reads and writes them."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result, Transform
from suta_calib.units import mm
from suta_calib.words import listed

POSE: Final = Option("pose", "Which of several poses, by its child frame.", "NAME")
# Slicer's axes (right, anterior, superior) in ITK's (left, posterior, superior).
_RAS_LPS: Final = np.diag([-1.0, -1.0, 1.0, 1.0])


def one_pose(result: Result, given: Given, form: str) -> Transform:
    """The pose that the options name, or the only one.

    Raises:
        InputError: none, several and none was named, or none of that name.
    """
    poses = result.need_transforms(form)
    if POSE in given:
        poses = tuple(pose for pose in poses if pose.child == given.text(POSE))
    if len(poses) != 1:
        names = listed([pose.child for pose in result.need_transforms(form)])
        problem = f"{len(poses)} poses" + (f" {given.text(POSE)!r}" if POSE in given else "")
        raise given.refuse(POSE, problem, f"the name of one: {names}")
    return poses[0]


def itk_parameters(transform: Transform) -> FloatArray:
    """(12,) of ITK's AffineTransform: nine of a matrix by rows, and a translation in mm.

    Slicer's transform takes coordinates from the child to the parent in RAS; ITK's takes them the
    other way, in LPS.
    """
    matrix = np.array(transform.matrix)
    matrix[:3, 3] = mm(matrix[:3, 3])
    other_way = _RAS_LPS @ np.linalg.inv(matrix) @ _RAS_LPS
    return np.concatenate([other_way[:3, :3].ravel(), other_way[:3, 3]])
