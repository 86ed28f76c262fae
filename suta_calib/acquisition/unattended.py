"""Measuring without a key for each rest: rest after rest.

Each rest that follows a motion is the next station. A stream that pauses may hide a motion, and who
pauses on the way rests where no landmark is: then the next rest is not the next station any more.
Where that can have happened, and where enough landmarks are known to be certain, the artefact
decides which one the arm rests on.
"""

from __future__ import annotations

import numpy as np

from suta_calib.acquisition.averaging import Average
from suta_calib.acquisition.guided import ENTER
from suta_calib.acquisition.run import Run
from suta_calib.acquisition.seating_check import ANOTHER, BETTER, CERTAIN, likelier
from suta_calib.acquisition.stops import Complete, Ended, Event, Interrupted, Rejected, StopFinder
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import wrap


class Unattended:
    """Takes stops as they come; each is recorded for ``seconds``.

    With ``attended``, somebody holds the arm and may press keys: no rest counts before the arm was
    seen to move, as it may rest anywhere when the session begins.
    """

    def __init__(
        self, run: Run, finder: StopFinder, seconds: float, *, attended: bool = False
    ) -> None:
        self._run, self._finder, self._seconds = run, finder, seconds
        self._attended = self._unmoved = attended
        self._quit = False
        # What was asked for: the rest as it is now, or the last landmark once more.
        self._at_once = self._again = False
        self._short: Average | None = None
        self._doubt = run.last is not None
        # Rows of an earlier run have their labels for good.
        self._fresh = run.last is None
        self._said_still = False
        if run.plan.how:
            run.say(f"At every landmark: {run.plan.how}")
        if run.last is not None:
            self._left(run.last)

    @property
    def done(self) -> bool:
        """Whether every station has been visited, or the user has had enough."""
        return self._quit or self._run.done

    def press(self, key: str) -> None:
        """React to a key: Enter takes this rest, r the last landmark again, s skips, q quits."""
        run, finder = self._run, self._finder
        if self.done:
            return
        if key == "q":
            self._quit = True
        elif key == "s":
            run.say(f"{run.station.name} skipped")
            run.skip()
        elif key in ("r", "b"):
            run.back()
            # Seated anew before the key, or after it.
            self._again = True
            finder.restart()
            run.say(f"{run.station.name} is taken again: lift the tip and seat it once more")
        elif key == ENTER:
            self._at_once = True
            finder.restart()

    def handle(self, event: Event) -> None:
        """React to what the stream told."""
        if isinstance(event, Complete):
            self._complete(event.average)
        elif isinstance(event, Ended):
            self._ended(event)
        elif isinstance(event, Rejected):
            self._run.say(str(event))
        elif isinstance(event, Interrupted):
            self._doubt = True

    def finish(self) -> None:
        """Nothing more comes: a rest cut short that waits for its successor is one after all."""
        self._settle_short(None)
        run = self._run
        few = 0 < len(run.taken) < CERTAIN
        if few and self._fresh and run.seating is not None and not run.done:
            for place in run.taken:
                note = "too few landmarks to check whether one was missed: check its name"
                run.notes.setdefault(run.plan.stations[place].name, note)

    def _complete(self, average: Average) -> None:
        if not self._is_next(average):
            return
        self._settle_short(average)
        if self.done:
            return
        nowhere = 40e-3  # m; nobody seats so badly
        if self._is_seated_again(average):
            self._run.say(f"{self._run.plan.stations[self._run.index - 1].name} again")
            self._run.back()
            self._again = True
        elif not self._at_once and self._sure() and self._farthest_off(average) > nowhere:
            self._doubt = True
            self._run.say(
                "the arm rested where none of the remaining landmarks can be (next: "
                f"{self._run.station.name}): treated as a pause on the way"
            )
            self._left(average.angles)
            return
        self._confirm(average)

    def _is_next(self, average: Average) -> bool:
        """Whether the arm has been elsewhere since the last station, and is elsewhere now."""
        last = self._run.last
        if self._at_once:
            return True
        if self._unmoved and average.way is None:
            return False
        if last is None:
            return True
        moved = max(self._finder.excursion, _away(average.angles, last))
        if moved < self._finder.settings.motion:
            return False
        seating, stations = self._run.seating, self._run.plan.stations
        if seating is None or self._run.done or self._run.index == 0:
            return True
        repeated = stations[self._run.index - 1].labels == self._run.station.labels
        if self._again or repeated or not seating.same_place(average.angles, last):
            return True
        if self._is_seated_again(average):
            return True
        if not self._said_still:
            self._run.say(f"still on {stations[self._run.index - 1].name}: not counted again")
        self._said_still = True
        return False

    def _ended(self, event: Ended) -> None:
        """A rest too short: perhaps the next station, perhaps a pause on the way."""
        average = event.average
        if not self._is_next(average):
            return
        # A rest cut short counts if it lasted this part of what was asked for; the smaller part if
        # the stream left out some of it, or began during it.
        share = 0.05 if event.interrupted else 0.5
        if average.seconds < share * self._seconds or event.refusal:
            self._doubt = True
            if average.seconds > 0:
                self._run.say(str(event))
            return
        self._run.say(
            f"rejected: moved after {average.seconds:.1f} of {self._seconds:g} s ({event.what}); "
            "the part at rest is used if the arm does not come back"
        )
        self._settle_short(average)
        self._short = average

    def _settle_short(self, following: Average | None) -> None:
        """What to make of a rest cut short, once it is known where the arm rests next."""
        short, self._short = self._short, None
        if short is None or self.done:
            return
        seating = self._run.seating
        if following is not None:
            near = _away(short.angles, following.angles) < self._finder.settings.motion
            if near or (seating and seating.same_place(short.angles, following.angles)):
                self._run.say("the arm is back at the same place: recorded again as one rest")
                return
        # As many landmarks tell where the artefact stands.
        recognisable = seating is not None and len(seating.tips) >= 3
        if recognisable and self._farthest_off(short) > ANOTHER:
            self._doubt = True
            self._run.say(f"rested {short.seconds:.1f} s but not on a landmark: treated as a pause")
            return
        self._confirm(short, f"shortened: {short.seconds:.1f} of {self._seconds:g} s")

    def _is_seated_again(self, average: Average) -> bool:
        """Whether this is the last landmark once more, whose sample does not fit."""
        run, seating = self._run, self._run.seating
        if not self._attended or self._at_once or self._again or seating is None or not run.index:
            return False
        last = run.plan.stations[run.index - 1]
        if last.name not in run.notes:
            return False
        misfit = seating.misfit(last.labels["landmark"], average.angles)
        before = seating.tips[last.labels["landmark"]]
        better = BETTER * misfit < float(np.linalg.norm(seating.tip(average.angles) - before))
        return misfit < ANOTHER and better and BETTER * misfit < self._farthest_off(average)

    def _farthest_off(self, average: Average) -> float:
        """How far the tip is from where even the nearest of the landmarks left must be, m."""
        seating = self._run.seating
        if seating is None:
            return 0.0
        return min(seating.misfit(s.name, average.angles) for s in self._run.left)

    def _sure(self) -> bool:
        """Whether five landmarks that agree to 10 mm leave no doubt where the artefact stands."""
        seating = self._run.seating
        if seating is None or len(seating.tips) < 5:
            return False
        return seating.disagreement(list(seating.tips), list(seating.tips.values())) < 10e-3

    def _confirm(self, average: Average, note: str = "") -> None:
        run = self._run
        asked_for = self._at_once or self._again
        if run.seating is not None and not asked_for and (self._doubt or self._sure()):
            # A motion may have been missed: it goes on to the landmark the arm really rests on.
            left = [station.name for station in run.left]
            landmark, missed = run.seating.which(left[0], left, average.angles), list[str]()
            while run.station.name != landmark:
                missed.append(run.station.name)
                run.skip()
            if missed:
                run.say(f"missed {', '.join(missed)}: the distances show that this is {landmark}")
        self._doubt = self._unmoved = self._at_once = self._again = False
        run.confirm(average, note)
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
        if (true := likelier(seating, names, taken, tips)) is None:
            return
        missed = [names[k] for k in range(true[-1]) if k not in true]
        start = " at the start" if missed == names[: true[0]] else ""
        changed = [(a, b) for a, b in zip(taken, true, strict=True) if a != b]
        run.say(
            f"missed {', '.join(missed) or 'none'}{start}: the distances show that the samples "
            f"named {', '.join((names[a] for a, _ in changed))} are "
            f"{', '.join((names[b] for _, b in changed))}"
        )
        run.rename(true)

    def _left(self, angles: FloatArray) -> None:
        self._finder.measure_excursion_from(angles)
        self._said_still = False


def _away(angles: FloatArray, other: FloatArray) -> float:
    return float(np.max(np.abs(wrap(angles - other))))
