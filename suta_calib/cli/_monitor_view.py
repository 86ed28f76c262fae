"""What ``suta-calib monitor`` shows: a live table, plain lines, or one object at the end."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from suta_calib.cli._output import console
from suta_calib.device.diagnosis import remarks
from suta_calib.device.reading import ERROR_MEANING, WARNING_MEANING
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.tracker import matched_joints

if TYPE_CHECKING:
    from suta_calib.arrays import FloatArray
    from suta_calib.device import DeviceSpec, Statistics
    from suta_calib.device.monitoring import Monitor

_LIVE_S: Final = 0.25
_LINE_S: Final = 1.0
# A pause at the end that is no chance, s.
SILENT_S: Final = 1.0
_COUNTS: Final = {
    "lost_frames": "lost",
    "gaps": "gaps",
    "frame_crc_errors": "frame CRC errors",
    "word_crc_errors": "word CRC errors",
    "garbage_bytes": "stray bytes",
    "interruptions": "interruptions",
}


class TipView:
    """The tip's pose of an arm, through its URDF as it stands.

    Raises:
        UrdfError: no such file, frame or chain.
        InputError: the device lacks a joint of the chain.
    """

    def __init__(self, urdf: Path, tip: str, base: str | None, spec: DeviceSpec) -> None:
        self._arm = ArmModel.from_urdf(urdf, tip, base)
        self._columns = matched_joints(self._arm, spec.names, spec.path)
        self.frames = f"{self._arm.tip} in {self._arm.chain.base}"

    def pose(self, angles: FloatArray) -> dict[str, list[float]]:
        """Position in mm and roll, pitch, yaw in degrees for the device's angles (n,), rad."""
        rotation, position = self._arm.forward(angles[self._columns])
        return {
            "position_mm": (1e3 * position).tolist(),
            "rotation_rpy_deg": np.rad2deg(rpy_from_rotation(rotation)).tolist(),
        }


def report(
    watched: Monitor, statistics: Statistics, spec: DeviceSpec, tip: TipView | None, now: float
) -> dict[str, Any]:
    """Everything there is to say at a moment, as plain values."""
    seen = watched.snapshot(now)
    last = watched.last
    joints = {
        name: {
            "angle_deg": math.degrees(seen.angles[k]),
            "noise_deg": math.degrees(seen.noise[k]),
            "error": bool(seen.error[k]),
            "warning": bool(seen.warning[k]),
            "error_flags": int(statistics.error_flags[k]),
            "warning_flags": int(statistics.warning_flags[k]),
            "crc_errors": int(statistics.joint_crc_errors[k]),
        }
        for k, name in enumerate(spec.names)
    }
    return {
        "device": str(spec.path),
        "port": spec.port,
        "format": spec.format,
        "frame_rate_hz": seen.rate,
        "clock_ppm": seen.clock_ppm,
        "frames": statistics.frames,
        **{key: int(getattr(statistics, key)) for key in _COUNTS},
        "stale_readings": statistics.stale_readings,
        "joints": joints,
        "tip": None if tip is None or last is None else tip.pose(last.angles),
        "remarks": [*_silence(now - last.arrival if last else 0.0), *remarks(statistics, spec)],
    }


def _silence(since: float) -> list[str]:
    """What to say of a device that no longer sends, ``since`` so many seconds."""
    if since < SILENT_S:
        return []
    return [f"nothing has come for {since:.1f} s: is the cable plugged in, is the device on?"]


