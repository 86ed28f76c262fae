"""One unknown point touched from many directions: pivot calibration, single-point articulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import SampleColumns, Samples
from suta_calib.terms.poses import MeasuredPoses, PoseSource
from suta_calib.terms.resimulation import Resimulation
from suta_calib.terms.synthetic import (
    EXACT,
    NO_OUTLIERS,
    OutlierModel,
    PoseNoise,
    Simulated,
    contaminated,
    random_turns,
    simulated,
)
from suta_calib.terms.term import Block, Noise, Pose, Setup, Term, grouped, point_parameters

# Relative eigenvalue of the normal matrix below which a direction is not determined at all.
_ROUNDING: Final = 1e-12


def _at_origin(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """In the tool's frame: in the base frame, noise would seem to tell where the arm points."""
    del data
    return poses[0].inverse_act(own)


def _at_tip(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """The same for a tip somewhere on the tool."""
    del data
    return poses[0].inverse_act(own[3:6]) - own[0:3]


class FixedPoint(Term):
    """``R_iᵀ (c - p_i) - t`` for every touch of the unknown point c.

    Over an arm, t = 0: the tip is the end of the chain, which has its own parameters. This finds
    what parallel pillars hide, such as the tool's length; it leaves the overall scale free unless
    another term fixes it. Over a tracked body, the tip t in it is unknown: pivot calibration.

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
        self._tip = point_parameters("tip") if isinstance(poses, MeasuredPoses) else ()
        points = (p for n in self._points for p in point_parameters(f"fixed_point[{n}]"))
        self.own = (*self._tip, *points)
        rows = np.arange(len(poses))
        block = Block(
            "position",
            "m",
            3,
            _at_tip if self._tip else _at_origin,
            rows[:, None],
            self._own_of_rows(),
            np.zeros((len(poses), 0)),
            noise,
            np.zeros(len(poses)),
            tuple(str(n) for n in labels),
        )
        self.blocks = (block,)

    def _own_of_rows(self) -> IntArray:
        """Which own parameters each row looks at: the tip, if it is unknown, and its point."""
        tip = len(self._tip)
        point = tip + 3 * self._point[:, None] + np.arange(3)
        return np.hstack([np.tile(np.arange(tip), (len(point), 1)), point])

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> FixedPoint:
        """Build it from a row of a job file."""
        return cls(poses, setup.noise)

    @classmethod
    def simulate(
        cls,
        count: int,
        *,
        spread: PoseNoise = EXACT,
        seed: int = 0,
        tip: ArrayLike = (0.02, -0.01, 0.15),
        posts: ArrayLike = ((0.1, 0.2, -1.0),),
        turn: float = np.pi / 4,
        axes: ArrayLike | None = None,
        gross: OutlierModel = NO_OUTLIERS,
    ) -> Simulated[FixedPoint]:
        """Poses of a tracked tool that pivots on one post after the other.

        Args:
            count: poses on each post.
            spread: noise of the tracked poses.
            seed: of everything random.
            tip: (3,) in the tool, m.
            posts: (k, 3) in the tracker, m; labelled ``post_1``, ``post_2``, …
            turn: largest turn from the middle orientation, rad.
            axes: (k, 3) the only axes, in the tool, to turn about; any axis by default.
            gross: poses that are grossly wrong; the swapped ones swap places, not orientations.
        """
        random, noise, errors = np.random.default_rng(seed).spawn(3)
        t, c = np.asarray(tip, dtype=float), np.atleast_2d(np.asarray(posts, dtype=float))
        R = random_turns(random, count * len(c), turn, axes)
        poses = spread.scattered(noise, (R, np.repeat(c, count, axis=0) - R @ t))
        poses, outliers = contaminated(errors, poses, gross, swap_orientation=False)
        labels = {"point": [f"post_{k + 1}" for k in range(len(c)) for _ in range(count)]}
        samples = Samples.from_arrays([], np.zeros((len(R), 0)), labels=labels)
        return simulated(cls(MeasuredPoses(*poses, samples)), (t, *c), outliers)

    def over_poses(self, poses: PoseSource) -> Self:
        """The same over other poses."""
        return type(self)(poses, self.noise)

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """Every touch at its point."""
        points = [[values[f"fixed_point[{n}].{key}"] for key in "xyz"] for n in self._points]
        target = np.array(points)[self._point]
        return self.over_poses(again.touched(self.poses, target, noise[0]))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """The tip by linear least squares, then the mean of the touches of each point."""
        tip = stacked_pivot(rotation, position, self._point) if self._tip else np.zeros(3)
        touched = position + rotation @ tip
        means = [touched[self._point == k].mean(axis=0) for k in range(len(self._points))]
        return np.concatenate([tip[: len(self._tip)], *means])

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


def stacked_pivot(
    rotation: FloatArray, position: FloatArray, point: IntArray, weight: FloatArray | None = None
) -> FloatArray:
    """Tip in the tool, (..., 3), of ``R_i t + p_i = c_k`` by linear least squares.

    Each point c_k is eliminated by subtracting the mean over its rows; what the rotations leave
    undetermined of t is zero.

    Args:
        rotation: (n, 3, 3), poses of the tool.
        position: (n, 3), m.
        point: (n,) which point each row touched, from 0.
        weight: (..., n) of the rows, for many solutions at once; one by default.
    """
    weight = np.ones(len(position)) if weight is None else weight
    back = np.einsum("nij,ni->nj", rotation, position)
    normal = weight.sum(axis=-1)[..., None, None] * np.eye(3)
    moment = weight @ back
    for k in np.unique(point):
        rows = point == k
        w = weight[..., rows]
        total = np.maximum(w.sum(axis=-1), 1e-300)[..., None]
        R = (w @ rotation[rows].reshape(-1, 9)).reshape(*w.shape[:-1], 3, 3)
        p = w @ position[rows] / total
        normal = normal - np.swapaxes(R, -1, -2) @ R / total[..., None]
        moment = moment - np.einsum("...ij,...i->...j", R, p)
    inverse = np.linalg.pinv(normal, _ROUNDING, hermitian=True)
    return np.asarray(-np.einsum("...ij,...j->...i", inverse, moment))
