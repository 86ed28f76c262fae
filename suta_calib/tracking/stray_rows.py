"""Rows that are wrong by themselves: a record that is stuck, and single wild rows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.acquisition.averaging import NORMAL
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.tracking.errors_in_time import NOTHING, ErrorsInTime, fitted

# Rounds in which rows that are off by so many medians are left out of the fit, and enough rows.
ROUNDS: Final = 4
OFF: Final = 6.0
ENOUGH: Final = 3000
# Times the scatter, or the noise, that the reference moves on while a record is stuck; times
# that it is then off what one of a hundred other rows is.
STUCK: Final = 5.0
PEAK: Final = 3.0
# Times that a wild row is off what one of a hundred is, and the largest that is not wild; and rows
# on either side that it is held against.
WILD: Final = 5.0
WILD_RATIO: Final = 2.0
BESIDE: Final = 5
# Of the rows, so many at most are wild: more are how this record scatters.
FEW: Final = 0.01


@dataclass(frozen=True, eq=False)
class Stray:
    """Rows that tell nothing.

    Attributes:
        rows: (m,) which.
        size: how far the reference moves on, or the worst is off, m.
        count: of stretches, or of wild rows.
        first, last: rows of the longest stretch, or the worst row.
    """

    rows: IntArray
    size: float
    count: int
    first: int
    last: int


def robust_residual(record: ErrorsInTime) -> FloatArray:
    """(n, 3) what is left of the error, rows that are far off left out of the fit."""
    inliers = np.ones(len(record.time), dtype=bool)
    left = record.error
    # Evenly spaced rows are enough to fit.
    few = np.zeros(len(inliers), dtype=bool)
    few[:: max(1, len(inliers) // ENOUGH)] = True
    for _ in range(ROUNDS):
        left = record.error - record.columns @ fitted(record.columns, record.error, inliers & few)
        sizes = np.linalg.norm(left, axis=1)
        again = sizes <= OFF * max(float(np.median(sizes)), NOTHING / OFF)
        if np.array_equal(again, inliers):
            break
        inliers = again
    return left


def stuck_rows(record: ErrorsInTime, left: FloatArray, scatter: float) -> Stray | None:
    """Rows in which the record stays where it is while the reference moves on.

    Args:
        record: errors over time.
        left: (n, 3) of them, what no honest cause explains, m.
        scatter: what the median row is off by, m.
    """
    place, truth, n = record.recorded, record.reference, len(left)
    # What changes from row to row without direction.
    second = np.diff(place, 2, axis=0)
    noise = NORMAL * float(np.median(np.abs(second))) / np.sqrt(6.0)
    tolerance = STUCK * noise
    far = STUCK * max(scatter, tolerance)
    speed = np.linalg.norm(record.velocity, axis=1)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(record.time))])
    # From each row to the one by which the reference has gone so far, and to each row likewise.
    every = np.arange(n)
    ahead, back = np.searchsorted(way, way + far), np.searchsorted(way, way - far, "right") - 1
    start = np.concatenate([every[ahead < n], back[back >= 0]])
    end = np.concatenate([ahead[ahead < n], every[back >= 0]])
    stays = np.linalg.norm(place[end] - place[start], axis=1) <= tolerance
    moves = np.linalg.norm(truth[end] - truth[start], axis=1) > 0.5 * far
    edges = np.zeros(n + 1, dtype=np.intp)
    np.add.at(edges, start[stays & moves], 1)
    np.add.at(edges, end[stays & moves] + 1, -1)
    covered = np.cumsum(edges[:-1]) > 0
    rows = np.flatnonzero(covered)
    if not len(rows) or covered.all():
        return None
    # Play stands still too, and a slow tracker: then rows are off by no more than others.
    sizes = np.linalg.norm(left, axis=1)
    usual = float(np.quantile(sizes[~covered], 1 - FEW))
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    runs = [run for run in runs if sizes[run].max() > PEAK * usual]
    if not runs:
        return None
    ways = [float(np.linalg.norm(truth[run[-1]] - truth[run[0]])) for run in runs]
    worst = int(np.argmax(ways))
    first, last = int(runs[worst][0]), int(runs[worst][-1])
    return Stray(np.concatenate(runs), ways[worst], len(runs), first, last)


def wild_rows(
    record: ErrorsInTime, left: FloatArray, scatter: float, used: BoolArray
) -> Stray | None:
    """Single rows that are off from those before and from those after, the same way.

    Args:
        record: errors over time.
        left: (n, 3) of them, what no honest cause explains, m.
        scatter: what the median row is off by, m.
        used: (n,) rows that are not stuck.
    """
    at, left = np.flatnonzero(used), left[used]
    n, reach = len(left), BESIDE
    padded = np.concatenate([left[reach:0:-1], left, left[-2 : -2 - reach : -1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, reach, axis=0)
    before, after = np.median(windows[:n], axis=2), np.median(windows[reach + 1 :], axis=2)
    ahead, behind = left - before, left - after
    same = np.einsum("nk,nk->n", ahead, behind) > 0
    off = np.minimum(np.linalg.norm(ahead, axis=1), np.linalg.norm(behind, axis=1)) * same
    usual = max(float(np.quantile(off, 1 - FEW)), scatter, NOTHING / WILD)
    wild = off > WILD * usual
    rows = np.flatnonzero(wild)
    if not 0 < len(rows) <= max(1, FEW * n):
        return None
    # Where the motion turns sharply, what is between two rows is not known so well.
    step = float(np.median(np.diff(record.time)))
    near = min(1 + math.ceil(record.interval / step), len(used) - 1)
    turns = np.zeros(len(used))
    bend = np.linalg.norm(record.velocity[near:] - record.velocity[:-near], axis=1)
    for shift in range(near + 1):
        part = turns[shift : shift + len(bend)]
        np.maximum(part, bend * max(record.interval, step), out=part)
    least = WILD_RATIO * max(float(off[~wild].max()), rms_length(left[~wild]))
    rows = rows[off[rows] > np.maximum(least, turns[at[rows]])]
    if not len(rows):
        return None
    worst = int(rows[np.argmax(off[rows])])
    return Stray(at[rows], float(off[worst]), len(rows), int(at[worst]), int(at[worst]))
