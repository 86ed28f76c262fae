"""A kind of plain numbers: the three readings of an accelerometer at rest, in units of g."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.geometry.symbols import symbolic_rotation
from suta_calib.measurements import NumberColumn, SampleColumns
from suta_calib.terms import Block, Observed, PoseSource, Setup
from suta_calib.terms.block import Pose
from suta_calib_tilt.inclinometer import Inclinometer, mount_and_up

AXES = ("ax", "ay", "az")


def _difference(poses: Sequence[Pose], own: Any, data: Any) -> Any:
    """What the sensor should read less what it read, in its own frame."""
    up = symbolic_rotation(ca.vertcat(own[3], own[4], 0))[:, 2]
    return symbolic_rotation(own[:3]).T @ poses[0].R.T @ up - data


@dataclass(frozen=True, eq=False, repr=False)
class Accelerometer(Inclinometer):
    """a = Sᵀ Rᵀ u for each row: the unknowns are those of the inclinometer."""

    kind: ClassVar[str] = "accelerometer"
    about: ClassVar[str] = "an accelerometer at rest on the tip's link, in units of g"
    columns: ClassVar[SampleColumns] = SampleColumns(
        numbers=tuple(NumberColumn(axis) for axis in AXES),
        about={axis: f"Along its {axis[1]} axis." for axis in AXES},
    )
    unit: ClassVar[str] = ""
    has_angles: ClassVar[bool] = False

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> "Accelerometer":
        """Build it from a row of a job file."""
        return cls(poses, setup.noise)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Three numbers for each row."""
        own, labels = np.tile(np.arange(5), (len(self.poses), 1)), self.poses.samples.origin
        read = self._read
        block = ("acceleration", "1", 3, _difference, own, read, self.noise, labels)
        return (Block.per_sample(*block),)

    def start(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """As that of the inclinometer, by the directions."""
        length = np.linalg.norm(self._read, axis=1, keepdims=True)
        return mount_and_up(rotation, self._read / np.maximum(length, 1e-12))

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The readings of an ideal sensor."""
        own = np.array([values[p.name] for p in self.own_parameters])
        up = rotation_from_vector(np.array([own[3], own[4], 0.0]))[:, 2]
        read = (poses.at(values)[0] @ rotation_from_vector(own[:3])).transpose(2, 0, 1) @ up
        return Observed(numbers=dict(zip(AXES, read, strict=True)))

    @property
    def _read(self) -> np.ndarray:
        numbers = self.poses.samples.numbers
        return np.column_stack([numbers[axis] for axis in AXES])
