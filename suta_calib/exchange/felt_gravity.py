"""What an accelerometer felt of gravity: logs of phones and IMUs, at the rests of an arm."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.acquisition.averaging import average, row_noise
from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.clock import Clock
from suta_calib.exchange.delimited import DELIMITED_OPTIONS, read_sheet
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.pose_table import read_readings
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.recorded_rests import SECONDS, Rest, found_rests, shortest_rest
from suta_calib.exchange.sheet import Sheet
from suta_calib.exchange.table_roles import UNIT
from suta_calib.units import deg, from_deg
from suta_calib.words import listed

POSTURES: Final = Option(
    "postures",
    "Joint readings of the arm at the rests of the log: a row for each, in order; or a recording. "
    "In rad, or in what --unit or the names of the columns say.",
    "FILE.csv",
    file=True,
)
DOWNWARDS: Final = Option(
    "downwards",
    "The log has the pull of gravity (iPhone), not the push against it (Android): change the sign.",
    flag=True,
)
ACCELERATION: Final = ("ax", "ay", "az")
STANDARD_GRAVITY: Final = 9.80665
# Gravity at rest in the units of sensors, and their names; within a tenth of each.
_UNITS: Final = ((1.0, "g"), (STANDARD_GRAVITY, "m/s²"), (1000.0, "mg or cm/s²"))
_NEAR: Final = 0.1
# Zero errors and scales of cheap sensors change what is felt at rest by less than this share.
_AT_REST: Final = 0.08
_FEWEST: Final = 5


@dataclass(frozen=True, eq=False)
class GravityLog:
    """What an accelerometer felt, in one unit, pointing up at rest.

    Attributes:
        path: the file.
        clock: when.
        acceleration: (m, 3) at the times of the clock.
        dropped: rows of the file with missing values.
        notes, remarks: one sentence each.
    """

    path: Path
    clock: Clock
    acceleration: FloatArray
    dropped: int = 0
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        path: Path,
        time: FloatArray,
        acceleration: FloatArray,
        lines: Sequence[int] | None = None,
        without: str = "",
    ) -> GravityLog:
        """A log of times (n,), in s or since 1970, and accelerations (n, 3).

        Args:
            path: the file.
            time: NaN where it is missing.
            acceleration: likewise.
            lines: (n,) in the file.
            without: what to do if gravity was taken out of the log.

        Raises:
            ForeignFileError: no times, two units, or no gravity.
        """
        complete = np.flatnonzero(np.isfinite(acceleration).all(axis=1) & np.isfinite(time))
        if not len(complete):
            columns = {"time": time, **dict(zip(("ax", "ay", "az"), acceleration.T, strict=True))}
            empty = [name for name, values in columns.items() if not np.isfinite(values).any()]
            missing = f": {listed(empty)} without any number" if empty else ""
            expected = "times and accelerations along x, y and z"
            raise ForeignFileError(f"no complete row{missing}", expected, file=path)
        # More than any sensor tells in any unit; its square must stay a number.
        for row in complete[np.abs(acceleration[complete]).max(axis=1) > 1e6][:1].tolist():
            found, line = (
                f"{np.abs(acceleration[row]).max():.3g}",
                None if lines is None else lines[row],
            )
            raise ForeignFileError(found, "an acceleration", file=path, line=line)
        clock = Clock.of(path, time[complete])
        rows = complete[clock.rows]
        felt = acceleration[rows]
        size = np.linalg.norm(felt, axis=1)
        usual = float(np.median(size))
        # Below this size, in any unit, gravity was taken out of what was felt.
        if not usual > 0.2:
            hint = without or "record the acceleration with gravity"
            found = f"an acceleration of {usual:.2g} on average, so that gravity was taken out"
            raise ForeignFileError(found, "gravity: 1 g, or 9.81 m/s²", file=path, hint=hint)
        notes, remarks = list(clock.notes), list(clock.remarks)
        if (other := _row_in_another_unit(size)) is not None:
            raise ForeignFileError(
                f"an acceleration of {size[other]:.3g}, where other rows have {_usual(size):.3g}",
                "one unit",
                file=path,
                line=None if lines is None else lines[int(rows[other])],
                hint="g and m/s² seem to be mixed; multiply those in g by 9.80665",
            )
        unit = next((name for of, name in _UNITS if abs(usual / of - 1.0) < _NEAR), "")
        if unit:
            remarks.append(f"Gravity is about {usual:.4g}: the unit is {unit}.")
        else:
            notes.append(
                f"What was felt is {usual:.4g} on average, which is gravity in no usual unit. The "
                "direction does not depend on the unit; but check that the arm rested, and that "
                "the sensor is scaled right."
            )
        return cls(path, clock, felt, len(time) - len(complete), tuple(notes), tuple(remarks))

    @property
    def usual(self) -> float:
        """Gravity in the unit of the log."""
        return float(np.median(np.linalg.norm(self.acceleration, axis=1)))

    def rows(self, form: str) -> ImportedRows:
        """Every row of the log."""
        felt = np.linalg.norm(self.acceleration, axis=1) / self.usual
        moving = float(np.mean(np.abs(felt - 1.0) > _AT_REST))
        remarks = [
            *self.remarks,
            f"To get the rests of an arm with its joint readings, give {POSTURES.switch} FILE.csv.",
        ]
        if moving > 0.01:
            remarks.insert(0, f"In {moving:.0%} of the rows more or less than gravity was felt.")
        columns = {"time": self.clock.time, **_columns(self.acceleration)}
        return self._imported(form, columns, self.dropped, self.notes, remarks)

    def at_postures(self, form: str, given: Given) -> ImportedRows:
        """Samples: the readings of the arm's joints with what was felt at each rest.

        Raises:
            ForeignFileError: no rests, or not as many as postures.
        """
        postures = _Postures.read(Path(given.text(POSTURES)), given)
        rests, how = self._matched(postures, given)
        numbers = [k for k, rest in enumerate(rests) if rest is not None]
        complete = [rest for rest in rests if rest is not None]
        means = np.array([rest.angles for rest in complete]) * self.usual
        scatter = np.array([_scatter(rest) for rest in complete])
        columns: dict[str, NDArray[Any]] = {n: v[numbers] for n, v in postures.columns.items()}
        columns |= _columns(means)
        columns["std_deg"] = deg(scatter)
        columns["time"] = np.array([rest.end for rest in complete])
        remarks = [
            f"{len(complete)} rests, matched with {postures.path.name} {how}. Each row is the mean "
            f"of a rest; the direction of one reading scatters by {deg(np.median(scatter)):.2g}° "
            "(column std_deg).",
            *self.remarks,
        ]
        notes = [*self.notes, *self._doubts(complete)]
        if self.dropped:
            remarks.append(
                f"{self.dropped} of {self.dropped + len(self.clock.time)} rows of the log have a "
                "missing number and were left out."
            )
        lost = [f"{k + 1}" for k, rest in enumerate(rests) if rest is None]
        if lost:
            notes.append(
                f"{len(lost)} of {len(rests)} postures were left out (row {listed(lost)}): the "
                "phone did not rest at their times."
            )
        return self._imported(form, columns, len(lost), notes, remarks)

    def _matched(self, postures: _Postures, given: Given) -> tuple[list[Rest | None], str]:
        """The rest of each posture, and how they were matched.

        In order, where there are as many and times, if any, agree but for one shift of the clocks.
        Else by time, where the times are those of the log.
        """
        rests, at = self.rests(shortest_rest(given)), postures.time
        count = len(next(iter(postures.columns.values())))
        if len(rests) == count and (at is None or _run_alike(at, rests)):
            return [*rests], "in order"
        begin, end = self.clock.time[0], self.clock.time[-1]
        if at is not None and np.mean((at >= begin) & (at <= end)) >= 0.5:
            return self._at_times(at, postures, given), "by their times"
        if len(rests) == count:
            raise ForeignFileError(
                f"as many rests as {postures.what}, but at other intervals than its times tell",
                "the same intervals",
                file=self.path,
                hint="delete the rows and cut the log where the two differ",
            )
        raise self._other_count(rests, count, postures)

    def _at_times(self, at: FloatArray, postures: _Postures, given: Given) -> list[Rest | None]:
        """The mean about each time; None where the sensor did not rest then."""
        half = 0.5 * shortest_rest(given)
        rests = [self._rest(middle - half, middle + half) for middle in at.tolist()]
        if (count := sum(rest is not None for rest in rests)) < max(1, len(rests) // 2):
            raise ForeignFileError(
                f"{count} of {len(rests)} postures of {postures.path.name} at whose times the "
                "sensor rested",
                "most of them, or as many rests as postures",
                file=self.path,
                hint="do both clocks agree? Without a column 'time' in the postures, rests are "
                "taken in order",
            )
        return rests

    def rests(self, seconds: float) -> list[Rest]:
        """The times of at least so many s in which the sensor did not move.

        There what is felt changes, and scatters, by little more than its noise.

        Raises:
            ForeignFileError: there are none.
        """
        felt, time = self.acceleration / self.usual, self.clock.time
        noise = float(np.sqrt(np.mean(row_noise(felt, 0) ** 2)))
        # Half a window of 0.4 s.
        half = max(4, round(0.2 / self.clock.step))
        rests = list[Rest]()
        # What a window may change and scatter by in a rest, rad or parts of gravity, whatever its
        # noise.
        quiet = from_deg(0.15)
        if len(felt) > 2 * half:
            mean, square = _means(felt, half), _means(felt**2, half)
            change = np.linalg.norm(mean[half:] - mean[:-half], axis=1)
            middle = 0.5 * (mean[half:] + mean[:-half])
            variance = 0.5 * (square[half:] + square[:-half]) - middle**2
            scatter = np.sqrt(np.maximum(variance.mean(axis=1), 0.0))
            # Five standard deviations of a difference, and twice the scatter, of noise alone.
            still = change < max(quiet, 5.0 * noise * np.sqrt(2.0 / half))
            still &= scatter < max(quiet, 2.0 * noise)
            rest = np.concatenate([np.repeat(still[:1], half), still, np.repeat(still[-1:], half)])
            edges = np.flatnonzero(np.diff(np.concatenate([[False], rest, [False]]).astype(int)))
            # A motion is seen for as long as a window, what is shorter is noise.
            breaks = np.flatnonzero(np.diff(edges)[1::2] < half)
            edges = np.delete(edges, np.concatenate([2 * breaks + 1, 2 * breaks + 2]))
            for begin, end in edges.reshape(-1, 2).tolist():
                last = min(end, len(time)) - 1
                if time[last] - time[begin] + 2.0 * half * self.clock.step < seconds:
                    continue
                if (mean_rest := self._rest(time[begin], time[last])) is not None:
                    rests.append(mean_rest)
        if not rests:
            problem = f"{len(time)} readings in {np.ptp(time):.1f} s, but no rest of {seconds:g} s"
            expected = "an arm that rests at every posture"
            hint = f"to find shorter rests, give {SECONDS.switch} N"
            raise ForeignFileError(problem, expected, file=self.path, hint=hint)
        return rests

    def still(self, begin: float, end: float) -> Mapping[str, float] | None:
        """The mean of a time as columns; None where the sensor moved, or said too little."""
        rest = self._rest(begin, end)
        if rest is None:
            return None
        mean = dict(zip(ACCELERATION, (self.usual * rest.angles).tolist(), strict=True))
        return {**mean, "std_deg": deg(_scatter(rest))}

    def _rest(self, begin: float, end: float) -> Rest | None:
        """The mean of a time; None where the sensor moved, or said too little."""
        time = self.clock.time
        rows = np.flatnonzero((time >= begin) & (time <= end))
        if len(rows) < _FEWEST:
            return None
        felt = self.acceleration[rows] / self.usual
        halves = [half.mean(axis=0) for half in np.array_split(felt, 2)]
        scatter = felt.std(axis=0) / np.sqrt(len(felt) / 4.0)
        # Two halves of a rest differ by less, rad; a hand that holds a phone does not.
        limit = from_deg(0.3) + 4.0 * float(np.linalg.norm(scatter))
        if np.linalg.norm(halves[1] - halves[0]) > limit:
            return None
        mean = average(felt)
        return Rest(mean.angles, begin, end, mean.std)

    def _other_count(self, rests: Sequence[Rest], count: int, postures: _Postures) -> Exception:
        """Error that there are not as many rests as postures, to be raised by the caller."""
        begin = self.clock.time[0]
        at = listed([f"{rest.begin - begin:.1f}" for rest in rests], 40)
        # Rests in a row whose directions are closer may be one that was disturbed, rad.
        repeated = [
            f"{before.begin - begin:.1f} s and {after.begin - begin:.1f} s"
            for before, after in pairwise(rests)
            if np.linalg.norm(after.angles - before.angles) < from_deg(0.1)
        ]
        hint = f"choose the shortest rest with {SECONDS.switch} N, or correct the postures"
        if repeated:
            hint += f"; no change of direction between {listed(repeated)}: was the phone touched?"
        gaps = np.diff(self.clock.time)
        for k in np.flatnonzero(self.clock.gaps)[:1].tolist():
            hint += (
                f"; the log has a gap of {gaps[k]:.3g} s, {self.clock.time[k] - begin:.1f} s after "
                "its beginning: delete the postures whose rest lies in it"
            )
        return ForeignFileError(
            f"{len(rests)} rests in the log, {at} s after its beginning",
            f"{count}, as many as {postures.what}",
            file=self.path,
            hint=hint,
        )

    def _doubts(self, rests: Sequence[Rest]) -> list[str]:
        """Rests in which other than gravity was felt."""
        sizes = np.array([np.linalg.norm(rest.angles) for rest in rests])
        ratio = sizes / np.median(sizes)
        off = np.flatnonzero(np.abs(ratio - 1.0) > _AT_REST)
        if not len(off):
            return []
        first, begin = int(off[0]), self.clock.time[0]
        return [
            f"{len(off)} of {len(rests)} rests felt other than gravity (the first, "
            f"{rests[first].begin - begin:.1f} s after the beginning, {ratio[first]:.3g} times as "
            "much as most): the arm moved or shook. Leave these rows out, or record them again."
        ]

    def _imported(
        self,
        form: str,
        columns: Mapping[str, NDArray[Any]],
        dropped: int,
        notes: Sequence[str],
        remarks: Sequence[str],
    ) -> ImportedRows:
        return ImportedRows(
            source=self.path,
            form=form,
            columns=columns,
            dropped=dropped,
            notes=tuple(notes),
            remarks=tuple(remarks),
        )


@dataclass(frozen=True, eq=False)
class _Postures:
    """Where an arm was at its rests.

    Attributes:
        path: the file.
        columns: of its samples, (k,) each.
        time: (k,) s, when; None where the file does not say.
        what: they are, in words.
    """

    path: Path
    columns: Mapping[str, NDArray[Any]]
    time: FloatArray | None
    what: str

    @classmethod
    def read(cls, path: Path, given: Given) -> _Postures:
        """A list of postures, or the rests in a recording of joints."""
        rows = read_readings(path, given.texts(UNIT))
        if not isinstance(rows, ImportedRows):
            raise ForeignFileError(rows.sentence, "joint readings", file=path)
        if rows.dropped:
            # One posture less, and every rest after it would go with the posture of another.
            raise ForeignFileError(
                f"{rows.dropped} row{'s' * (rows.dropped != 1)} with a missing number",
                "every joint's reading in every row, one row for each rest",
                file=path,
                hint="fill in the reading, or delete both the row and its rest",
            )
        columns = {n: v for n, v in rows.columns.items() if n not in ("time", *ACCELERATION)}
        time = rows.columns.get("time")
        if time is None or time.dtype.kind != "f":
            return cls(path, columns, None, f"{path.name} has rows")
        # Rows that make a file of postures a recording of the arm's joints.
        if len(time) >= 60 and float(np.median(np.diff(time))) < 1.0:
            clock = Clock.of(path, time)
            joints = [name for name, values in columns.items() if values.dtype.kind == "f"]
            angles = np.column_stack([columns[name][clock.rows] for name in joints])
            rests = found_rests(path, joints, clock.time, angles, given)
            means = np.array([rest.angles for rest in rests])
            at = np.array([0.5 * (rest.begin + rest.end) for rest in rests])
            return cls(path, dict(zip(joints, means.T, strict=True)), at, f"{path.name} has rests")
        return cls(path, columns, Clock.in_seconds(time)[0], f"{path.name} has rows")


def check_unit(given: Given) -> None:
    """Refuse a unit of joint readings without a file of them."""
    if UNIT in given and POSTURES not in given:
        raise given.refuse(UNIT, "a unit of joint readings", f"with it {POSTURES.switch} FILE.csv")


def _run_alike(time: FloatArray, rests: Sequence[Rest]) -> bool:
    """Whether times (n,) and n rests differ by one shift, but for less than half an interval."""
    begin = np.array([rest.begin for rest in rests])
    if len(begin) < 2:
        return True
    since = time - begin
    most = 0.4 * float(np.median(np.diff(begin)))
    return bool(np.abs(since - np.median(since)).max() < most)


def _row_in_another_unit(size: FloatArray) -> int | None:
    """The first of several rows (n,) that are in g where most are in m/s², or vice versa."""
    ratio = size / _usual(size)
    for factor in (STANDARD_GRAVITY, 1.0 / STANDARD_GRAVITY):
        of_same_unit = np.flatnonzero(np.abs(ratio / factor - 1.0) < _NEAR)
        if len(of_same_unit) >= max(_FEWEST, 0.005 * len(size)):
            return int(of_same_unit[0])
    return None


def _usual(size: FloatArray) -> float:
    """Gravity in the unit that most of the rows (n,) are in."""
    near = [np.abs(size / of - 1.0) < _NEAR for of, _ in _UNITS]
    most = max(near, key=np.count_nonzero)
    return float(np.median(size[most] if most.any() else size))


def _means(values: FloatArray, count: int) -> FloatArray:
    """(n - count + 1, 3) means of so many neighbouring rows of (n, 3)."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[count:] - sums[:-count]) / count)


