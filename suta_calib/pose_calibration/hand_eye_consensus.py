"""Where a hand-eye calibration starts: pairs of poses that agree, and how they scatter."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length, vector_from_rotation
from suta_calib.pose_calibration.consensus import Consensus, find_consensus, minimal_samples
from suta_calib.terms.hand_eye_start import Poses, close_the_loop, loops, quaternion_hand_eye

# Pairs that determine X, and pairs of a minimal sample: one more, against small turns.
NEEDED: Final = 3
SAMPLE: Final = 4
# Loops that may be the middle one: some of them are good ones, however many are outliers.
CANDIDATES: Final = 25


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


def robust_start(A: Poses, B: Poses, seed: int) -> Consensus:
    """What most pairs agree on; all of them where they are too few to tell."""
    n = len(A[1])
    if n <= SAMPLE:
        return plain_start(A, B)

    def propose(rows: IntArray) -> Poses:
        return quaternion_hand_eye((A[0][rows], A[1][rows]), (B[0][rows], B[1][rows]))

    samples = minimal_samples(np.zeros(n, dtype=np.intp), SAMPLE, seed)
    return find_consensus(samples, propose, lambda X: _norms(A, B, X), NEEDED)


def plain_start(A: Poses, B: Poses) -> Consensus:
    """All pairs, and how they scatter about the closed form."""
    X = quaternion_hand_eye(A, B)
    Z = close_the_loop(A, X, B)
    R, p = loops(A, X, B)
    turned = vector_from_rotation(Z[0].T @ R)
    sigmas = np.array([rms_length(p - Z[1]), rms_length(turned)]) / np.sqrt(3.0)
    return Consensus(np.ones(len(p), dtype=np.bool_), sigmas)
