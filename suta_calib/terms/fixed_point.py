"""One unknown point touched from many directions: pivot calibration, single-point articulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.geometry import FloatArray, Symbol
from suta_calib.measurements import SampleColumns
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.term import Block, Noise, Pose, Setup, Term, grouped, point_parameters


def _residual(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """In the tool's frame: in the base frame, noise would seem to tell where the arm points."""
    del data
    return poses[0].inverse_act(own)


class FixedPoint(Term):
    """``R_iᵀ (c - p_i)`` for every touch of the unknown point c.

    Finds what parallel pillars hide, such as the tool's length; leaves the overall scale free
    unless another term fixes it.

    Args:
        poses: samples with the label point.
        noise: scatter and robustness, m per axis.
    """

    kind: ClassVar[str] = "fixed_point"
    columns: ClassVar[SampleColumns] = SampleColumns(labels=("point",))

    def __init__(self, poses: PoseSource, noise: Noise = Noise()) -> None:
        super().__init__(poses, noise)
        labels = poses.samples.labels["point"]
        self._points, self._point = grouped(labels)
        self.own = tuple(p for n in self._points for p in point_parameters(f"fixed_point[{n}]"))
        rows = np.arange(len(poses))
        self.blocks = (
            Block(
                "position",
                "m",
                3,
                _residual,
                rows[:, None],
                3 * self._point[:, None] + np.arange(3),
                np.zeros((len(poses), 0)),
                noise,
                np.zeros(len(poses)),
                tuple(str(n) for n in labels),
            ),
        )

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> FixedPoint:
        """Build it from a row of a job file."""
        return cls(poses, setup.noise)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """The mean of the touches of each point."""
        del rotation
        means = [position[self._point == k].mean(axis=0) for k in range(len(self._points))]
        return np.concatenate(means)

    def check_enough(self) -> None:
        """Two touches of every point at least."""
        for k, name in enumerate(self._points):
            touches = int(np.sum(self._point == k))
            if touches < 2:
                raise SamplesError(
                    f"point {name} touched once",
                    "every point touched at least twice, from different directions",
                    where=self.kind,
                )
