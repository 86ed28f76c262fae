"""A port that a process of its own reads, so that nothing this one does can lose bytes.

A program that loads its libraries holds up all of its threads, for a second on a busy computer;
a pseudo-terminal keeps 4 kB, 0.15 s of six joints at 768 Hz. This process keeps what arrives, and
when it did, until it is asked for. It ends with its parent, however that ends.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import struct
import sys
import time
from collections import deque
from collections.abc import Iterator
from typing import IO, Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.port import Port
from suta_calib.errors import DeviceError, DisconnectedError, PortBusyError, SutaCalibError

# What a message is, its time of arrival (`time.perf_counter`, s), and how many bytes follow.
HEAD: Final = struct.Struct("<cdI")
OPENED: Final = b"O"
DATA: Final = b"D"
FAILED: Final = b"F"
_LOOK_S: Final = 0.05
_BUSY_S: Final = 0.5
# A pause after each read: fewer and larger pieces, for so little that no buffer fills up.
_COLLECT_S: Final = 0.002
# Who has not asked for so many bytes will not ask any more.
_MOST: Final = 1 << 28


def error_to_bytes(error: SutaCalibError) -> bytes:
    """An error as it goes through a pipe: its class's name and its sentence."""
    return f"{type(error).__name__}\n{error}".encode()


def messages(data: bytearray) -> Iterator[tuple[bytes, float, bytes]]:
    """Take the whole messages from the front of what has come through the pipe."""
    while len(data) >= HEAD.size:
        kind, arrival, size = HEAD.unpack_from(data)
        end = HEAD.size + size
        if len(data) < end:
            return
        yield kind, arrival, bytes(data[HEAD.size : end])
        del data[:end]


class _Outbox:
    """Messages on their way to the parent, however slow it takes them."""

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._size = 0

    def put(self, kind: bytes, data: bytes = b"") -> None:
        message = HEAD.pack(kind, time.perf_counter(), len(data)) + data
        self._waiting.append(message)
        self._size += len(message)
        self.send()

    def send(self) -> None:
        """As much as the pipe takes now."""
        with contextlib.suppress(BlockingIOError):
            while self._waiting:
                message = self._waiting[0]
                sent = os.write(self._descriptor, message)
                self._size -= sent
                if sent < len(message):
                    self._waiting[0] = message[sent:]
                    return
                self._waiting.popleft()

    @property
    def empty(self) -> bool:
        return not self._waiting

    @property
    def full(self) -> bool:
        return self._size > _MOST


def serve(spec: DeviceSpec, parent: IO[bytes], out: int) -> None:
    """Read the port until the parent's end of ``parent`` is closed, or the port is gone."""
    outbox = _Outbox(out)
    try:
        _pump(spec, outbox, parent)
    except SutaCalibError as error:
        outbox.put(FAILED, error_to_bytes(error))
    except Exception as error:  # noqa: BLE001 (told by the parent, who alone has a user)
        outbox.put(FAILED, error_to_bytes(DeviceError(f"{spec.port}: {error or type(error)}")))
    while not outbox.empty and not _left(parent):
        time.sleep(_COLLECT_S)
        outbox.send()


def _pump(spec: DeviceSpec, outbox: _Outbox, parent: IO[bytes]) -> None:
    with contextlib.closing(_opened(spec)) as port:
        # What waited before is not where the arm is now.
        port.flush()
        outbox.put(OPENED)
        while not _left(parent) and not outbox.full:
            data = port.read(_LOOK_S)
            if data:
                outbox.put(DATA, data)
                time.sleep(_COLLECT_S)
            else:
                outbox.send()
    raise DisconnectedError(f"{spec.port}: its readings were not asked for any more")


def _opened(spec: DeviceSpec) -> Port:
    """The port; one whose reader was killed a moment ago is free a moment later."""
    give_up = time.perf_counter() + _BUSY_S
    while True:
        try:
            return Port(spec)
        except PortBusyError:
            if time.perf_counter() > give_up:
                raise
            time.sleep(_LOOK_S)


def _left(parent: IO[bytes]) -> bool:
    """Whether the parent has closed its end, or is no more."""
    return bool(select.select([parent], [], [], 0)[0])


def main() -> None:
    """Entry point of the process; the device comes pickled through its standard input."""
    # Ctrl-C is meant for the parent, who then closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    spec = pickle.load(sys.stdin.buffer)
    with contextlib.suppress(BrokenPipeError):
        serve(spec, sys.stdin.buffer, sys.stdout.fileno())
    os._exit(0)


if __name__ == "__main__":
    main()
