"""A port that a process of its own reads, so that nothing this one does can lose bytes.

A program that loads its libraries holds up all of its threads, for a second on a busy computer;
a pseudo-terminal keeps 4 kB, 0.15 s of six joints at 768 Hz. The process keeps what arrives, and
when it did, until it is asked for. It opens the port when it is asked to, again and again, and
ends with its parent, however that ends.

Through its standard input come the device, pickled, which is opened at once, and later `AGAIN` for
every further opening; through its standard output go messages: what happened, when, and how many
bytes follow.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Final

from suta_calib import errors
from suta_calib.device.description import UNASKED
from suta_calib.device.device_file import glance
from suta_calib.device.formats import format_of
from suta_calib.device.port import Port
from suta_calib.errors import DeviceError, DisconnectedError, PortBusyError, SutaCalibError
from suta_calib.processes import started

if TYPE_CHECKING:
    from suta_calib.device.description import DeviceSpec
    from suta_calib.device.port import Port

AGAIN: Final = b"A"
# What a message is, its time (`time.perf_counter`, s), and how many bytes follow.
_HEAD: Final = struct.Struct("<cdI")
_OPENED: Final = b"O"
_DATA: Final = b"D"
_FAILED: Final = b"F"
# How often the child looks whether its parent is still there while nothing arrives, s.
_LOOK_S: Final = 0.05
# A parent that has not asked for so many bytes will not ask any more.
_LARGEST_BACKLOG: Final = 1 << 28
_AT_ONCE: Final = 1 << 20
# Who lags behind gets so much at once, s: ten frames are decoded nearly as fast as one.
_PIECE_S: Final = 0.002
_ENDING_S: Final = 2.0


class PortProcess:
    """A port that a process of its own reads, which begins to open it at once.

    Args:
        spec: gives the port, a name or one of `port_name.URLS`, and the baud rate.

    Attributes:
        arrived: when the bytes that `read` gave last had come, `time.perf_counter`, s.
    """

    def __init__(self, spec: DeviceSpec) -> None:
        self._spec = spec
        self.arrived = time.perf_counter()
        self._opening = False
        self._start()

    def serves(self, spec: DeviceSpec) -> bool:
        """Whether this is that device's port."""
        return (self._spec.port, self._spec.baudrate) == (spec.port, spec.baudrate)

    def open(self) -> None:
        """Wait until the port is open; where it was lost, it is looked for once.

        Raises:
            PortNotFoundError, PortBusyError, PortPermissionError: it cannot be opened.
            DeviceFileError: port or baud rate mean nothing to pyserial.
        """
        if self._process.poll() is not None:
            self.close()
            self._start()
        elif not self._opening:
            self._send(AGAIN)
        self._opening = False
        while not self._waiting:
            self._fill(None)
        kind, self.arrived, data = self._waiting.popleft()
        if kind == _FAILED:
            raise _error(data)
        assert kind == _OPENED

    def read(self, timeout: float) -> bytes:
        """Bytes that came together; waits for them up to ``timeout`` s, then gives none.

        Raises:
            DisconnectedError: the port is gone.
        """
        if not self._waiting:
            self._fill(timeout)
        if not self._waiting:
            self.arrived = time.perf_counter()
            return b""
        kind, self.arrived, data = self._waiting.popleft()
        if kind == _FAILED:
            raise _error(data)
        assert kind == _DATA
        first, pieces = self.arrived, [data]
        while self._waiting and self._waiting[0][0] == _DATA:
            if self._waiting[0][1] - first > _PIECE_S:
                break
            _, self.arrived, data = self._waiting.popleft()
            pieces.append(data)
        return b"".join(pieces)

    def close(self) -> None:
        """Let go of the port, gone or not, and end the process."""
        for end in (self._out, self._in):
            with contextlib.suppress(OSError):
                end.close()
        try:
            self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _start(self) -> None:
        self._process = started("suta_calib.device.port_process")
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._out, self._in = self._process.stdin, self._process.stdout
        self._data = bytearray()
        self._waiting: deque[tuple[bytes, float, bytes]] = deque()
        self._opening = True
        self._send(pickle.dumps(self._spec))

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(BrokenPipeError):
            self._out.write(data)
            self._out.flush()

    def _fill(self, timeout: float | None) -> None:
        if not select.select([self._in], [], [], timeout)[0]:
            return
        data = os.read(self._in.fileno(), _AT_ONCE)
        if not data:
            raise DisconnectedError(
                f"{self._spec.port}: the process that read it has ended; try again"
            )
        came, at = self._data, 0
        came += data
        while len(came) - at >= _HEAD.size:
            kind, arrival, size = _HEAD.unpack_from(came, at)
            end = at + _HEAD.size + size
            if len(came) < end:
                break
            self._waiting.append((kind, arrival, bytes(came[at + _HEAD.size : end])))
            at = end
        del came[:at]


