"""A linear transform for 3D Slicer and ITK, as text (``.tfm``) or HDF5 (``.h5``)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.exchange.chosen_poses import POSE, POSE_OPTIONS, chosen_poses
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.optional_packages import load
from suta_calib.units import mm
from suta_calib.words import listed


class SlicerTfmWriter(Writer):
    """One pose as ITK's text file of transforms."""

    name = "slicer-tfm"
    summary = "one pose as linear transform of 3D Slicer and ITK, text (.tfm)"
    example = "results --format slicer-tfm --pose tip --out tip.tfm"
    options = POSE_OPTIONS
    file = "exported.tfm"

    def content(self, result: Result, given: Given) -> bytes:
        """An ``AffineTransform_double_3_3``, in mm and ITK's axes."""
        numbers = _itk_parameters(result, given, self.name)
        return (
            "#Insight Transform File V1.0\n#Transform 0\n"
            "Transform: AffineTransform_double_3_3\n"
            f"Parameters: {' '.join(map(repr, numbers.tolist()))}\n"
            "FixedParameters: 0 0 0\n"
        ).encode()


class SlicerH5Writer(Writer):
    """One pose as ITK's HDF5 file of transforms, which SimpleITK writes."""

    name = "slicer-h5"
    summary = "one pose as linear transform of 3D Slicer and ITK, HDF5 (.h5)"
    example = "results --format slicer-h5 --pose tip --out tip.h5"
    options = POSE_OPTIONS
    extra = "formats"
    file = "exported.h5"

    def content(self, result: Result, given: Given) -> bytes:
        """An ``AffineTransform_double_3_3``, in mm and ITK's axes."""
        itk = load("SimpleITK", self.extra)
        transform = itk.AffineTransform(3)
        transform.SetParameters(_itk_parameters(result, given, self.name).tolist())
        # SimpleITK writes to files only.
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self.file
            itk.WriteTransform(transform, str(path))
            return path.read_bytes()


def _itk_parameters(result: Result, given: Given, form: str) -> FloatArray:
    """(12,) of ITK's AffineTransform: nine of a matrix by rows, and a translation in mm.

    Slicer's transform takes coordinates from the child to the parent in RAS; ITK's takes them the
    other way, in LPS.
    """
    poses = chosen_poses(result, form, given)
    if len(poses) != 1:
        names = listed([pose.child for pose in poses])
        raise given.refuse(POSE, f"{len(poses)} poses", f"the name of one: {names}")
    matrix = np.array(poses[0].matrix)
    matrix[:3, 3] = mm(matrix[:3, 3])
    # Slicer's axes (right, anterior, superior) in ITK's (left, posterior, superior).
    ras_lps = np.diag([-1.0, -1.0, 1.0, 1.0])
    other_way = ras_lps @ np.linalg.inv(matrix) @ ras_lps
    return np.concatenate([other_way[:3, :3].ravel(), other_way[:3, 3]])
