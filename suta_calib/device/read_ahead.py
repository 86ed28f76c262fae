"""A device that is listened to while everything else still starts.

What an arm does before a program has loaded its libraries is measured too: a process of its own
opens the port at once and keeps what arrives, and a thread decodes it.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Final, Self

from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec
from suta_calib.device.port import Port
from suta_calib.device.reading import Reading, Statistics
from suta_calib.device.remote_port import RemotePort

_SLICE: Final = 0.05


class ReadAhead:
    """`Bus` in a thread of its own; as a context manager it is closed in the end.

    Args:
        spec: the device.
        reconnect: whether to wait for a device that was lost.
        first: its port, if somebody began to open it even before `spec` was read; closed here.

    Attributes:
        on_event: told what happens when it is read about, in the reader's thread; may be set later.
    """

    def __init__(
        self, spec: DeviceSpec, *, reconnect: bool = False, first: RemotePort | None = None
    ) -> None:
        self._arrived: queue.SimpleQueue[list[Reading] | str | Exception] = queue.SimpleQueue()
        if first is not None and not first.serves(spec):
            first.close()
            first = None
        # Started here, before anybody loads anything.
        self._first: RemotePort | None = first or RemotePort(spec)
        self._bus = Bus(
            spec, reconnect=reconnect, on_event=self._arrived.put, open_port=self._open_port
        )
        self.on_event: Callable[[str], None] = _ignore
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="device", daemon=True)
        self._thread.start()

    @property
    def statistics(self) -> Statistics:
        """What was lost or damaged so far."""
        return self._bus.statistics

    def read(self, timeout: float = 0.1) -> list[Reading]:
        """Whatever has arrived since the last call; empty after the timeout.

        Raises:
            DeviceError: as `Bus` raises it, once what came before it has been read.
        """
        try:
            arrived = self._arrived.get(timeout=timeout)
        except queue.Empty:
            return []
        if isinstance(arrived, Exception):
            raise arrived
        if isinstance(arrived, str):
            self.on_event(arrived)
            return []
        return arrived

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)

    def _open_port(self, spec: DeviceSpec) -> Port | RemotePort:
        """The port that is being opened already; later, when all is loaded, one in this process."""
        first, self._first = self._first, None
        if first is None:
            return Port(spec)
        try:
            first.wait_open()
        except BaseException:
            first.close()
            raise
        return first

    def _listen(self) -> None:
        try:
            with self._bus as bus:
                while not self._stop.is_set():
                    readings = bus.read(_SLICE)
                    if readings:
                        self._arrived.put(readings)
        except Exception as error:  # noqa: BLE001 (raised again where it is read)
            self._arrived.put(error)


def _ignore(message: str) -> None:
    del message
