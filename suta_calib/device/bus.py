"""A device on a port: readings as they come, fresh ones only, and what is wrong if none come."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Self

from suta_calib.device.clock import Freshness
from suta_calib.device.description import DeviceSpec
from suta_calib.device.diagnosis import Watch
from suta_calib.device.formats import decoder_for
from suta_calib.device.port_process import PortProcess
from suta_calib.device.reading import Reading, Statistics
from suta_calib.errors import DeviceError, DisconnectedError, WrongFormatError


class Bus:
    """An open device; a context manager.

    A process of its own reads the port, so that nothing is lost while this one is busy: what came
    meanwhile is read later, with the time at which it arrived.

    Data that was waiting when the port is opened is old and thrown away; then readings are left
    out until the device's clock has run with this computer's for ``settle`` s. The same happens
    after a reconnection, and when the device's clock jumps (it was restarted).

    Args:
        spec: the device.
        reconnect: wait for a device that is gone, or silent, instead of raising; a device that
            was never heard is an error all the same.
        silence: after this long without a byte, or without a frame, something is wrong, s; for
            the first byte twice as long, as many boards restart when their port is opened.
        settle: how long the clocks must agree before readings are believed to be fresh, s;
            0 takes everything that comes once the port is open.
        settling: a device whose clock has not run with this computer's for so long never will, s.
        absence: whoever has not read for so long wants to know where the arm is now, and gets
            nothing of that time, s; by default nothing is left out, however late it is read.
        on_event: called with one sentence for everything that was wrong and went on.
        port: its port, where somebody began to open it even before ``spec`` was read; closed here.

    Attributes:
        spec: the device.
        statistics: what has passed so far.
    """

    def __init__(
        self,
        spec: DeviceSpec,
        *,
        reconnect: bool = False,
        silence: float = 2.0,
        settle: float = 0.1,
        settling: float = 5.0,
        absence: float = math.inf,
        on_event: Callable[[str], None] = lambda _: None,
        port: PortProcess | None = None,
    ) -> None:
        self.spec = spec
        self._reconnect, self._silence = reconnect, silence
        self._settling, self._absence = settling, absence
        self._say = on_event
        self._decoder = decoder_for(spec)
        self.statistics: Statistics = self._decoder.statistics
        self._fresh = Freshness(settle, self.statistics, self._leapt)
        self._watch = Watch(spec, silence, reconnect, self._say)
        self._port: PortProcess | None = port
        self._lost = False
        self._asked = self._lost_at = self._next_try = self._since = 0.0
        self._last_arrival = 0.0
        # What came before is old, `time.perf_counter`, s.
        self._wanted_from = -math.inf

    def __enter__(self) -> Self:
        """Open the port.

        Raises:
            PortNotFoundError, PortBusyError, PortPermissionError: it cannot be opened.
            DeviceFileError: port or baud rate mean nothing to pyserial.
        """
        if isinstance(self._port, PortProcess) and not self._port.serves(self.spec):
            self.close()
        if self._port is None:
            self._port = PortProcess(self.spec)
        try:
            self._port.open()
        except BaseException:
            self.close()
            raise
        self._begin(self._port.arrived)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the port; harmless if it is closed."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def read(self, timeout: float = 0.1) -> list[Reading]:
        """Whatever has arrived, oldest first; waits for the first up to ``timeout`` s.

        Returns:
            Readings; none if none came in time.

        Raises:
            DeviceSilentError: no byte for too long.
            WrongFormatError: bytes that are not what ``device.yaml`` announces, or a clock that
                does not run in microseconds.
            DisconnectedError: the port is gone, and reconnecting was not asked for.
        """
        now = time.perf_counter()
        if now - self._asked > self._absence and not self._lost:
            self._wanted_from = now
            self._decoder.resume(None)
            self._begin(now)
        deadline = now + timeout
        while True:
            readings = self._read_once(max(deadline - now, 0.0))
            now = self._asked = time.perf_counter()
            if readings or now >= deadline:
                return readings

    def _read_once(self, timeout: float) -> list[Reading]:
        if self._port is None:
            raise DisconnectedError(f"{self.spec.port}: not open")
        if self._lost:
            self._look_again(self._port, timeout)
            return []
        try:
            data = self._port.read(timeout)
        except DisconnectedError as error:
            self._disconnected(error)
            return []
        arrival = self._port.arrived
        if not data or arrival < self._wanted_from:
            self._watch.check(arrival)
            return []
        decoded = self._decoder.feed(data, arrival)
        readings, leapt = self._fresh.take(decoded)
        if leapt:
            self._decoder.resume(self._fresh.last)
        if leapt or arrival - self._last_arrival > self._silence:
            self._since = arrival
        self._last_arrival = arrival
        self._watch.saw(data, bool(decoded), arrival)
        self._watch.check(arrival)
        if self._fresh.settled:
            self._since = arrival
        elif arrival - self._since > self._settling:
            raise WrongFormatError(
                f"{self.spec.port}: found frames whose time does not advance like this "
                f"computer's clock, for {arrival - self._since:.0f} s; expected a time in "
                "microseconds; check what the device sends as its time"
            )
        return readings

    def _begin(self, now: float) -> None:
        """What comes from now on has nothing to do with what came before."""
        self._asked = self._since = self._last_arrival = now
        self._watch.restart(now)
        self._fresh.restart()

    def _leapt(self, leap: float) -> None:
        self.statistics.interruptions += 1
        self._say(
            f"{self.spec.port}: the device's clock jumped by {leap:+.3g} s; readings are not "
            "used until it advances like this computer's again"
        )

    def _disconnected(self, error: DisconnectedError) -> None:
        self._lost = True
        self.statistics.interruptions += 1
        if not self._reconnect:
            self.close()
            raise error
        self._lost_at = time.perf_counter()
        self._next_try = self._lost_at + 0.2
        self._say(f"{error}; waiting for the device")

    def _look_again(self, port: PortProcess, timeout: float) -> None:
        now = time.perf_counter()
        if now < self._next_try:
            time.sleep(min(timeout, self._next_try - now))
            return
        self._next_try = now + 0.2
        try:
            port.open()
        except DeviceError:
            return  # a port that appears may be forbidden, or busy, for a moment
        self._lost = False
        self._begin(port.arrived)
        self._decoder.resume(self._fresh.last)
        self._say(f"{self.spec.port}: connected again after {now - self._lost_at:.1f} s")
