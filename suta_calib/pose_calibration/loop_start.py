"""Which pairs of poses agree, before any is fitted: of one eye and one target, and of several."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length, vector_from_rotation
from suta_calib.pose_calibration.consensus import (
    DIMENSION,
    Consensus,
    find_consensus,
    minimal_samples,
    outlier_limit,
)
from suta_calib.pose_calibration.undetermined import axes_that_stand
from suta_calib.terms.hand_eye_start import (
    Poses,
    chordal_mean,
    close_the_loop,
    loop_closures,
    quaternion_hand_eye,
    some_poses,
)
from suta_calib.terms.many_eyes_start import SeenTogether, eyes_and_targets, loop_errors

# Pairs that determine X.
NEEDED: Final = 3
# Pairs below which positions can be fitted so well that they would seem exact: no pair can be
# judged by others then.
FEW_PAIRS: Final = 8


def first_consensus(A: Poses, B: Poses, together: SeenTogether, seed: int | None) -> Consensus:
    """What most pairs agree on; all of them without a seed.

    Of several eyes and targets the pairs of each two that saw one another tell which of them agree,
    where there are enough; these tell all poses, and all pairs are judged by them.
    """
    if together.eyes == together.targets == 1:
        return _of_one(A, B, seed)
    count = len(A[1])
    believed, alone = np.ones(count, dtype=np.bool_), list[FloatArray]()
    if seed is not None:
        for _, _, rows in together.edges:
            if len(rows) >= FEW_PAIRS:
                of_edge = _of_one(some_poses(A, rows), some_poses(B, rows), seed)
                believed[rows] = of_edge.inliers
                alone.append(of_edge.sigmas)
    errors = loop_errors(A, B, *poses_by(A, B, together, believed), together)
    if seed is None:
        return Consensus.of_all(count, *(rms_length(e) / np.sqrt(3.0) for e in errors))
    norms = np.stack([np.linalg.norm(e, axis=1) for e in errors], axis=1)
    middle = np.median(norms[believed], axis=0)
    sigmas = np.maximum(middle / np.sqrt(chdtri(DIMENSION, 0.5)), 1e-300)
    if alone:
        # Where all together scatter so many times more than each two by themselves, an eye or a
        # target was not where it was: no scatter of instruments or of a hand explains it.
        # Scatter, in units of the extent or rad, that is rounding.
        sigmas = np.minimum(sigmas, 5.0 * np.median(alone, axis=0) + 1e-9)
    inliers = np.sum((norms / sigmas) ** 2, axis=1) <= outlier_limit(count, 2)
    # Where the hand turns about one axis only, rotations alone leave X open: closed forms say
    # nothing of these rows.
    part_of_row = together.parts[0][together.eye]
    for part in np.unique(part_of_row):
        rows = (part_of_row == part) & believed
        if len(axes_that_stand(A[0][rows], float(sigmas[1]))):
            inliers[part_of_row == part] = believed[part_of_row == part]
    return Consensus(inliers, sigmas)


def poses_by(
    A: Poses, B: Poses, together: SeenTogether, rows: IntArray | BoolArray
) -> tuple[Poses, Poses]:
    """Closed-form X and Z that some rows tell."""
    part = SeenTogether(together.eye[rows], together.target[rows], together.eyes, together.targets)
    return eyes_and_targets(some_poses(A, rows), some_poses(B, rows), part)


def _of_one(A: Poses, B: Poses, seed: int | None) -> Consensus:
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
