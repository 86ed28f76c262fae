"""How a recorded arm moved between its rows: readings at other times than those of the rows.

Between two rows each joint follows a cubic polynomial that meets both readings and, there, the
slopes of the polynomials through the five nearest rows (Hermite). What that may be wrong by is told
by the rows themselves: each is predicted from its two neighbours on either side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.units import ms

# Rows that a polynomial takes: two on either side of one in the middle.
WINDOW: Final = 5
# The error of a row that is predicted from its neighbours is that of twice the step, and falls with
# the fourth power of the step.
BY_STEP: Final = 2.0**-4
# Readings that differ by less were read at one moment, rad or m.
_SAME: Final = 1e-6


@dataclass(frozen=True, eq=False)
class JointRecording:
    """Moments at which an arm was read, one after the other; stretches without gaps are runs.

    Attributes:
        time: (k,) of the moments, s; of each file on an axis of its own, so that they increase.
        first, last: (k,) the first and the last moment of the run of each.
        powers: (4, k, joints) of the polynomial from each moment to the next, by powers of the
            time since.
        error: (k, joints) what readings half way to the next may be wrong by, rad or m.
    """

    time: FloatArray
    first: IntArray
    last: IntArray
    powers: FloatArray
    error: FloatArray

    @classmethod
    def of(cls, time: FloatArray, readings: FloatArray, runs: IntArray) -> JointRecording:
        """Of moments in order (k,), what was read then (k, joints), and which run each is of."""
        k, joints = readings.shape
        edges = [0, *(1 + np.flatnonzero(np.diff(runs))).tolist(), k]
        first, last = np.zeros(k, dtype=np.intp), np.zeros(k, dtype=np.intp)
        powers, error = np.zeros((4, k, joints)), np.zeros((k, joints))
        axis, end = time.copy(), 0.0
        for begin, stop in pairwise(edges):
            mine = slice(begin, stop)
            axis[mine] += end - time[begin]
            end = axis[stop - 1] + 1.0
            first[mine], last[mine] = begin, stop - 1
            powers[0, mine] = readings[mine]
            if stop - begin > 1:
                slope, error[mine] = _slopes(time[mine], readings[mine])
                _fill(powers[:, mine], time[mine], slope)
        return cls(axis, first, last, powers, error)

    def told(self, moment: IntArray, within: float) -> BoolArray:
        """(n,) whether readings are known at all times so near to these moments, s."""
        first, last = self.first[moment], self.last[moment]
        # Times are rounded, and the polynomials go on for as little.
        needed = 0.99 * within
        since, until = self.time[moment] - self.time[first], self.time[last] - self.time[moment]
        return np.asarray((last - first + 1 >= WINDOW) & (np.minimum(since, until) >= needed))

    def at(self, moment: IntArray, offset: float | FloatArray) -> FloatArray:
        """(4, n, joints) readings ``offset`` s after some moments (n,), by powers of what comes on.

        The first are the readings, the second what they change by in a second.
        """
        time = self.time[moment] + offset
        at = np.searchsorted(self.time, time, side="right") - 1
        # Beyond the ends of a run its last polynomials go on.
        at = np.clip(at, self.first[moment], np.maximum(self.last[moment] - 1, self.first[moment]))
        x = (time - self.time[at])[:, None]
        a, b, c, d = self.powers[:, at]
        return np.array(
            [a + x * (b + x * (c + x * d)), b + x * (2 * c + 3 * x * d), c + 3 * x * d, d]
        )


@dataclass(frozen=True, eq=False)
class JointMotion:
    """How an arm moved near some rows of a recording.

    Attributes:
        recording: all of it, whichever rows are looked at.
        moment: (n,) which of its moments each row is.
        q: (n, joints) readings of the rows.
        rows: how many the recording has.
    """

    recording: JointRecording
    moment: IntArray
    q: FloatArray
    rows: int

    def __len__(self) -> int:
        return len(self.moment)

    @property
    def error(self) -> FloatArray:
        """(n, joints) what readings between the rows may be wrong by, one standard deviation."""
        # Of a run that is too short it is not known: rad or m that are as good as nothing.
        unknown = 0.1
        return np.minimum(self.recording.error[self.moment], unknown)

    def of(self, q: FloatArray) -> bool:
        """Whether these are the readings of the rows, but for noise."""
        # Encoders that are simulated anew scatter by less; another unit, sign or zero is more.
        noise = 5e-3
        return q.shape == self.q.shape and bool(np.all(np.abs(q - self.q) < noise))

    def beyond(self, offset: float | FloatArray) -> FloatArray:
        """(4, n, joints) `JointRecording.at`, readings counted from those of the rows."""
        there = self.recording.at(self.moment, offset)
        there[0] -= self.recording.powers[0, self.moment]
        return there

    def take(self, rows: IntArray) -> JointMotion:
        """Near some of the rows."""
        return replace(self, moment=self.moment[rows], q=self.q[rows])

    def over_joints(self, places: IntArray, count: int) -> JointMotion:
        """With so many joints, of which those of the readings have these places."""

        def wider(array: FloatArray) -> FloatArray:
            new = np.zeros((*array.shape[:-1], count))
            new[..., places] = array
            return new

        old = self.recording
        recording = replace(old, powers=wider(old.powers), error=wider(old.error))
        return replace(self, recording=recording, q=wider(self.q))


class TimedRows(NamedTuple):
    """Rows of a recording.

    Attributes:
        time: (n,) when each was taken, s.
        q: (n, joints) readings, rad or m.
        file: (n,) number of the file of each.
        origin: (n,) where each came from.
    """

    time: FloatArray
    q: FloatArray
    file: IntArray
    origin: Sequence[str]


def motion_of(rows: TimedRows, turning: BoolArray) -> JointMotion:
    """How an arm moved near the rows of a recording.

    Args:
        rows: the recording; each file is one by itself.
        turning: (joints,) joints that are where they were after a full turn of their reading.

    Raises:
        SamplesError: times that are not in order or in another unit, and readings that tell
            nothing of the motion between the rows.
    """
    _check_order(rows)
    # Rows of one moment, such as of several targets, are one.
    new = np.concatenate([[True], (np.diff(rows.time) > 0.0) | (np.diff(rows.file) != 0)])
    moment, first = np.cumsum(new) - 1, np.flatnonzero(new)
    time, readings, file = rows.time[first], rows.q[first], rows.file[first]
    _check_unit(time, readings, file)
    gap = np.diff(file) != 0
    for number in np.unique(file):
        mine = np.flatnonzero(file == number)
        steps = np.diff(time[mine])
        if len(steps):
            # Steps, in units of the usual one of its file, from which on a step is a gap: two rows
            # are missing.
            gap[mine[:-1]] |= steps > 3.0 * np.median(steps)
    runs = np.concatenate([[0], np.cumsum(gap)])
    for run in range(runs[-1] + 1):
        mine = np.flatnonzero(runs == run)
        readings[np.ix_(mine, turning)] = np.unwrap(readings[np.ix_(mine, turning)], axis=0)
    recording = JointRecording.of(time, readings, runs)
    _check_smooth(rows.origin[0].rpartition(":")[0] or "samples", readings, runs, recording)
    return JointMotion(recording, moment.astype(np.intp), rows.q, len(rows.q))


def _windows(count: int) -> IntArray:
    """(count, w) which moments of a run are nearest to each; fewer where it has few."""
    width = min(WINDOW, count)
    first = np.clip(np.arange(count) - width // 2, 0, count - width)
    return np.asarray(first[:, None] + np.arange(width))


def _slopes(time: FloatArray, readings: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of one run (k,): slopes (k, joints) and what readings between may be wrong by (k, joints)."""
    near = _windows(len(time))
    width = near.shape[1]
    step = (time[-1] - time[0]) / (len(time) - 1)
    since = (time[near] - time[:, None]) / step
    powers = since[:, :, None] ** np.arange(width)
    slope = np.linalg.solve(powers, readings[near])[:, 1] / step
    if width < WINDOW:
        return slope, np.full_like(readings, np.inf)
    # Each from the others, which lie on both sides of it but at the ends of the run.
    other = np.abs(since) > 0.0
    count = (len(time), width - 1)
    lesser = powers[other].reshape(*count, width)[:, :, : width - 1]
    predicted = np.linalg.solve(lesser, readings[near][other].reshape(*count, -1))[:, 0]
    missed = readings - predicted
    # At the ends they are extrapolated, which says nothing of what is between.
    missed[:2], missed[-2:] = missed[2], missed[-3]
    # An error may vanish at one row, not at several.
    nearby = missed[near] ** 2
    return slope, BY_STEP * np.sqrt(nearby.mean(axis=1))


