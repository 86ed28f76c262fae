"""The times of a recording's rows: their unit, repeated stamps, gaps; and values between rows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import ForeignFileError


@dataclass(frozen=True, eq=False)
class Clock:
    """When the rows of a recording were taken.

    Attributes:
        time: (m,) s, increasing.
        rows: (m,) rows of the recording that they are of; of rows with one stamp the first.
        step: s between most rows.
        notes: what must be known of the stamps, one sentence each.
        remarks: what was taken for granted.
    """

    time: FloatArray
    rows: NDArray[np.intp]
    step: float
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: Path, stamps: FloatArray) -> Clock:
        """The clock of stamps (n,), in s, or in any unit if they count from 1970.

        Raises:
            ForeignFileError: times that run backwards, do not change, or are in a unit that
                nothing tells.
        """
        if len(stamps) < 2:
            raise ForeignFileError(f"{len(stamps)} rows", "a recording", file=path)
        if not np.isfinite(stamps).all():
            raise ForeignFileError("a time that is no number", "a time in each row", file=path)
        stamps, remark = cls.in_seconds(stamps)
        notes = list[str]()
        steps = np.diff(stamps)
        if (steps < 0).all():
            raise ForeignFileError(
                "a time that is earlier in every row: the recording runs backwards",
                "times that increase",
                file=path,
                hint="turn the order of the rows around, and check the sign of the clock",
            )
        if (steps < 0).any():
            row = int(np.argmax(steps < 0)) + 1
            raise ForeignFileError(
                f"a time that runs backwards by {-steps[row - 1]:.6g} s after {row} rows",
                "times that increase",
                file=path,
                hint="was the clock set, or the recording started again? Cut the file there",
            )
        rows = np.flatnonzero(np.concatenate([[True], steps > 0]))
        if len(rows) < 2:
            raise ForeignFileError("one time in all rows", "times that increase", file=path)
        time = stamps[rows]
        step = float(np.median(np.diff(time)))
        # s between rows of a recording of motion; what is slower is in another unit, or no
        # recording.
        slowest = 1.0
        if step > slowest:
            raise ForeignFileError(
                f"rows {step:.6g} s apart",
                f"a recording with at least one row every {slowest:g} s",
                file=path,
                where="column 'time'",
                hint="if the times are in ms, µs or ns, say so with --columns 'time=time [ms]'",
            )
        if repeated := len(stamps) - len(rows):
            notes.append(
                f"{repeated} of {len(stamps)} rows of {path.name} repeat the time of the row "
                "before: only the first row of each time is used."
            )
        clock = cls(time, rows, step)
        gaps = np.diff(time)[clock.gaps]
        if len(gaps):
            notes.append(
                f"{path.name} has {len(gaps)} {'gap' if len(gaps) == 1 else 'gaps'} of up to "
                f"{gaps.max():.3g} s, of which nothing is known."
            )
        return cls(time, rows, step, tuple(notes), (remark,) if remark else ())

    @staticmethod
    def in_seconds(stamps: FloatArray) -> tuple[FloatArray, str]:
        """Stamps (n,) in s, and a sentence if they were in another unit since 1970."""
        size = float(np.median(np.abs(stamps)))
        # Times since 1970 in ns, µs and ms, from 1973 to the year 5138, and how many make a second;
        # those in s are smaller than all of them.
        since_1970 = ((1e17, "ns", 1e9), (1e14, "µs", 1e6), (1e11, "ms", 1e3))
        for least, unit, per_second in since_1970:
            if size > least:
                return stamps / per_second, f"Times were read as {unit} since 1970."
        return stamps, ""

    @property
    def gaps(self) -> BoolArray:
        """(m - 1,) whether the time to the next row is a gap."""
        # A pause of so many usual steps, and of so long, s, is a gap: nothing is known of what lies
        # in it.
        gap_steps = 5.0
        return np.asarray(np.diff(self.time) > max(gap_steps * self.step, 0.2))


@dataclass(frozen=True, eq=False)
class Between:
    """Where times lie among the rows of a clock, and how the four rows about each count.

    Attributes:
        rows: (n, 4) of the clock's times; the second is the last at or before each time.
        weights: (n, 4) of a cubic through the four; of a line where one of them is beyond a gap;
            of the second alone where nothing is known.
        known: (n,) whether rows on both sides are near.
    """

    rows: IntArray
    weights: FloatArray
    known: BoolArray

    @classmethod
    def of(cls, clock: Clock, at: FloatArray) -> Between:
        """For times (n,), s."""
        time, gaps, last = clock.time, clock.gaps, len(clock.time) - 1
        first = np.clip(np.searchsorted(time, at, side="right") - 1, 0, last - 1)
        rows = np.clip(first[:, None] + np.arange(-1, 3), 0, last)
        inside = (at >= time[0]) & (at <= time[-1]) & ~gaps[first]
        # The outer two count if nothing lies between them and the inner ones.
        unbroken = np.concatenate([[False], ~gaps, [False]])
        cubic = (unbroken[first] & unbroken[first + 2])[:, None]
        where = time[rows]
        weights = np.zeros((len(at), 4))
        for k in range(4):
            other_rows = [j for j in range(4) if j != k]
            differences = where[:, [k]] - where[:, other_rows]
            differences[differences == 0] = 1.0
            weights[:, k] = np.prod((at[:, None] - where[:, other_rows]) / differences, axis=1)
        share = (at - time[first]) / (time[first + 1] - time[first])
        line = np.stack([np.zeros_like(at), 1.0 - share, share, np.zeros_like(at)], axis=1)
        weights = np.where(cubic, weights, line)
        weights[~inside] = [0.0, 1.0, 0.0, 0.0]
        return cls(rows, weights, inside)
