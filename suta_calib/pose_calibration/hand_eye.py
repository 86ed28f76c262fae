"""Hand-eye calibration of one eye, AX = XB and AX = ZB, with the eye in the hand or beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, get_args

from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.errors import ParameterError
from suta_calib.geometry.numbers import homogeneous
from suta_calib.measurements.pose_files import PosePairs
from suta_calib.pose_calibration.eye_poses import EyePoses, Model, Unknown, unknowns_of
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.loop_answer import LoopAnswer
from suta_calib.pose_calibration.loop_fit import checked_pairs, fit_loops
from suta_calib.pose_calibration.robust_answer import doubting, set_aside
from suta_calib.pose_calibration.sight import Sight
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EyeSetup
from suta_calib.trust.hypotheses.depth_scale import DepthScale
from suta_calib.trust.rule import Rule
from suta_calib.units import deg, text


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class HandEyeCalibration(EyePoses, LoopAnswer):
    """Poses of the eye and of the target.

    Attributes:
        X, Z: as in `EyePoses`.
        model: ``AX=XB`` or ``AX=ZB``.
    """

    model: Model
    X: FloatArray
    Z: FloatArray

    @property
    def in_a_line(self) -> str:
        """The setup, and how well the pairs agree."""
        count = int(self.inliers.sum())
        return f"{self.setup}, RMS {text(self.rms, 'm')} mm over {count} pairs"

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Which of X and Z the model asks for."""
        return unknowns_of(self.model)

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust X."""
        caution = self._cautions_on_pairs
        if not self.moved and self.unsure() and not self.far_sight:
            caution.append(
                f"{self.unsure()}. Add poses, turned by 30° or more about different axes."
            )
        caution += self.others_found(DepthScale.name)
        bad = self.objections("pairs", self.inliers, self.length)
        if self.inverted != "good":
            beside = (
                ""
                if self.setup != EYE_IN_HAND
                else ("Is the camera beside the robot? Then use --setup eye-to-hand. ")
            )
            (bad if self.inverted == "bad" else caution).append(
                f"{self.lengths_told} {beside}Are both poses inverted? Then X is the transform "
                f"that is called Z here: {self.Z_told}."
            )
        # A hand may move by millimetres, a target be seen from them: not both.
        (bad if len(self.notes) > 1 else caution).extend(self.notes)
        agreed = self.agreed("pairs", f"{deg(self.rms_angle):.3f}°")
        return Assessment.of(
            "" if bad else f"{self.accuracy_text}; {agreed}",
            bad=bad,
            care=[*caution, *set_aside("pairs", self.inliers), *self.notes_on_rows("pairs")],
        )


@doubting
def calibrate_hand_eye(
    hand: tuple[ArrayLike, ArrayLike],
    seen: tuple[ArrayLike, ArrayLike],
    *,
    setup: EyeSetup = EYE_IN_HAND,
    model: Model = "AX=XB",
    robust: bool = True,
    seed: int = 0,
    rule: Rule = Rule(),
) -> HandEyeCalibration:
    """X (and Z) of ``A_i X B_i = Z`` from pairs of poses.

    Closed form by quaternions of motions, from a consensus of the pairs, then robustly on SE(3)
    with displacements and turns weighted by the noise that they show: no unit of length matters.
    AX = XB is the same with Z eliminated: both models estimate both from all poses at once, because
    motions between consecutive poses share their noise.

    Args:
        hand: ``T_base_hand``: rotations (n, 3, 3) and positions (n, 3), m.
        seen: ``T_eye_target``: the same.
        setup: where the eye is; the target is on the other.
        model: which of the two is asked for.
        robust: False for least squares over all pairs.
        seed: of the minimal samples.
        rule: when a hypothesis about wrong data is reported.

    Raises:
        SamplesError: too few pairs; pairs that do not agree with any X, with what would make them
            agree; or motions that do not determine X: pure translation, or turns about parallel
            axes; names the undetermined directions.
    """
    A, B = checked_pairs(hand, seen, setup)
    if model not in get_args(Model):
        raise ParameterError(f"model {model!r}", f"one of {', '.join(get_args(Model))}")
    fitted = fit_loops(A, B, Sight.of_one(len(A[1])), setup, robust=robust, seed=seed, rule=rule)
    return HandEyeCalibration(
        model=model,
        X=homogeneous(fitted.X[0][0], fitted.X[1][0]),
        Z=homogeneous(fitted.Z[0][0], fitted.Z[1][0]),
        **fitted.attributes,
        setup=setup,
        rule=rule,
    )


def hand_eye_from_pairs(pairs: PosePairs, **options: Any) -> HandEyeCalibration:
    """`calibrate_hand_eye` of a file, with its options: errors name it, so do notes on its unit."""
    with error_context(pairs.path):
        answer = calibrate_hand_eye(pairs.hand, pairs.target, **options)
    return replace(answer, notes=pairs.unit_notes)
