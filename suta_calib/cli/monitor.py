"""``suta-calib monitor``: what a device sends, live."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click
from rich.console import Group
from rich.text import Text

from suta_calib.cli._options import PATH, POSITIVE, FiniteRange, json_option, option, urdf_option
from suta_calib.cli._output import LiveView, print_json
from suta_calib.device import Bus, DeviceSpec, Reading, read_device
from suta_calib.device.monitoring import LOSSES, Monitor, stream_report, watch
from suta_calib.device.reading import ERROR_MEANING, WARNING_MEANING
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.inputs import UrdfFile
from suta_calib.model.arm import ArmModel
from suta_calib.report.console import FittedTable
from suta_calib.report.listing import Column, Listing, Tone, shown_as
from suta_calib.tracking.tracker import matched_joints
from suta_calib.units import deg, mm

# With --json somebody waits for the answer.
_JSON_SECONDS: Final = 3.0


@click.command()
@option("--device", "The device.yaml.", PATH, required=True)
@urdf_option("Also show the tip pose of this arm.")
@option("--tip", "With --urdf: any link or frame of the arm.")
@option("--base", "With --urdf: link in which the poses are given; default: the root.")
@option(
    "--seconds",
    f"Stop after this time; default with --json: {_JSON_SECONDS:g}.",
    FiniteRange(min=0.1),
)
@option(
    "--silence S",
    "How long a device may send nothing before it is reported as silent; twice as long after the "
    "start.",
    POSITIVE,
    2.0,
)
@json_option
def monitor(
    device: Path,
    urdf: UrdfFile | None,
    tip: str | None,
    base: str | None,
    seconds: float | None,
    silence: float,
    as_json: bool,
) -> None:
    """Show what a device sends. Run this first if anything does not work.

    It shows each joint's angle, its noise over the last second and the flags of its encoder, other
    numbers that come with them (extra_columns), and the frame rate, damaged frames and lost frames.
    In a terminal the table is live; elsewhere one
    line is printed per second. It ends after --seconds or with Ctrl-C, and then shows the problems
    and what to do. If the port cannot be opened, sends nothing, or sends unreadable bytes, the
    command ends with an error message.
    """
    if (urdf is None) != (tip is None):
        raise click.UsageError("found one of --urdf and --tip; expected both or none")
    if base is not None and urdf is None:
        raise click.UsageError("found --base without --urdf; expected both or none")
    spec = read_device(device)
    shown_tip = None if urdf is None or tip is None else _Tip(urdf, tip, base, spec)
    if as_json and seconds is None:
        seconds = _JSON_SECONDS
    watched, view = Monitor(spec), _View(spec.port, shown_tip, quiet=as_json)
    bus = Bus(spec, reconnect=True, silence=silence, on_event=view.event)

    read_until = 0.0

    def report() -> dict[str, Any]:
        pose = None if shown_tip is None else shown_tip.pose(watched.last)
        return stream_report(watched, bus.statistics, spec, pose, read_until)

    def show(now: float) -> None:
        nonlocal read_until
        read_until = now
        if watched.last is not None:
            view.show(now, report)

    try:
        with view, bus:
            watch(bus, watched, seconds=seconds, show=show)
    finally:
        # However it ended: who pressed Ctrl-C wants to know what was seen until then.
        if watched.last is not None:
            if as_json:
                print_json(report() | {"events": view.events})
            else:
                view.conclude(report())


class _Tip:
    """The tip's pose of an arm, through its URDF as it stands."""

    def __init__(self, urdf: UrdfFile, tip: str, base: str | None, spec: DeviceSpec) -> None:
        self._arm = ArmModel.from_urdf(urdf, tip, base)
        self._columns = matched_joints(self._arm, spec.names, spec.path)
        self.frames = f"{self._arm.tip} in {self._arm.chain.base}"

    def pose(self, reading: Reading | None) -> dict[str, list[float]] | None:
        """Position in mm and roll, pitch, yaw in degrees at a reading; None before the first."""
        if reading is None:
            return None
        rotation, position = self._arm.forward(reading.angles[self._columns])
        return {
            "position_mm": mm(position).tolist(),
            "rotation_rpy_deg": deg(rpy_from_rotation(rotation)).tolist(),
        }


