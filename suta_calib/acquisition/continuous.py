"""Measuring while the arm moves: a hand sweeps it, with the tip in a socket, on a plate, or free.

Rows are on the disk within a second, as they come. When the sweep ends, all of it is looked at:
what was measured while the tip was off its place is left out, and what follows a slip gets a label
of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from suta_calib.acquisition.guided import ENTER
from suta_calib.acquisition.run import Sample, SamplesFile, Say
from suta_calib.acquisition.stops import Began, Event
from suta_calib.acquisition.sweep import APART, Moment, Moments, PostureDistance, Thinning, thinned
from suta_calib.acquisition.sweep_contact import Surface, Telling, TipContact, contact
from suta_calib.acquisition.touch_sequence import TouchSequence
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.measurements.samples import STROKE
from suta_calib.model.parameters import ParameterSet
from suta_calib.units import deg, mm

# Column of the s since the first reading.
TIME: Final = "time"
# How often a line is said where no screen shows it, s.
_SAID: Final = 10.0


@dataclass(frozen=True)
class Swept(Displayable):
    """What a sweep left.

    Attributes:
        postures: rows: postures that are apart from one another.
        strokes: how many strokes they are from.
        left_out: postures that were left out because the tip was off.
        lift_offs: `LiftOff` of each time in which it was; None where that was not tested.
        slips: `Slip` of each time when its place moved; None likewise.
        scatter: of the tip about its place, m; None likewise.
    """

    postures: int
    strokes: int
    left_out: int = 0
    lift_offs: tuple[Any, ...] | None = None
    slips: tuple[Any, ...] | None = None
    scatter: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """As JSON data, in mm."""
        document: dict[str, Any] = {
            "postures": self.postures,
            "strokes": self.strokes,
            "left_out": self.left_out,
        }
        if self.lift_offs is not None and self.slips is not None and self.scatter is not None:
            document["lift_offs"] = [
                {"begin_s": off.begin, "end_s": off.end, "distance_mm": mm(off.distance)}
                for off in self.lift_offs
            ]
            document["slips"] = [
                {"time_s": slip.time, "distance_mm": mm(slip.distance), "std_mm": mm(slip.std)}
                for slip in self.slips
            ]
            document["scatter_mm"] = mm(self.scatter)
        return document


class Continuous:
    """Takes a sample of every posture that is apart from all others, for ``seconds``.

    Args:
        plan: its first station's labels are those of all samples.
        file: with the columns `TIME` and `STROKE` beside the plan's, where no joint is called so.
        say: shows a line.
        seconds: how long is recorded; pauses of the stream do not count.
        every: least time between two samples, s.
        surface: what the tip touches; None where readings do not tell whether it does.
        unknowns: parameters of which it is shown what these postures leave open.
        apart: how far postures are apart, rad.
        quiet: whether a screen shows `doing`, so that no lines need be said meanwhile.

    Attributes:
        count: rows of this sweep.
        swept: what it left, once it is `conclude`d.
    """

    def __init__(
        self,
        plan: TouchSequence,
        file: SamplesFile,
        say: Say,
        seconds: float = math.inf,
        every: float = 0.0,
        *,
        surface: Surface | None = None,
        unknowns: ParameterSet | None = None,
        apart: float = APART,
        quiet: bool = False,
    ) -> None:
        self._plan, self._file, self._say, self._quiet = plan, file, say, quiet
        self._seconds, self._surface = seconds, surface
        self._telling = None
        if surface is not None and unknowns is not None:
            self._telling = Telling(surface, unknowns)
        self._before = len(file.rows)
        strokes = [int(labels.get(STROKE, "0") or 0) for labels, _ in file.rows]
        self._thinning_of: dict[str, Any] = {
            "apart": apart,
            "every": every,
            "earlier": [angles for _, angles in file.rows],
            "strokes": max(strokes, default=0),
        }
        self._apart = apart
        self._postures = PostureDistance(plan.arm)
        self._thinning = Thinning(self._postures, **self._thinning_of)
        self._moments, self._seen = Moments(), list[Moment]()
        self._waiting: list[Sample] = []
        self._kept: list[FloatArray] = []
        self._flush_at, self._say_at, self._look_at = 0.0, _SAID, 0.0
        self._flagged: set[str] = set()
        self._quit = self._ended = False
        self._open: tuple[str, ...] | None = None
        self.count = 0
        self.swept: Swept | None = None

    @property
    def done(self) -> bool:
        """Whether the time is up, or the user has had enough."""
        return self._quit or self._moments.seconds >= self._seconds

    def press(self, key: str) -> None:
        """Enter or q ends the sweep."""
        self._quit |= key in ("q", ENTER)

    def handle(self, event: Event) -> None:
        """Rests mean nothing here."""

    def feed(self, readings: Iterable[Reading]) -> list[Event]:
        """Take the arm's readings as they come; an event says that a posture was a new one."""
        before = self.count + len(self._waiting)
        for reading in readings:
            if self.done:  # a busy computer gets many at once
                break
            self._tell_of_flags(reading)
            for moment in self._moments.feed([reading]):
                self._take(moment)
        seconds = self._moments.seconds
        if seconds >= self._flush_at or self.done:
            self._flush_at = seconds + 1.0
            self.finish()
        if seconds >= self._say_at and not self._quiet:
            self._say_at = seconds + _SAID
            self._say(self.doing())
        return [Began()] if self.count + len(self._waiting) > before else []

    def finish(self) -> None:
        """Write what is not written yet."""
        if self._waiting:
            self._file.put_all(self._waiting)
            self.count += len(self._waiting)
            self._waiting = []

    def doing(self) -> str:
        """What there is so far, in a line."""
        n, strokes = self.count + len(self._waiting), self._thinning.stroke
        left = self._seconds - self._moments.seconds
        time = f"{self._moments.seconds:.0f} s"
        time += f", {left:.0f} s remaining" if math.isfinite(left) else ""
        parts = [f"{n} postures in {strokes} strokes, {time}"]
        if self._kept:
            q = np.array(self._kept)
            steps = self._postures.steps(q, q[0])
            ranges = zip(self._plan.arm.joints, np.ptp(steps, axis=0), strict=True)
            parts.append("covered: " + ", ".join(f"{j} {deg(r):.0f}°" for j, r in ranges))
        if self._open is None or self._moments.seconds >= self._look_at:
            # How often what is undetermined is looked at, s.
            self._look_at = self._moments.seconds + 3.0
            self._open = self._untold()
        if self._open:
            parts.append(f"not determined yet: {', '.join(self._open)}")
        return "; ".join(parts)

    def conclude(self) -> list[str]:
        """Look at the whole sweep, and write what holds; sentences of what was found."""
        if self._ended:
            return []
        self._ended = True
        for moment in self._moments.rest():
            self._take(moment)
        self.finish()
        if not self.count:
            return []
        contacts, lines, left_out = None, list[str](), 0
        touching = np.ones(len(self._seen), dtype=np.bool_)
        if self._surface is not None:
            rows, strokes = thinned(
                self._postures, self._seen, touching.tolist(), apart=self._apart
            )
            try:
                contacts = contact(self._surface, self._seen, rows, strokes)
                touching = contacts.touching
                left_out = int(np.sum(~touching[rows]))
            except SamplesError as error:
                lines.append(f"lift-off and slip were not tested: {error}")
        rows, strokes = thinned(self._postures, self._seen, touching.tolist(), **self._thinning_of)
        if contacts is not None:
            self._file.exchange(
                self._before,
                [self._row(k, s, contacts) for k, s in zip(rows, strokes, strict=True)],
            )
            self.count = len(rows)
        n = len(np.unique(strokes))
        self.swept = Swept(self.count, n)
        if contacts is not None:
            self.swept = replace(
                self.swept,
                left_out=left_out,
                lift_offs=contacts.lift_offs,
                slips=contacts.slips,
                scatter=contacts.scatter,
            )
        return [self._summary(self.swept), *lines, *self._told(contacts), *self._advice(n)]

    def _take(self, moment: Moment) -> None:
        self._seen.append(moment)
        if self._thinning.counts(moment):
            self._kept.append(moment.angles)
            self._waiting.append(self._labelled(moment, self._thinning.stroke))

    def _labelled(self, moment: Moment, stroke: int, place: int = 0) -> Sample:
        labels = dict(self._plan.stations[0].labels)
        if place:
            labels |= {column: f"{labels[column]}_slip{place}" for column in self._plan.place}
        labels |= {TIME: f"{moment.time:.4f}", STROKE: str(stroke)}
        return {k: v for k, v in labels.items() if k not in self._plan.arm.joints}, moment.angles

    def _row(self, row: int, stroke: int, found: TipContact) -> Sample:
        moment = self._seen[row]
        return self._labelled(moment, int(stroke), int(found.place(np.array([moment.time]))[0]))

    def _tell_of_flags(self, reading: Reading) -> None:
        for index in np.flatnonzero(reading.error):
            joint = self._plan.arm.joints[index]
            if joint not in self._flagged:
                self._flagged.add(joint)
                self._say(f"rejected: error flag of {joint}; readings with this flag are not used")

    def _untold(self) -> tuple[str, ...]:
        """What of the unknowns these postures leave open, and others would tell."""
        few = 10
        if self._telling is None or len(self._kept) < few:
            return ()
        return self._telling.untold(np.array(self._kept))

    def _summary(self, swept: Swept) -> str:
        text = (
            f"{swept.postures} postures in {swept.strokes} strokes, "
            f"{deg(self._apart):.3g} deg or more apart"
        )
        if swept.scatter is not None:
            text += f"; the tip scatters by {mm(swept.scatter):.2g} mm about its place"
        return text

    def _told(self, found: TipContact | None) -> list[str]:
        """Sentences of lift-offs and slips."""
        if found is None:
            return []
        lines = [
            f"lift-off from {off.begin:.2f} to {off.end:.2f} s: the tip was up to "
            f"{mm(off.distance):.2g} mm off; rows of this time are left out"
            for off in found.lift_offs
        ]
        # Lines about single lift-offs.
        most_lines = 10
        if len(lines) > most_lines:
            rest = sum(off.end - off.begin for off in found.lift_offs[most_lines:])
            lines[most_lines:] = [f"{len(lines) - most_lines} more lift-offs, {rest:.1f} s in all"]
        for k, slip in enumerate(found.slips):
            place = " ".join(self._plan.stations[0].labels[column] for column in self._plan.place)
            lines.append(
                f"slip at {slip.time:.2f} s: what the tip is on moved by {mm(slip.distance):.2g} ± "
                f"{mm(slip.std):.1g} mm; rows from then on are of {place}_slip{k + 1}. Clamp it"
            )
        return lines

    def _advice(self, strokes: int) -> list[str]:
        sentences = []
        if self._moments.unusable:
            sentences.append(
                f"{self._moments.unusable} readings were no numbers, or invalid: not used"
            )
        if self._moments.repeated:
            sentences.append(f"{self._moments.repeated} readings came twice")
        # Strokes that tell how much a stroke errs: of fewer, a variance is known to a third at
        # best.
        enough_strokes = 20
        if self._surface is not None and strokes < enough_strokes:
            sentences.append(
                f"only {strokes} strokes: the ± of a calibration are rough. Reverse the motion "
                f"more often, {enough_strokes} times or more"
            )
        return sentences


def time_columns(joints: Sequence[str]) -> tuple[str, ...]:
    """Columns of a sweep beside the joints' and the labels'."""
    return tuple(name for name in (TIME, STROKE) if name not in joints)
