"""What ``suta-calib track`` shows while it runs: a live table, or a line a second."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Self

import click

from suta_calib.cli._output import console

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live
    from rich.table import Table

    from suta_calib.device import Statistics
    from suta_calib.tracking.session import TrackingSession

_LIVE_S: Final = 0.25
_LINE_S: Final = 1.0
# A pose older than this is not where the arm is.
_STALE_S: Final = 0.5


class TrackView:
    """Shows a session from a thread of its own; a context manager.

    On a terminal the table renews itself; elsewhere there is one plain line a second; with
    ``quiet`` nothing. Events are lines on stderr.

    Args:
        session: what is shown.
        table: makes the table.
        line: makes the line.
        quiet: show nothing but events.

    Attributes:
        events: everything that was said, in order.
        broken: whether nobody reads what is shown any more.
    """

    def __init__(
        self,
        table: Callable[[], RenderableType],
        line: Callable[[], str],
        *,
        quiet: bool,
    ) -> None:
        self._table, self._line, self._quiet = table, line, quiet
        self._to = console()
        self._live: Live | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._show, name="view", daemon=True)
        self.events: list[str] = []
        self.broken = False

    def say(self, event: str) -> None:
        """An event: above the table, or on stderr."""
        self.events.append(event)
        if self._live is not None:
            self._live.console.print(event, soft_wrap=True)
        else:
            click.echo(f"suta-calib: {event}", err=True)

    def __enter__(self) -> Self:
        if not self._quiet and self._to.is_terminal:
            from rich.live import Live

            self._live = Live(console=self._to, auto_refresh=False, transient=True)
            self._live.start()
        if not self._quiet:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _show(self) -> None:
        while not self._over.wait(_LINE_S if self._live is None else _LIVE_S):
            try:
                if self._live is None:
                    click.echo(self._line())
                else:
                    self._live.update(self._table(), refresh=True)
            except OSError:
                self.broken = True
                return


def track_line(session: TrackingSession, rate: float, *, stats: bool) -> str:
    """One line: where the tip is, how sure that is, how many poses a second."""
    pose = session.last
    if pose is None:
        return "no reading yet"
    if stale := _stale(session):
        return stale
    if not pose.valid:
        return f"not valid: error flag of {', '.join(pose.errors)}   {rate:.0f} Hz"
    text = "tip {:9.3f} {:9.3f} {:9.3f} mm".format(*(1e3 * pose.position))
    if pose.std is not None:
        text += " ± {:.3f} {:.3f} {:.3f}".format(*(1e3 * pose.std))
    text += f"   {rate:.0f} Hz"
    if pose.warnings:
        text += f"   warning of {', '.join(pose.warnings)}"
    if stats:
        latency = session.latency.summary()
        text += f"   latency p50 {latency['p50_ms']:.3f} p99 {latency['p99_ms']:.3f} ms"
    return text


def track_table(
    session: TrackingSession, statistics: Statistics, rate: float, *, stats: bool
) -> RenderableType:
    """The pose, what publishers did, what the device lost."""
    from rich.console import Group

    parts: list[RenderableType] = [_pose_table(session), *_counts(session, statistics, rate)]
    if stats:
        parts.append(latency_table(session))
    return Group(*parts)


def latency_table(session: TrackingSession) -> RenderableType:
    """Percentiles of latency, and of the interval between frames."""
    table = _table("From the frame's arrival to publication, ms")
    for name in ("", "p50", "p95", "p99", "max", "mean", "jitter"):
        table.add_column(name, justify="right" if name else "left")
    for name, each in (("latency", session.latency), ("interval", session.interval)):
        figures = each.summary()
        keys = ("p50", "p95", "p99", "max", "mean", "jitter")
        table.add_row(name, *(f"{figures[f'{key}_ms']:.3f}" for key in keys))
    return table


def _pose_table(session: TrackingSession) -> RenderableType:
    from rich.text import Text

    from suta_calib.geometry.numbers import rpy_from_rotation
    from suta_calib.units import SHOWN

    pose = session.last
    if pose is None:
        return Text("no reading yet", style="yellow")
    if not pose.valid:
        return Text(f"NOT VALID: error flag of {', '.join(pose.errors)}", style="bold red")
    stale = _stale(session)
    table = _table(f"Tip in the base{f': {stale.upper()}' if stale else ''}")
    for name in ("", "x", "y", "z"):
        table.add_column(name, justify="right" if name else "left", min_width=10 if name else 0)
    table.add_row("position, mm", *(f"{1e3 * v:.3f}" for v in pose.position), style="bold")
    if pose.std is not None:
        table.add_row("± std, mm", *(f"{1e3 * v:.3f}" for v in pose.std))
    angles = SHOWN["rad"].per_si * rpy_from_rotation(pose.rotation)
    table.add_row("roll pitch yaw, deg", *(f"{v:.3f}" for v in angles))
    return table


def _stale(session: TrackingSession) -> str:
    """What to say of a pose that is old, empty for a fresh one."""
    now = time.perf_counter() if session.running else session.ended
    age = 0.0 if session.last is None else now - session.last.arrival
    return f"no reading for {age:.1f} s" if age > _STALE_S else ""


def _counts(session: TrackingSession, device: Statistics, rate: float) -> list[RenderableType]:
    from rich.text import Text

    lost = f"{device.lost_frames} lost, {device.frame_crc_errors} damaged frames"
    lost += f", {device.word_crc_errors} damaged words"
    lines = [f"{rate:.0f} poses a second, {session.valid} valid, {session.invalid} not; {lost}"]
    pose = session.last
    if pose is not None and pose.warnings:
        lines.append(f"warning flag of {', '.join(pose.warnings)}")
    for publisher in session.publishers:
        counts = ", ".join(f"{name} {value}" for name, value in publisher.statistics().items())
        lines.append(f"{publisher.name}: {counts}")
    return [Text(line) for line in lines]


def _table(title: str) -> Table:
    from rich import box
    from rich.table import Table

    return Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
