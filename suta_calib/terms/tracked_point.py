"""An external instrument saw the tip: motion capture, a laser tracker, another arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import extent, register_points, rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log
from suta_calib.measurements import SampleColumns, Samples
from suta_calib.terms.block import Block, Pose, flat, pose_of
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.poses import ArmPoses, MeasuredPoses, PoseSource
from suta_calib.terms.synthetic import (
    EXACT,
    NO_OUTLIERS,
    OutlierModel,
    PoseNoise,
    Simulated,
    contaminated,
    named,
)
from suta_calib.terms.term import (
    SEEN_UNIT,
    Gap,
    Medium,
    Observed,
    SeenTerm,
    TrueFrame,
    check_unit,
    pose_named,
    pose_values,
)

# Where the instrument sees the base from, unless `TrackedPoint.simulate` is told.
_T: Final = (rotation_from_vector([0.3, -1.2, 0.7]), np.array([1.1, -0.4, 0.6]))


def _position(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    base = pose_of(own)
    return base.R @ poses[0].p + base.p - data


def _rotation(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    return symbolic_chordal_log(ca.reshape(data, 3, 3).T @ pose_of(own).R @ poses[0].R)


@dataclass(frozen=True, eq=False)
class TrackedPoint(SeenTerm):
    """``T_instrument_base p_i - z_i``; the instrument-to-base pose is unknown.

    Attributes:
        poses: samples with a measured position, and an orientation of the tip if there is one.
        label: instruments with the same label stand at the same place.

    Raises:
        SamplesError: the samples hold no positions.
    """

    kind: ClassVar[str] = "tracked_point"
    about: ClassVar[str] = (
        "an external instrument saw the tip at x, y, z (m; columns qx, qy, qz, qw may be added); "
        "where the instrument stands is found too"
    )
    columns: ClassVar[SampleColumns] = SampleColumns(position=True, orientation="optional")
    medium: ClassVar[Medium] = "instrument"
    frames: ClassVar[tuple[TrueFrame, ...]] = (
        TrueFrame("base", "base_in_instrument", required=False),
    )
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "base": (
            "the unknown pose of the instrument makes up for it",
            "choose it by convention (leave it at nominal), or survey the base with the instrument",
        )
    }
    tells: ClassVar[Mapping[Gap, str]] = {
        "base": "see the tip with an external instrument (tracked_point)",
        "place": "see the tip with an external instrument (tracked_point)",
    }

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Positions, and rotations where they were seen."""
        samples, own = self.poses.samples, np.tile(np.arange(6), (len(self.poses), 1))
        block, labels, angular = Block.per_sample, samples.origin, self.angular_noise
        position = block("position", "m", 3, _position, own, self._seen, self.noise, labels)
        if samples.rotation is None:
            return (position,)
        turned = flat(samples.rotation)
        return position, block("rotation", "rad", 3, _rotation, own, turned, angular, labels)

    @property
    def _seen(self) -> FloatArray:
        if self.poses.samples.position is None:
            raise SamplesError("no positions", "columns x, y, z", where=self.kind)
        return self.poses.samples.position

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tip as the instrument sees it."""
        (frame,) = self._frames
        R, p = pose_named(values, frame)
        rotation, position = poses.at(values)
        return Observed(position @ R.T + p, R @ rotation)

    def check_enough(self) -> None:
        """Three samples at least, for the instrument's pose is six unknowns; in the arm's unit."""
        if len(self.poses) < 3:
            raise SamplesError(
                f"{len(self.poses)} samples",
                "at least 3: the pose of the instrument alone is six unknowns",
                where=self.kind,
            )
        if not isinstance(self.poses, ArmPoses):
            return
        seen, moved = extent(self._seen), extent(self.poses.at({})[1])
        expected = "the tip's positions in m, as the arm moved it"
        check_unit(self, "positions", seen, moved, expected, SEEN_UNIT)

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
        samples = Samples.from_arrays([], np.zeros((count, 0)), position=points)
        exact = cls(MeasuredPoses(upright, points, samples))
        truth = named(exact, (pose_values(*T),))
        ideal = exact.observed(truth, exact.poses).position
        seen, outliers = contaminated(errors, spread.scattered(noise, (upright, ideal)), gross)
        samples = replace(samples, position=seen[1])
        return Simulated(cls(MeasuredPoses(upright, points, samples)), truth, outliers)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Arun's registration of the tip's positions to what the instrument saw."""
        del rotation
        return pose_values(*register_points(position, self._seen))
