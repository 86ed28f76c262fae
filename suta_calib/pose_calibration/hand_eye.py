"""Hand-eye calibration, AX = XB and AX = ZB, with the eye in the hand or beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.geometry.numbers import (
    extent,
    homogeneous,
    rms_length,
    rotation_from_vector,
    tangent_of_poses,
    vector_from_rotation,
)
from suta_calib.measurements.pose_files import PosePairs
from suta_calib.measurements.scale import PPM, LengthScale
from suta_calib.pose_calibration.consensus import Consensus, find_consensus, minimal_samples
from suta_calib.pose_calibration.eye_poses import ENOUGH, EyePoses, Model, Unknown, unknowns_of
from suta_calib.pose_calibration.hand_eye_causes import (
    refuse_constant,
    refuse_misread,
    refuse_strangers,
)
from suta_calib.pose_calibration.inputs import checked_poses, error_context
from suta_calib.pose_calibration.robot_noise import EYE, TARGET, RobotNoise, noise_made_directions
from suta_calib.pose_calibration.robust_answer import RobustAnswer, doubting
from suta_calib.pose_calibration.robust_fit import MOST_ROWS, ROUNDING, RobustFit, robust_fit
from suta_calib.pose_calibration.undetermined import axes_that_stand, refuse_undetermined
from suta_calib.solver.covariance import observed_parts
from suta_calib.solver.problem import Problem
from suta_calib.terms.hand_eye_start import (
    EYE_IN_HAND,
    EYE_TO_HAND,
    EyeSetup,
    Poses,
    as_eye_in_hand,
    chordal_mean,
    close_the_loop,
    loop_closures,
    quaternion_hand_eye,
)
from suta_calib.terms.poses import together
from suta_calib.trust.hypotheses.depth_scale import DepthScale
from suta_calib.trust.hypothesis import Finding, weigh
from suta_calib.trust.rule import Rule
from suta_calib.units import deg, from_deg, text

# Pairs that determine X.
NEEDED: Final = 3
# What makes X known.
ADVICE: Final = "turn the hand about at least two axes that are not parallel"
# Pairs below which positions can be fitted so well that they would seem exact: no pair can be
# judged by others then.
FEW_PAIRS: Final = 8
# What X and Z are another by, where it is moved.
MAY_MOVE: Final[dict[EyeSetup, dict[str, str]]] = {
    EYE_IN_HAND: {
        EYE: "the camera on the hand (or the hand's tool frame)",
        TARGET: "the target (or the base)",
    },
    EYE_TO_HAND: {
        EYE: "the camera (or the base)",
        TARGET: "the target on the hand (or the hand's tool frame)",
    },
}


class DistanceTrend(NamedTuple):
    """Relative error of the distance to a target, and its standard deviation."""

    share: float
    std: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class HandEyeCalibration(Displayable, EyePoses, RobustAnswer):
    """Poses of the eye and of the target; `solution` is in units of `length`.

    Residuals are ``A_i X B_i - Z`` in Z's outer frame.

    Attributes:
        setup, X, Z: as in `EyePoses`.
        model: ``AX=XB`` or ``AX=ZB``.
        rotation_residuals: (n, 3), the turn between ``A_i X B_i`` and Z, rad.
        axes: (n - 1, 3) rotation vectors of the hand's consecutive motions, rad.
        robot_noise_fraction: part of the rotational noise that seems to be the hand's, 0 to 1.
        copies: how many of the pairs that were fitted repeat another: no measurements.
        length: m per unit of `solution`.
    """

    setup: EyeSetup
    model: Model
    X: FloatArray
    Z: FloatArray
    rotation_residuals: FloatArray
    axes: FloatArray
    robot_noise_fraction: float
    copies: int
    length: float

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
    def rms_angle(self) -> float:
        """Root mean square turn of the inliers' ``A_i X B_i`` against Z, rad."""
        return rms_length(self.rotation_residuals[self.inliers])

    @property
    def far_sight(self) -> Finding | None:
        """That the eye sees too far or too near; the covariance allows for it."""
        return self.finding(DepthScale.name)

    @property
    def trend(self) -> DistanceTrend:
        """By what share the eye seems to see too far, supported or not."""
        evidence = self.evidence(DepthScale.name)
        if evidence is None:
            return DistanceTrend(0.0, 0.0)
        return DistanceTrend(float(evidence.size[0]), float(evidence.std[0]))

    @property
    def _std_without_far_sight(self) -> float:
        """Standard deviation of X's position but for `far_sight`, m, 3-D."""
        evidence = self.evidence(DepthScale.name)
        assert evidence is not None
        moves = self.length * evidence.moves[:3]
        by_it = (1.0 + 1.0 / evidence.significance**2) * float(moves @ moves)
        return math.sqrt(max(float(np.trace(self.covariance[:3, :3])) - by_it, 0.0))

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust X."""
        caution = list[str]()
        count = int(self.inliers.sum()) - self.copies
        if self.copies:
            rows = "1 pair repeats" if self.copies == 1 else f"{self.copies} pairs repeat"
            caution.append(f"{rows} another exactly, hand and target. Measure new poses instead.")
        if count < ENOUGH:
            caution.append(
                f"Only {count} pairs: the standard deviations are uncertain, and a wrong pair may "
                "stay unnoticed. Take a dozen or more."
            )
        if self.far_sight:
            caution.append(
                f"{self.far_sight.sentence} Without it, ± would be "
                f"{text(self._std_without_far_sight, 'm')} mm, and a part of the pairs without "
                "this error gives the same."
            )
        if self.moved:
            caution.append(self.moved.sentence)
        elif self.unsure and not self.far_sight:
            caution.append(f"{self.unsure}. Add poses, turned by 30° or more about different axes.")
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
            care=[*caution, *self.set_aside("pairs", self.inliers), *self.notes_on_rows("pairs")],
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
    # No hand and no eye is believed to turn more exactly than this when turns are weighed against
    # displacements: what is smaller repeats well, but is an error of the instruments all the same.
    finest_turn = from_deg(0.1)
    A, B = checked_poses(*hand, "hand"), checked_poses(*seen, "seen")
    if setup not in get_args(EyeSetup) or model not in get_args(Model):
        raise ParameterError(
            f"setup {setup!r} and model {model!r}",
            f"one of {', '.join(get_args(EyeSetup))} and one of {', '.join(get_args(Model))}",
        )
    if len(A[1]) != len(B[1]):
        raise SamplesError(
            f"{len(A[1])} poses of the hand and {len(B[1])} of the target",
            "the same number of both",
        )
    if len(A[1]) < NEEDED:
        raise SamplesError(
            f"{len(A[1])} pairs of poses", f"at least {NEEDED}, turned about different axes"
        )
    refuse_constant(A, B)
    A = as_eye_in_hand(A, setup)
    # How large all this is: lengths are solved in units of it, so that none counts.
    length = extent(A[1]) + rms_length(B[1]) or 1.0
    centre = A[1].mean(axis=0)
    scaled, target = (A[0], (A[1] - centre) / length), (B[0], B[1] / length)
    few = len(A[1]) < FEW_PAIRS
    start_from = partial(_start, seed=seed if robust and not few else None)
    start = start_from(scaled, target)
    other = next(name for name in get_args(EyeSetup) if name != setup)
    refuse_misread(start, scaled, target, length, other, start_from, rule)
    noise = RobotNoise(scaled, target, finest_turn)
    # In units of the extent few positions are taken to scatter by this at least.
    floors = (5e-4 if few else 0.0, finest_turn)
    fit = robust_fit(noise.make, start, floors, robust=robust, revise=noise.revise)
    if noise.moves_targets and not noise.explains(fit):
        noise.forget()
        fit = robust_fit(noise.make, start, floors, robust=robust)
    made_by_noise = noise_made_directions(fit, noise)
    refuse_strangers(fit, start, A[0], length, made_by_noise)
    still = axes_that_stand(A[0][fit.inliers], fit.sigmas[1])
    axis = still if len(still) == 1 else None
    refuse_undetermined(fit.solution, EYE, "X", ADVICE, axis, made_by_noise)
    failed = list[str]()
    answer = fit.examined(length, "pairs", MAY_MOVE[setup])
    weighed = weigh(answer, failed)
    far = next((f for f in weighed if f.hypothesis.name == DepthScale.name), None)
    explained: tuple[FloatArray, ...] = ()
    followed = np.zeros_like(fit.covariance)
    if far is not None and far.supported(rule):
        change = far.evidence.explained(answer.plain_fit).reshape(len(fit.sigmas), -1, 3)
        explained = tuple(-s * part for s, part in zip(fit.sigmas, change, strict=True))
        followed = fit.followed(far.evidence)
    x = fit.solution.x
    X = rotation_from_vector(x[3:6]), x[:3] * length
    Z = rotation_from_vector(x[9:12]), x[6:9] * length + centre
    loops = loop_closures(A, X, B)
    jacobian = tangent_of_poses(x, length)
    return HandEyeCalibration(
        setup=setup,
        model=model,
        X=homogeneous(*X),
        Z=homogeneous(*Z),
        covariance=jacobian @ (fit.spread(explained) + followed) @ jacobian.T,
        residuals=loops[1] - Z[1],
        rotation_residuals=vector_from_rotation(Z[0].T @ loops[0]),
        inliers=fit.inliers,
        suspects=fit.suspects,
        axes=vector_from_rotation(np.swapaxes(A[0][1:], 1, 2) @ A[0][:-1]),
        robot_noise_fraction=noise.lever.fraction,
        copies=_copies(scaled, target, fit),
        solution=fit.solution,
        length=length,
        unjudged=tuple(failed),
        examination=answer,
        weighed=tuple(weighed),
        rule=rule,
    )


def _copies(A: Poses, B: Poses, fit: RobustFit) -> int:
    """How many fitted pairs repeat another, as far as noise could ever let them."""
    rows = np.flatnonzero(fit.inliers)
    if len(rows) > MOST_ROWS:
        return 0
    # Part of the noise within which hand and eye are read alike only where they were not read
    # again.
    near = 0.05 * np.maximum(fit.sigmas, ROUNDING)
    numbers = [
        row_numbers for R, p in (A, B) for row_numbers in (p / near[0], R.reshape(-1, 9) / near[1])
    ]
    return len(rows) - len(np.unique(together(np.hstack(numbers)[rows], 1.0)))


def with_scale(answer: HandEyeCalibration, scale_ppm: float) -> HandEyeCalibration:
    """The same, with the effect of a scale error of all seen lengths in the covariance.

    A target of another size than its file says puts all that is seen nearer or farther. X follows,
    and where distances hardly differ no residual shows it. Where the residuals show that distances
    are off, the covariance allows for that already.

    Args:
        answer: from pairs of poses.
        scale_ppm: standard deviation of the factor on what was seen, against what the hand moved,
            1e-6.
    """
    if answer.far_sight or scale_ppm == 0.0:
        return answer
    solution, scale = answer.solution, LengthScale(scale_ppm * PPM)
    problem = Problem([replace(term, scale=scale) for term in solution.problem.terms])
    part = observed_parts(replace(solution.spread.fit, problem=problem)).of_scale
    jacobian = tangent_of_poses(solution.x[:12], answer.length)
    return replace(answer, covariance=answer.covariance + jacobian @ part @ jacobian.T)


def hand_eye_from_pairs(pairs: PosePairs, **options: Any) -> HandEyeCalibration:
    """`calibrate_hand_eye` of a file, with its options: errors name it, so do notes on its unit."""
    with error_context(pairs.path):
        answer = calibrate_hand_eye(pairs.hand, pairs.target, **options)
    return replace(answer, notes=pairs.unit_notes)


def _start(A: Poses, B: Poses, seed: int | None) -> Consensus:
    """What most pairs agree on; all of them without a seed, or where they are too few to tell."""
    n = len(A[1])
    # Pairs of a minimal sample: one more than needed, against small turns.
    sample = 4
    if seed is None or n <= sample:
        X = quaternion_hand_eye(A, B)
        Z = close_the_loop(A, X, B)
        R, p = loop_closures(A, X, B)
        distances = rms_length(p - Z[1]), rms_length(vector_from_rotation(Z[0].T @ R))
        return Consensus.of_all(n, *(length / np.sqrt(3.0) for length in distances))

    def propose(rows: IntArray) -> Poses:
        return quaternion_hand_eye((A[0][rows], A[1][rows]), (B[0][rows], B[1][rows]))

    def residuals(X: Poses, rows: IntArray) -> FloatArray:
        return _norms((A[0][rows], A[1][rows]), (B[0][rows], B[1][rows]), X)

    samples = minimal_samples(np.zeros(n, dtype=np.intp), sample, seed)
    return find_consensus(n, samples, propose, residuals, NEEDED)


def _norms(A: Poses, B: Poses, X: Poses) -> FloatArray:
    """Distance (m, n, 2) of every loop from the middle of all, in length and in angle."""
    R, p = _loops(A, B, X)
    middle = np.median(p, axis=-1, keepdims=True)
    # Of every number of the rotations the median, and the rotation next to these.
    centre = chordal_mean(np.median(R, axis=-1).reshape(-1, 1, 3, 3)).reshape(-1, 1, 9)
    cosine = ((centre @ R)[:, 0] - 1.0) / 2.0
    turned = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.stack([np.linalg.norm(p - middle, axis=1), turned], axis=-1)


def _loops(A: Poses, B: Poses, X: Poses) -> Poses:
    """Every ``A_i X B_i`` for every X, number by number: rotations (m, 9, n), positions (m, 3, n).

    They are linear in X: one product of matrices makes them all. For a single X, with which all
    rows are tried, that matrix would be nine times as large as what it makes.
    """
    n, unknown = len(A[1]), X[0].reshape(-1, 9)
    if len(unknown) == 1:
        R, p = loop_closures(A, X, B)
        return np.swapaxes(R.reshape(1, n, 9), 1, 2), np.swapaxes(p, 1, 2)
    turning = np.einsum("nab,ncd->bcadn", A[0], B[0]).reshape(9, -1)
    reaching = np.einsum("nab,nc->bcan", A[0], B[1]).reshape(9, -1)
    shifting = np.einsum("nab->ban", A[0]).reshape(3, -1)
    R = (unknown @ turning).reshape(-1, 9, n)
    p = (unknown @ reaching + X[1] @ shifting).reshape(-1, 3, n) + A[1].T
    return R, p
