"""``suta-calib track``: the calibrated tip, live."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from suta_calib.cli._numbers import FiniteRange
from suta_calib.cli._output import check_folder, console, json_option, print_json
from suta_calib.cli._signals import ended_by_sigterm

if TYPE_CHECKING:
    from suta_calib.cli._track_view import TrackView
    from suta_calib.device import DeviceSpec, Statistics
    from suta_calib.model.arm import ArmModel
    from suta_calib.tracking.publisher import Publisher
    from suta_calib.tracking.session import TrackingSession
    from suta_calib.tracking.tracker import Tool
    from suta_calib.tracking.uncertainty import CalibrationUncertainty

NO_POSE: Final = 1
_PATH = click.Path(path_type=Path)
_ADDRESS: Final = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<host>[^\[\]]*)):(?P<port>\d+)")
_LARGEST_PORT: Final = 65535


def _address(host_needed: bool) -> Callable[..., tuple[str, int] | None]:
    """Reads ``HOST:PORT``, ``[IPv6]:PORT``, and ``PORT`` alone where a host is not needed."""

    def read(
        context: click.Context, parameter: click.Parameter, text: str | None
    ) -> tuple[str, int] | None:
        if text is None:
            return None
        match = _ADDRESS.fullmatch(f":{text}" if text.isdigit() else text)
        host = (match["six"] or match["host"]) if match else ""
        if match is None or int(match["port"]) > _LARGEST_PORT or (host_needed and not host):
            wanted = "HOST:PORT" if host_needed else "a port number, or HOST:PORT"
            raise click.BadParameter(
                f"found {text!r}; expected {wanted}, port up to {_LARGEST_PORT}", context, parameter
            )
        return host, int(match["port"])

    return read


@dataclass(frozen=True)
class _Wanted:
    """Where poses are to go."""

    igtl: tuple[str, int] | None
    igtl_name: str
    udp: tuple[str, int] | None
    csv: Path | None
    parquet: Path | None


@click.command()
@click.argument("arm", type=_PATH, metavar="ARM.urdf")
@click.option("--tip", required=True, help="Link or frame of the arm that is tracked.")
@click.option("--base", help="Link the pose is relative to; default: the root link.")
@click.option("--device", type=_PATH, required=True, help="device.yaml: port, format, joints.")
@click.option(
    "--result",
    type=_PATH,
    metavar="RESULT.json",
    help="Of the calibration that wrote ARM.urdf: for the tip's standard uncertainty.",
)
@click.option("--tool", type=_PATH, metavar="TIP.json", help="Pivot offset, as pivot --out writes.")
@click.option(
    "--igtl",
    callback=_address(host_needed=False),
    metavar="[HOST:]PORT",
    help="Serve OpenIGTLink TRANSFORM messages, mm, to any number of clients. [Slicer: 18944]",
)
@click.option("--igtl-name", default="TipToBase", show_default=True, help="Their device name.")
@click.option(
    "--udp",
    callback=_address(host_needed=True),
    metavar="HOST:PORT",
    help="Send JSON datagrams, m.",
)
@click.option("--csv", type=_PATH, metavar="FILE", help="Record every pose as CSV, m.")
@click.option("--parquet", type=_PATH, metavar="FILE", help="Record every pose as Parquet, m.")
@click.option("--seconds", type=FiniteRange(min=0, min_open=True), help="Stop after so long.")
@click.option("--stats", is_flag=True, help="Show the latency from frame arrival to publication.")
@click.option(
    "--rate",
    type=FiniteRange(min=0, min_open=True),
    metavar="HZ",
    help="Publish at most so many poses a second; default: one for every frame.",
)
@json_option
@click.pass_context
def track(
    context: click.Context,
    arm: Path,
    tip: str,
    base: str | None,
    device: Path,
    result: Path | None,
    tool: Path | None,
    igtl: tuple[str, int] | None,
    igtl_name: str,
    udp: tuple[str, int] | None,
    csv: Path | None,
    parquet: Path | None,
    seconds: float | None,
    stats: bool,
    rate: float | None,
    as_json: bool,
) -> None:
    """Track the tip of ARM.urdf (a calibrated one, for raw readings) until Ctrl-C or --seconds.

    A pose is not valid while an encoder of the arm raises its error flag: OpenIGTLink clients then
    get nothing, UDP datagrams say "valid": false and have no numbers, and rows of files have valid
    0 and no pose. A device that is unplugged or silent is waited for. Files are complete when the
    command ends; until then they are called FILE.part. With --json one object with counts, latency
    and the last pose is printed at the end, and nothing else. Exits with 1 where there was no
    valid pose.
    """
    from suta_calib.device import read_device
    from suta_calib.model.arm import ArmModel
    from suta_calib.tracking.tracker import TipKinematics, Tool, Tracker, read_tool
    from suta_calib.tracking.uncertainty import read_uncertainty

    model = ArmModel.from_urdf(arm, tip, base)
    spec = read_device(device)
    uncertainty = None if result is None else read_uncertainty(result, model)
    carried = Tool.none() if tool is None else read_tool(tool)
    tracker = Tracker(model, spec.names, TipKinematics(model, carried, uncertainty), device)
    wanted = _Wanted(igtl, igtl_name, udp, csv, parquet)
    with ExitStack() as stack:
        session = _session(tracker, wanted, rate, stack, model)
        statistics, view, interrupted = _run(session, spec, seconds, stats, quiet=as_json)
    about = _about(model, spec, carried, uncertainty)
    answer = about | _answer(session, statistics, view) | {"interrupted": interrupted}
    if as_json:
        print_json(answer)
    else:
        _print_end(session, statistics, uncertainty, stats=stats)
    if interrupted:
        raise KeyboardInterrupt
    if view.broken:
        raise BrokenPipeError
    if not session.valid:
        click.echo("suta-calib: no valid pose in all that time", err=True)
        context.exit(NO_POSE)


def _session(
    tracker: Any, wanted: _Wanted, rate: float | None, stack: ExitStack, model: ArmModel
) -> TrackingSession:
    from suta_calib.tracking.igtl import IgtlPublisher
    from suta_calib.tracking.publisher import UdpPublisher
    from suta_calib.tracking.recording import CsvRecorder, ParquetRecorder
    from suta_calib.tracking.session import TrackingSession

    publishers: list[Publisher] = []
    if wanted.igtl is not None:
        host, port = wanted.igtl
        publishers.append(stack.enter_context(IgtlPublisher(port, wanted.igtl_name, host)))
    if wanted.udp is not None:
        publishers.append(stack.enter_context(UdpPublisher(*wanted.udp)))
    for path, recorder in ((wanted.csv, CsvRecorder), (wanted.parquet, ParquetRecorder)):
        if path is not None:
            check_folder(path.parent)
            publishers.append(stack.enter_context(recorder(path, model.joints)))
    return TrackingSession(tracker, publishers, rate)


def _run(
    session: TrackingSession, spec: DeviceSpec, seconds: float | None, stats: bool, *, quiet: bool
) -> tuple[Statistics, TrackView, bool]:
    """Track; what the device did, what was said, and whether Ctrl-C ended it."""
    from suta_calib.cli._track_view import TrackView, track_line, track_table
    from suta_calib.device import Bus
    from suta_calib.tracking.session import Pace

    pace = Pace(lambda: session.latency.count)
    view = TrackView(
        lambda: track_table(session, bus.statistics, pace(), stats=stats),
        lambda: track_line(session, pace(), stats=stats),
        quiet=quiet,
    )
    bus = Bus(spec, reconnect=True, on_event=view.say)
    try:
        with ended_by_sigterm(), bus, view:
            session.run(bus, seconds, lambda: view.broken)
    except KeyboardInterrupt:
        return bus.statistics, view, True
    return bus.statistics, view, False


def _about(
    model: ArmModel, spec: DeviceSpec, tool: Tool, known: CalibrationUncertainty | None
) -> dict[str, Any]:
    from suta_calib.tracking.uncertainty import SOURCE_WORDS

    uncertainty = known and {
        "source": SOURCE_WORDS[known.source],
        "parameters": list(known.names),
        "held": list(known.held),
        "tool_included": tool.std is not None,
    }
    return {
        "arm": str(model.chain.path),
        "base": model.chain.base,
        "tip": model.tip,
        "device": str(spec.path),
        "tool_mm": [1e3 * float(v) for v in tool.tip],
        "uncertainty": uncertainty,
    }


def _answer(session: TrackingSession, device: Statistics, view: TrackView) -> dict[str, Any]:
    from suta_calib.tracking.publisher import pose_dict

    counts = {key: value for key, value in vars(device).items() if isinstance(value, int)}
    flags = {
        name: {"errors": int(errors), "warnings": int(warnings)}
        for name, errors, warnings in zip(
            device.joints, device.error_flags, device.warning_flags, strict=True
        )
    }
    last = session.last_valid
    return session.summary() | {
        "last": None if last is None else pose_dict(last),
        "stream": counts | {"flags": flags},
        "events": view.events,
    }


def _print_end(
    session: TrackingSession,
    device: Statistics,
    known: CalibrationUncertainty | None,
    *,
    stats: bool,
) -> None:
    from suta_calib.cli._track_view import track_table
    from suta_calib.tracking.uncertainty import SOURCE_WORDS

    to = console()
    to.print(track_table(session, device, session.summary()["rate_hz"], stats=stats))
    if known is not None:
        were = "was" if len(known.held) == 1 else "were"
        held = f"; relative to {', '.join(known.held)}, which {were} held" if known.held else ""
        to.print(f"± is from the {SOURCE_WORDS[known.source]}{held}.", soft_wrap=True)
    for publisher in session.publishers:
        path = getattr(publisher, "path", None)
        if path is not None and publisher.published:
            to.print(f"Written: {path}", soft_wrap=True)
