"""Hand-eye calibration, AX = XB and AX = ZB, with the eye in the hand or beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.errors import SamplesError
from suta_calib.geometry import FloatArray, homogeneous, rotation_from_vector, vector_from_rotation
from suta_calib.measurements.samples import Samples
from suta_calib.navigation.consensus import (
    BoolArray,
    Consensus,
    find_consensus,
    minimal_samples,
)
from suta_calib.navigation.hand_share import estimate_hand_share
from suta_calib.navigation.robust_fit import RobustFit, evaluate, robust_fit
from suta_calib.navigation.rotation_covariance import tangent_of_vector
from suta_calib.navigation.undetermined import axis_of_all_turns, refuse_undetermined
from suta_calib.navigation.verdict import Verdict, verdict_of
from suta_calib.solver.solution import Solution
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.hand_eye_start import (
    Poses,
    close_the_loop,
    inverse,
    loops,
    quaternion_hand_eye,
)
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.term import IntArray, Noise

Setup = Literal["eye-in-hand", "eye-to-hand"]
Model = Literal["AX=XB", "AX=ZB"]
LEAST_POSES: Final = 3
SAMPLE: Final = 4
# Loops that may be the middle one: some of them are good ones, however many are outliers.
CANDIDATES: Final = 25
# No hand and no eye is believed to turn more exactly than this when turns are weighed against
# displacements: what is smaller repeats well, but is an error of the instruments all the same.
FINEST_TURN: Final = float(np.radians(0.1))
MANY_OUTLIERS: Final = 0.4
UNSURE: Final = 2e-3
UNSURE_TURN: Final = float(np.radians(0.5))


@dataclass(frozen=True, eq=False)
class HandEyeCalibration:
    """Where the eye is, and where the target.

    Attributes:
        setup: ``eye-in-hand`` or ``eye-to-hand``.
        model: ``AX=XB`` or ``AX=ZB``.
        X: (4, 4), ``T_hand_eye``, or ``T_base_eye`` for eye-to-hand; m.
        Z: (4, 4), ``T_base_target``, or ``T_hand_target`` for eye-to-hand; m.
        covariance: (12, 12) of X and Z: displacement (m, outer frame's axes) and small turn (rad,
            axes of the eye and of the target) of each.
        position_residuals: (n, 3), ``A_i X B_i - Z`` in the outer frame of Z, m.
        rotation_residuals: (n, 3), the turn between ``A_i X B_i`` and Z, rad.
        inliers: (n,) pairs that were fitted.
        axes: (n - 1, 3) rotation vectors of the hand's consecutive motions, rad.
        hand_share: part of the rotational noise that seems to be the hand's, 0 to 1.
        solution: of the solver, in units of `length`.
        length: m per unit of `solution`.
    """

    setup: Setup
    model: Model
    X: FloatArray
    Z: FloatArray
    covariance: FloatArray
    position_residuals: FloatArray
    rotation_residuals: FloatArray
    inliers: BoolArray
    axes: FloatArray
    hand_share: float
    solution: Solution
    length: float

    @property
    def std(self) -> dict[str, FloatArray]:
        """Standard deviations (6,) of X and of Z: displacement, m, and turn, rad."""
        std = np.sqrt(np.diag(self.covariance))
        return {"X": std[:6], "Z": std[6:]}

    @property
    def rms(self) -> float:
        """Root mean square distance of the inliers' ``A_i X B_i`` from Z, m."""
        return _rms(self.position_residuals[self.inliers])

    @property
    def rms_angle(self) -> float:
        """Root mean square turn of the inliers' ``A_i X B_i`` against Z, rad."""
        return _rms(self.rotation_residuals[self.inliers])

    @property
    def outliers(self) -> tuple[int, ...]:
        """Pairs judged outliers, from 0."""
        return tuple(int(row) for row in np.flatnonzero(~self.inliers))

    @property
    def verdict(self) -> Verdict:
        """How far to trust X."""
        bad, caution = list[str](), list[str]()
        if not self.solution.converged:
            bad.append(f"The solver did not converge: {self.solution.verdict}.")
        share = 1.0 - float(self.inliers.mean())
        if share > MANY_OUTLIERS:
            bad.append(f"{share:.0%} of the pairs do not agree with the rest.")
        displaced, turned = (float(np.linalg.norm(self.std["X"][k])) for k in (_SLIDE, _TURN))
        if displaced > UNSURE or turned > UNSURE_TURN:
            caution.append(
                f"X is known to ± {1e3 * displaced:.1f} mm and ± {np.degrees(turned):.2f}° only "
                "(one sigma): add poses, turned by 30° or more about different axes."
            )
        return verdict_of(bad, caution)


