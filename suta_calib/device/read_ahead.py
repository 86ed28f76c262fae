"""A device that is listened to while everything else still starts.

What an arm does before a program has loaded its libraries is measured too: a thread opens the port
at once and keeps what arrives until it is asked for.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec
from suta_calib.device.reading import Reading, Statistics

_SLICE: Final = 0.05


class ReadAhead:
    """`Bus` in a thread of its own; as a context manager it is closed in the end.

    Args:
        spec: the device.
        reconnect: whether to wait for a device that was lost.

    Attributes:
        on_event: told what happens when it is read about, in the reader's thread; may be set later.
    """

    def __init__(self, spec: DeviceSpec, *, reconnect: bool = False) -> None:
        self._arrived: queue.SimpleQueue[list[Reading] | str | Exception] = queue.SimpleQueue()
        self._bus = Bus(spec, reconnect=reconnect, on_event=self._arrived.put)
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)

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
