"""A linear transform as text, ``.tfm``, for 3D Slicer and ITK."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.exchange.itk import POSE, itk_parameters, one_pose
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer


class SlicerTfmWriter(Writer):
    """One pose as ITK's text file of transforms."""

    name: ClassVar[str] = "slicer-tfm"
    summary: ClassVar[str] = "one pose as linear transform of 3D Slicer and ITK, text (.tfm)"
    example: ClassVar[str] = "results --format slicer-tfm --pose tip --out tip.tfm"
    options: ClassVar[tuple[Option, ...]] = (POSE,)
    file: ClassVar[str] = "exported.tfm"

    def content(self, result: Result, given: Given) -> bytes:
        """An ``AffineTransform_double_3_3``, in mm and ITK's axes."""
        numbers = itk_parameters(one_pose(result, given, self.name))
        return (
            "#Insight Transform File V1.0\n#Transform 0\n"
            "Transform: AffineTransform_double_3_3\n"
            f"Parameters: {' '.join(repr(float(value)) for value in numbers)}\n"
            "FixedParameters: 0 0 0\n"
        ).encode()
