"""One run through the stations: what was confirmed, where it goes on, what is said about it.

Its samples file grows by one confirmed row at a time and is complete at every moment: each row
means the whole file written under another name and renamed, so that whoever is killed in the
middle leaves the file as it was before. Every line in it that is not this run's stays as it is,
also if somebody wrote it after the run began.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from suta_calib.acquisition.averaging import Average
from suta_calib.acquisition.pictures import NothingSeenError, Seen, nothing_seen
from suta_calib.acquisition.rest import DEFAULT_REST
from suta_calib.acquisition.seating_check import SeatingCheck, Visit, disagreement_with
from suta_calib.acquisition.session_events import Stations, StationState, StationStatus
from suta_calib.acquisition.touch_sequence import ONE_POINT, Station, TouchSequence
from suta_calib.arrays import FloatArray
from suta_calib.errors import OutputError, SamplesError
from suta_calib.geometry.numbers import vector_from_rotation, wrap
from suta_calib.measurements import lines_of, read_csv_table, read_text, write_text
from suta_calib.measurements.csv_table import number_in
from suta_calib.units import deg, mm

Say = Callable[[str], None]
# Labels and readings (n,), rad.
Sample = tuple[Mapping[str, str], FloatArray]
_MISFIT: Final = "its distances do not fit the others: seat it again, or check its name"
TWISTS: Final = {"ccw": "counter-clockwise", "cw": "clockwise"}


class Run:
    """The stations of a plan, and which of them have been measured.

    Whenever that changes, ``changed`` is called. ``see`` gives labels of what a camera sees there,
    ``visits`` are touches of the same places before, by landmark, or the empty name.

    Attributes:
        index: number of the station that is next.
        skipped: names of stations that were left out.
        notes: what the user should look at again, by station.
        last: (n,) readings of the sample confirmed last, rad, or None.
    """

    def __init__(
        self,
        plan: TouchSequence,
        file: SamplesFile,
        say: Say,
        changed: Callable[[], None] = lambda: None,
        see: Seen = nothing_seen,
        visits: Mapping[str, Sequence[Visit]] = MappingProxyType({}),
    ) -> None:
        self.plan, self.file, self.say, self._changed = plan, file, say, changed
        self._see, self._visits = see, visits
        self.seating = None if plan.artefact is None else SeatingCheck(plan.arm, plan.artefact)
        self.skipped: list[str] = []
        self.notes: dict[str, str] = {}
        self._rows: dict[int, int] = {}
        self.index = 0
        self.last: FloatArray | None = file.rows[-1][1] if file.rows else None
        self._last_labels = self._of_plan(file.rows[-1][0]) if file.rows else None
        # It goes on after the last confirmed one.
        for row, (labels, angles) in enumerate(file.rows):
            following = range(self.index, len(plan.stations))
            of_plan = self._of_plan(labels)
            place = next((k for k in following if plan.stations[k].labels == of_plan), None)
            if self.seating is not None:
                self.seating.put(labels["landmark"], angles)
            if place is not None:
                self._rows[place], self.index = row, place + 1
        if self.seating is not None:
            readings = {labels["landmark"]: angles for labels, angles in file.rows}
            self.notes = dict.fromkeys(self.seating.misplaced(readings), _MISFIT)

    @property
    def done(self) -> bool:
        """Whether no station is left."""
        return self.index >= len(self.plan.stations)

    @property
    def station(self) -> Station:
        """The next one."""
        return self.plan.stations[self.index]

    @property
    def left(self) -> tuple[Station, ...]:
        """The next one and all after it."""
        return self.plan.stations[self.index :]

    @property
    def taken(self) -> tuple[int, ...]:
        """Numbers of the stations that this run's samples are of, in the file's order."""
        return tuple(sorted(self._rows, key=lambda place: self._rows[place]))

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the stations without a sample."""
        return tuple(s.name for k, s in enumerate(self.plan.stations) if k not in self._rows)

    @property
    def state(self) -> Stations:
        """How far it is, for whoever follows it."""

        def status(place: int, name: str) -> StationStatus:
            if place == self.index:
                return "next"
            if place in self._rows:
                return "taken"
            return "skipped" if name in self.skipped else "open"

        states = (
            StationState(s.name, status(k, s.name), self.notes.get(s.name, ""))
            for k, s in enumerate(self.plan.stations)
        )
        seating = self.seating
        tips = {} if seating is None else dict(seating.tips)
        return Stations(tuple(states), tips, None if seating is None else seating.placed())

    def confirm(self, average: Average, note: str = "", *, described: bool = True) -> None:
        """Write the sample of the next station, say so (and describe it), go on; as `put`.

        Where a camera does not see what it should there is no sample, and the station stays next.
        """
        station = self.station
        try:
            fields = self._see()
        except NothingSeenError as problem:
            self.last, self._last_labels = average.angles, None
            self.say(
                f"{station.name}: no sample: the picture shows {problem.found}; move the arm on"
            )
            return
        labels = {**station.labels, **average.cells, **fields}
        row = self.file.put(labels, average.angles, self._rows.get(self.index))
        doubts = self._doubts(average)
        self._rows[self.index], self.last = row, average.angles
        self._last_labels = self._of_plan(station.labels)
        lines = self.described(average, note) if described else [f"{station.name}: kept"]
        for line in lines:
            self.say(line)
        self.notes.pop(station.name, None)
        if self.is_suspicious(average):
            doubts.append(_MISFIT)
        if doubts:
            self.notes[station.name] = "; ".join(doubts)
        if self.seating is not None:
            self.seating.put(station.labels["landmark"], average.angles)
        self.index += 1
        self._changed()

    def skip(self) -> None:
        """Leave the next station out."""
        self.skipped.append(self.station.name)
        self.index += 1
        self._changed()

    def rename(self, places: Sequence[int]) -> None:
        """Take this run's samples, in the file's order, for those of other stations.

        Stations left out before one of these ``places`` (numbers, increasing) were missed. Where
        the new labels cannot be written nothing changes, and an OutputError says so.
        """
        self.file.relabel([self.plan.stations[place].labels for place in places])
        self._rows = {place: row for row, place in enumerate(places)}
        self.index = places[-1] + 1
        self.skipped = [
            s.name for k, s in enumerate(self.plan.stations[: self.index]) if k not in self._rows
        ]
        self.notes.clear()
        if self.seating is not None:
            self.seating.tips.clear()
            for labels, angles in self.file.rows:
                self.seating.put(labels["landmark"], angles)
        self._changed()

    def back(self) -> None:
        """Return to the station before; its sample stays until there is another one."""
        self.index = max(0, self.index - 1)
        name = self.station.name
        self.skipped = [skipped for skipped in self.skipped if skipped != name]
        self._changed()

    def is_suspicious(self, average: Average) -> bool:
        """Whether the next station's distances would stand out."""
        if self.seating is None:
            return False
        return self.seating.suspicious(self.station.labels["landmark"], average.angles)

    def described(self, average: Average, note: str = "") -> list[str]:
        """Lines about a sample of the next station: scatter, and distances where there are any."""
        name = self.station.name
        out = int(np.max(average.left_out))
        text = f"{name}: recorded {average.count} readings in {average.seconds:.1f} s"
        text += f", {out} left out as gross errors" if out else ""
        lines = [f"{text} ({note})" if note else text]
        std = zip(self.plan.arm.joints, deg(average.std), strict=True)
        lines.append("  std in deg: " + "  ".join(f"{joint} {value:.4f}" for joint, value in std))
        if average.extra:
            extra = (f"{n} {x.mean:.4f} (std {x.std:.4f})" for n, x in average.extra.items())
            lines.append("  " + "  ".join(extra))
        if self.seating is not None:
            landmark = self.station.labels["landmark"]
            errors = self.seating.distances(landmark, average.angles)
            largest = sorted(errors, key=lambda other: -abs(errors[other]))[:4]
            text = ", ".join(f"to {other} {mm(errors[other]):+.2f} mm" for other in largest)
            if more := len(errors) - len(largest):
                rms = mm(float(np.sqrt(np.mean(np.square(list(errors.values()))))))
                text += f"; {more} smaller ones; rms {rms:.2f} mm"
            lines += [f"  distances, measured - certified: {text}"] if errors else []
        if self.is_suspicious(average):
            lines.append(
                f"  check: these distances do not fit; is the plug seated, and is this {name}?"
            )
        return [*lines, *(f"  look: {doubt}" for doubt in self._doubts(average))]

    def _of_plan(self, labels: Mapping[str, str]) -> dict[str, str]:
        """Labels without the numbers that were measured beside them."""
        return {name: labels[name] for name in self.plan.label_columns}

    def _doubts(self, average: Average) -> list[str]:
        """What speaks against a sample of the next station, before it is kept."""
        doubts = []
        last, labels = self.last, self._last_labels
        if last is not None and labels is not None and labels != self.station.labels:
            before = next(
                (s.name for s in self.plan.stations if s.labels == labels), "the last sample"
            )
            if float(np.max(np.abs(wrap(average.angles - last)))) < DEFAULT_REST.motion:
                doubts.append(
                    f"the same posture as {before}: check whether the arm moved to this landmark"
                )
        if moved := disagreement_with(self.plan.arm, average.angles, self._before()):
            doubts.append(moved)
        turned = self._twist(average)
        if turned is not None and turned <= 0:
            other = next(way for name, way in TWISTS.items() if name != self.plan.twist)
            did = f"it turned {deg(-turned):.1f} deg {other}" if turned else "it did not turn"
            turn = TWISTS[self.plan.twist]
            doubts.append(
                f"the plug was not turned {turn} before the arm came to rest ({did}): "
                f"{self.plan.how}"
            )
        return doubts

    def _before(self) -> list[Visit]:
        """Earlier touches of what the next station is on."""
        visits = list(self._visits.get(self.station.labels.get("landmark", ""), ()))
        if self.plan.place == ONE_POINT:
            visits += [
                Visit(f"rest {place + 1}", self.file.rows[row][1])
                for place, row in self._rows.items()
                if place != self.index and self.plan.stations[place].name not in self.notes
            ]
        return visits

    def _twist(self, average: Average) -> float | None:
        """How far the plug turned the right way just before a rest, rad; negative the other way.

        None where nothing is asked for, or it was not seen how the arm came to the rest. What
        counts is the tip's turn about the socket's axis, whatever joints make it: where the last
        joint's axis is the socket's, it is that joint's motion.
        """
        if not self.plan.twist or average.way is None or not len(average.way):
            return None
        last, _ = self.plan.arm.forward(average.angles)
        rotations, _ = self.plan.arm.forward(average.way)
        artefact = self.plan.artefact
        mark = None if artefact is None else artefact.landmark(self.station.labels["landmark"])
        # Up in the tip's frame: the artefact's z; the base's where that is not known.
        up = (last if mark is None or mark.rotation is None else mark.rotation)[2]
        to_go = np.array([vector_from_rotation(rotation.T @ last) for rotation in rotations]) @ up
        turned = last_motion(to_go, DEFAULT_REST.motion)
        return turned if self.plan.twist == "ccw" else -turned