def _error(data: bytes) -> SutaCalibError:
    """The error that `_Outbox.fail` told of."""
    name, _, sentence = data.decode().partition("\n")
    kind = getattr(errors, name, DeviceError)
    # Its sentence is complete: whatever else the class would make of it is not wanted again.
    error: SutaCalibError = kind.__new__(kind)
    Exception.__init__(error, sentence)
    return error


def open_ahead(device: Path) -> PortProcess | None:
    """Begin to open the port of a ``device.yaml`` before anything else is loaded or checked.

    Returns:
        For `Bus`; None where there is anything to complain of, which `read_device` will do.
    """
    spec = glance(device)
    return None if spec is None else PortProcess(spec)


class _Outbox:
    """Messages on their way to the parent, however slow it takes them."""

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._size = 0

    def put(self, kind: bytes, data: bytes = b"") -> None:
        message = _HEAD.pack(kind, time.perf_counter(), len(data)) + data
        self._waiting.append(message)
        self._size += len(message)
        self.send()

    def fail(self, error: SutaCalibError) -> None:
        """An error as it goes through a pipe: its class's name and its sentence."""
        self.put(_FAILED, f"{type(error).__name__}\n{error}".encode())

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
    def full(self) -> bool:
        return self._size > _LARGEST_BACKLOG


class _Child:
    """The process: opens and reads the port until the parent's end of the pipe is closed."""

    def __init__(self, spec: DeviceSpec, parent: int, out: int) -> None:
        self._spec, self._parent, self._outbox = spec, parent, _Outbox(out)

    def serve(self) -> None:
        """Until the parent is no more."""
        asked = AGAIN
        while asked == AGAIN:
            try:
                self._pump()
            except SutaCalibError as error:
                self._outbox.fail(error)
            except Exception as error:  # noqa: BLE001 (told by the parent, who alone has a user)
                self._outbox.fail(DeviceError(f"{self._spec.port}: {error or type(error)}"))
            # Until the parent's next word, it gets what it has not yet taken.
            while not self._parent_spoke(_LOOK_S):
                self._outbox.send()
            asked = os.read(self._parent, 1)

    def _parent_spoke(self, timeout: float) -> bool:
        """Whether there is something to read from the parent, its end included."""
        return bool(select.select([self._parent], [], [], timeout)[0])

    def _pump(self) -> None:
        with contextlib.closing(self._opened()) as port:
            # What waited before is not where the arm is now.
            port.flush()
            self._outbox.put(_OPENED)
            while not self._parent_spoke(0) and not self._outbox.full:
                data = port.read(_LOOK_S)
                if data:
                    self._outbox.put(_DATA, data)
                else:
                    self._outbox.send()
        if self._outbox.full:
            raise DisconnectedError(f"{self._spec.port}: its readings were not asked for any more")

    def _opened(self) -> Port:
        def opened() -> Port:
            if self._spec.format in UNASKED:
                return Port(self._spec)
            # Whose port is opened ahead does not wait for what this loads.

            return format_of(self._spec).port(self._spec)

        # A port whose last reader was killed a moment ago is busy for so long, s.
        give_up = time.perf_counter() + 0.5
        while True:
            try:
                return opened()
            except PortBusyError:
                if time.perf_counter() > give_up:
                    raise
                time.sleep(_LOOK_S)


def main() -> None:
    """Entry point of the process."""
    # Ctrl-C is meant for the parent, who then closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    spec = pickle.load(sys.stdin.buffer)
    with contextlib.suppress(BrokenPipeError):
        _Child(spec, sys.stdin.fileno(), sys.stdout.fileno()).serve()
    os._exit(0)


if __name__ == "__main__":
    main()