def _fill(powers: FloatArray, time: FloatArray, slope: FloatArray) -> None:
    """The rest of the powers (4, k, joints) of a run whose readings are there already."""
    step = np.diff(time)[:, None]
    mean = np.diff(powers[0], axis=0) / step
    powers[1] = slope
    powers[2, :-1] = (3.0 * mean - 2.0 * slope[:-1] - slope[1:]) / step
    powers[3, :-1] = (slope[:-1] + slope[1:] - 2.0 * mean) / step**2


def _check_order(rows: TimedRows) -> None:
    time = rows.time
    step, same_file = np.diff(time), np.diff(rows.file) == 0
    for row in np.flatnonzero(same_file & (step < 0.0)).tolist():
        raise SamplesError(
            f"a time of {time[row + 1]:.6g} s after {time[row]:.6g} s",
            "time that increases from row to row",
            where=f"{rows.origin[row + 1]}, time",
            hint="sort the rows by time; put rows after a restart of the clock into another file",
        )
    moved = np.max(np.abs(np.diff(rows.q, axis=0)), axis=1, initial=0.0) > _SAME
    for row in np.flatnonzero(same_file & (step == 0.0) & moved).tolist():
        raise SamplesError(
            f"the time {time[row]:.6g} s twice, with other readings of the joints",
            "one posture at one time",
            where=f"{rows.origin[row + 1]}, time",
            hint="the time may be rounded: write it with more digits",
        )


