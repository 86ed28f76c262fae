"""What a device sends, for somebody who watches it: at the moment, and in all."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec
from suta_calib.device.diagnosis import remarks
from suta_calib.device.formats import format_of
from suta_calib.device.reading import Reading, Statistics
from suta_calib.geometry.numbers import wrap
from suta_calib.units import deg

# What was lost or damaged, by its name in `Statistics`, and what it is called.
LOSSES: Final = {
    "lost_frames": "lost",
    "gaps": "gaps",
    "frame_crc_errors": "frame CRC errors",
    "word_crc_errors": "word CRC errors",
    "garbage_bytes": "stray bytes",
    "interruptions": "interruptions",
}


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The last second of a stream.

    Attributes:
        angles: (n,) of the last reading, rad; NaN before the first.
        noise: (n,) standard deviation over the window of the readings without error flag, rad;
            NaN where there are fewer than two.
        error: (n,) the error flag was raised in the window.
        warning: (n,) the same for the warning flag.
        rate: frames per second of this computer's time over the window, readings and those that
            had a damaged word; 0 where none came.
        clock_ppm: how much faster the device's clock runs than this computer's; None too early.
    """

    angles: FloatArray
    noise: FloatArray
    error: BoolArray
    warning: BoolArray
    rate: float
    clock_ppm: float | None


class Monitor:
    """Keeps the readings of a device's last second."""

    def __init__(self, spec: DeviceSpec) -> None:
        self._joints, self._window = len(spec.joints), 1.0
        self._has_clock = format_of(spec).has_clock
        self._recent: deque[Reading] = deque()
        # When, and how many frames with a damaged word had come until then.
        self._damaged: deque[tuple[float, int]] = deque([(-math.inf, 0)])
        self._first: Reading | None = None
        # The newest reading, however old.
        self.last: Reading | None = None

    def add(self, readings: Iterable[Reading]) -> None:
        """Take the next readings, oldest first."""
        for reading in readings:
            self._first = self._first or reading
            self.last = reading
            self._recent.append(reading)

    def note_damaged(self, now: float, count: int) -> None:
        """How many frames with a damaged word have come so far, at this time (s, as arrivals)."""
        if count != self._damaged[-1][1]:
            self._damaged.append((now, count))

    def snapshot(self, now: float) -> Snapshot:
        """The window that ends ``now`` (`time.perf_counter`, s)."""
        recent = self._recent
        while recent and now - recent[0].arrival > self._window:
            recent.popleft()
        while len(self._damaged) > 1 and now - self._damaged[1][0] > self._window:
            self._damaged.popleft()
        damaged = max(self._damaged[-1][1] - self._damaged[0][1], 0)
        count = self._joints
        none = np.zeros(count, dtype=np.bool_)
        error = np.array([r.error for r in recent]) if recent else none[None]
        warning = np.array([r.warning for r in recent]) if recent else none[None]
        angles = np.array([r.angles for r in recent]).reshape(-1, count)
        rate, clock_ppm = 0.0, None
        if self._first is not None and self.last is not None:
            # Shortly after the start the window is not full yet.
            span = min(now - self._first.arrival, self._window)
            rate = (len(recent) + damaged) / span if span > 0 else 0.0
            host = self.last.arrival - self._first.arrival
            # Before 5 s, late reading by this computer is larger than any clock's error.
            if self._has_clock and host >= 5.0:
                clock_ppm = 1e6 * ((self.last.time - self._first.time) / host - 1.0)
        return Snapshot(
            angles=np.full(count, np.nan) if self.last is None else self.last.angles,
            noise=_deviation(angles, error[: len(angles)]),
            error=np.asarray(error.any(axis=0)),
            warning=np.asarray(warning.any(axis=0)),
            rate=rate,
            clock_ppm=clock_ppm,
        )


def watch(
    bus: Bus,
    monitor: Monitor,
    *,
    seconds: float | None = None,
    show: Callable[[float], None] = lambda _: None,
) -> None:
    """Read a device until the time is over, which begins with the first reading.

    Args:
        bus: the device, open.
        monitor: gets its readings.
        seconds: how long, s; for ever by default.
        show: called after every look, with the time (`time.perf_counter`, s).

    Raises:
        DeviceError: as the bus raises it.
    """
    end = None
    while end is None or time.perf_counter() < end:
        readings = bus.read(0.05)
        if readings and end is None and seconds is not None:
            end = readings[0].arrival + seconds
        monitor.add(readings)
        monitor.note_damaged(time.perf_counter(), bus.statistics.word_crc_errors)
        show(time.perf_counter())


def stream_report(
    monitor: Monitor,
    statistics: Statistics,
    spec: DeviceSpec,
    tip: dict[str, list[float]] | None = None,
    now: float | None = None,
) -> dict[str, Any]:
    """Everything there is to say of a stream at this moment, as JSON data.

    Args:
        monitor: the last second of it.
        statistics: all of it.
        spec: the device.
        tip: the pose of the arm's tip, where that is known.
        now: until when the device was read (`time.perf_counter`, s); until this moment by default.
            To close a port takes a third of a second at a socket, in which nothing is read.
    """
    now, last = time.perf_counter() if now is None else now, monitor.last
    snapshot = monitor.snapshot(now)
    joints = {
        name: {
            "angle_deg": deg(float(snapshot.angles[k])),
            "noise_deg": deg(float(snapshot.noise[k])),
            "error": bool(snapshot.error[k]),
            "warning": bool(snapshot.warning[k]),
            "error_flags": int(statistics.error_flags[k]),
            "warning_flags": int(statistics.warning_flags[k]),
            "crc_errors": int(statistics.joint_crc_errors[k]),
        }
        for k, name in enumerate(spec.names)
    }
    since = 0.0 if last is None else now - last.arrival
    extra = dict(zip(spec.extra_columns, last.extra.tolist(), strict=True)) if last else {}
    silent = (
        f"no data for {since:.1f} s; check that the cable is plugged in and the device is "
        "switched on"
    )
    paused = since >= 1.0  # less is chance
    return {
        "device": str(spec.path),
        "port": spec.port,
        "format": spec.format,
        "frame_rate_hz": snapshot.rate,
        "clock_ppm": snapshot.clock_ppm,
        "frames": statistics.frames,
        **{key: int(getattr(statistics, key)) for key in LOSSES},
        "stale_readings": statistics.stale_readings,
        "joints": joints,
        "extra": extra,
        "tip": tip,
        "remarks": [*([silent] if paused else []), *remarks(statistics, spec)],
    }


def _deviation(angles: FloatArray, error: BoolArray) -> FloatArray:
    """Standard deviation on the circle, column by column, of the angles without error, rad."""
    if len(angles) < 2:
        return np.full(angles.shape[1], np.nan)
    # About a valid angle, the differences do not wrap.
    about = angles[(~error).argmax(axis=0), np.arange(angles.shape[1])]
    valid = np.ma.masked_array(wrap(angles - about), mask=error)
    return np.asarray(np.ma.filled(valid.std(axis=0, ddof=1), np.nan))
