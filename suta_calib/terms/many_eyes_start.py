"""Closed-form poses of many eyes and many targets: where the solver of `hand_eye` starts.

    A_i X_e B_i = Z_t for every row i, in which eye e saw target t

Eyes and targets are the nodes of a graph, and those that were seen together its edges. Rotations
come from two beginnings: a tree of single hand-eye calibrations, which needs one edge with motions;
and all equations at once as linear ones in the nine numbers of every rotation, which needs motions
of all rows together only. The better one is refined by means of rotations; positions are then
linear. Rows that disagree lose their weight.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import nearest_rotation, vector_from_rotation
from suta_calib.terms.block import joined
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    Poses,
    after,
    close_the_loop,
    quaternion_hand_eye,
    some_poses,
)

# Relative singular value below which a direction is not determined at all.
ROUNDING: Final = 1e-10


@dataclass(frozen=True, eq=False)
class SeenTogether:
    """Which eye saw which target in every row, by numbers from 0.

    Attributes:
        eye, target: (n,) of every row.
        eyes, targets: how many there are.
    """

    eye: IntArray
    target: IntArray
    eyes: int
    targets: int

    @classmethod
    def of(cls, eye: IntArray, target: IntArray) -> SeenTogether:
        """All that the rows name."""
        counts = (int(which.max(initial=-1)) + 1 for which in (eye, target))
        return cls(eye, target, *counts)

    @cached_property
    def parts(self) -> tuple[IntArray, IntArray]:
        """Part of the graph of every eye and of every target, from 0; -1 of what has no row."""
        part = joined(self.eye, self.target)
        of_eyes, of_targets = (np.full(k, -1, dtype=np.intp) for k in (self.eyes, self.targets))
        of_eyes[self.eye], of_targets[self.target] = part, part
        return of_eyes, of_targets

    @property
    def edges(self) -> Iterator[tuple[int, int, IntArray]]:
        """Every eye and target that were seen together, with their rows; many rows first."""
        pair = self.eye * self.targets + self.target
        names, count = np.unique(pair, return_counts=True)
        for k in np.argsort(-count, kind="stable").tolist():
            eye, target = divmod(int(names[k]), self.targets)
            yield eye, target, np.flatnonzero(pair == names[k])


def eyes_and_targets(hand: Poses, seen: Poses, together: SeenTogether) -> tuple[Poses, Poses]:
    """X of every eye and Z of every target, from ``T_base_hand`` and ``T_eye_target`` by row.

    Of one eye and one target, quaternions of consecutive motions, then the mean of the loops. What
    the motions leave open is chosen arbitrarily. What no row looks at stays where the hand is.
    """
    if together.eyes == together.targets == 1:
        X = quaternion_hand_eye(hand, seen)
        Z = close_the_loop(hand, X, seen)
        return (X[0][None], X[1][None]), (Z[0][None], Z[1][None])
    weight = np.ones(len(hand[1]))
    X, Z = _weighed(hand, seen, together, weight)
    # Rounds in which rows lose weight by how far off they are.
    for _ in range(6):
        slid, turned = loop_errors(hand, seen, X, Z, together)
        again = _believed(slid) * _believed(turned)
        if np.allclose(again, weight, atol=0.02):
            break
        weight = again
        X, Z = _weighed(hand, seen, together, weight, Z[0])
    return X, Z


def loop_errors(
    hand: Poses, seen: Poses, X: Poses, Z: Poses, together: SeenTogether
) -> tuple[FloatArray, FloatArray]:
    """How far every ``A_i X B_i`` ends from its Z: displacement (n, 3), m, and turn (n, 3), rad.

    Displacements are along the axes of Z's outer frame, turns about the target's.
    """
    R_Z, p_Z = some_poses(Z, together.target)
    R, p = after(after(hand, some_poses(X, together.eye)), seen)
    return p - p_Z, vector_from_rotation(np.swapaxes(R_Z, 1, 2) @ R)


def _believed(errors: FloatArray) -> FloatArray:
    """(n,) weights of rows, one up to twice the middle error, less beyond."""
    size = np.linalg.norm(errors, axis=1)
    limit = max(2.0 * float(np.median(size)), 1e-12)
    # Squared, so that rows that are wrong by far hardly pull.
    return np.asarray(np.minimum(1.0, limit / np.maximum(size, 1e-300)) ** 2)


def _weighed(
    hand: Poses,
    seen: Poses,
    together: SeenTogether,
    weight: FloatArray,
    R_Z: FloatArray | None = None,
) -> tuple[Poses, Poses]:
    """X and Z by weighted rows; from rotations of the targets, or from the better beginning."""
    beginnings = (
        [R_Z]
        if R_Z is not None
        else [
            _by_tree(hand, seen, together),
            _by_equations(hand[0], seen[0], together, weight),
        ]
    )
    refined = [_rotations(hand[0], seen[0], together, weight, start) for start in beginnings]
    R_X, R_Z = min(refined, key=lambda turns: _chords(hand[0], seen[0], turns, together))
    p_X, p_Z = _positions(hand, seen, R_X, together, weight)
    return (R_X, p_X), (R_Z, p_Z)


def _chords(
    A: FloatArray, B: FloatArray, turns: tuple[FloatArray, FloatArray], together: SeenTogether
) -> float:
    """How far loops are turned from their targets, summed: few that are far off count little."""
    R_X, R_Z = turns
    off = A @ R_X[together.eye] @ B - R_Z[together.target]
    return float(np.linalg.norm(off, axis=(1, 2)).sum())


def _by_tree(hand: Poses, seen: Poses, together: SeenTogether) -> FloatArray:
    """From the edge of each part whose motions tell most, from end to end of other edges."""
    edges = [*together.edges]
    R_X: dict[int, FloatArray] = {}
    R_Z: dict[int, FloatArray] = {}

    def told(rows: IntArray) -> float:
        """How much the hand turns about the axis about which it turns least, times rows."""
        mean = hand[0][rows].mean(axis=0)
        return len(rows) * float(np.linalg.eigvalsh(np.eye(3) - mean.T @ mean)[0])

    left = sorted(edges, key=lambda edge: -told(edge[2]))
    while left:
        # An edge at which the tree grows: that of most rows.
        joins = (e for e in edges if (e[0] in R_X) != (e[1] in R_Z))
        eye, target, rows = next(joins, None) or next(
            (e for e in left if e[0] not in R_X and e[1] not in R_Z), left[0]
        )
        A, B = some_poses(hand, rows), some_poses(seen, rows)
        if eye not in R_X and target not in R_Z:
            R_X[eye] = quaternion_hand_eye(A, B)[0] if len(rows) >= FEWEST else np.eye(3)
        if eye not in R_X:
            R_X[eye] = nearest_rotation(np.einsum("nji,jk,nlk->il", A[0], R_Z[target], B[0]))
        elif target not in R_Z:
            R_Z[target] = nearest_rotation((A[0] @ R_X[eye] @ B[0]).sum(axis=0))
        left = [e for e in left if e[0] not in R_X or e[1] not in R_Z]
    return np.array([R_Z.get(k, np.eye(3)) for k in range(together.targets)])


def _by_equations(
    A: FloatArray, B: FloatArray, together: SeenTogether, weight: FloatArray
) -> FloatArray:
    """The least eigenvector of all equations ``A_i X B_i = Z``, in each part of the graph."""
    eyes, targets = together.eyes, together.targets
    # Transposed: vec(A X B) = (A ⊗ Bᵀ) vec(X), row by row.
    products = np.einsum("n,nij,nlk->njlik", weight, A, B).reshape(-1, 9, 9)
    mixed, diagonal = np.zeros((eyes, targets, 9, 9)), np.zeros(eyes + targets)
    np.add.at(mixed, (together.eye, together.target), products)
    np.add.at(diagonal, together.eye, weight)
    np.add.at(diagonal, eyes + together.target, weight)
    # In units of how often each is seen: the largest of the mixed part is the least of all.
    root = 1.0 / np.sqrt(np.maximum(diagonal, 1e-12))
    scale = root[:eyes, None, None, None] * root[None, eyes:, None, None]
    matrix = (scale * mixed).transpose(0, 2, 1, 3)
    rotations = np.tile(np.eye(3), (targets, 1, 1))
    of_eyes, of_targets = together.parts
    for part in np.unique(of_targets[of_targets >= 0]):
        e, t = np.flatnonzero(of_eyes == part), np.flatnonzero(of_targets == part)
        block = matrix[e][:, :, t].reshape(9 * len(e), 9 * len(t))
        right = np.linalg.svd(block)[2][0]
        turns = right.reshape(-1, 3, 3) * root[eyes + t, None, None]
        rotations[t] = nearest_rotation(turns * np.sign(np.linalg.det(turns).sum() or 1.0))
    return rotations


def _rotations(
    A: FloatArray, B: FloatArray, together: SeenTogether, weight: FloatArray, R_Z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means of rotations, of the eyes by the targets and in turn, until they stay."""
    w = weight[:, None, None]
    back, after = np.swapaxes(A, 1, 2), np.swapaxes(B, 1, 2)
    R_X = np.tile(np.eye(3), (together.eyes, 1, 1))
    # Sweeps of means of rotations.
    for _ in range(100):
        R_X = _means(w * (back @ R_Z[together.target] @ after), together.eye, R_X)
        again = _means(w * (A @ R_X[together.eye] @ B), together.target, R_Z)
        still, R_Z = np.abs(again - R_Z).max() < ROUNDING, again
        if still:
            break
    return R_X, R_Z


