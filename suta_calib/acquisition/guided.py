"""Measuring with somebody at the keyboard: what each key does in each situation."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import tty
from typing import Any, Final, Protocol, Self

from suta_calib.acquisition.averaging import Average
from suta_calib.acquisition.run import Run
from suta_calib.acquisition.stops import Complete, Ended, Event, Interrupted, Rejected, StopFinder

ENTER: Final = "\n"
_WAITING: Final = "Enter records now, s skips, b goes back, q quits"
_ASKING: Final = "Enter keeps it, r records again, s skips, b goes back, q quits"


class Guided:
    """Asks for one station after the other, recorded for ``seconds``; what is confirmed counts."""

    def __init__(self, run: Run, finder: StopFinder, seconds: float) -> None:
        self._run, self._finder, self._seconds = run, finder, seconds
        self._sample: Average | None = None
        # The arm may rest anywhere when the command starts: the first rest is asked for.
        self._asked = self._quit = False
        if run.last is not None:
            finder.measure_excursion_from(run.last)
        self._next()

    @property
    def done(self) -> bool:
        """Whether every station has been visited, or the user has had enough."""
        return self._quit or self._run.done

    @property
    def asking(self) -> bool:
        """Whether a key is expected, rather than only possible."""
        return self._sample is not None or not self._asked

    def finish(self) -> None:
        """Nothing is pending: what was not confirmed does not count."""

    def handle(self, event: Event) -> None:
        """React to what the stream told."""
        if isinstance(event, Complete):
            moved = self._finder.excursion > self._finder.settings.motion
            if self._sample is None and (self._asked or moved):
                self._sample = event.average
                for line in [*self._run.described(event.average), _ASKING]:
                    self._run.say(line)
        elif isinstance(event, Rejected | Interrupted) or (
            isinstance(event, Ended) and self._sample is None and self._asked
        ):
            self._run.say(str(event))

    def press(self, key: str) -> None:
        """React to a key; others than those offered only show the offer again."""
        if self.done:
            return
        if key == "q":
            self._quit = True
        elif key in ("s", "b"):
            (self._run.skip if key == "s" else self._run.back)()
            self._next()
        elif key == "r" or (key == ENTER and self._sample is None):
            self._sample, self._asked = None, True
            self._finder.restart()
            self._run.say(
                f"recording {self._run.station.name} for {self._seconds:g} s as soon as the arm "
                "rests"
            )
        elif key == ENTER and self._sample is not None:
            self._run.confirm(self._sample, described=False)
            self._finder.measure_excursion_from(self._sample.angles)
            self._next()
        else:
            self._run.say(_WAITING if self._sample is None else _ASKING)

    def _next(self) -> None:
        self._sample, self._asked = None, False
        run = self._run
        if run.done:
            return
        place = f"{run.index + 1} of {len(run.plan.stations)}"
        how = f"{run.plan.how}; " if run.plan.how else ""
        start = "" if run.last is None else "when the arm moves there and rests, it is recorded; "
        run.say(f"Bring the tip to {run.station.name} ({place}): {how}{start}{_WAITING}")


class Keys(Protocol):
    """Where keys come from; a context manager.

    Attributes:
        terminal: whether somebody is there, who may press one at any time.
    """

    terminal: bool

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def key(self) -> str | None:
        """The next key that was pressed; None for none."""


class Keyboard:
    """Standard input, or another file descriptor, as a source of keys."""

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self.terminal = os.isatty(descriptor)  # whether somebody sits at it
        self._before: list[Any] | None = None
        self._line = b""
        self._ended = False

    def __enter__(self) -> Self:
        if self.terminal:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def key(self) -> str | None:
        """The next key that was pressed, in lower case, a line feed for Enter; None for none."""
        if self._ended:
            return "q"
        if b"\n" not in self._line:
            if not select.select([self._descriptor], [], [], 0)[0]:
                return None
            data = os.read(self._descriptor, 1 if self.terminal else 1024)
            self._ended = not data
            self._line += data + (b"\n" if self._ended and self._line else b"")
            if not (self.terminal or self._ended or b"\n" in self._line):
                return None
        if not self._line:
            return "q"
        if self.terminal:
            pressed, self._line = self._line, b""
        else:
            line, _, self._line = self._line.partition(b"\n")
            pressed = line.strip()[:1]
        letter = pressed.decode("utf-8", "replace").lower()
        return ENTER if letter in ("", "\n", "\r", " ") else letter