class View:
    """Shows the stream while it runs.

    In a terminal a table that is drawn anew four times a second, elsewhere a line per second.

    Args:
        spec: the device.
        tip: to show the tip's pose, or None.
        quiet: show nothing, not even what happens.
    """

    def __init__(self, spec: DeviceSpec, tip: TipView | None, quiet: bool) -> None:
        self._spec, self._tip, self._quiet = spec, tip, quiet
        self._console = console()
        self._next = 0.0
        self._live: Live | None = None
        self.events: list[str] = []

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._quiet:
            waiting = Text(f"{self._spec.port}: waiting for the first frames …")
            self._live = Live(waiting, console=self._console, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the last table where it is."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def event(self, sentence: str) -> None:
        """Something went wrong, and it went on."""
        self.events.append(sentence)
        if not self._quiet:
            self._console.print(sentence, style="yellow", soft_wrap=True)

    def show(self, watched: Monitor, statistics: Statistics, now: float) -> None:
        """Draw, if it is time to."""
        if self._quiet or watched.last is None:
            return
        if not self._next:  # a rate needs some time to be one
            self._next = now + _LIVE_S
        if now < self._next:
            return
        self._next = now + (_LINE_S if self._live is None else _LIVE_S)
        data = report(watched, statistics, self._spec, self._tip, now)
        if self._live is None:
            self._console.print(_line(data), soft_wrap=True)
        else:
            self._live.update(self._picture(data), refresh=True)

    def conclude(self, data: dict[str, Any]) -> None:
        """What was seen in all, and what is wrong."""
        counts = ", ".join(_counted(data[key], name) for key, name in _COUNTS.items())
        self._console.print(f"{data['frames']} frames; {counts}", soft_wrap=True)
        for remark in data["remarks"] or ["nothing wrong was seen"]:
            self._console.print(f"· {remark}", soft_wrap=True)

    def _picture(self, data: dict[str, Any]) -> Group:
        table = Table(title=_title(data), title_justify="left")
        table.add_column("joint")
        for name in ("angle, °", "noise, °"):
            table.add_column(name, justify="right")
        table.add_column("flags")
        for name, joint in data["joints"].items():
            style = "red" if joint["error"] else "yellow" if joint["warning"] else ""
            angle, noise = _number(joint["angle_deg"], 4), _number(joint["noise_deg"], 5)
            table.add_row(name, angle, noise, Text(_meaning(joint), style=style))
        counts = ", ".join(_counted(data[key], name) for key, name in _COUNTS.items())
        found = [Text(f"· {remark}", style="yellow") for remark in data["remarks"]]
        return Group(table, Text(counts), *_tip_text(self._tip, data), *found)


def _title(data: dict[str, Any]) -> str:
    title = f"{data['port']} · {data['frame_rate_hz']:.1f} {data['format']}/s"
    if data["clock_ppm"] is not None:
        title += f" · device clock {data['clock_ppm']:+.0f} ppm"
    return title


def _line(data: dict[str, Any]) -> str:
    angles = "  ".join(
        f"{name} {_number(joint['angle_deg'], 3)}°{_mark(joint)}"
        for name, joint in data["joints"].items()
    )
    bad = ", ".join(_counted(data[key], name) for key, name in _COUNTS.items() if data[key])
    tip = "" if data["tip"] is None else f"  tip {_vector(data['tip']['position_mm'])} mm"
    return f"{data['frame_rate_hz']:.1f} {data['format']}/s  {angles}{tip}  {bad}".rstrip()


def _counted(number: int, name: str) -> str:
    return f"{number} {name.removesuffix('s') if number == 1 else name}"


def _mark(joint: dict[str, Any]) -> str:
    return " ERROR" if joint["error"] else " warning" if joint["warning"] else ""


def _meaning(joint: dict[str, Any]) -> str:
    return ERROR_MEANING if joint["error"] else WARNING_MEANING if joint["warning"] else "good"


def _tip_text(tip: TipView | None, data: dict[str, Any]) -> list[Text]:
    if tip is None or data["tip"] is None:
        return []
    position, turn = data["tip"]["position_mm"], data["tip"]["rotation_rpy_deg"]
    return [Text(f"{tip.frames}: {_vector(position)} mm, roll pitch yaw {_vector(turn)}°")]


def _vector(values: list[float]) -> str:
    return " ".join(_number(value, 2) for value in values)


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
