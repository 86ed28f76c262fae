"""Hand-eye calibration of several eyes and several targets in one problem."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.geometry.numbers import homogeneous, rms_length
from suta_calib.measurements.pose_files import PosePairs
from suta_calib.pose_calibration.eye_poses import PoseAccuracy, Unknown, relative_pose
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.loop_answer import LoopAnswer
from suta_calib.pose_calibration.loop_fit import checked_pairs, fit_loops
from suta_calib.pose_calibration.robust_answer import doubting, exchanged, set_aside
from suta_calib.pose_calibration.sight import Sight
from suta_calib.pose_calibration.undetermined import NotFound
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EyeSetup
from suta_calib.trust.hypotheses.depth_scale import DepthScale
from suta_calib.trust.rule import Rule
from suta_calib.units import deg, mm, text
from suta_calib.words import listed

# Names in one sentence.
NAMED: Final = 6


@dataclass(frozen=True, eq=False)
class FoundPose(PoseAccuracy):
    """The pose of one eye, or of one target.

    Attributes:
        name: its label.
        pose: (4, 4), m: an X or a Z.
        std6: (6,) displacement, m, outer axes, and turn, rad, own axes.
        rows: (k,) that look at it.
        inliers: how many of them were fitted.
        rms, rms_angle: of these against the answer, m and rad.
        partners: names of the targets that the eye saw, or of the eyes that saw the target.
        noise: scatter of one component of what an eye sees, m and rad; None of a target, and where
            it cannot be told from the hand's.
    """

    name: str
    pose: FloatArray
    std6: FloatArray
    rows: IntArray
    inliers: int
    rms: float
    rms_angle: float
    partners: tuple[str, ...]
    noise: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ManyEyesCalibration(LoopAnswer):
    """Poses of several eyes and of their targets.

    Attributes:
        sight: which eye saw which target in every row.
        X: (eyes, 4, 4), ``T_hand_eye``, or ``T_base_eye`` for eye-to-hand; m.
        Z: (targets, 4, 4), ``T_base_target``, or ``T_hand_target`` for eye-to-hand; m.
        covariance: displacement (m, outer frame's axes) and small turn (rad, own axes) of all X,
            then of all Z.
        not_found: eyes and targets whose pose the rows do not give: they are neither in `sight`
            nor are their rows among those of the answer, which have their `numbers`.
        noise: of the hand, then of every eye, (1 + eyes, 2), m and rad: scatter of one component.
            None where no rest of the hand has rows of two eyes.
    """

    sight: Sight
    X: FloatArray
    Z: FloatArray
    not_found: tuple[NotFound, ...] = ()
    noise: FloatArray | None = None

    @property
    def in_a_line(self) -> str:
        """How many of what, and how well the pairs agree."""
        count = int(self.inliers.sum())
        return (
            f"{len(self.X)} eyes, {len(self.Z)} targets, {self.setup}, RMS "
            f"{text(self.rms, 'm')} mm over {count} pairs"
        )

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Both are solved and told."""
        return "X", "Z"

    @cached_property
    def eyes(self) -> tuple[FoundPose, ...]:
        """Every eye."""
        together = self.sight.together
        return tuple(
            self._found(k, name, self.X[k], together.eye == k, self.sight.targets, together.target)
            for k, name in enumerate(self.sight.eyes)
        )

    @cached_property
    def targets(self) -> tuple[FoundPose, ...]:
        """Every target."""
        together, first = self.sight.together, len(self.X)
        return tuple(
            self._found(
                first + k, name, self.Z[k], together.target == k, self.sight.eyes, together.eye
            )
            for k, name in enumerate(self.sight.targets)
        )

    def _found(
        self,
        place: int,
        name: str,
        pose: FloatArray,
        rows: BoolArray,
        names: tuple[str, ...],
        partners: IntArray,
    ) -> FoundPose:
        at, good = slice(6 * place, 6 * place + 6), rows & self.inliers
        return FoundPose(
            name,
            pose,
            np.sqrt(np.maximum(np.diag(self.covariance)[at], 0.0)),
            np.flatnonzero(rows),
            int(good.sum()),
            rms_length(self.residuals[good]),
            rms_length(self.rotation_residuals[good]),
            tuple(names[k] for k in np.unique(partners[good]).tolist()),
            self._noise_of(place),
        )

    def _noise_of(self, eye: int) -> tuple[float, float] | None:
        if self.noise is None or eye >= len(self.X):
            return None
        place, turn = self.noise[1 + eye].tolist()
        return place, turn

    @property
    def posed(self) -> tuple[str, ...]:
        """Every X, then every Z, by name."""
        X = (f"X of {name}" for name in self.sight.eyes)
        return (*X, *(f"Z of {name}" for name in self.sight.targets))

    def relative(self, first: str, second: str) -> tuple[FloatArray, FloatArray]:
        """``T_first_second`` (4, 4) of two eyes, m, and its standard deviations (6,), m and rad.

        What the two have in common, such as the error of the hand's poses, is not in it. Turns and
        displacements are about the axes of the second and of the first.
        """
        a, b = (self.sight.eyes.index(name) for name in (first, second))
        rows = np.concatenate([6 * eye + np.arange(6) for eye in (a, b)])
        pose, spread = relative_pose(self.X[a], self.X[b], self.covariance[np.ix_(rows, rows)])
        return pose, np.sqrt(np.maximum(np.diag(spread), 0.0))

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust every X."""
        caution = [*(one.sentence for one in self.not_found[:NAMED]), *self._cautions_on_pairs]
        if not self.moved and not self.far_sight:
            unsure = [eye for eye in self.eyes if eye.unsure("")]
            caution += [
                f"{eye.unsure(f'X of eye {eye.name}')}. Add poses in which this eye sees a target, "
                "turned by 30° or more about different axes."
                for eye in unsure[:NAMED]
            ]
        caution += self.others_found(DepthScale.name)
        caution += [*self._losing]
        disagreeing = sum(one.rows for one in self.not_found if one.disagrees)
        of_all = np.append(self.inliers, np.zeros(disagreeing, dtype=np.bool_))
        bad = self.objections("pairs", of_all, self.length)
        if objection := self._inverted:
            bad.append(objection)
        (bad if len(self.notes) > 1 else caution).extend(self.notes)
        accuracies = listed([f"eye {eye.name}: {eye.within}" for eye in self.eyes], NAMED)
        agreed = self.agreed("pairs", f"{deg(self.rms_angle):.3f}°")
        return Assessment.of(
            "" if bad else f"{accuracies} (one standard deviation, 3-D); {agreed}",
            bad=bad,
            care=[*caution, *set_aside("pairs", self.inliers), *self.notes_on_rows("pairs")],
            facts=[*self._about_the_graph],
        )

    @property
    def _losing(self) -> Iterator[str]:
        """Eyes and targets most of whose rows were left out."""
        for role, poses in (("eye", self.eyes), ("target", self.targets)):
            for one in poses:
                lost = len(one.rows) - one.inliers
                if lost > 0.4 * len(one.rows):
                    yield (
                        f"{lost} of the {len(one.rows)} rows of {role} {one.name} do not agree "
                        f"with the others and are left out. Was {role} {one.name} moved, or is its "
                        "label wrong in some rows?"
                    )

    @property
    def _inverted(self) -> str:
        """That the poses seem to be inverted, which exchanges X and Z; empty if not."""
        near, far = (
            [np.linalg.norm(one.pose[:3, 3]) for one in side] for side in (self.eyes, self.targets)
        )
        held, standing = (near, far) if self.setup == EYE_IN_HAND else (far, near)
        std = max(float(np.linalg.norm(one.std6[:3])) for one in (*self.eyes, *self.targets))
        lengths = float(np.median(held)), float(np.median(standing))
        if exchanged(np.array(lengths[:1]), np.array(lengths[1:]), std) != "bad":
            return ""
        return (
            f"What is on the hand is {mm(lengths[0]):.0f} mm from it, farther than what is fixed "
            f"is from the base ({mm(lengths[1]):.0f} mm). Are the eyes on the other side? Then use "
            "the other --setup. Are both poses inverted? Then X and Z are exchanged."
        )

    @property
    def _about_the_graph(self) -> Iterator[str]:
        """Which parts are not joined, and what hangs on one eye alone."""
        of_eyes, of_targets = self.sight.together.parts
        parts = np.unique(of_eyes)
        if len(parts) > 1:
            groups = listed([self._part(int(part), of_eyes, of_targets) for part in parts], NAMED)
            yield (
                f"The eyes and targets fall into {len(parts)} groups that no row joins: {groups}. "
                "Each group is calibrated by itself, and only the poses of the hand relate them. "
                "Let eyes of two groups see one target to join them."
            )
        alone = [t for t in self.targets if len(t.partners) == 1]
        if len(self.eyes) > 1 and alone:
            names = listed([f"{t.name} (eye {t.partners[0]})" for t in alone], NAMED)
            s = "s" * (len(alone) > 1)
            yield (
                f"Target{s} {names} {'were' if s else 'was'} seen by one eye only. "
                f"{'Their Z hang' if s else 'Its Z hangs'} on this eye alone: no other eye checks "
                "it."
            )

    def _part(self, part: int, of_eyes: IntArray, of_targets: IntArray) -> str:
        names = [
            *(f"eye {self.sight.eyes[k]}" for k in np.flatnonzero(of_eyes == part)),
            *(f"target {self.sight.targets[k]}" for k in np.flatnonzero(of_targets == part)),
        ]
        return f"({listed(names, NAMED)})"


@doubting
def calibrate_many_eyes(
    hand: tuple[ArrayLike, ArrayLike],
    seen: tuple[ArrayLike, ArrayLike],
    *,
    eye: ArrayLike | None = None,
    target: ArrayLike | None = None,
    setup: EyeSetup = EYE_IN_HAND,
    robust: bool = True,
    seed: int = 0,
    rule: Rule = Rule(),
) -> ManyEyesCalibration:
    """X of every eye and Z of every target of ``A_i X_e B_i = Z_t``, from pairs of poses.

    As `calibrate_hand_eye`, in one problem: eyes and targets are joined by the rows in which they
    saw one another, and rows with one pose of the hand share its errors. An eye whose X the rows
    leave open has none; the others do not suffer from it.

    Args:
        hand: ``T_base_hand``: rotations (n, 3, 3) and positions (n, 3), m.
        seen: ``T_eye_target``: the same.
        eye: (n,) label of the eye that saw it; one eye without it.
        target: (n,) label of the target that was seen; one target without it.
        setup: where the eyes are; the targets are on the other.
        robust: False for least squares over all pairs.
        seed: of the minimal samples.
        rule: when a hypothesis about wrong data is reported.

    Raises:
        SamplesError: as `calibrate_hand_eye`, with the eye or the target that it is about; labels
            that are exchanged from some row on; or no eye whose X is determined.
    """
    A, B = checked_pairs(hand, seen, setup)
    sight = Sight.of(len(A[1]), eye, target)
    fitted = fit_loops(A, B, sight, setup, robust=robust, seed=seed, rule=rule)
    return ManyEyesCalibration(
        sight=fitted.sight,
        not_found=fitted.not_found,
        noise=fitted.noise,
        X=np.array([homogeneous(*pose) for pose in zip(*fitted.X, strict=True)]),
        Z=np.array([homogeneous(*pose) for pose in zip(*fitted.Z, strict=True)]),
        setup=setup,
        rule=rule,
        **fitted.attributes,
    )


def many_eyes_from_pairs(pairs: PosePairs, **options: Any) -> ManyEyesCalibration:
    """`calibrate_many_eyes` of a file, with its options: errors name it."""
    with error_context(pairs.path):
        answer = calibrate_many_eyes(
            pairs.hand, pairs.target, eye=pairs.eye, target=pairs.marks, **options
        )
    return replace(answer, notes=pairs.unit_notes)