class _View(LiveView):
    """Shows the stream while it runs: a table in a terminal, elsewhere a line per second."""

    def __init__(self, port: str, tip: _Tip | None, quiet: bool) -> None:
        super().__init__(quiet=quiet, waiting=f"{port}: waiting for the first frames …")
        self._tip, self._next = tip, 0.0
        self.events: list[str] = []

    def event(self, sentence: str) -> None:
        """Something went wrong, and it went on."""
        self.events.append(sentence)
        if not self.quiet:
            self.to.print(sentence, style="yellow", soft_wrap=True)

    def show(self, now: float, report: Callable[[], dict[str, Any]]) -> None:
        """Draw, if it is time to."""
        if self.quiet:
            return
        if not self._next:  # a rate needs some time to be one
            self._next = now + 0.25
        if now < self._next:
            return
        self._next = now + (1.0 if self.live is None else 0.25)
        if self.live is None:
            self.to.print(_line(report()), soft_wrap=True)
        else:
            self.live.update(self._picture(report()), refresh=True)

    def conclude(self, data: dict[str, Any]) -> None:
        """What was seen in all, and what is wrong."""
        self.to.print(f"{data['frames']} frames; {_losses(data)}", soft_wrap=True)
        for remark in data["remarks"] or ["no problem was found"]:
            self.to.print(f"· {remark}", soft_wrap=True)

    def _picture(self, data: dict[str, Any]) -> Group:
        title = f"{data['port']} · {data['frame_rate_hz']:.1f} {data['format']}/s"
        if data["clock_ppm"] is not None:
            title += f" · device clock {data['clock_ppm']:+.0f} ppm"
        table = FittedTable(JOINTS.of(data["joints"].items(), title))
        lines = [Text(f"· {remark}", style="yellow") for remark in data["remarks"]]
        lines = [*([Text(extra)] if (extra := _extra(data)) else []), *lines]
        if self._tip is not None and data["tip"] is not None:
            where, turn = (_vector(data["tip"][key]) for key in ("position_mm", "rotation_rpy_deg"))
            lines = [Text(f"{self._tip.frames}: {where} mm, roll pitch yaw {turn}°"), *lines]
        return Group(table, Text(_losses(data), overflow="ignore"), *lines)


def _flag(joint: dict[str, Any]) -> tuple[str, Tone | None]:
    if joint["error"]:
        return ERROR_MEANING, "bad"
    return (WARNING_MEANING, "care") if joint["warning"] else ("good", None)


JOINTS: Final = Listing[tuple[str, dict[str, Any]]](
    "",
    Column("", "joint", lambda row: row[0]),
    shown_as("angle, °", lambda row: _number(row[1]["angle_deg"], 4)),
    shown_as("noise, °", lambda row: _number(row[1]["noise_deg"], 5)),
    Column("", "flags", lambda row: _flag(row[1])[0], tone=lambda row: _flag(row[1])[1]),
)


def _line(data: dict[str, Any]) -> str:
    angles = "  ".join(
        f"{name} {_number(joint['angle_deg'], 3)}°"
        + (" ERROR" if joint["error"] else " warning" if joint["warning"] else "")
        for name, joint in data["joints"].items()
    )
    bad = _losses({key: number for key, number in data.items() if number})
    tip = "" if data["tip"] is None else f"  tip {_vector(data['tip']['position_mm'])} mm"
    shown = "  ".join(filter(None, (angles, _extra(data))))
    return f"{data['frame_rate_hz']:.1f} {data['format']}/s  {shown}{tip}  {bad}".rstrip()


def _extra(data: dict[str, Any]) -> str:
    """What was sent last beside the joints."""
    return "  ".join(f"{name} {_number(value, 4)}" for name, value in data["extra"].items())


def _losses(data: dict[str, Any]) -> str:
    """What was damaged or lost, as far as it was counted."""
    counts = {name: data[key] for key, name in LOSSES.items() if key in data}
    return ", ".join(
        f"{n} {name.removesuffix('s') if n == 1 else name}" for name, n in counts.items()
    )


def _vector(values: list[float]) -> str:
    return " ".join(_number(value, 2) for value in values)


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
