"""Rows that are wrong by themselves: a record that is stuck, and single wild rows."""

from __future__ import annotations

import math

import numpy as np

from suta_calib.acquisition.averaging import row_noise
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.tracking.errors_in_time import (
    LEAST,
    NOTHING,
    ErrorsInTime,
    FaultEstimate,
    Kind,
    fitted,
)


def stray_rows(record: ErrorsInTime) -> tuple[list[FaultEstimate], BoolArray]:
    """What is stuck or wild, and which rows (n,) are neither."""
    left = _robust_residual(record)
    faults, usable = list[FaultEstimate](), np.ones(len(left), dtype=bool)
    for find in (_stuck, _wild):
        fault = find(record, left, usable) if np.sum(usable) >= LEAST else None
        if fault is not None:
            faults.append(fault)
            usable &= np.isfinite(fault.shape[:, 0])
    return faults, usable


def _robust_residual(record: ErrorsInTime) -> FloatArray:
    """(n, 3) what is left of the error, rows that are far off left out of the fit."""
    far_off = 6.0  # medians
    inliers = np.ones(len(record.time), dtype=bool)
    left = record.error
    # So many evenly spaced rows are enough to fit.
    few = np.zeros(len(inliers), dtype=bool)
    few[:: max(1, len(inliers) // 3000)] = True
    for _ in range(4):
        left = record.error - record.columns @ fitted(record.columns, record.error, inliers & few)
        sizes = np.linalg.norm(left, axis=1)
        again = sizes <= far_off * max(float(np.median(sizes)), NOTHING / far_off)
        if np.array_equal(again, inliers):
            break
        inliers = again
    return left


def _usual(sizes: FloatArray) -> float:
    """What all but one in a hundred do not exceed: more are how this record scatters."""
    return float(np.quantile(sizes, 0.99))


def _fault(
    kind: Kind, left: FloatArray, rows: IntArray, size: float, count: int, ends: tuple[int, int]
) -> FaultEstimate:
    shape = np.zeros_like(left)
    shape[rows] = np.nan
    return FaultEstimate(kind, size, math.nan, shape, count, *ends)


def _scatter(left: FloatArray) -> float:
    """What the median row is off by, m."""
    return max(float(np.median(np.linalg.norm(left, axis=1))), NOTHING / 5.0)


def _stuck(record: ErrorsInTime, left: FloatArray, _: BoolArray) -> FaultEstimate | None:
    """Stretches in which the record stays where it is while the reference moves on."""
    place, truth, n = record.recorded, record.reference, len(left)
    # Times the noise that it may move meanwhile; times that, or the scatter, that the reference
    # moves on.
    tolerance = 5.0 * float(row_noise(place))
    far = 5.0 * max(_scatter(left), tolerance)
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
    peak = 3.0 * _usual(sizes[~covered])
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    runs = [run for run in runs if sizes[run].max() > peak]
    if not runs:
        return None
    ways = [float(np.linalg.norm(truth[run[-1]] - truth[run[0]])) for run in runs]
    longest = runs[int(np.argmax(ways))]
    ends = int(longest[0]), int(longest[-1])
    return _fault("stuck", left, np.concatenate(runs), max(ways), len(runs), ends)


def _wild(record: ErrorsInTime, left: FloatArray, used: BoolArray) -> FaultEstimate | None:
    """Single rows that are off from those before and from those after, the same way."""
    # Rows on either side; times that a wild row is off what is usual, and the largest of the rest.
    beside, times_usual, times_largest = 5, 5.0, 2.0
    at, kept = np.flatnonzero(used), left[used]
    n = len(kept)
    padded = np.concatenate([kept[beside:0:-1], kept, kept[-2 : -2 - beside : -1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, beside, axis=0)
    before, after = np.median(windows[:n], axis=2), np.median(windows[beside + 1 :], axis=2)
    ahead, behind = kept - before, kept - after
    same = np.einsum("nk,nk->n", ahead, behind) > 0
    off = np.minimum(np.linalg.norm(ahead, axis=1), np.linalg.norm(behind, axis=1)) * same
    wild = off > times_usual * max(_usual(off), _scatter(left), NOTHING / times_usual)
    rows = np.flatnonzero(wild)
    if not 0 < len(rows) <= max(1, n / 100):
        return None
    # Where the motion turns sharply, what is between two rows is not known so well.
    step = float(np.median(np.diff(record.time)))
    near = min(1 + math.ceil(record.interval / step), len(used) - 1)
    turns = np.zeros(len(used))
    bend = np.linalg.norm(record.velocity[near:] - record.velocity[:-near], axis=1)
    for shift in range(near + 1):
        part = turns[shift : shift + len(bend)]
        np.maximum(part, bend * max(record.interval, step), out=part)
    least = times_largest * max(float(off[~wild].max()), rms_length(kept[~wild]))
    rows = rows[off[rows] > np.maximum(least, turns[at[rows]])]
    if not len(rows):
        return None
    worst = int(rows[np.argmax(off[rows])])
    return _fault("wild", left, at[rows], float(off[worst]), len(rows), (int(at[worst]),) * 2)
