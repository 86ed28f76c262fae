"""An external instrument saw the tip: motion capture, a laser tracker, another arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points, rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log
from suta_calib.measurements import SampleColumns, Samples
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.poses import MeasuredPoses, PoseSource
from suta_calib.terms.resimulation import Resimulation, pose_named
from suta_calib.terms.synthetic import (
    EXACT,
    NO_OUTLIERS,
    OutlierModel,
    PoseNoise,
    Simulated,
    contaminated,
    simulated,
)
from suta_calib.terms.term import (
    Block,
    Noise,
    Pose,
    Setup,
    Term,
    pose_of,
    pose_parameters,
    pose_values,
)

# Where the instrument sees the base from, unless `TrackedPoint.simulate` is told.
_T: Final = (rotation_from_vector([0.3, -1.2, 0.7]), np.array([1.1, -0.4, 0.6]))


def _position(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    base = pose_of(own)
    return base.R @ poses[0].p + base.p - data


def _rotation(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    return symbolic_chordal_log(ca.reshape(data, 3, 3).T @ pose_of(own).R @ poses[0].R)


class TrackedPoint(Term):
    """``T_instrument_base p_i - z_i``; the instrument-to-base pose is unknown.

    Args:
        poses: samples with a measured position, and an orientation of the tip if there is one.
        noise: scatter and robustness of a position, m per axis.
        angular_noise: the same for the orientation, rad per axis.
        label: instruments with the same label stand at the same place.

    Raises:
        SamplesError: the samples hold no positions.
    """

    kind: ClassVar[str] = "tracked_point"
    columns: ClassVar[SampleColumns] = SampleColumns(position=True, orientation="optional")

    def __init__(
        self,
        poses: PoseSource,
        noise: Noise = Noise(),
        angular_noise: Noise = Noise(),
        label: str = "default",
    ) -> None:
        super().__init__(poses, noise, angular_noise)
        self.label = label
        samples = poses.samples
        if samples.position is None:
            raise SamplesError("no positions", "columns x, y, z", where=self.kind)
        self._seen = samples.position
        name = "base" if label == "default" else f"base[{label}]"
        self.own = pose_parameters(name)
        n = len(poses)
        rows, own = np.arange(n)[:, None], np.tile(np.arange(6), (n, 1))
        zero, labels = np.zeros(n), samples.origin
        self.blocks = (
            Block("position", "m", 3, _position, rows, own, self._seen, noise, zero, labels),
        )
        if samples.rotation is not None:
            data = np.swapaxes(samples.rotation, 1, 2).reshape(n, 9)
            self.blocks += (
                Block(
                    "rotation", "rad", 3, _rotation, rows, own, data, angular_noise, zero, labels
                ),
            )

    def check_enough(self) -> None:
        """Three samples at least: the pose of the instrument is six unknowns."""
        if len(self.poses) < 3:
            raise SamplesError(
                f"{len(self.poses)} samples",
                "at least 3: the pose of the instrument alone is six unknowns",
                where=self.kind,
            )

    @classmethod
    def simulate(
        cls,
        count: int,
        *,
        spread: PoseNoise = EXACT,
        seed: int = 0,
        T: Poses = _T,
        size: ArrayLike = (0.2, 0.2, 0.2),
        gross: OutlierModel = NO_OUTLIERS,
    ) -> Simulated[TrackedPoint]:
        """Corresponding points, as for a registration: exact ones, and what an instrument saw.

        Args:
            count: of points.
            spread: noise of what was seen; of its position.
            seed: of everything random.
            T: ``T_instrument_base``, rotation (3, 3) and position (3,), m.
            size: (3,) edges of the box that the points fill, m; two of them for coplanar points,
                one for points on a line.
            gross: points that were seen grossly wrong.
        """
        random, noise, errors = np.random.default_rng(seed).spawn(3)
        points = (random.random((count, 3)) - 0.5) * np.asarray(size, dtype=float)
        upright = np.tile(np.eye(3), (count, 1, 1))
        seen = spread.scattered(noise, (upright, points @ T[0].T + T[1]))
        (_, position), outliers = contaminated(errors, seen, gross)
        samples = Samples.from_arrays([], np.zeros((count, 0)), position=position)
        term = cls(MeasuredPoses(upright, points, samples))
        return simulated(term, (pose_values(*T),), outliers)

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> TrackedPoint:
        """Build it from a row of a job file."""
        return cls(poses, setup.noise, setup.angular_noise, setup.label)

    def over_poses(self, poses: PoseSource) -> Self:
        """The same over other poses."""
        return type(self)(poses, self.noise, self.angular_noise, self.label)

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """The tip as the instrument sees it."""
        R, p = pose_named(values, self.own[0].name.removesuffix(".x"))
        rotation, position = self.poses.at(values)
        return self.over_poses(again.seen(self.poses, (R @ rotation, position @ R.T + p), noise))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Arun's registration of the tip's positions to what the instrument saw."""
        del rotation
        return pose_values(*register_points(position, self._seen))
