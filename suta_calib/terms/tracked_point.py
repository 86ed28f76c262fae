"""An external instrument saw the tip, or targets near it: motion capture, a laser tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import extent, register_points, rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log
from suta_calib.measurements import SampleColumns, Samples
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import Block, Pose, flat, grouped, pose_of
from suta_calib.terms.checks import check_unit
from suta_calib.terms.external_frame import (
    point_named,
    point_parameters,
    pose_named,
    pose_parameters,
    pose_values,
)
from suta_calib.terms.hand_eye_start import Poses, chordal_mean
from suta_calib.terms.instrument_terms import SEEN_UNIT, InstrumentTerm
from suta_calib.terms.observed import Observed, TrueFrame
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
from suta_calib.terms.target_start import instrument_and_targets
from suta_calib.terms.term import Gap, Mount

# Where the instrument sees the base from, unless `TrackedPoint.simulate` is told.
_T: Final = (rotation_from_vector([0.3, -1.2, 0.7]), np.array([1.1, -0.4, 0.6]))


def _position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    base = pose_of(unknowns)
    target = poses[0].p + poses[0].R @ unknowns[6:9] if unknowns.numel() > 6 else poses[0].p
    return base.R @ target + base.p - data


def _weighted_position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _position(poses, unknowns, data[:3]) / data[3:]


def _rotation(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    target = poses[0].R @ pose_of(unknowns[6:12]).R if unknowns.numel() > 6 else poses[0].R
    return symbolic_chordal_log(ca.reshape(data, 3, 3).T @ pose_of(unknowns).R @ target)


@dataclass(frozen=True, eq=False, repr=False)
class TrackedPoint(InstrumentTerm):
    """``T_instrument_base (p_i + R_i t) - z_i``; the instrument-to-base pose is unknown.

    Without the label target, t = 0: the tip itself was seen. With it, every label is a reflector or
    a marker that sits somewhere unknown on the tip's link, ``target[A].x|y|z`` in the tip frame;
    where orientations were seen too it is a frame, whose turn ``target[A].rx|ry|rz`` is unknown as
    well. The targets then take up whatever moves the tip frame in its link.

    Where the samples state a standard deviation of each coordinate (in the instrument's axes), rows
    and axes weigh by them. What is learnt is then one factor on all that they state.

    Attributes:
        poses: samples with a measured position, an orientation if there is one, and perhaps the
            label target.
        label: instruments with the same label stand at the same place.
        typical_sigma: the row that `noise` is said of, where the samples state standard deviations,
            m: by default their geometric mean, from which on learning begins unless `noise` says
            otherwise. Rows that are taken keep that of the whole.

    Raises:
        SamplesError: the samples hold no positions.
    """

    kind = "tracked_point"
    order = 7
    about = (
        "an external instrument measured the tip at x, y, z (m; columns qx, qy, qz, qw may be "
        "added). The pose of the instrument is estimated too. With a column target, the measured "
        "point is the reflector of that name: it is anywhere on the tip's link, and its place is "
        "estimated too"
    )
    columns = SampleColumns(
        position=True,
        position_sigma=True,
        orientation="optional",
        common_labels=("target",),
        about={
            "x, y, z": "Position that the instrument measured.",
            "sigma_x, sigma_y, sigma_z": "Standard deviation of each, or one sigma of all three "
            "(m, or mm with _mm): how rows weigh against each other.",
            "qx, qy, qz, qw": "Orientation that the instrument measured.",
            "target": "Name of the measured reflector; without the column, the tip itself.",
        },
    )
    medium = "instrument"
    mark = "target"
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"target": ("target",), "row": ()}
    frames = (
        TrueFrame(
            "base",
            "base_in_instrument",
            "pose of the base in the instrument's frame",
            required=False,
            seen_from=True,
        ),
    )
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "base": (
            "a change of the unknown pose of the instrument has the same effect",
            "nothing to do if the arm's base is only a convention; otherwise measure the base "
            "with the instrument",
        ),
        "tool": (
            "moves the tip in its link. The instrument does not see this, because the unknown "
            "places of the targets on that link cancel it",
            "nothing to do: the targets are estimated relative to the tip",
        ),
    }
    tells: ClassVar[Mapping[Gap, str]] = {
        "base": "measure the tip with an external instrument (tracked_point)",
        "place": "measure the tip with an external instrument (tracked_point)",
    }

    typical_sigma: float | None = None

    def __post_init__(self) -> None:
        stated = self.poses.samples.position_sigma
        if stated is not None and self.typical_sigma is None:
            object.__setattr__(self, "typical_sigma", float(np.exp(np.mean(np.log(stated)))))
        super().__post_init__()

    @property
    def opens(self) -> Mapping[Gap, tuple[str, str]]:
        """Only targets take up where the tip is in its link."""
        gaps: tuple[Gap, ...] = ("base", "tool") if self.marked else ("base",)
        return {gap: self.leaves_open[gap] for gap in gaps}

    @cached_property
    def _targets(self) -> tuple[list[str], IntArray]:
        """Their labels, and which of them each sample saw, (n,); none where it was the tip."""
        if not self.marked:
            return [], np.zeros(len(self.poses), dtype=np.intp)
        return grouped(self.poses.samples.labels[self.mark])

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The pose of the instrument, then where the targets are in the tip."""
        of_one = point_parameters if self.poses.samples.rotation is None else pose_parameters
        frames = (p for frame in self.frame_names for p in pose_parameters(frame))
        return (*frames, *(p for n in self._targets[0] for p in of_one(f"target[{n}]")))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Positions, and rotations where they were seen."""
        samples, own_columns = self.poses.samples, np.tile(np.arange(6), (len(self.poses), 1))
        names, target = self._targets
        if names:
            size = (len(self.own_parameters) - 6) // len(names)
            own_columns = np.hstack([own_columns, 6 + size * target[:, None] + np.arange(size)])
        block, labels, angular = Block.per_sample, samples.origin, self.angular_noise
        position = block(
            "position", "m", 3, _position, own_columns, self._measured, self.noise, labels
        )
        if samples.position_sigma is not None:
            position = self._weighted(position, samples.position_sigma)
        if samples.rotation is None:
            return (position,)
        turned = flat(samples.rotation)
        return position, block(
            "rotation", "rad", 3, _rotation, own_columns, turned, angular, labels
        )

    def _weighted(self, block: Block, stated: FloatArray) -> Block:
        assert self.typical_sigma is not None
        relative, noise = stated / self.typical_sigma, block.noise
        if noise.sigma is None:
            noise = replace(noise, sigma=self.typical_sigma)
        return replace(
            block,
            residual=_weighted_position,
            data=np.hstack([block.data, relative]),
            noise=noise,
            relative=relative,
            typical=self.typical_sigma,
        )

    @property
    def _measured(self) -> FloatArray:
        if self.poses.samples.position is None:
            raise self.refuse("no positions", "columns x, y, z")
        return self.poses.samples.position

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tip, or the targets, as the instrument sees them."""
        (frame,) = self.frame_names
        R, p = pose_named(values, frame)
        rotation, position = poses.at(values)
        labels = poses.samples.labels.get(self.mark)
        if labels is not None:
            names, target = grouped(labels)
            turned = f"target[{names[0]}].rx" in values
            frames = [_target_named(values, f"target[{n}]", turned=turned) for n in names]
            sits, at = (np.array(c)[target] for c in zip(*frames, strict=True))
            position = position + np.einsum("nij,nj->ni", rotation, at)
            rotation = rotation @ sits
        return Observed(position @ R.T + p, R @ rotation)

    def check_enough(self) -> None:
        """Three samples at least, for the instrument's pose is six unknowns; in the arm's unit.

        A target that was seen once says nothing but where it is itself.
        """
        if len(self.poses) < 3:
            raise self.refuse(
                f"{len(self.poses)} samples",
                "at least 3 that are not on a line: the instrument has six unknowns",
            )
        names, target = self._targets
        for name, rows in zip(names, np.bincount(target), strict=False):
            if rows < 2:
                raise self.refuse(
                    f"target {name} seen once",
                    "every target measured at least twice, because its place on the link is "
                    "unknown",
                    hint="is its label misspelt?",
                )
        if not isinstance(self.poses, ArmPoses):
            return
        expected = "the tip's positions in m, as the arm moved it"
        check_unit(self, "positions", extent(self._measured), extent, expected, SEEN_UNIT)

    @classmethod
    def simulate(
        cls,
        count: int,
        *,
        spread: PoseNoise | None = None,
        seed: int = 0,
        T: Poses = _T,
        size: ArrayLike = (0.2, 0.2, 0.2),
        gross: OutlierModel | None = None,
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
        ideal = exact.observed(truth, exact.poses).place
        positions, outliers = contaminated(
            errors, (spread or EXACT).scattered(noise, (upright, ideal)), gross or NO_OUTLIERS
        )
        samples = replace(samples, position=positions[1])
        return Simulated(cls(MeasuredPoses(upright, points, samples)), truth, outliers)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Arun's registration of the tip's positions; `instrument_and_targets` where there are."""
        if not self._targets[0]:
            return pose_values(*register_points(position, self._measured))
        R, p, turns, targets = self._body(rotation, position)
        if turns is None:
            return np.concatenate([pose_values(R, p), targets.reshape(-1)])
        poses = [pose_values(turn, t) for turn, t in zip(turns, targets, strict=True)]
        return np.concatenate([pose_values(R, p), *poses])

    def _body(
        self, rotation: FloatArray, position: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray]:
        """``T_instrument_base``, and turns (k, 3, 3) and places (k, 3) of targets in the tip."""
        orientations, (_, target) = self.poses.samples.rotation, self._targets
        R, p, targets = instrument_and_targets(
            (rotation, position), self._measured, target, orientations
        )
        if orientations is None:
            return R, p, None, targets
        sits = np.swapaxes(R @ rotation, 1, 2) @ orientations
        turns = [chordal_mean(sits[target == k]) for k in range(len(targets))]
        return R, p, np.array(turns), targets

    def mount(self, rotation: FloatArray, position: FloatArray) -> Mount | None:
        """By hand-eye calibration over the arm as it is where orientations were seen."""
        if self.marked:
            return None
        _, _, turns, targets = self._body(rotation, position)
        return Mount(None if turns is None else turns[0], targets[0])

    @property
    def on_unknown_mount(self) -> tuple[str, TrackedPoint] | None:
        """The same with a target in place of the tip."""
        if self.marked:
            return None
        samples = self.poses.samples
        labels = {**samples.labels, self.mark: np.full(len(samples), "body")}
        what = "a reflector at another place on the tip's link"
        if samples.rotation is not None:
            what = "a body that is fixed to the tip's link with an unknown position and orientation"
        marked = self.over_poses(self.poses.with_samples(replace(samples, labels=labels)))
        return f"the instrument measures {what}: give its name in a column {self.mark}", marked


def _target_named(values: Mapping[str, float], label: str, *, turned: bool) -> Poses:
    """Rotation (3, 3) of a target, upright where none was seen, and position (3,)."""
    return pose_named(values, label) if turned else (np.eye(3), point_named(values, label))
