"""``suta-calib track``: the calibrated tip, live."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, Self

import click
from rich.console import Group
from rich.text import Text

from suta_calib.cli._options import (
    PATH,
    POSITIVE,
    anyway_option,
    chain_option,
    flag,
    json_option,
    option,
    urdf_argument,
)
from suta_calib.cli._output import LiveView, console, print_json, printing
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.report.console import FittedTable, Wrapped
from suta_calib.report.listing import Table
from suta_calib.tracking.live import Tracking, TrackOptions
from suta_calib.tracking.session import Pace
from suta_calib.tracking.uncertainty import SOURCE_WORDS
from suta_calib.units import FARTHEST, deg, from_mm, mm
from suta_calib.words import listed

if TYPE_CHECKING:
    from rich.console import RenderableType

    from suta_calib.tracking.live import Tracking
    from suta_calib.tracking.session import TrackingSession

_ADDRESS: Final = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<host>[^\[\]]*)):(?P<port>\d+)")


def _address(host_needed: bool) -> Callable[..., tuple[str, int] | None]:
    """Reads ``HOST:PORT``, ``[IPv6]:PORT``, and ``PORT`` alone where a host is not needed."""
    largest_port = 65535

    def read(
        context: click.Context, parameter: click.Parameter, text: str | None
    ) -> tuple[str, int] | None:
        if text is None:
            return None
        match = _ADDRESS.fullmatch(f":{text}" if text.isdigit() else text)
        host = (match["six"] or match["host"]) if match else ""
        if match is None or int(match["port"]) > largest_port or (host_needed and not host):
            form = "HOST:PORT" if host_needed else "a port number, or HOST:PORT"
            raise click.BadParameter(
                f"found {text!r}; expected {form}, port up to {largest_port}", context, parameter
            )
        return host, int(match["port"])

    return read


def _payload(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, ...] | None:
    """Reads ``KG`` and ``KG,X,Y,Z``: kg, m."""
    if text is None:
        return None
    try:
        kg, *place = map(float, text.split(","))
    except ValueError:
        kg, place = math.nan, []
    if not (math.isfinite(kg) and kg >= 0.0 and len(place) in (0, 3)):
        expected = "kg, or kg,x,y,z with the centre of mass in mm"
        raise click.BadParameter(f"found {text!r}; expected {expected}", context, parameter)
    x, y, z = (from_mm(value) for value in place or (0.0, 0.0, 0.0))
    if not all(abs(value) <= FARTHEST for value in (x, y, z)):
        expected = f"a place within {FARTHEST:g} m"
        raise click.BadParameter(f"found {text!r}; expected {expected}", context, parameter)
    return kg, x, y, z


@click.command()
@urdf_argument("ARM.urdf", "arm")
@option("--tip", "Link or frame of the arm that is tracked; default: that of the job of --result.")
@chain_option
@option("--base", "Link in which the pose is given; default: the root link.")
@option("--device", "device.yaml: port, format, joints.", PATH, required=True)
@option(
    "--result RESULT.json",
    "Result of the calibration that wrote ARM.urdf, for the standard uncertainty of the tip.",
    PATH,
)
@anyway_option
@option(
    "--payload KG[,X,Y,Z]",
    "What the tip carries, kg, and its centre of mass in the frame of the tip, mm, for an arm with "
    "compliances in --result; default: what its samples state, if they all state the same.",
    callback=_payload,
)
@option(
    "--recalibrate POINTS.yaml",
    "File of points that do not move. Each rest on one of them shows how the encoders' zeros drift "
    "(needs --result). Poses stay those of the calibration; what the touches would add stands "
    "beside them.",
    PATH,
)
@option("--tool TIP.json", "Offset of the tip, as pivot --out writes it.", PATH)
@option(
    "--igtl [HOST:]PORT",
    "Send OpenIGTLink TRANSFORM messages in mm to any number of clients; with --result also "
    "SENSOR messages NAMEStd with the standard deviations of x y z (mm) and of the rotations "
    "(degrees). [Slicer: 18944]",
    callback=_address(host_needed=False),
)
@option(
    "--host ADDRESS",
    "Address for --igtl; default: only this computer can read; with 0.0.0.0 everybody in the "
    "network can.",
    default="127.0.0.1",
)
@option("--igtl-name", "Device name in the OpenIGTLink messages.", default="TipToBase")
@option(
    "--udp HOST:PORT", "Send JSON datagrams, lengths in m.", callback=_address(host_needed=True)
)
@option("--csv FILE", "Record every pose as CSV, m.", PATH)
@option("--parquet FILE", "Record every pose as Parquet, m.", PATH)
@flag("--force", "Replace existing recordings of the same name.")
@option("--seconds", "Stop this long after the first reading, in s.", POSITIVE)
@flag("--stats", "Show the latency from frame arrival to publication.")
@option("--rate HZ", "Largest number of poses per second; default: one for every frame.", POSITIVE)
@json_option
@click.pass_context
def track(context: click.Context, /, **options: Any) -> None:
    """Track the tip of ARM.urdf (a calibrated one, for raw readings) until Ctrl-C or --seconds.

    A pose is not valid while an encoder of the arm sets its error flag: OpenIGTLink clients then
    receive nothing, UDP datagrams contain "valid": false and no numbers, and rows of files have
    valid 0 and no pose. If the device is unplugged or silent, the command waits for it. Files are
    complete when the command ends; until then they are called FILE.part, and without --force they
    do not replace existing ones. With --json only one object with counts, latency and the last pose
    is printed at the end. The exit code is 1 if there was no valid pose.
    """
    stats, as_json = options.pop("stats"), options.pop("as_json")
    tracking = Tracking(TrackOptions(**options))
    view = TrackView(tracking, stats=stats, quiet=as_json)
    tracking.on_event = view.say
    with tracking:
        tracking.run(view, lambda: view.broken)
    with printing():
        if as_json:
            print_json(tracking.as_dict())
        else:
            _print_end(tracking, stats=stats)
    if tracking.interrupted:
        raise KeyboardInterrupt
    if not tracking.session.valid:
        click.echo("suta-calib: no valid pose during all this time", err=True)
        context.exit(1)


def _print_end(tracking: Tracking, *, stats: bool) -> None:
    to, session, calibration = console(), tracking.session, tracking.uncertainty
    to.print(_table(tracking, session.summary()["rate_hz"], stats=stats))
    if calibration is not None:
        are = "is" if len(calibration.fixed) == 1 else "are"
        fixed = (
            f"; valid only while the held {', '.join(calibration.fixed)} {are} correct"
            if calibration.fixed
            else ""
        )
        counted = listed(calibration.counted)
        held = f", and from the assumed error of {counted}, held at nominal" if counted else ""
        to.print(f"± is from the {SOURCE_WORDS[calibration.source]}{held}{fixed}.", soft_wrap=True)
    for note in tracking.notes:
        to.print(note, soft_wrap=True)
    if (live := tracking.recalibration) is not None:
        drifts = (f"{j} {deg(v):+.3f} ± {deg(s):.3f}" for j, (v, s) in live.zeros.items())
        touches = f"{len(live.touches)} touch{'es' * (len(live.touches) != 1)}"
        to.print(f"Drift of the zeros by {touches}, deg: {', '.join(drifts)}", soft_wrap=True)
    for publisher in session.publishers:
        path = getattr(publisher, "path", None)
        if path is not None and publisher.published:
            to.print(f"Written: {path}", soft_wrap=True)


class TrackView(LiveView):
    """Shows a session from a thread of its own, with latency if asked; events are lines on stderr.

    Attributes:
        broken: whether nobody reads what is shown any more.
    """

    def __init__(self, tracking: Tracking, *, stats: bool, quiet: bool) -> None:
        super().__init__(quiet=quiet, transient=True)
        self._tracking, self._stats = tracking, stats
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._show, name="view", daemon=True)
        self.broken = False

    def say(self, event: str) -> None:
        """An event: above the table, or on stderr."""
        if self.live is not None:
            self.live.console.print(event, soft_wrap=True)
        else:
            click.echo(f"suta-calib: {event}", err=True)

    def __enter__(self) -> Self:
        super().__enter__()
        if not self.quiet:
            self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        super().__exit__(*error)

    def _show(self) -> None:
        session = self._tracking.session
        pace = Pace(lambda: session.latency.count)
        while not self._over.wait(1.0 if self.live is None else 0.25):
            try:
                if self.live is None:
                    click.echo(_line(session, pace(), stats=self._stats))
                else:
                    table = _table(self._tracking, pace(), stats=self._stats)
                    self.live.update(table, refresh=True)
            except OSError:
                self.broken = True
                return


def _line(session: TrackingSession, rate: float, *, stats: bool) -> str:
    """One line: where the tip is, how sure that is, how many poses a second."""
    pose = session.last
    if pose is None:
        return "no reading yet"
    if stale := _stale(session):
        return stale
    if not pose.valid:
        return f"not valid: error flag of {', '.join(pose.errors)}   {rate:.0f} Hz"
    line = "tip {:9.3f} {:9.3f} {:9.3f} mm".format(*mm(pose.position))
    if pose.std is not None:
        line += " ± {:.3f} {:.3f} {:.3f}".format(*mm(pose.std))
    line += f"   {rate:.0f} Hz"
    if pose.warnings:
        line += f"   warning of {', '.join(pose.warnings)}"
    if stats:
        latency = session.latency.summary()
        line += f"   latency p50 {latency['p50_ms']:.3f} p99 {latency['p99_ms']:.3f} ms"
    return line


def _table(tracking: Tracking, rate: float, *, stats: bool) -> RenderableType:
    """The pose, what the device lost, what publishers did, percentiles of latency."""
    session, device = tracking.session, tracking.statistics
    lost = f"{device.lost_frames} frames lost, {device.frame_crc_errors} damaged"
    lost += f", {device.word_crc_errors} damaged words"
    lines = [
        f"{rate:.0f} poses per second, {session.valid} valid, {session.invalid} invalid; {lost}"
    ]
    if session.last is not None and session.last.warnings:
        lines.append(f"warning flag of {', '.join(session.last.warnings)}")
    for publisher in session.publishers:
        counts = ", ".join(f"{name} {value}" for name, value in publisher.statistics().items())
        lines.append(f"{publisher.name}: {counts}")
    parts: list[RenderableType] = [_pose_table(session), Wrapped("\n".join(lines))]
    if stats:
        keys = ("p50", "p95", "p99", "max", "mean", "jitter")
        title, rows = "From the frame's arrival to publication, ms", []
        for name, statistics in (("latency", session.latency), ("interval", session.interval)):
            figures = statistics.summary()
            rows.append((name, *(f"{figures[f'{key}_ms']:.3f}" for key in keys)))
        parts.append(_numbers(title, keys, rows))
    return Group(*parts)


def _pose_table(session: TrackingSession) -> RenderableType:
    pose = session.last
    if pose is None:
        return Text("no reading yet", style="yellow")
    if not pose.valid:
        return Text(f"NOT VALID: error flag of {', '.join(pose.errors)}", style="bold red")
    stale = _stale(session)
    values_by_name = {"position, mm": mm(pose.position)}
    if pose.std is not None:
        values_by_name["± std, mm"] = mm(pose.std)
    values_by_name["roll pitch yaw, deg"] = deg(rpy_from_rotation(pose.rotation))
    rows = [(name, *(f"{v:10.3f}" for v in values)) for name, values in values_by_name.items()]
    return _numbers(f"Tip in the base{f': {stale.upper()}' if stale else ''}", "xyz", rows)


def _stale(session: TrackingSession) -> str:
    """What to say of a pose that is old, empty for a fresh one."""
    now = time.perf_counter() if session.running else session.ended
    age = 0.0 if session.last is None else now - session.last.arrival
    # By then it is not where the arm is.
    return f"no reading for {age:.1f} s" if age > 0.5 else ""


def _numbers(title: str, heads: Sequence[str], rows: list[tuple[str, ...]]) -> RenderableType:
    """A table of numbers, each row with a name."""
    columns = ["", *heads]
    untoned = [[None] * len(columns)] * len(rows)
    return FittedTable(
        Table(title, "", columns, frozenset(range(1, len(columns))), rows, untoned, list)
    )