def _check_unit(time: FloatArray, readings: FloatArray, file: IntArray) -> None:
    same_file = np.diff(file) == 0
    step = np.diff(time)[same_file]
    if len(step) < WINDOW - 1:
        found = f"{len(time)} rows"
        raise SamplesError(found, f"at least {WINDOW} rows of a moving arm", where="time")
    moved = np.max(np.abs(np.diff(readings, axis=0)), axis=1)[same_file]
    usual, speed = float(np.median(step)), float(np.median(moved / step))
    # Seconds from row to row that no recording of a moving arm has; beyond the first only if the
    # arm is so slow, rad/s or m/s, that it would take an hour for a turn.
    long_steps = (0.9, 20.0)
    least, most = long_steps
    hardly_moves = 0.002
    if usual > most or (usual > least and speed < hardly_moves):
        unit = "ms" if usual < 900 else "µs" if usual < 9e5 else "ns"
        factor = {"ms": 1e3, "µs": 1e6, "ns": 1e9}[unit]
        raise SamplesError(
            f"{usual:.4g} s from row to row",
            "times in s of a moving arm",
            where="time",
            hint=f"they look like {unit}: divide by {factor:.0e}".replace("e+0", "e"),
        )
    # Rad/s or m/s that no joint turns with.
    fastest = 100.0
    if speed > fastest:
        raise SamplesError(
            f"readings that change by {speed:.3g} rad/s",
            "times in s of a moving arm",
            where="time",
            hint="the times look like another unit: convert them to s",
        )


def _check_smooth(
    place: str, readings: FloatArray, runs: IntArray, recording: JointRecording
) -> None:
    """Refuse an arm that did not move, and rows that tell nothing of how it moved between them."""
    steps = np.diff(readings, axis=0)[np.diff(runs) == 0]
    complete = np.isfinite(recording.error).all(axis=1)
    size = float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0
    if size < _SAME:
        raise SamplesError(
            "an arm that does not move",
            "a moving arm, because the time offset has no effect at rest",
            where=place,
            hint="remove time_offset_ms",
        )
    missed = (
        float(np.sqrt(np.mean(recording.error[complete] ** 2))) / BY_STEP
        if complete.any()
        else np.inf
    )
    # Errors of predicted rows, in units of the steps of the readings from row to row, from which on
    # the rows tell nothing of the motion between them: 1.4 for rows at any postures, 0 for a smooth
    # path.
    if missed > 0.5 * size:
        usual = float(np.median(np.diff(recording.time)[np.diff(runs) == 0]))
        raise SamplesError(
            f"rows {ms(usual):.4g} ms apart that tell nothing of the motion between them",
            "rows so close in time that each follows from its neighbours",
            where=place,
            hint="record more often; for an arm that rested at each row, remove time_offset_ms",
        )
