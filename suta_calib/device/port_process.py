"""A port that a process of its own reads, so that nothing this one does can lose bytes.

A program that loads its libraries holds up all of its threads, for a second on a busy computer;
a pseudo-terminal keeps 4 kB, 0.15 s of six joints at 768 Hz. The process keeps what arrives, and
when it did, until it is asked for. It opens the port when it is asked to, again and again, and
ends with its parent, however that ends.

Through its standard input come the device, pickled, which is opened at once, and later `AGAIN` for
every further opening; through its standard output go lists of messages: what happened, when, and
the bytes that came.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import Final, Literal

from suta_calib import errors
from suta_calib.device.description import UNASKED, DeviceSpec
from suta_calib.device.device_file import glance
from suta_calib.device.formats import format_of
from suta_calib.device.port import Port
from suta_calib.errors import DeviceError, DisconnectedError, PortBusyError, SutaCalibError
from suta_calib.sandbox import started

AGAIN: Final = b"A"
# What happened, when (`time.perf_counter`, s), and the bytes that came, or an error's text.
_Message = tuple[Literal["opened", "data", "failed"], float, bytes]


class PortProcess:
    """A port that a process of its own reads, which begins to open it at once.

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
        """Wait until the port is open; one that was lost is looked for once; errors of `Port`."""
        if self._process.poll() is not None:
            self.close()
            self._start()
        elif not self._opening:
            self._send(AGAIN)
        self._opening = False
        while not self._waiting:
            self._fill(None)
        self._take()

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
        pieces = [self._take()]
        # Who lags behind gets so much at once, s: ten frames are decoded nearly as fast as one.
        until = self.arrived + 0.002
        while self._waiting and self._waiting[0][0] == "data" and self._waiting[0][1] <= until:
            pieces.append(self._take())
        return b"".join(pieces)

    def close(self) -> None:
        """Let go of the port, gone or not, and end the process."""
        for end in (self._out, self._in):
            with contextlib.suppress(OSError):
                end.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _start(self) -> None:
        self._process = started("suta_calib.device.port_process")
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._out = self._process.stdin
        with self._process.stdout as pipe:
            self._in = Connection(os.dup(pipe.fileno()), writable=False)
        self._waiting: deque[_Message] = deque()
        self._opening = True
        self._send(pickle.dumps(self._spec))

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(BrokenPipeError):
            self._out.write(data)
            self._out.flush()

    def _fill(self, timeout: float | None) -> None:
        try:
            if self._in.poll(timeout):
                self._waiting += self._in.recv()
        except (EOFError, OSError):
            raise DisconnectedError(
                f"{self._spec.port}: the process that read the port has ended; try again"
            ) from None

    def _take(self) -> bytes:
        """The bytes of the next message, or the error that it tells of."""
        what, self.arrived, data = self._waiting.popleft()
        if what != "failed":
            return data
        name, _, sentence = data.decode().partition("\n")
        kind = getattr(errors, name, DeviceError)
        # Its sentence is complete: whatever else the class would make of it is not wanted again.
        error: SutaCalibError = kind.__new__(kind)
        Exception.__init__(error, sentence)
        raise error


def open_ahead(device: Path) -> PortProcess | None:
    """Begin to open the port of a ``device.yaml`` before anything else is loaded or checked.

    None where there is anything to complain of, which `read_device` will do.
    """
    spec = glance(device)
    return None if spec is None else PortProcess(spec)


class _Outbox(threading.Thread):
    """Sends messages to the parent, however slow it takes them: what waits, all at once."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(daemon=True)
        self._connection = Connection(descriptor, readable=False)
        self._waiting: SimpleQueue[_Message] = SimpleQueue()
        self._put = self._sent = 0
        self.start()

    def put(self, what: Literal["opened", "data", "failed"], data: bytes = b"") -> None:
        self._put += len(data)
        self._waiting.put((what, time.perf_counter(), data))

    def fail(self, error: SutaCalibError) -> None:
        """An error as it goes through a pipe: its class's name and its sentence."""
        self.put("failed", f"{type(error).__name__}\n{error}".encode())

    @property
    def full(self) -> bool:
        """Whether a parent has not asked for so many bytes that it will not ask any more."""
        return self._put - self._sent > 1 << 28

    def run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                messages = [self._waiting.get()]
                while not self._waiting.empty():
                    messages.append(self._waiting.get())
                self._connection.send(messages)
                self._sent += sum(len(data) for *_, data in messages)


# How often the child looks whether its parent is still there while nothing arrives, s.
_LOOK_S: Final = 0.05


def _pump(spec: DeviceSpec, parent: int, outbox: _Outbox) -> None:
    """Open and read the port until the parent says something, or ends."""
    with contextlib.closing(_opened(spec)) as port:
        # What waited before is not where the arm is now.
        port.flush()
        outbox.put("opened")
        while not select.select([parent], [], [], 0)[0] and not outbox.full:
            if data := port.read(_LOOK_S):
                outbox.put("data", data)
    if outbox.full:
        raise DisconnectedError(f"{spec.port}: its readings were not fetched any more")


def _opened(spec: DeviceSpec) -> Port:
    # A port whose last reader was killed a moment ago is busy for so long, s.
    give_up = time.perf_counter() + 0.5
    while True:
        try:
            return Port(spec) if spec.format in UNASKED else format_of(spec).port(spec)
        except PortBusyError:
            if time.perf_counter() > give_up:
                raise
            time.sleep(_LOOK_S)


def main() -> None:
    """Entry point of the process."""
    # Ctrl-C is meant for the parent, who then closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    spec, parent = pickle.load(sys.stdin.buffer), sys.stdin.fileno()
    outbox, asked = _Outbox(sys.stdout.fileno()), AGAIN
    while asked == AGAIN:
        try:
            _pump(spec, parent, outbox)
        except SutaCalibError as error:
            outbox.fail(error)
        except Exception as error:  # noqa: BLE001 (told by the parent, who alone has a user)
            outbox.fail(DeviceError(f"{spec.port}: {error or type(error)}"))
        asked = os.read(parent, 1)
    os._exit(0)


if __name__ == "__main__":
    main()
