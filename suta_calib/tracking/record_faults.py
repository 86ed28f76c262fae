"""What a record itself got wrong: a clock, a stuck tracker, something knocked, single wild rows.

None of this is the motion's doing, and all of it hides in an error that is averaged. What an honest
record may err by is taken out first: an offset, errors that grow with the place or depend on which
way it moves, lateness, play and geometry where joints are known. Stray rows are looked for first
(stuck, or wild by themselves), then one of the others (`shifts_in_time`) in the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

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
from suta_calib.tracking.shifts_in_time import ShiftsInTime
from suta_calib.tracking.trajectory import Trajectory
from suta_calib.units import Unit, mm, ms, with_std


@dataclass(frozen=True)
class RecordFault:
    """Something that the record, and not the motion, got wrong.

    Attributes:
        kind: ``stuck`` rows, ``wild`` rows, a ``jump``, a ``step`` of its time, or the ``rate`` of
            its clock.
        first, last: file and line of its first and last row; of the worst where it is wild rows,
            of the longest stretch where it stuck more than once.
        since, until: their times, s.
        to_the_end: whether it lasts until the last row.
        count: of stretches, or of wild rows.
        size: how far the reference moved on, or the rows are off, m; by how much the recording
            comes later, s, or its clock runs fast, a number.
        std: its standard deviation; NaN of rows that are stuck or wild.
        seconds: of the whole record.
        explained: share of the squares of the errors that it explains, from 0 to 1.
        latency, rms: s and m, as they are without it, and without those told before it.
        latency_with, rms_with: as they are with it.
        spoils: whether it explains most of the error, and one of these numbers changed by more
            than its standard uncertainty.
    """

    kind: Kind
    first: str
    last: str
    since: float
    until: float
    to_the_end: bool
    count: int
    size: float
    std: float
    seconds: float
    explained: float
    latency: float
    rms: float
    latency_with: float
    rms_with: float
    spoils: bool

    @property
    def unit(self) -> Unit:
        """Of ``size`` and ``std``."""
        return "1" if self.kind == "rate" else "s" if self.kind == "step" else "m"

    @property
    def sentence(self) -> str:
        """What it is, what to do, and what the answer is without it."""
        return (
            f"{self._what} Without this fault: {mm(self.rms):.3f} mm RMS (not "
            f"{mm(self.rms_with):.3f}), latency {ms(self.latency):.2f} ms (not "
            f"{ms(self.latency_with):.2f})."
        )

    @property
    def _what(self) -> str:
        from_there = f"From {self.since:.3f} s on ({self.first}),"
        stretch = f"from {self.since:.3f} s to {self.until:.3f} s ({self.first} to {self.last})"
        if self.kind == "stuck":
            times = f" {self.count} times, longest" if self.count > 1 else ""
            return (
                f"The recording keeps the same value{times} {stretch}, while the reference moves "
                f"by {mm(self.size):.1f} mm. Leave these rows out."
            )
        if self.kind == "wild":
            many = self.count > 1
            return (
                f"{self.count} row{('s are' if many else ' is')} away from the rows before and "
                f"after by {('up to ' if many else '')}{mm(self.size):.2f} mm ({self.first}, at "
                f"{self.since:.3f} s). Leave {('them' if many else 'it')} out."
            )
        if self.kind == "jump":
            by = with_std(self.size, self.std, "m")
            where = from_there if self.to_the_end else stretch[0].upper() + stretch[1:]
            return (
                f"{where} the recording is shifted by {by} against the reference. Check whether "
                "a base, a tool or a target was knocked. Evaluate the rows before and after "
                "separately."
            )
        if self.kind == "step":
            later = "later" if self.size > 0 else "earlier"
            return (
                f"{from_there} the recording is {abs(ms(self.size)):.2f} ± {ms(self.std):.2f} ms "
                f"{later} than before. Check whether its time stamps jumped. Evaluate the rows "
                "before and after separately."
            )
        # Two digits of the std, in per cent, and two decimals at least.
        digits = max(2, 1 - math.floor(math.log10(max(100 * self.std, 1e-6))))
        grows = abs(ms(self.size * self.seconds))
        return (
            f"The recording's clock runs {100 * abs(self.size):.{digits}f} ± "
            f"{100 * self.std:.{digits}f} % {('fast' if self.size > 0 else 'slow')} compared "
            f"with the reference's: the latency changes by {grows:.1f} ms in {self.seconds:.1f} "
            "s. Take the times of both from the same clock."
        )


def record_faults(
    record: ErrorsInTime,
    recorded: Trajectory,
    rows: np.typing.NDArray[np.intp],
    latency: tuple[float, float],
    std_of_rms: Callable[[FloatArray], float],
) -> tuple[RecordFault, ...]:
    """What explains a record's errors that is no error of the motion, one beside those before it.

    Args:
        record: errors over time.
        recorded: whose rows (n,) are named.
        rows: those that the record has.
        latency: and its standard uncertainty, s.
        std_of_rms: the standard deviation of a root mean square, m, by squares in order of time.
    """
    faults, shape, lateness = list[RecordFault](), np.zeros_like(record.error), 0.0
    squares, late = np.sum(record.error**2, axis=1), 0.0
    # Of the squares of the errors, what a fault explains that spoils the answer.
    most = 0.5
    for candidate in _candidates(record):
        # Each beside those before it: what one explains does not make the next a trifle.
        shape, lateness = shape + candidate.shape, lateness + candidate.lateness
        before, latency_with = squares, late
        squares, late = _without(record, shape)
        late += lateness
        with_it, rms = (float(np.sqrt(np.mean(values))) for values in (before, squares))
        changed = abs(late - latency_with) > latency[1] or abs(with_it - rms) > std_of_rms(squares)
        explained = 1.0 - float(squares.sum()) / max(float(before.sum()), 1e-300)
        first, last = rows[candidate.first], rows[candidate.last]
        fault = RecordFault(
            kind=candidate.kind,
            first=recorded.origin(first),
            last=recorded.origin(last),
            since=float(recorded.time[first]),
            until=float(recorded.time[last]),
            to_the_end=bool(candidate.last == len(rows) - 1),
            count=candidate.count,
            size=candidate.size,
            std=candidate.std,
            seconds=float(record.time[-1] - record.time[0]),
            explained=explained,
            latency=latency[0] + late,
            rms=rms,
            latency_with=latency[0] + latency_with,
            rms_with=with_it,
            spoils=bool(explained > most and changed),
        )
        # The same of one that is worth a word.
        faults += [fault] if explained > 0.05 else []
    return tuple(faults)


def _candidates(record: ErrorsInTime) -> list[FaultEstimate]:
    """The most telling faults: stuck and wild rows, and one of the others."""
    if len(record.time) < LEAST:
        return []
    candidates, usable = _stray_rows(record)
    other = ShiftsInTime(record, usable).most_telling() if np.sum(usable) >= LEAST else None
    return [*candidates, other] if other else candidates


def _stray_rows(record: ErrorsInTime) -> tuple[list[FaultEstimate], BoolArray]:
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
    at, errors = np.flatnonzero(used), left[used]
    n = len(errors)
    padded = np.concatenate([errors[beside:0:-1], errors, errors[-2 : -2 - beside : -1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, beside, axis=0)
    before, after = np.median(windows[:n], axis=2), np.median(windows[beside + 1 :], axis=2)
    ahead, behind = errors - before, errors - after
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
    least = times_largest * max(float(off[~wild].max()), rms_length(errors[~wild]))
    rows = rows[off[rows] > np.maximum(least, turns[at[rows]])]
    if not len(rows):
        return None
    worst = int(rows[np.argmax(off[rows])])
    return _fault("wild", left, at[rows], float(off[worst]), len(rows), (int(at[worst]),) * 2)


def _without(record: ErrorsInTime, shape: FloatArray) -> tuple[FloatArray, float]:
    """Squares of the errors (m,) without a shape (n, 3), m², and what lateness that leaves, s."""
    finite = np.isfinite(shape[:, 0])
    error, columns = record.error[finite] - shape[finite], record.estimated[finite]
    # What the alignment makes of it: lateness and transform go with the rest that it estimates.
    follows = fitted(columns, error)
    moved = 1 + record.transform.shape[2]
    error = error - columns[:, :, :moved] @ follows[:moved]
    return np.sum(error**2, axis=1), float(follows[0])
