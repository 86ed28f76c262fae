"""What repeats of the same touch say: how far they scatter, and which of them are grossly wrong.

Repeats see the same posture, so what is wrong with the model is wrong in all of them alike. Only
what differs among them is scatter, and only what stands apart from them a gross error.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.terms.block import Block

# Groups of repeats below which their scatter says too little.
ENOUGH_GROUPS: Final = 10
# Of a touch's rows beyond the threshold: a displaced touch has half, any other hardly one in ten.
DISPLACED_SHARE: Final = 0.25
# Of all rows: where more are beyond the threshold, it is the model that is wrong, or the threshold.
LARGEST_OUTLIER_SHARE: Final = 0.5


def repeat_groups(block: Block, touch: IntArray) -> tuple[IntArray, IntArray]:
    """Which rows repeat each other: the number of each row's group (n,), and the groups' sizes.

    Args:
        block: whose rows these are.
        touch: (samples,) number of the touch each sample repeats.
    """
    # A residual of two samples may be seen from either end; distances do not care.
    members = np.sort(touch[block.samples], axis=1)
    _, group, count = np.unique(members, axis=0, return_inverse=True, return_counts=True)
    return group.reshape(-1).astype(np.intp), count.astype(np.intp)


def repeat_variance(
    block: Block, residual: FloatArray, touch: IntArray, sound: BoolArray
) -> float | None:
    """Variance of a residual's norm among repeats of the same touches, or None without enough.

    Args:
        block: whose rows these are.
        residual: (n, d).
        touch: (samples,) number of the touch each sample repeats.
        sound: (n,) rows that count.
    """
    residual = residual[sound]
    group, _ = repeat_groups(block, touch)
    _, group, count = np.unique(group[sound], return_inverse=True, return_counts=True)
    if np.sum(count > 1) < ENOUGH_GROUPS:
        return None
    mean = np.zeros((len(count), block.size))
    np.add.at(mean, group, residual)
    inside = residual - (mean / count[:, None])[group]
    return float(np.sum(inside**2) / np.sum(count - 1))


def gross_rows(block: Block, residual: FloatArray, touch: IntArray) -> BoolArray:
    """Rows (n,) that are grossly wrong, and all rows of touches that have many such.

    A row is grossly wrong if it is beyond the Huber threshold from its repeats; with fewer than
    three of them, if it is so from zero as well: what repeats agree on is the model's. Where most
    rows would be wrong, none is.

    Args:
        block: whose rows these are.
        residual: (n, d).
        touch: (samples,) number of the touch each sample repeats.
    """
    limit = block.noise.huber
    group, count = repeat_groups(block, touch)
    told = (count > 2)[group]
    beyond = (_apart(residual, group, count) > limit) & (told | (_norm(residual) > limit))
    samples, most = block.samples, int(block.samples.max()) + 1
    rows, bad = np.zeros(most), np.zeros(most)
    for k in range(samples.shape[1]):
        np.add.at(rows, samples[:, k], 1.0)
        np.add.at(bad, samples[:, k], beyond)
    suspect = bad > DISPLACED_SHARE * rows
    found = np.asarray(beyond | suspect[samples].any(axis=1))
    return found if found.mean() <= LARGEST_OUTLIER_SHARE else np.zeros_like(found)


def _apart(residual: FloatArray, group: IntArray, count: IntArray) -> FloatArray:
    """(n,) how far each row is from the median of its repeats, from the other one of two."""
    first = np.cumsum(count) - count
    deviation = np.empty_like(residual)
    for k in range(residual.shape[1]):
        ordered = residual[np.lexsort((residual[:, k], group)), k]
        median = (ordered[first + (count - 1) // 2] + ordered[first + count // 2]) / 2
        deviation[:, k] = residual[:, k] - median[group]
    distance = _norm(deviation) * np.where(count == 2, 2.0, 1.0)[group]
    return np.where(count[group] == 1, np.inf, distance)


def _norm(residual: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(residual, axis=1))