def _means(rotations: FloatArray, which: IntArray, before: FloatArray) -> FloatArray:
    """Chordal means of the rows of each; as they were before of what has none."""
    total = np.zeros_like(before)
    np.add.at(total, which, rotations)
    numbers = np.unique(which)
    means = before.copy()
    means[numbers] = nearest_rotation(total[numbers])
    return means


def _positions(
    hand: Poses, seen: Poses, R_X: FloatArray, together: SeenTogether, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions of eyes and targets: linear least squares of all loops, the smallest solution."""
    eyes, count = together.eyes, together.eyes + together.targets
    seen_in_hand = np.einsum("nij,nj->ni", R_X[together.eye], seen[1])
    right = hand[1] + np.einsum("nij,nj->ni", hand[0], seen_in_hand)
    normal, moment = np.zeros((count, count, 3, 3)), np.zeros((count, 3))
    w, (e, t) = weight[:, None, None], (together.eye, eyes + together.target)
    for node in (e, t):
        np.add.at(normal, (node, node), w * np.eye(3))
    np.add.at(normal, (e, t), -w * np.swapaxes(hand[0], 1, 2))
    np.add.at(normal, (t, e), -w * hand[0])
    np.add.at(moment, e, -weight[:, None] * np.einsum("nji,nj->ni", hand[0], right))
    np.add.at(moment, t, weight[:, None] * right)
    matrix = normal.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count)
    solved = np.linalg.pinv(matrix, ROUNDING, hermitian=True)
    positions = (solved @ moment.reshape(-1)).reshape(count, 3)
    return positions[:eyes], positions[eyes:]