def last_motion(to_go: FloatArray, least: float) -> float:
    """How far a coordinate went at last, with its sign, without what came before it turned round.

    It still had ``to_go`` (k,) so far, oldest first; what moves less than the ``least`` is at rest.
    """
    back = to_go[::-1]
    far = np.flatnonzero(np.abs(back) > least)
    if not len(far):
        return 0.0
    back = back[far[0] :]
    other_side = np.flatnonzero(back * np.sign(back[0]) < -least)
    back = back[: other_side[0]] if len(other_side) else back
    return float(back[np.argmax(np.abs(back))])


class SamplesFile:
    """The rows of one run in a samples CSV.

    Args:
        path: the file; made with its folder when the first row comes.
        joints: columns of the readings.
        labels: label columns, and those of numbers that are measured beside the joints.
        key: labels all rows of this run share.
        resume: go on with rows of this run that are already there.

    Attributes:
        rows: labels and readings (n,), rad, of this run's rows, in the file's order.

    Raises:
        SamplesError: the file is there and is no samples file with these columns, or holds rows of
            this run although it is not to be resumed.
        OutputError: the folder cannot be made.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str],
        labels: Sequence[str],
        key: Mapping[str, str],
        *,
        resume: bool = False,
    ) -> None:
        self.path, self._joints, self._labels, self._key = path, joints, labels, key
        self.rows: list[Sample] = []
        self._header: list[str] = [*joints, *labels]
        # The lines of the file with their ends, and which of them are this run's rows.
        self._lines, self._at = [_line(self._header)], list[int]()
        if path.exists():
            self._read(resume)

    def _read(self, resume: bool) -> None:
        table = read_csv_table(self.path)
        readings = np.stack(
            [table.numbers(j, "one column per joint") for j in self._joints], axis=1
        )
        labels = {name: table.labels(name, "a label column") for name in self._labels}
        self._lines = lines_of(read_text(self.path, SamplesError))
        self._header = _cells(self._lines[table.header_line - 1])
        self.rows, self._at = [], []
        for index, line in enumerate(table.lines):
            row_labels = {name: str(values[index]) for name, values in labels.items()}
            if any(row_labels[name] != value for name, value in self._key.items()):
                continue
            if not resume:
                run = ", ".join(f"{name} {value}" for name, value in self._key.items())
                raise SamplesError(
                    f"existing samples of {run}",
                    "a file without them: measured samples are never overwritten",
                    file=self.path,
                    line=line,
                    hint="continue with --resume, or give another --repeat or --out",
                )
            self._at.append(line - 1)
            self.rows.append((row_labels, readings[index]))

    def put(self, labels: Mapping[str, str], angles: FloatArray, at: int | None = None) -> int:
        """Write one row, in place of this run's row number ``at`` if that is given; its number.

        When this returns, the row is on the disk.

        Raises:
            OutputError: it could not be written; the file is as it was.
        """
        rows = list(self.rows)
        index = len(rows) if at is None else at
        rows[index : index + 1] = [(labels, angles)]
        self._write(rows)
        return index

    def put_all(self, rows: Sequence[Sample]) -> None:
        """Write several rows at once after those there are; errors as of `put`."""
        self._write([*self.rows, *rows])

    def exchange(self, kept: int, rows: Sequence[Sample]) -> None:
        """Write other rows in place of this run's from number ``kept`` on; errors as of `put`."""
        self._look_again()
        gone = {*self._at[kept:]}
        lines = [line for k, line in enumerate(self._lines) if k not in gone]
        self._put([*self.rows[:kept], *rows], self.rows[:kept], lines, self._at[:kept])

    def relabel(self, labels: Sequence[Mapping[str, str]]) -> None:
        """Give all rows of this run other labels, in order, at once; errors as of `put`."""
        self._write(
            [({**old, **new}, angles) for new, (old, angles) in zip(labels, self.rows, strict=True)]
        )

    def numbers(self, names: Sequence[str]) -> FloatArray:
        """(rows, names) what was measured beside the joints in this run's rows."""
        cells = [[number_in(labels[name]) for name in names] for labels, _ in self.rows]
        return np.array(cells).reshape(-1, len(names))

    def _write(self, rows: list[Sample]) -> None:
        """Write the file with these rows; they are this run's once they are on the disk."""
        self._look_again()
        self._put(rows, self.rows, list(self._lines), list(self._at))

    def _put(
        self, rows: list[Sample], before: list[Sample], lines: list[str], at: list[int]
    ) -> None:
        """Write these rows over a file's lines, of which some (``at``) were rows ``before``."""
        for k, (labels, angles) in enumerate(rows):
            new = dict(labels) | dict(zip(self._joints, map(str, angles.tolist()), strict=True))
            if k >= len(at):
                if not lines[-1].endswith(("\n", "\r")):
                    lines[-1] += "\n"
                at.append(len(lines))
                lines.append(_line([new.get(name, "") for name in self._header]))
            elif rows[k] is not before[k]:
                # What stands in columns that are nobody's here stays.
                old = dict(zip(self._header, _cells(lines[at[k]]), strict=True))
                lines[at[k]] = _line([(old | new)[name] for name in self._header])
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path}: not written: {error.strerror}") from error
        write_text(self.path, "".join(lines))
        self.rows, self._lines, self._at = rows, lines, at

    def _look_again(self) -> None:
        """Take over what somebody else wrote into the file since it was looked at last."""
        if not self.path.exists():
            return
        if lines_of(read_text(self.path, SamplesError)) == self._lines:
            return
        now = SamplesFile(self.path, self._joints, self._labels, self._key, resume=True)
        before = self.rows
        same = len(before) == len(now.rows) and all(
            a == b and np.array_equal(p, q) for (a, p), (b, q) in zip(before, now.rows, strict=True)
        )
        if not same:
            raise OutputError(
                f"{self.path}: not written: found {len(now.rows)} samples of this run, because "
                f"the file was changed during the run; expected the {len(before)} that were "
                "written; continue with --resume, or with another --out"
            )
        self._lines, self._at, self._header = now._lines, now._at, now._header


def _cells(line: str) -> list[str]:
    """The cells of a line, as `read_csv_table` reads them."""
    return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True))]


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
