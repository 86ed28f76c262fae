"""How many robots are followed, as it is seen: one line for each, what needs attention first."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from textwrap import shorten
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.text import Text

from suta_calib.cli._output import LiveView, printing
from suta_calib.report.console import FittedTable
from suta_calib.report.listing import Column, Listing, Tone

if TYPE_CHECKING:
    from suta_calib.fleet.following import FollowedRobot, State

# What needs attention first.
_ORDER: Final[tuple[State, ...]] = ("failed", "changed", "held", "sound", "waiting", "reading")
_TONES: Final[dict[State, Tone]] = {"failed": "bad", "changed": "bad", "held": "care"}
_WORDS: Final[dict[State, str]] = {
    "reading": "starting",
    "waiting": "no row yet",
    "sound": "nothing changed",
    "held": "last row far off",
    "changed": "changed",
    "failed": "stopped",
}
# Seconds between two pictures of a table, and between two lines where there is no terminal.
_PICTURES: Final = 0.5
_LINES: Final = 10.0, 60.0
# Letters of a note: the summary has all of them.
_NOTE: Final = 60


def _evidence(robot: FollowedRobot) -> str:
    return f"{robot.evidence:.2g} of {robot.limit:.3g}" if robot.limit else ""


ROBOTS: Final = Listing["FollowedRobot"](
    "",
    Column("name", "robot"),
    Column(
        "state", "state", cell=lambda r: _WORDS[r.state], tone=lambda r: _TONES.get(r.state, "soft")
    ),
    Column("rows", "rows", form="d"),
    Column("behind", "behind", form="d", optional=True),
    Column("evidence", "evidence", cell=_evidence, numeric=True),
    Column("note", "", cell=lambda r: shorten(r.note, _NOTE, placeholder=" …"), optional=True),
)


class FollowView(LiveView):
    """On a terminal a table that renews itself; elsewhere a line for what happens to a robot."""

    def __init__(self, *, quiet: bool) -> None:
        super().__init__(quiet=quiet, transient=True)
        self._known: dict[str, State] = {}
        self._next, self._wait = time.monotonic() + _LINES[0], _LINES[0]

    def show(self, robots: Sequence[FollowedRobot]) -> None:
        """Draw, if it is time to."""
        if self.quiet:
            return
        with printing():
            if self.live is None:
                self._lines(robots)
            elif time.monotonic() >= self._next or not self._known:
                self._next = time.monotonic() + _PICTURES
                self._known = {robot.name: robot.state for robot in robots}
                self.live.update(self._picture(robots), refresh=True)

    def say(self, line: str) -> None:
        """A line, above the table if there is one."""
        if not self.quiet:
            with printing():
                self.to.print(line, soft_wrap=True)

    def _lines(self, robots: Sequence[FollowedRobot]) -> None:
        for robot in robots:
            before = self._known.get(robot.name)
            # Of a change its note comes with the next look.
            told = robot.state == "failed" or (robot.state == "changed" and robot.note)
            if told and before != robot.state:
                self._known[robot.name] = robot.state
                what = f"{robot.name}: {_WORDS[robot.state]} after {robot.rows} rows"
                self.to.print(f"{what}: {robot.note}", soft_wrap=True)
        if time.monotonic() >= self._next:
            self._wait = min(2.0 * self._wait, _LINES[1])
            self._next = time.monotonic() + self._wait
            self.to.print(_counts(robots), soft_wrap=True)

    def _picture(self, robots: Sequence[FollowedRobot]) -> Group:
        room = max(self.to.height - 7, 3)
        order = sorted(robots, key=lambda r: (_ORDER.index(r.state), -r.evidence))
        table = FittedTable(ROBOTS.of(order[:room]))
        rest = len(robots) - room
        more = [Text(f"and {rest:,} more")] if rest > 0 else []
        return Group(table, *more, Text(_counts(robots)), Text("Ctrl-C ends it with a summary"))


def _counts(robots: Sequence[FollowedRobot]) -> str:
    """``20 robots: 18 nothing changed, 1 changed, 1 no row yet; 2,340 rows``."""
    found = Counter(robot.state for robot in robots)
    counts = ", ".join(f"{found[s]:,} {_WORDS[s]}" for s in _ORDER if found[s])
    behind = sum(robot.behind for robot in robots)
    lag = f", {behind:,} more wait to be looked at" if behind else ""
    rows = sum(robot.rows for robot in robots)
    return f"{len(robots):,} robots: {counts}; {rows:,} rows{lag}"
