"""Where the poses of a term come from: an arm's readings, or a tracking system.

A pose source gives ``T_base_tool`` for every sample. For an arm it is a function of the unknown
geometry; for a body that was tracked it is a measurement. Terms are written over either.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.measurements.samples import Samples
from suta_calib.model.arm import ArmModel


class PoseSource(ABC):
    """Poses ``T_base_tool`` of the samples of one term.

    Attributes:
        samples: the rows, with whatever was observed beside the pose.
    """

    samples: Samples

    def __len__(self) -> int:
        return len(self.samples)

    @abstractmethod
    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Rotations (n, 3, 3) and positions (n, 3), m, for parameter values by name."""

    @abstractmethod
    def with_samples(self, samples: Samples) -> PoseSource:
        """The same poses with other things observed beside them; rows for rows."""

    @abstractmethod
    def take(self, rows: ArrayLike) -> PoseSource:
        """The poses of some samples, by number or by boolean mask."""


class ArmPoses(PoseSource):
    """Poses of an arm's tip by forward kinematics: the geometry may be unknown."""

    def __init__(self, arm: ArmModel, samples: Samples) -> None:
        self.arm = arm
        self.samples = samples

    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Forward kinematics of the samples."""
        return self.arm.forward(self.samples.q, values)

    def with_samples(self, samples: Samples) -> ArmPoses:
        """The same arm's poses at the samples' readings."""
        return ArmPoses(self.arm, samples)

    def take(self, rows: ArrayLike) -> ArmPoses:
        """The poses of some samples of the same arm."""
        return ArmPoses(self.arm, self.samples.take(rows))


class MeasuredPoses(PoseSource):
    """Poses that were measured: no parameter changes them.

    Args:
        rotation: (n, 3, 3) of ``T_base_tool``.
        position: (n, 3), m.
        samples: what was observed beside them, n rows (may have no joints).
        exact: whether their own noise may be left out of account when it is judged what the data
            tell: because it is small, or the caller judges by himself.
    """

    def __init__(
        self, rotation: FloatArray, position: FloatArray, samples: Samples, *, exact: bool = False
    ) -> None:
        self.rotation, self.position = rotation, position
        self.samples, self.exact = samples, exact

    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """The measured poses, whatever the values."""
        del values
        return np.asarray(self.rotation), np.asarray(self.position)

    def with_samples(self, samples: Samples) -> MeasuredPoses:
        """The same measured poses."""
        return MeasuredPoses(self.rotation, self.position, samples, exact=self.exact)

    def take(self, rows: ArrayLike) -> MeasuredPoses:
        """Some of the poses."""
        some, samples = np.asarray(rows), self.samples.take(rows)
        return MeasuredPoses(self.rotation[some], self.position[some], samples, exact=self.exact)
