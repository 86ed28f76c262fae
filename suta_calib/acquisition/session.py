"""The loop between a device and whoever takes the samples, and what happened on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from suta_calib.acquisition.continuous import Continuous
from suta_calib.acquisition.guided import Guided
from suta_calib.acquisition.replay import RecordedStream
from suta_calib.acquisition.rest import STALL
from suta_calib.acquisition.stops import StopFinder
from suta_calib.acquisition.unattended import Unattended
from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec, columns_of
from suta_calib.device.formats import format_of
from suta_calib.device.reading import Reading, Statistics

# What makes events of readings, and who decides which stop is which sample.
Finder: TypeAlias = StopFinder | Continuous
Sampler: TypeAlias = Guided | Unattended | Continuous


class ArmReadings:
    """Picks the arm's joints, in its order, out of those of a device; errors of `columns_of`."""

    def __init__(self, spec: DeviceSpec, joints: Sequence[str]) -> None:
        self._columns = columns_of(joints, spec.names, "the arm", spec.path)
        self._same = spec.names == tuple(joints)

    def __call__(self, readings: Iterable[Reading]) -> list[Reading]:
        """The same readings with the arm's joints only."""
        if self._same:
            return list(readings)
        c = self._columns
        return [
            replace(r, angles=r.angles[c], error=r.error[c], warning=r.warning[c]) for r in readings
        ]


@dataclass(eq=False)
class StreamEvents:
    """What went wrong in the stream, for the summary at the end.

    Attributes:
        messages: of the bus: disconnected, reconnected.
        stalls: length of each pause, by the device's clock, s.
        readings: how many came.
        seconds: from the first one's arrival to the last one's.
    """

    messages: list[str] = field(default_factory=list)
    stalls: list[float] = field(default_factory=list)
    readings: int = 0
    seconds: float = 0.0


def run_session(
    source: Bus | RecordedStream,
    choose: ArmReadings,
    finder: Finder,
    sampler: Sampler,
    *,
    events: StreamEvents,
    idle: Callable[[Reading | None], None] = lambda _: None,
    record: Callable[[Sequence[Reading]], None] | None = None,
    patience: float = np.inf,
) -> bool:
    """Take samples until there is nothing left to take.

    After every read ``record`` gets the readings as they came, with all joints, and ``idle``, which
    looks after keys and listeners, the latest one of the arm's joints, if any came. False where
    nothing happened for ``patience`` s.

    Raises:
        DeviceError: as the source raises it.
        OutputError: a sample could not be written.
    """
    since = time.monotonic()
    first: Reading | None = None
    last: Reading | None = None
    while not sampler.done:
        readings = source.read(0.05)
        now = time.monotonic()
        if record is not None:
            record(readings)
        chosen = choose(readings)
        stop_events = finder.feed(chosen)
        for event in stop_events:
            if not sampler.done:
                sampler.handle(event)
        since = now if stop_events else since
        if readings:
            events.stalls += _pauses(readings if last is None else [last, *readings])
            first, last = first or readings[0], readings[-1]
            events.readings += len(readings)
            events.seconds = last.arrival - first.arrival
        idle(chosen[-1] if chosen else None)
        if now - since > patience:
            sampler.finish()
            return sampler.done
    return True


def summary_lines(events: StreamEvents, statistics: Statistics, spec: DeviceSpec) -> list[str]:
    """The summary of a stream in sentences, worst things last."""
    rate = events.readings / max(events.seconds, 1e-9)
    lines = [f"{events.readings} readings in {events.seconds:.1f} s ({rate:.0f} per s)"]
    counted = {
        "lost frames": statistics.lost_frames,
        format_of(spec).damaged: statistics.frame_crc_errors,
        "words with a wrong CRC": statistics.word_crc_errors,
        "invalid bytes": statistics.garbage_bytes,
    }
    happened = [f"{count} {what}" for what, count in counted.items() if count]
    lines[0] += f": {', '.join(happened)}" if happened else ": no losses, no CRC errors"
    if statistics.stale_readings:
        lines.append(f"{statistics.stale_readings} outdated readings discarded")
    if events.stalls:
        lengths = ", ".join(f"{length:.1f} s" for length in events.stalls)
        lines.append(f"the stream paused {_times(len(events.stalls))}: {lengths}")
    for what, flags in (("error", statistics.error_flags), ("warning", statistics.warning_flags)):
        raised = [f"{j} {_times(n)}" for j, n in zip(spec.names, flags, strict=True) if n]
        lines += [f"{what} flag set: {', '.join(raised)}"] if raised else []
    return lines + events.messages


def _pauses(readings: Sequence[Reading]) -> list[float]:
    """Lengths of the pauses between readings, by the device's clock, s.

    When they were read says as much about this computer as about the device: a busy one makes
    pauses, and hides them.
    """
    steps = (after.time - before.time for before, after in pairwise(readings))
    return [step for step in steps if step > STALL]


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
