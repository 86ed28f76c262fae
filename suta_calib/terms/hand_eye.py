"""A camera on the moving body sees a target that stays: hand-eye calibration, AX = ZB."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import extent, rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log
from suta_calib.measurements import SampleColumns, Samples, YamlSection
from suta_calib.measurements.fields import TEXT, Field
from suta_calib.measurements.pose_files import FAR, NEAR
from suta_calib.measurements.scale import LengthScale
from suta_calib.terms.block import Block, Pose, flat, grouped, pose_of
from suta_calib.terms.checks import check_unit
from suta_calib.terms.external_frame import labelled, pose_named, pose_values
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.instrument_terms import SEEN_UNIT, InstrumentTerm
from suta_calib.terms.many_eyes_start import SeenTogether, eyes_and_targets
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
    random_turns,
)
from suta_calib.terms.term import Gap

# Where the eye is in the hand, and where the target, unless `HandEye.simulate` is told.
_X: Final = (rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08]))
_Z: Final = (rotation_from_vector([2.0, 0.4, 0.3]), np.array([0.6, 0.2, -0.1]))
# Labels of the samples that name the eye and the target.
LABELS: Final = ("eye", "target")


@dataclass(frozen=True, eq=False)
class Owners:
    """Owners ``names`` of poses, and ``which`` (n,) of them each sample looks at."""

    names: list[str]
    which: IntArray

    def poses(self, values: Mapping[str, float]) -> Poses:
        """Rotation (n, 3, 3) and position (n, 3), m, that each sample looks at."""
        rotations, positions = zip(*(pose_named(values, name) for name in self.names), strict=True)
        return np.array(rotations)[self.which], np.array(positions)[self.which]


def _target_in_eye(poses: Sequence[Pose], unknowns: Symbol) -> Pose:
    """``T_eye_target = (T_base_hand T_hand_eye)⁻¹ T_base_target`` as the unknowns have it."""
    hand_eye, target = pose_of(unknowns[0:6]), pose_of(unknowns[6:12])
    R_base_eye = poses[0].R @ hand_eye.R
    p_base_eye = poses[0].R @ hand_eye.p + poses[0].p
    return Pose(R_base_eye.T @ target.R, R_base_eye.T @ (target.p - p_base_eye))


def target_position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """In the eye's frame, which moves with the arm: the base gauge stays unobservable."""
    target, robot_noise_fraction = Pose(ca.reshape(data[3:12], 3, 3), data[0:3]), data[12]
    expected, hand_in_eye = (
        _target_in_eye(poses, unknowns),
        pose_of(unknowns[0:6]).inverse_act([0, 0, 0]),
    )
    turn = symbolic_chordal_log(expected.R @ target.R.T)
    lever = robot_noise_fraction * (target.p - hand_in_eye) + data[13:16]
    return expected.p - target.p - ca.cross(turn, lever)


