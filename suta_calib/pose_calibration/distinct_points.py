"""Points that occur more than once: how many rows it takes to have seen enough of them."""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray, IntArray


def distinct_rows(a: FloatArray, b: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of points without their exact copies.

    Args:
        a: (n, 3) points in one frame.
        b: (n, 3) the same points in another.

    Returns:
        (k,) rows that are not copies of one before, in their order; and (n,) for every row the
        index of its like among them.
    """
    _, first, copies = np.unique(np.hstack([a, b]), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    return first[order], rank[copies.reshape(-1)]


def determining_rows(a: FloatArray, b: FloatArray) -> int:
    """Rows (n, 3) of which every choice has three different points, as long as some have.

    Two points fit any pair of their like: where the two that occur most are many rows, what most
    rows agree on says nothing of the turn about them. In the words of robust regression, the rows
    are not in general position (Rousseeuw and Leroy 1987, section 3.4). Three where no point
    occurs twice in either frame.
    """
    return 1 + max(_two_most_frequent(points) for points in (a, b))


def _two_most_frequent(points: FloatArray) -> int:
    counts = np.unique(points, axis=0, return_counts=True)[1]
    return int(np.sort(counts)[-2:].sum())
