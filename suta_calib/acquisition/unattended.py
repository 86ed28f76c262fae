"""Measuring without anybody at the keyboard: each rest that follows a motion is the next station.

A stream that pauses may hide a motion, and who pauses on the way rests where no landmark is: then
the next rest is not the next station any more. Where that can have happened, and where enough
landmarks are known to be certain, the artefact decides which one the arm rests on.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.acquisition.averaging import Average, wrap
from suta_calib.acquisition.run import Run
from suta_calib.acquisition.seating_check import ANOTHER, CERTAIN, likelier
from suta_calib.acquisition.stops import (
    Began,
    Complete,
    Ended,
    Event,
    Interrupted,
    Rejected,
    StopFinder,
)
from suta_calib.arrays import FloatArray

# A rest cut short counts if it lasted this part of what was asked for.
_ENOUGH: Final = 0.5
# And this part, if the stream left out some of it, or began during it.
_ENOUGH_INTERRUPTED: Final = 0.05
# As many landmarks tell where the artefact stands.
_TELLING: Final = 3
# As many that agree to this leave no doubt where the others are, m; and nobody seats so badly, m.
_SURE: Final = 5
_AGREED: Final = 10e-3
_NOWHERE: Final = 40e-3


class Unattended:
    """Takes stops as they come.

    Args:
        run: the stations.
        finder: where the stops come from.
        seconds: how long a stop is recorded.
    """

    def __init__(self, run: Run, finder: StopFinder, seconds: float) -> None:
        self._run, self._finder, self._seconds = run, finder, seconds
        self._short: Average | None = None
        self._doubt = run.last is not None
        # Rows of an earlier run have their labels for good.
        self._fresh = run.last is None
        self._said_still = False
        if run.last is not None:
            self._left(run.last)

    @property
    def done(self) -> bool:
        """Whether every station has been visited."""
        return self._run.done

    def handle(self, event: Event) -> None:
        """React to what the stream told."""
        if isinstance(event, Complete):
            self._complete(event.average)
        elif isinstance(event, Ended):
            self._ended(event)
        elif isinstance(event, Rejected):
            self._run.say(f"rejected: {event.reason} of {', '.join(event.joints)}")
        elif isinstance(event, Interrupted):
            self._doubt = True
        else:
            assert isinstance(event, Began)

    def finish(self) -> None:
        """Nothing more comes: a rest cut short that waits for its successor is one after all."""
        self._settle_short(None)
        run = self._run
        few = 0 < len(run.taken) < CERTAIN
        if few and self._fresh and run.seating is not None and not run.done:
            for place in run.taken:
                note = "of so few landmarks nothing tells that none was missed: check its name"
                run.notes.setdefault(run.plan.stations[place].name, note)

    def _complete(self, average: Average) -> None:
        if not self._is_next(average):
            return
        self._settle_short(average)
        if self.done:
            return
        if self._sure() and self._farthest_off(average) > _NOWHERE:
            self._doubt = True
            self._run.say(
                f"rested where none of the landmarks left can be, {self._run.station.name} next: "
                "taken for a pause on the way"
            )
            self._left(average.angles)
            return
        self._confirm(average)

    def _is_next(self, average: Average) -> bool:
        """Whether the arm has been elsewhere since the last station, and is elsewhere now."""
        last = self._run.last
        if last is None:
            return True
        moved = max(self._finder.excursion, _away(average.angles, last))
        if moved < self._finder.settings.motion:
            return False
        seating, stations = self._run.seating, self._run.plan.stations
        if seating is None or self._run.done or self._run.index == 0:
            return True
        repeated = stations[self._run.index - 1].labels == self._run.station.labels
        if not repeated and seating.same_place(average.angles, last):
            self._say_still(stations[self._run.index - 1].name)
            return False
        return True

    def _say_still(self, name: str) -> None:
        if not self._said_still:
            self._run.say(f"still on {name}: not counted again")
        self._said_still = True

    def _ended(self, event: Ended) -> None:
        """A rest too short: perhaps the next station, perhaps a pause on the way."""
        average = event.average
        if not self._is_next(average):
            return
        what = ", ".join(event.joints) or "seen only after a gap"
        share = _ENOUGH_INTERRUPTED if event.interrupted else _ENOUGH
        if average.seconds < share * self._seconds:
            self._doubt = True
            if average.seconds > 0:
                self._run.say(f"rejected: moved after {average.seconds:.1f} s ({what})")
            return
        self._run.say(
            f"rejected: moved after {average.seconds:.1f} of {self._seconds:g} s ({what}); "
            "its resting part counts if the arm does not come back"
        )
        self._settle_short(average)
        self._short = average

    def _settle_short(self, following: Average | None) -> None:
        """What to make of a rest cut short, once it is known where the arm rests next."""
        short, self._short = self._short, None
        if short is None or self.done:
            return
        if following is not None and self._same(short.angles, following.angles):
            self._run.say("back where it rested before: one rest, recorded again")
            return
        if self._elsewhere(short):
            self._doubt = True
            self._run.say(f"rested {short.seconds:.1f} s on no landmark: taken for a pause")
            return
        self._confirm(short, f"cut short: {short.seconds:.1f} of {self._seconds:g} s")

    def _elsewhere(self, average: Average) -> bool:
        """Whether the artefact says that this is none of the landmarks that are left."""
        seating = self._run.seating
        if seating is None or len(seating.tips) < _TELLING:
            return False
        return self._farthest_off(average) > ANOTHER

    def _farthest_off(self, average: Average) -> float:
        """How far the tip is from where even the nearest of the landmarks left must be, m."""
        seating = self._run.seating
        if seating is None:
            return 0.0
        return min(seating.misfit(s.name, average.angles) for s in self._run.left)

    def _sure(self) -> bool:
        """Whether the landmarks measured leave no doubt where the artefact stands."""
        seating = self._run.seating
        if seating is None or len(seating.tips) < _SURE:
            return False
        names = list(seating.tips)
        return seating.disagreement(names, [seating.tips[name] for name in names]) < _AGREED

    def _same(self, angles: FloatArray, other: FloatArray) -> bool:
        if _away(angles, other) < self._finder.settings.motion:
            return True
        seating = self._run.seating
        return seating is not None and seating.same_place(angles, other)

    def _confirm(self, average: Average, note: str = "") -> None:
        if self._doubt or self._sure():
            self._skip_missed(average)
        self._doubt = False
        self._run.confirm(average, note)
        self._left(average.angles)
        if self._fresh:
            self._check_names()

    def _check_names(self) -> None:
        """Whether landmarks were missed, so that names so far are those of others."""
        run, seating = self._run, self._run.seating
        if seating is None:
            return
        names = [s.labels["landmark"] for s in run.plan.stations]
        taken = run.taken
        tips = [seating.tip(angles) for _, angles in run.file.rows]
        true = likelier(seating, names, taken, tips)
        if true is not None:
            missed = [names[k] for k in range(true[-1]) if k not in true]
            start = " at the start" if missed == names[: true[0]] else ""
            changed = [(a, b) for a, b in zip(taken, true, strict=True) if a != b]
            run.say(
                f"missed {', '.join(missed) or 'none'}{start}: by their distances what was taken "
                f"for {', '.join(names[a] for a, _ in changed)} is "
                f"{', '.join(names[b] for _, b in changed)}"
            )
            run.rename(true)

    def _skip_missed(self, average: Average) -> None:
        """Go on to the landmark the arm really rests on, where a motion may have been missed."""
        run = self._run
        if run.seating is None:
            return
        found = run.seating.which(run.station.name, [s.name for s in run.left], average.angles)
        missed = []
        while run.station.name != found:
            missed.append(run.station.name)
            run.skip()
        if missed:
            run.say(f"missed {', '.join(missed)}: by its distances this is {found}")

    def _left(self, angles: FloatArray) -> None:
        self._finder.measure_excursion_from(angles)
        self._said_still = False


def _away(angles: FloatArray, other: FloatArray) -> float:
    return float(np.max(np.abs(wrap(angles - other))))
