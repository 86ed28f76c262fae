"""One run through the stations: what was confirmed, where it goes on, what is said about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from suta_calib.acquisition.averaging import Average
from suta_calib.acquisition.samples_file import SamplesFile
from suta_calib.acquisition.seating_check import DistanceError, SeatingCheck
from suta_calib.acquisition.touch_sequence import Station, TouchSequence
from suta_calib.arrays import FloatArray

Say = Callable[[str], None]
_MOST_DISTANCES: Final = 4


class Run:
    """The stations of a plan, and which of them have been measured.

    Args:
        plan: what to measure.
        file: where confirmed samples go.
        say: shows the user a line.

    Attributes:
        index: number of the station that is next.
        skipped: names of stations that were left out.
        notes: what the user should look at again, by station.
        last: (n,) readings of the sample confirmed last, rad, or None.
    """

    def __init__(self, plan: TouchSequence, file: SamplesFile, say: Say) -> None:
        self.plan, self.file, self.say = plan, file, say
        self.seating = None if plan.artefact is None else SeatingCheck(plan.arm, plan.artefact)
        self.skipped: list[str] = []
        self.notes: dict[str, str] = {}
        self._rows: dict[int, int] = {}
        self.index = 0
        self.last: FloatArray | None = file.rows[-1][1] if file.rows else None
        self._resume()

    def _resume(self) -> None:
        """Find the station after the last confirmed one."""
        for row, (labels, angles) in enumerate(self.file.rows):
            following = range(self.index, len(self.plan.stations))
            place = next((k for k in following if self.plan.stations[k].labels == labels), None)
            if self.seating is not None:
                self.seating.put(labels["landmark"], angles)
            if place is not None:
                self._rows[place], self.index = row, place + 1

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

    def confirm(self, average: Average, note: str = "", *, described: bool = True) -> None:
        """Write the sample of the next station, then say so, then go on.

        Args:
            average: the sample.
            note: said with it.
            described: whether to describe it, which `described` has not yet done.

        Raises:
            OutputError: it could not be written.
        """
        station = self.station
        row = self.file.put(station.labels, average.angles, self._rows.get(self.index))
        self._rows[self.index], self.last = row, average.angles
        lines = self.described(average, note) if described else [f"{station.name}: kept"]
        for line in lines:
            self.say(line)
        self.notes.pop(station.name, None)
        if self.is_suspicious(average):
            self.notes[station.name] = "distances stand out: seat it again, or check its name"
        if self.seating is not None:
            self.seating.put(station.labels["landmark"], average.angles)
        self.index += 1

    def skip(self) -> None:
        """Leave the next station out."""
        self.skipped.append(self.station.name)
        self.index += 1

    def rename(self, places: Sequence[int]) -> None:
        """Take this run's samples, in the file's order, for those of other stations.

        Args:
            places: their stations' numbers, increasing; those left out before them were missed.

        Raises:
            OutputError: the new labels could not be written; nothing has changed then.
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

    def back(self) -> None:
        """Return to the station before; its sample stays until there is another one."""
        self.index = max(0, self.index - 1)
        name = self.station.name
        self.skipped = [each for each in self.skipped if each != name]

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
        std = zip(self.plan.arm.joints, np.degrees(average.std), strict=True)
        lines.append("  std in deg: " + "  ".join(f"{joint} {value:.4f}" for joint, value in std))
        if self.seating is not None:
            landmark = self.station.labels["landmark"]
            errors = self.seating.distances(landmark, average.angles)
            lines += [f"  distances, measured - certified: {_listed(errors)}"] if errors else []
        if self.is_suspicious(average):
            lines.append(f"  look: these distances stand out; is the plug seated, is this {name}?")
        return lines


def _listed(errors: list[DistanceError]) -> str:
    """The largest first, and how many more there are."""
    largest = sorted(errors, key=lambda each: -abs(each.error))[:_MOST_DISTANCES]
    text = ", ".join(f"to {each.other} {1e3 * each.error:+.2f} mm" for each in largest)
    more = len(errors) - len(largest)
    rms = 1e3 * float(np.sqrt(np.mean([each.error**2 for each in errors])))
    return f"{text}; {more} smaller ones; rms {rms:.2f} mm" if more else text
