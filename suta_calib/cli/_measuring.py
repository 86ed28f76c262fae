"""One call of ``suta-calib measure``, from opening the port to the summary."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np

from suta_calib.acquisition.continuous import Continuous
from suta_calib.acquisition.guided import Guided, Keyboard
from suta_calib.acquisition.raw import RawRecorder
from suta_calib.acquisition.run import Run
from suta_calib.acquisition.samples_file import SamplesFile
from suta_calib.acquisition.session import (
    ArmReadings,
    Finder,
    Happenings,
    Taker,
    run_session,
    told,
)
from suta_calib.acquisition.stops import StopFinder
from suta_calib.acquisition.touch_sequence import TouchSequence
from suta_calib.acquisition.unattended import Unattended
from suta_calib.cli._output import console
from suta_calib.cli.measure import INTERRUPTED, PATIENCE_S, MeasureOptions

if TYPE_CHECKING:
    from rich.status import Status

    from suta_calib.device.description import DeviceSpec
    from suta_calib.device.read_ahead import ReadAhead


class Measuring:
    """Everything one call needs, put together.

    Args:
        options: of the command line.
        plan: what to measure.
        spec: the device.
        source: its readings.
        choose: picks the arm's joints.
        file: where confirmed samples go.
    """

    def __init__(
        self,
        options: MeasureOptions,
        plan: TouchSequence,
        spec: DeviceSpec,
        source: ReadAhead,
        choose: ArmReadings,
        file: SamplesFile,
    ) -> None:
        self._options, self._plan, self._spec = options, plan, spec
        self._source, self._choose, self._file = source, choose, file
        source.on_event = self._note
        self._console = console(stderr=options.as_json)
        self._status: Status | None = None
        self._happenings = Happenings()
        self._lines: list[str] = []
        self._run: Run | None = None
        self._finder: Finder | None = None

    def run(self) -> dict[str, Any]:
        """Measure; what was measured and what happened.

        Raises:
            SutaCalibError: bad input, a device that does not answer, a disk that is full.
        """
        taker, finder = self._taker()
        self._finder = finder
        finished = taker.done
        if finished:
            self.say(f"nothing left to measure: {self._file.path} has every station")
            return self._summary("complete")
        try:
            finished = self._measure(taker, finder)
        except KeyboardInterrupt:
            return self._summary(INTERRUPTED)
        return self._summary("complete" if finished else "incomplete")

    def say(self, line: str) -> None:
        """Show a line, now: through a pipe, what is confirmed must not wait in a buffer."""
        self._console.print(line, soft_wrap=True)
        (sys.stderr if self._options.as_json else sys.stdout).flush()

    def _note(self, message: str) -> None:
        self._happenings.messages.append(message)
        # A clock that was set anew hides how long the stream was cut.
        if isinstance(self._finder, StopFinder):
            self._finder.interrupt()
        self.say(message)

    def _taker(self) -> tuple[Taker, Finder]:
        options = self._options
        if options.continuous is not None:
            both = Continuous(self._plan, self._file, self.say, options.continuous, options.every)
            return both, both
        even = self._spec.format == "lines"
        joints, rest = self._plan.arm.joints, options.rest
        finder = StopFinder(joints, options.seconds, rest, even=even)
        self._run = Run(self._plan, self._file, self.say)
        kind = Unattended if options.yes else Guided
        return kind(self._run, finder, options.seconds), finder

    def _measure(self, taker: Taker, finder: Finder) -> bool:
        joints = [joint.name for joint in self._spec.joints]
        with ExitStack() as stack:
            raw = self._options.raw
            record = (
                None if raw is None else stack.enter_context(RawRecorder(raw, joints, self.say))
            )
            idle = self._idle(stack, taker, finder)
            try:
                return run_session(
                    self._source,
                    self._choose,
                    finder,
                    taker,
                    happenings=self._happenings,
                    idle=idle,
                    record=(lambda _: None) if record is None else record.write,
                    patience=self._patience,
                )
            finally:
                self._close()

    def _close(self) -> None:
        """Also after Ctrl-C or a lost device: say what there is."""
        if self._status is not None:
            self._status.stop()
        if not self._happenings.readings:
            return
        self._lines = told(self._happenings, self._source.statistics, self._spec)
        count = len(self._file.rows)
        recorded = f"{count} sample{'s' * (count != 1)} in {self._file.path}"
        self.say(recorded if count else "no samples recorded")
        if not count and isinstance(self._finder, StopFinder) and self._finder.restless:
            rest = self._options.rest
            drift, tremble = np.degrees(rest.drift), np.degrees(rest.tremble)
            self.say(
                f"the arm was not seen at rest: within {rest.window:g} s, "
                f"{', '.join(self._finder.restless)} drifted by more than {drift:.2g} deg or "
                f"trembled by more than {tremble:.2g} deg; seat it firmly and let go, or allow "
                "more with --drift-deg or --tremble-deg"
            )
        if count and self._run is not None and not self._run.done:
            self.say("the same command with --resume goes on after the last one")
        for line in self._lines:
            self.say(line)

    @property
    def _patience(self) -> float:
        if self._options.patience is not None:
            return self._options.patience
        return PATIENCE_S if self._options.yes else math.inf

    def _idle(self, stack: ExitStack, taker: Taker, finder: Finder) -> Callable[[], None]:
        """What is done between two reads: keys, and the line that says what the arm does."""
        keyboard = stack.enter_context(Keyboard()) if isinstance(taker, Guided) else None
        if self._console.is_terminal and isinstance(finder, StopFinder):
            self._status = stack.enter_context(self._console.status("waiting for readings"))

        def idle() -> None:
            if keyboard is not None and isinstance(taker, Guided):
                wanted = keyboard.terminal or taker.asking
                key = keyboard.key() if wanted else None
                if key is not None:
                    taker.press(key)
            if self._status is not None and isinstance(finder, StopFinder):
                waiting = isinstance(taker, Guided) and taker.asking
                self._status.update(self._doing(finder, waiting=waiting))

        return idle

    def _doing(self, finder: StopFinder, *, waiting: bool) -> str:
        name = "" if self._run is None or self._run.done else f" · next: {self._run.station.name}"
        if not finder.resting:
            return f"moving{name}"
        if waiting:
            return f"resting, waiting for a key{name}"
        return f"resting {finder.recorded:.1f} of {self._options.seconds:g} s{name}"

    def _how_to_go_on(self, run: Run) -> str:
        if not run.done:
            return "they can still be measured"
        if run.seating is None:
            return "--resume takes more"
        return f"--resume --sequence {','.join(run.missing)} measures them"

    def _summary(self, status: str) -> dict[str, Any]:
        run = self._run
        found: dict[str, Any] = {
            "status": status,
            "file": str(self._file.path),
            "samples": len(self._file.rows),
            "happened": self._lines,
        }
        if run is not None:
            found |= {"missing": list(run.missing), "look_at": run.notes}
            if run.missing:
                self.say(f"missing: {', '.join(run.missing)}; {self._how_to_go_on(run)}")
            for name, note in run.notes.items():
                self.say(f"look at {name}: {note}")
        return found
