"""Where an instrument stands and where its targets sit on the tip's link: the solver's start.

    z_i = R (R_i t_k + p_i) + b    for every sample i of every target k

Gauss–Newton on the turn, b and all t from several beginnings: the tip seen in place of its targets,
which is right where they are near it; the inverse of R as any matrix W, which makes the equations
linear, and the best of many turns all about; and where orientations were seen, the hand-eye
calibration of every target, T_base_tip X_k = Z T_instrument_target with one Z. What the poses leave
undetermined stays as it begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import (
    nearest_rotation,
    random_rotations,
    register_points,
    rotation_from_vector,
    skew,
)
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    Poses,
    agreeing_hand_eye,
    chordal_mean,
    inverse_poses,
    some_poses,
)

# Relative singular value below which a direction is not determined at all.
_ROUNDING: Final = 1e-9


def instrument_and_targets(
    arm: Poses, positions: FloatArray, target: IntArray, turned: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The instrument and its targets that fit best.

    From ``T_base_tip`` (n, 3, 3) and (n, 3), m, positions (n, 3) in the instrument of the target
    (n,), from 0, that each row saw, and its rotation (n, 3, 3) where that was seen. Gives
    ``T_instrument_base`` (3, 3) and (3,), and the targets in the tip (k, 3).
    """
    beginnings = [*_beginnings(arm, positions, target)]
    if turned is not None:
        beginnings.append(_by_hand_eye(arm, (turned, positions), target))
    refined = [_refined(arm, positions, target, first) for first in beginnings]
    off = [
        squares + _squares_of_turns(arm[0], turned, target, unknowns[0])
        for squares, unknowns in refined
    ]
    return refined[int(np.argmin(off))][1]


Unknowns = tuple[FloatArray, FloatArray, FloatArray]


def _by_hand_eye(arm: Poses, target_poses: Poses, target: IntArray) -> Unknowns:
    """The mean Z of all targets whose rows turn, and where each then sits in the tip."""
    places = list[Poses]()
    for k in range(int(target.max()) + 1):
        rows = np.flatnonzero(target == k)
        if len(rows) >= FEWEST:
            hand, back = some_poses(arm, rows), inverse_poses(some_poses(target_poses, rows))
            _, Z = agreeing_hand_eye(hand, back)
            places += [Z] * len(rows)
    if not places:
        places = [(np.eye(3), np.zeros(3))]
    R = chordal_mean(np.array([Z[0] for Z in places])).T
    b = -R @ np.mean([Z[1] for Z in places], axis=0)
    # In the tip's frame, what is seen less where the tip is.
    away = np.einsum("nji,nj->ni", arm[0], (target_poses[1] - b) @ R - arm[1])
    sits = [away[target == k].mean(axis=0) for k in range(int(target.max()) + 1)]
    return R, b, np.array(sits)


def _squares_of_turns(
    rotation: FloatArray, turned: FloatArray | None, target: IntArray, R: FloatArray
) -> float:
    """Squared turns of the targets about their means in the tip, as lengths at `LEVER`, m²."""
    if turned is None:
        return 0.0
    sits = np.swapaxes(R @ rotation, 1, 2) @ turned
    means = np.array([chordal_mean(sits[target == k]) for k in range(int(target.max()) + 1)])
    # Of small turns, twice their squared angle.
    # What an angle is worth beside a length, m per rad: 0.5 mm beside 0.1°, as is assumed of noise.
    return 0.5 * 0.3**2 * float(np.sum((sits - means[target]) ** 2))


def _beginnings(arm: Poses, positions: FloatArray, target: IntArray) -> Iterator[Unknowns]:
    """The tip in place of its targets; and, of all turns of the instrument, the best.

    With W = Rᵀ the equations ``W z_i - p_i = R_i t_k + w`` are linear in t and w for any W: with
    these projected out, the sum of squares is a quadratic form of the nine entries of W.
    """
    rotation, position = arm
    count = int(target.max()) + 1
    yield *register_points(position, positions), np.zeros((count, 3))
    # About the middle, so that lengths are alike.
    middle = positions.mean(axis=0)
    # Rows, of many, that choose the turns.
    chosen = np.unique(np.linspace(0, len(positions) - 1, min(len(positions), 500)).astype(np.intp))
    sits = _of_targets(rotation, target, count)
    shift = np.broadcast_to(np.eye(3), (len(positions), 3, 3))
    columns = np.concatenate([sits, shift], axis=2)
    entries = np.kron(np.eye(3), (positions - middle)[chosen, None, :]).reshape(3 * len(chosen), 9)
    right = position[chosen].reshape(-1)
    basis, size, _ = np.linalg.svd(
        columns[chosen].reshape(-1, columns.shape[2]), full_matrices=False
    )
    basis = basis[:, size > _ROUNDING * size[0]]
    entries, right = entries - basis @ (basis.T @ entries), right - basis @ (basis.T @ right)
    square, linear = entries.T @ entries, entries.T @ right
    free = nearest_rotation(np.linalg.lstsq(entries, right, rcond=_ROUNDING)[0].reshape(3, 3))
    # A thousand turns of the instrument are some 15° apart; the best two of them are refined.
    turns = np.concatenate([free[None], random_rotations(np.random.default_rng(0), 1000)])
    w = turns.reshape(-1, 9)
    off = np.einsum("ni,ij,nj->n", w, square, w) - 2.0 * w @ linear
    for W in turns[[0, *(1 + np.argsort(off[1:], kind="stable")[:2])]]:
        solved = _least_squares(columns, (positions - middle) @ W.T - position)
        targets = solved[: 3 * count].reshape(count, 3)
        points = position + np.einsum("nij,nj->ni", rotation, targets[target])
        yield W.T, (positions - points @ W).mean(axis=0), targets


def _refined(
    arm: Poses, positions: FloatArray, target: IntArray, first: Unknowns
) -> tuple[float, Unknowns]:
    """Sum of squared residuals, and the unknowns, at the end of the descent."""
    rotation, position = arm
    (R, b, targets), count = first, len(first[2])
    sits = _of_targets(rotation, target, count)

    def left(R: FloatArray, b: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray]:
        lever = (position + sits @ targets.reshape(-1)) @ R.T
        return positions - lever - b, lever

    residual, lever = left(R, b, targets)
    # A step that takes no more of the squared residuals is the last.
    gain = 1e-9
    for _ in range(30):
        shift = np.broadcast_to(np.eye(3), (len(positions), 3, 3))
        columns = np.concatenate([-skew(lever), shift, R @ sits], axis=2)
        step = _least_squares(columns, residual)
        moved = (
            rotation_from_vector(step[:3]) @ R,
            b + step[3:6],
            targets + step[6:].reshape(count, 3),
        )
        after, lever_after = left(*moved)
        before = float(np.sum(residual**2))
        if not np.sum(after**2) < (1.0 - gain) * before:
            break
        (R, b, targets), residual, lever = moved, after, lever_after
    return float(np.sum(residual**2)), (R, b, targets)


def _of_targets(rotation: FloatArray, target: IntArray, count: int) -> FloatArray:
    """(n, 3, 3 count) derivatives of where each row's target is, in the base, by all targets."""
    columns = np.zeros((len(target), 3, count, 3))
    columns[np.arange(len(target)), :, target] = rotation
    return columns.reshape(len(target), 3, 3 * count)


def _least_squares(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Smallest solution (m,) of stacked equations (n, 3, m), columns scaled to one size."""
    matrix = columns.reshape(-1, columns.shape[2])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(matrix / size, right.reshape(-1), rcond=_ROUNDING)[0] / size)
