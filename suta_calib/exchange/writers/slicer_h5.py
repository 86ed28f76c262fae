"""A linear transform as HDF5, ``.h5``, for 3D Slicer and ITK."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import ClassVar

from suta_calib.exchange.itk import POSE, itk_parameters, one_pose
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.extras import load


class SlicerH5Writer(Writer):
    """One pose as ITK's HDF5 file of transforms, which SimpleITK writes."""

    name: ClassVar[str] = "slicer-h5"
    summary: ClassVar[str] = "one pose as linear transform of 3D Slicer and ITK, HDF5 (.h5)"
    example: ClassVar[str] = "results --format slicer-h5 --pose tip --out tip.h5"
    options: ClassVar[tuple[Option, ...]] = (POSE,)
    extra: ClassVar[str] = "formats"
    file: ClassVar[str] = "exported.h5"

    def content(self, result: Result, given: Given) -> bytes:
        """An ``AffineTransform_double_3_3``, in mm and ITK's axes."""
        itk = load("SimpleITK", self.extra)
        numbers = itk_parameters(one_pose(result, given, self.name))
        transform = itk.AffineTransform(3)
        transform.SetParameters(numbers.tolist())
        # SimpleITK writes to files only.
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self.file
            itk.WriteTransform(transform, str(path))
            return path.read_bytes()
