"""Devices for tests: descriptions, streams of frames, and a pty that stands for a port."""

from __future__ import annotations

import array
import contextlib
import fcntl
import os
import pty
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from suta_calib.device.description import DeviceSpec, JointSpec
from suta_calib.device.formats import encode_frame
from suta_calib.device.port import Port
from suta_calib.device.reading import Reading

RATE = 500.0


def device(count: int = 6, **changes: object) -> DeviceSpec:
    """A device of ``count`` joints that sends frames."""
    given = {
        "path": Path("device.yaml"),
        "port": "loop://",
        "baudrate": 921600,
        "format": "frames",
        "unit": "counts",
        "counts_per_turn": 1 << 22,
        "joints": tuple(JointSpec(f"joint_{k + 1}", 1) for k in range(count)),
    }
    return DeviceSpec(**(given | changes))  # type: ignore[arg-type]


def frames(sequences: Sequence[int], count: int = 6, start_us: int = 0) -> list[bytes]:
    """A frame per sequence number at `RATE`, with counts that differ from frame to frame."""
    random = np.random.default_rng(0)
    counts = random.integers(0, 1 << 22, (len(sequences), count))
    return [
        encode_frame(n, start_us + round(n * 1e6 / RATE), row.tolist())
        for n, row in zip(sequences, counts, strict=True)
    ]


def same(first: Sequence[Reading], second: Sequence[Reading]) -> bool:
    """Whether two lists of readings say the same, arrival aside."""
    return len(first) == len(second) and all(
        (a.sequence, a.time) == (b.sequence, b.time)
        and np.array_equal(a.angles, b.angles)
        and np.array_equal(a.error, b.error)
        and np.array_equal(a.warning, b.warning)
        for a, b in zip(first, second, strict=True)
    )


class PortHere:
    """A port that this process reads itself, for tests that hold its other end."""

    def __init__(self, spec: DeviceSpec) -> None:
        self._spec, self.arrived = spec, time.perf_counter()

    def open(self) -> None:
        self._port = Port(self._spec)

    def read(self, timeout: float) -> bytes:
        data = self._port.read(timeout)
        self.arrived = self._port.arrived
        return data

    def close(self) -> None:
        self._port.close()


class ClockedPort:
    """A port at which a piece comes every so often by a clock of its own, and then nothing more.

    What follows from silences does not depend on how busy the machine is, nor does anybody wait.

    Args:
        pieces: bytes, empty ones for silences.
        every: s.
    """

    def __init__(self, pieces: Iterable[bytes], every: float = 0.01) -> None:
        self._pieces, self._every, self.arrived = iter(pieces), every, time.perf_counter()

    def open(self) -> None:
        pass

    def read(self, timeout: float) -> bytes:
        del timeout
        self.arrived += self._every
        return next(self._pieces, b"")

    def close(self) -> None:
        pass


class PtyDevice:
    """A device on a pty, reached through a link that stays when the pty is another one.

    Args:
        link: path of the symbolic link.

    Attributes:
        sent: how many packets the pty has taken.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._master = self._slave = -1
        self._began = time.perf_counter()
        self.sent = 0

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.unplug()

    def plug(self) -> None:
        """Make a new pty under the link."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Close the pty, as a cable that is pulled out does."""
        self.stop()
        if self._master >= 0:
            self.link.unlink(missing_ok=True)
            os.close(self._slave)
            os.close(self._master)
            self._master = -1

    @property
    def taken(self) -> bool:
        """Whether whoever listens has read all that was sent."""
        waiting = array.array("i", [0])
        fcntl.ioctl(self._slave, termios.FIONREAD, waiting)
        return waiting[0] == 0

    def write(self, data: bytes) -> None:
        """Send bytes; what does not fit into the pty is lost, as on a wire."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def stream(
        self, packet: Callable[[int, int], bytes] | None = None, first: int | None = None
    ) -> None:
        """Send packets of (number, µs) at `RATE` until `stop`; frames by default.

        Its clock has run on since the last time, or begins where the number ``first`` belongs.
        """
        packet = packet or (lambda n, us: encode_frame(n, us, [n % 4096] * 6))
        if first is not None:
            self._began = time.perf_counter() - first / RATE
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, args=(packet,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Go silent."""
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def _run(self, packet: Callable[[int, int], bytes]) -> None:
        sent = self._due()
        while not self._stop.wait(0.002):
            due = self._due()
            for number in range(sent, due):
                self._send(packet(number, round(number * 1e6 / RATE)))
            sent = due

    def _send(self, data: bytes) -> None:
        """Wait for room: how busy the machine is must not decide what is lost."""
        while data and not self._stop.is_set():
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                self._stop.wait(0.001)
        self.sent += 1

    def _due(self) -> int:
        return int((time.perf_counter() - self._began) * RATE)