def _scatter(rest: Rest) -> float:
    """Standard deviation of the direction of one reading in a rest, rad: mean of both ways."""
    assert rest.std is not None
    return float(np.linalg.norm(rest.std) / np.sqrt(3.0))


def _columns(acceleration: FloatArray) -> dict[str, NDArray[Any]]:
    return dict(zip(ACCELERATION, acceleration.T, strict=True))


class AccelerometerReader(Reader):
    """A text table of an accelerometer; with the postures of an arm, samples of kind ``gravity``.

    Attributes:
        without_gravity: what to do about a log from which gravity was taken out.
    """

    options: ClassVar[tuple[Option, ...]] = (
        *(POSTURES, UNIT, SECONDS, DOWNWARDS),
        *DELIMITED_OPTIONS,
    )
    without_gravity: ClassVar[str] = ""

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Rows ``time, ax, ay, az``; with postures, their joints and the means of the rests."""
        if SECONDS in given and POSTURES not in given:
            raise given.refuse(
                SECONDS, "a duration of rests", f"with it {POSTURES.switch} FILE.csv"
            )
        check_unit(given)
        sheet = read_sheet(path, given)
        time, axes = self.columns(sheet, given)
        pull, why = (True, "") if DOWNWARDS in given else self.points_down(path)
        sign = -1.0 if pull else 1.0
        log = GravityLog.of(
            path, time, sign * sheet.numbers([*axes]), sheet.lines, self.without_gravity
        )
        if why:
            log = replace(log, remarks=(why, *log.remarks))
        return log.at_postures(self.name, given) if POSTURES in given else log.rows(self.name)

    @abstractmethod
    def columns(self, sheet: Sheet, given: Given) -> tuple[FloatArray, Sequence[int]]:
        """Times (n,), s or since 1970, and the columns of x, y and z."""

    def points_down(self, path: Path) -> tuple[bool, str]:
        """Whether the log has the pull of gravity, and a sentence that says why."""
        del path
        return False, (
            "The accelerations were taken to point up at rest, as those of Android phones and of "
            f"IMUs do; for a log that points down (iPhone), give {DOWNWARDS.switch}."
        )
