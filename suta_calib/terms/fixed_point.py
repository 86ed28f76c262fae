"""One unknown point touched from many directions: pivot calibration, single-point articulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import SampleColumns, Samples
from suta_calib.model.parameters import POSITION, Parameter
from suta_calib.terms.block import Block, Pose
from suta_calib.terms.external_frame import point_named, point_parameters
from suta_calib.terms.observed import Observed
from suta_calib.terms.places import PlaceTerm
from suta_calib.terms.poses import MeasuredPoses, PoseSource
from suta_calib.terms.synthetic import (
    EXACT,
    NO_OUTLIERS,
    OutlierModel,
    PoseNoise,
    Simulated,
    contaminated,
    named,
    random_turns,
)
from suta_calib.terms.term import Gap


def _position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """In the tool's frame: in the base frame, noise would seem to tell where the arm points."""
    del data
    touched = poses[0].inverse_act(unknowns[-3:])
    return touched - unknowns[:3] if unknowns.numel() > 3 else touched


@dataclass(frozen=True, eq=False, repr=False)
class FixedPoint(PlaceTerm):
    """``R_iᵀ (c - p_i) - t`` for every touch of the unknown point c.

    Over an arm, t = 0: the tip is the end of the chain, which has its own parameters. This finds
    what parallel pillars hide, such as the tool's length; it leaves the overall scale free unless
    another term fixes it. Over a tracked body, the tip t in it is unknown: pivot calibration.

    Attributes:
        poses: samples with the label point.
    """

    kind = "fixed_point"
    order = 3
    about = "one unknown point, touched from many directions: determines the tool's length"
    columns = SampleColumns(labels=("point",), about={"point": "Which point was touched."})
    place = "point"
    place_unknown = "fixed_point"
    place_keys = POSITION
    place_turns = False
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"point": ("point",), "row": ()}
    tested = "articulation"
    tells: ClassVar[Mapping[Gap, str]] = {
        "tool": "touch one fixed point from several directions (fixed_point)"
    }

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The tip in a tracked body, and the points."""
        return (*self._tip, *super().own_parameters)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The positions."""
        return self._blocks("position", 3, _position, common=len(self._tip))

    @cached_property
    def _tip(self) -> tuple[Parameter, ...]:
        return point_parameters("tip") if isinstance(self.poses, MeasuredPoses) else ()

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """Every touch at its point; of a tracked body, where it then is."""
        target = self._there(values, poses)
        if self._tip:
            target = target - poses.at(values)[0] @ point_named(values, "tip")
        return Observed(target)

    @classmethod
    def simulate(
        cls,
        count: int,
        *,
        spread: PoseNoise | None = None,
        seed: int = 0,
        tip: ArrayLike = (0.02, -0.01, 0.15),
        posts: ArrayLike = ((0.1, 0.2, -1.0),),
        turn: float = np.pi / 4,
        axes: ArrayLike | None = None,
        gross: OutlierModel | None = None,
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
        labels = {"point": [f"post_{k + 1}" for k in range(len(c)) for _ in range(count)]}
        samples = Samples.from_arrays([], np.zeros((len(R), 0)), labels=labels)
        turned = cls(MeasuredPoses(R, np.zeros((len(R), 3)), samples))
        truth = named(turned, (t, *c))
        scattered = (spread or EXACT).scattered(
            noise, (R, turned.observed(truth, turned.poses).place)
        )
        poses, outliers = contaminated(
            errors, scattered, gross or NO_OUTLIERS, swap_orientation=False
        )
        return Simulated(turned.over_poses(MeasuredPoses(*poses, samples)), truth, outliers)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """The tip by linear least squares, then the mean of the touches of each point."""
        names, point = self.places
        tip = stacked_pivot(rotation, position, point) if self._tip else np.zeros(3)
        touched = position + (rotation.reshape(-1, 3) @ tip).reshape(-1, 3)
        means = [touched[point == k].mean(axis=0) for k in range(len(names))]
        return np.concatenate([tip[: len(self._tip)], *means])

    def check_enough(self) -> None:
        """Two touches of every point at least."""
        names, point = self.places
        for name, touches in zip(names, np.bincount(point), strict=True):
            if touches < 2:
                raise self.refuse(
                    f"point {name} touched once",
                    "every point touched at least twice, from different directions",
                )


def rows_of_each(point: IntArray) -> list[slice | BoolArray]:
    """The rows (n,) of each of the points that are touched; all of them where it is one."""
    if not np.any(point != point[:1]):
        return [slice(None)]  # which copies nothing
    return [point == k for k in np.unique(point)]


def stacked_pivot(
    rotation: FloatArray, position: FloatArray, point: IntArray, weight: FloatArray | None = None
) -> FloatArray:
    """Tip in the tool, (..., 3), of ``R_i t + p_i = c_k`` by linear least squares.

    Each point c_k is eliminated by subtracting the mean over its rows; what the rotations leave
    undetermined of t is zero. Rows (n,) of the points count by ``weight`` (..., n), for many
    solutions at once; one by default.
    """
    weight = np.ones(len(position)) if weight is None else weight
    back = np.einsum("nij,ni->nj", rotation, position)
    normal = weight.sum(axis=-1)[..., None, None] * np.eye(3)
    moment = weight @ back
    for rows in rows_of_each(point):
        w = weight[..., rows]
        total = np.maximum(w.sum(axis=-1), 1e-300)[..., None]
        R = (w @ rotation[rows].reshape(-1, 9)).reshape(*w.shape[:-1], 3, 3)
        p = w @ position[rows] / total
        normal = normal - np.swapaxes(R, -1, -2) @ R / total[..., None]
        moment = moment - np.einsum("...ij,...i->...j", R, p)
    # Relative eigenvalue of the normal matrix below which a direction is not determined at all.
    rounding = 1e-12
    inverse = np.linalg.pinv(normal, rounding, hermitian=True)
    return np.asarray(-np.einsum("...ij,...j->...i", inverse, moment))