def target_rotation(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """The turn from where the target was seen to where it is expected."""
    target = ca.reshape(data, 3, 3)
    return symbolic_chordal_log(target.T @ _target_in_eye(poses, unknowns).R)


@dataclass(frozen=True, eq=False, repr=False)
class HandEye(InstrumentTerm):
    """``(T_base_hand,i X)⁻¹ Z`` against the measured ``T_eye_target,i``.

    X = ``T_hand_eye`` and Z = ``T_base_target`` are unknown. With the hand's poses inverted the
    same term is eye-to-hand: X = ``T_base_eye`` and Z = ``T_hand_target``. Eliminating Z gives
    AX = XB. With the labels eye and target every eye has an X of its own, and every target a Z.

    Noise that turns the hand moves the target, seen from the eye, about the hand; noise that turns
    what the eye sees does not. The part of the turn in each residual that is the hand's, times its
    lever, is taken out of the position: what is left is independent of it (Gauss-Markov).

    Attributes:
        poses: samples with the measured pose of the target in the eye.
        label: terms with the same label share the eye and the target, where no sample names them.
        target_label: of the target, where it is another one than the eye's.
        robot_noise_fraction: part of the rotational noise (of its variance) that is the hand's,
            0 to 1.
        lever_in_eye, lever_in_target: (3,), m, in the axes of the eye and of the target; their sum
            is added to the lever. Zero where the noise of places and turns is independent at the
            hand's and the target's origins: a tag's may be at its middle while its frame is not.

    Raises:
        SamplesError: the samples hold no positions or no orientations.
    """

    kind = "hand_eye"
    order = 8
    about = (
        "a camera on the tip saw a target: its pose in the camera, m. With columns eye and target, "
        "every camera and every target of a name has a pose of its own"
    )
    columns = SampleColumns(
        position=True,
        orientation="required",
        common_labels=LABELS,
        about={
            "x, y, z": "Position of the target in the camera.",
            "qx, qy, qz, qw": "Orientation of the target in the camera.",
            "eye": "Name of the camera, where there are several on the tip.",
            "target": "Name of the target that it saw, where there are several.",
        },
    )
    keys = (Field("target", TEXT, "Label of the target, where several cameras share it."),)
    medium = "camera"
    # What a camera sees is as large as the target was printed.
    assumed_scale = LengthScale.of_grade("printed")
    frames = (
        TrueFrame("hand_eye", "eye_in_tip", "pose of the camera on the tip", required=True),
        TrueFrame("target", "target_in_base", "pose of the target in the base", required=True),
    )
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "tool": (
            "moves the tip in the last link. The camera does not see this, because its unknown "
            "pose on the tip cancels it",
            "touch one fixed point from several directions (fixed_point); not needed if only the "
            "camera matters",
        )
    }

    target_label: str = ""
    robot_noise_fraction: float = 0.0
    lever_in_eye: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_in_target: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def _measured(self) -> Poses:
        samples = self.poses.samples
        if samples.position is None or samples.rotation is None:
            raise self.refuse("no poses of the target", "columns x, y, z, qx, qy, qz, qw")
        return samples.rotation, samples.position

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """The label of the target."""
        settings = super().read_settings(row)
        return {"target_label": settings.pop("target"), **settings} if settings else {}

    @property
    def settings(self) -> Mapping[str, Any]:
        """The label of the target."""
        return {"target_label": self.target_label} if self.target_label else {}

    def owners(self, poses: PoseSource) -> tuple[Owners, Owners]:
        """Owners of the poses of eyes and of targets, and which of them each pose looks at."""
        labels, owners = poses.samples.labels, list[Owners]()
        of_all = self.label, self.target_label or self.label
        for frame, column, label in zip(self.frames, LABELS, of_all, strict=True):
            names, which = (
                grouped(labels[column])
                if column in labels
                else ([label], np.zeros(len(poses), dtype=np.intp))
            )
            ends = [labelled(frame.owner, poses.label(name, frame.end)) for name in names]
            owners.append(Owners(ends, which))
        return owners[0], owners[1]

    @cached_property
    def seen_together(self) -> SeenTogether:
        """Which eye saw which target in every sample."""
        eyes, targets = self.owners(self.poses)
        return SeenTogether(eyes.which, targets.which, len(eyes.names), len(targets.names))

    @property
    def fractions(self) -> FloatArray:
        """(n,) part of each sample's rotational noise that is the hand's."""
        return np.full(len(self.poses), self.robot_noise_fraction)

    @property
    def frame_names(self) -> list[str]:
        """Owners of the poses of eyes, then of targets."""
        eyes, targets = self.owners(self.poses)
        return [*eyes.names, *targets.names]

    def prior_from_pose(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """As of one eye and one target; where there are several, by the name of either."""
        named = [owner for owner in self.frame_names if owner.endswith(f"[{label}]")]
        if label and named:
            return pose.of_pose(named[0])
        eyes, targets = self.owners(self.poses)
        keys = {"": eyes, self.frames[0].key: eyes, self.frames[1].key: targets}
        only = keys.get(label)
        return pose.of_pose(only.names[0]) if only and len(only.names) == 1 else {}

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Positions and rotations of the target in the eye."""
        (rotation, position), n = self._measured, len(self.poses)
        together = self.seen_together
        first = 6 * np.column_stack([together.eye, together.eyes + together.target])
        own_columns = (first[:, :, None] + np.arange(6)).reshape(n, 12)
        turned = flat(rotation)
        lever = np.array(self.lever_in_eye) + rotation @ self.lever_in_target
        both = np.column_stack([position, turned, self.fractions, lever])
        block, labels, angular = Block.per_sample, self.poses.samples.origin, self.angular_noise
        return (
            block("position", "m", 3, target_position, own_columns, both, self.noise, labels),
            block("rotation", "rad", 3, target_rotation, own_columns, turned, angular, labels),
        )

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The targets as the eyes see them."""
        X, Z = (owners.poses(values) for owners in self.owners(poses))
        rotation, position = poses.at(values)
        back = np.swapaxes(rotation @ X[0], 1, 2)
        eye = position + np.einsum("nij,nj->ni", rotation, X[1])
        return Observed(np.einsum("nij,nj->ni", back, Z[1] - eye), back @ Z[0])

    @classmethod
    def simulate(
        cls,
        count: int,
        *,
        hand: PoseNoise | None = None,
        eye: PoseNoise | None = None,
        seed: int = 0,
        X: Poses = _X,
        Z: Poses = _Z,
        turn: float = np.pi / 4,
        axes: ArrayLike | None = None,
        gross: OutlierModel | None = None,
        robot_noise_fraction: float = 0.0,
    ) -> Simulated[HandEye]:
        """A hand moves its eye about a target, half a metre away.

        Args:
            count: pairs of poses.
            hand: noise of ``T_base_hand``.
            eye: noise of ``T_eye_target``.
            seed: of everything random.
            X: ``T_hand_eye``, rotation (3, 3) and position (3,), m.
            Z: ``T_base_target``.
            turn: largest turn of the hand from the middle orientation, rad.
            axes: (k, 3) the only axes, in the hand, to turn about; any axis by default.
            gross: pairs in which what the eye saw is grossly wrong.
            robot_noise_fraction: of the term.
        """
        random, noise, errors = np.random.default_rng(seed).spawn(3)
        R = random_turns(random, count, turn, axes)
        # The eye sees the target half a metre away, about.
        ahead = np.array([0.0, 0.0, 0.5]) + random.uniform(-0.1, 0.1, (count, 3))
        p = Z[1] - R @ X[1] - np.einsum("nij,nj->ni", R @ X[0], ahead)
        samples = Samples.from_arrays([], np.zeros((count, 0)), position=ahead, rotation=R)
        exact = cls(MeasuredPoses(R, p, samples), robot_noise_fraction=robot_noise_fraction)
        truth = named(exact, (pose_values(*X), pose_values(*Z)))
        moved = MeasuredPoses(*(hand or EXACT).scattered(noise, (R, p)), samples)
        ideal = exact.observed(truth, exact.poses)
        assert ideal.rotation is not None
        targets = (eye or EXACT).scattered(noise, (ideal.rotation, ideal.place))
        (R_seen, p_seen), outliers = contaminated(errors, targets, gross or NO_OUTLIERS)
        samples = replace(samples, position=p_seen, rotation=R_seen)
        return Simulated(exact.over_poses(moved.with_samples(samples)), truth, outliers)

    def check_enough(self) -> None:
        """Three samples at least: two motions about different axes; in the arm's unit."""
        if len(self.poses) < 3:
            raise self.refuse(f"{len(self.poses)} poses", "at least 3, turned about different axes")
        if not isinstance(self.poses, ArmPoses):
            return
        _, target = self._measured
        away = float(np.median(np.linalg.norm(target, axis=1)))
        # About a target in its middle a camera may turn without seeing it move.
        if away > FAR or away < NEAR:
            what, expected = "the target's positions", "the target's positions in the camera, in m"
            check_unit(self, what, extent(target), extent, expected, SEEN_UNIT)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Closed-form poses of all eyes and targets; of one of each by quaternions of motions."""
        X, Z = eyes_and_targets((rotation, position), self._measured, self.seen_together)
        return np.concatenate([pose_values(*X).reshape(-1), pose_values(*Z).reshape(-1)])