_SLIDE: Final = slice(0, 3)
_TURN: Final = slice(3, 6)


def calibrate_hand_eye(
    hand: tuple[ArrayLike, ArrayLike],
    seen: tuple[ArrayLike, ArrayLike],
    *,
    setup: Setup = "eye-in-hand",
    model: Model = "AX=XB",
    robust: bool = True,
    seed: int = 0,
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

    Raises:
        SamplesError: too few pairs, or motions that do not determine X: pure translation, or turns
            about parallel axes; names the undetermined directions.
    """
    A, B = _as_arrays(hand), _as_arrays(seen)
    _check_counts(A, B)
    if setup == "eye-to-hand":
        A = inverse(A)
    length = _extent(A, B)
    centre = A[1].mean(axis=0)
    scaled, target = (A[0], (A[1] - centre) / length), (B[0], B[1] / length)
    start = _start(scaled, target, seed) if robust else _everything(scaled, target)
    share = _HandShare(scaled, target)
    floors = (0.0, FINEST_TURN)
    fit = robust_fit(share.make, start, floors, robust=robust, revise=share.revise)
    if share.value and not share.explains(fit):
        share.value, share.fixed = 0.0, True
        fit = robust_fit(share.make, start, floors, robust=robust)
    refuse_undetermined(
        fit.solution,
        "hand_eye",
        "X",
        "turn the hand about at least two axes that are not parallel",
        axis_of_all_turns(A[0][fit.inliers], fit.sigmas[1]),
    )
    return _result(fit, A, B, centre, length, setup, model, share.value)


class _HandShare:
    """How much of the rotational noise is the hand's, revised with the solution."""

    def __init__(self, hand: Poses, seen: Poses) -> None:
        self._hand, self._seen = hand, seen
        self.value, self.fixed = 0.5, False

    def make(self, rows: IntArray, noises: Sequence[Noise]) -> HandEye:
        return self._term(rows, noises, self.value)

    def revise(self, values: Mapping[str, float], inliers: BoolArray) -> None:
        rows = np.flatnonzero(inliers)
        at_target = evaluate(self._term(rows, (Noise(), Noise()), 0.0), values)
        x = np.array([values[f"hand_eye.{key}"] for key in ("x", "y", "z", "rx", "ry", "rz")])
        R_seen, p_seen = self._seen[0][rows], self._seen[1][rows]
        in_eye = np.einsum("nij,nj->ni", R_seen, at_target[1])
        lever = p_seen + rotation_from_vector(x[3:]).T @ x[:3]
        self.value = estimate_hand_share(at_target[0], np.cross(in_eye, lever))

    def explains(self, fit: RobustFit) -> bool:
        """Whether the residuals at the target grew no more by it than by chance."""
        rows = np.flatnonzero(fit.inliers)
        plain = robust_fit(
            lambda r, n: self._term(rows[r], n, 0.0),
            Consensus(np.ones(len(rows), dtype=np.bool_), np.array(fit.sigmas)),
            (0.0, FINEST_TURN),
            robust=False,
        )
        term = self._term(rows, (Noise(), Noise()), 0.0)
        with_share = [float(np.sum(r**2)) for r in evaluate(term, fit.solution.values)]
        without = [float(np.sum(r**2)) for r in plain.residuals]
        unknowns, numbers = 12, 6 * len(rows)
        allowed = 1.0 + 2.5 * unknowns / max(numbers - unknowns, 1)
        return all(w <= allowed * p for w, p in zip(with_share, without, strict=True))

    def _term(self, rows: IntArray, noises: Sequence[Noise], share: float) -> HandEye:
        (RA, pA), (RB, pB) = self._hand, self._seen
        nothing = np.zeros((len(rows), 0))
        samples = Samples.from_arrays([], nothing, position=pB[rows], rotation=RB[rows])
        poses = MeasuredPoses(RA[rows], pA[rows], samples)
        return HandEye(poses, noises[0], noises[1], hand_share=share)


def _result(
    fit: RobustFit,
    A: Poses,
    B: Poses,
    centre: FloatArray,
    length: float,
    setup: Setup,
    model: Model,
    hand_share: float,
) -> HandEyeCalibration:
    x = fit.solution.x
    X = rotation_from_vector(x[3:6]), x[:3] * length
    Z = rotation_from_vector(x[9:12]), x[6:9] * length + centre
    found = loops(A, X, B)
    jacobian = np.diag(np.tile(np.repeat([length, 1.0], 3), 2))
    jacobian[3:6, 3:6], jacobian[9:, 9:] = tangent_of_vector(x[3:6]), tangent_of_vector(x[9:12])
    motions = np.swapaxes(A[0][1:], 1, 2) @ A[0][:-1]
    return HandEyeCalibration(
        setup=setup,
        model=model,
        X=homogeneous(*X),
        Z=homogeneous(*Z),
        covariance=jacobian @ fit.covariance @ jacobian.T,
        position_residuals=found[1] - Z[1],
        rotation_residuals=vector_from_rotation(Z[0].T @ found[0]),
        inliers=fit.inliers,
        axes=vector_from_rotation(motions),
        hand_share=hand_share,
        solution=fit.solution,
        length=length,
    )


def _as_arrays(poses: tuple[ArrayLike, ArrayLike]) -> Poses:
    return np.asarray(poses[0], dtype=float), np.asarray(poses[1], dtype=float)


def _check_counts(A: Poses, B: Poses) -> None:
    if len(A[1]) != len(B[1]):
        raise SamplesError(
            f"{len(A[1])} poses of the hand and {len(B[1])} of the target", "as many of each"
        )
    if len(A[1]) < LEAST_POSES:
        raise SamplesError(
            f"{len(A[1])} pairs of poses", f"at least {LEAST_POSES}, turned about different axes"
        )


def _extent(A: Poses, B: Poses) -> float:
    """How large all this is: lengths are solved in units of it, so that none counts, m."""
    spread = A[1] - A[1].mean(axis=0)
    return float(_rms(spread) + _rms(B[1])) or 1.0


def _norms(A: Poses, B: Poses, X: Poses) -> FloatArray:
    """Distance (m, n, 2) of every loop from the middle of all, in length and in angle."""
    R, p = loops(A, X, B)
    middle = np.median(p, axis=-2, keepdims=True)
    mean = _middle_rotation(R)
    cosine = (np.einsum("mij,mnij->mn", mean, R) - 1.0) / 2.0
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.stack([np.linalg.norm(p - middle, axis=-1), angle], axis=-1)


def _middle_rotation(R: FloatArray) -> FloatArray:
    """Of some of many rotations (m, n, 3, 3) the one that is nearest to all: a median."""
    some = R[:, :: 1 + R.shape[1] // CANDIDATES]
    overlap = np.einsum("mkij,mnij->mkn", some, R)
    angle = np.arccos(np.clip((overlap - 1.0) / 2.0, -1.0, 1.0))
    best = np.argmin(np.median(angle, axis=2), axis=1)
    return np.asarray(some[np.arange(len(R)), best])


def _start(A: Poses, B: Poses, seed: int) -> Consensus:
    n = len(A[1])
    if n <= SAMPLE:
        return _everything(A, B)

    def propose(rows: IntArray) -> Poses:
        return quaternion_hand_eye((A[0][rows], A[1][rows]), (B[0][rows], B[1][rows]))

    samples = minimal_samples(np.zeros(n, dtype=np.intp), SAMPLE, seed)
    return find_consensus(samples, propose, lambda X: _norms(A, B, X), LEAST_POSES)


def _everything(A: Poses, B: Poses) -> Consensus:
    X = quaternion_hand_eye(A, B)
    Z = close_the_loop(A, X, B)
    R, p = loops(A, X, B)
    turned = vector_from_rotation(Z[0].T @ R)
    sigmas = np.array([_rms(p - Z[1]), _rms(turned)]) / np.sqrt(3.0)
    return Consensus(np.ones(len(p), dtype=np.bool_), sigmas)


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
