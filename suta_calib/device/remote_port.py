"""The parent's side of `port_process`: a port like any other, that loses nothing meanwhile."""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import subprocess
import sys
import time
from collections import deque
from pathlib import Path
from typing import Final

from suta_calib import errors
from suta_calib.device.description import DeviceSpec
from suta_calib.device.port_process import DATA, FAILED, OPENED, messages
from suta_calib.errors import DeviceError, DisconnectedError, SutaCalibError

_AT_ONCE: Final = 1 << 20
_ROOT: Final = Path(__file__).parents[2]
_ENDING_S: Final = 2.0


class RemotePort:
    """`Port` in a process of its own; made at once, opened when it is first asked about.

    Args:
        spec: gives the port, any pyserial URL, and the baud rate.

    Attributes:
        arrived: when the bytes that `read` gave last had come, `time.perf_counter`, s.
        keeps: whether what comes while nobody reads is kept with its time of arrival.
    """

    keeps = True

    def __init__(self, spec: DeviceSpec) -> None:
        self._spec = spec
        paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            # -P: a file of the user's folder must not stand in for a library.
            [sys.executable, "-P", "-m", "suta_calib.device.port_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._out, self._in = self._process.stdin, self._process.stdout
        self._data = bytearray()
        self._waiting: deque[tuple[bytes, float, bytes]] = deque()
        self.arrived = time.perf_counter()
        with contextlib.suppress(BrokenPipeError):
            pickle.dump(spec, self._out)
            self._out.flush()

    def serves(self, spec: DeviceSpec) -> bool:
        """Whether this is that device's port."""
        return (self._spec.port, self._spec.baudrate) == (spec.port, spec.baudrate)

    def wait_open(self) -> None:
        """Until the port is open.

        Raises:
            SutaCalibError: as `Port` raises it.
        """
        while not self._waiting:
            self._fill(None)
        kind, arrived, data = self._waiting.popleft()
        if kind == FAILED:
            raise _error(data)
        assert kind == OPENED
        self.arrived = arrived

    def read(self, timeout: float) -> bytes:
        """Bytes that came in one piece; waits for them up to ``timeout`` s, then gives none.

        Raises:
            DisconnectedError: the port is gone.
        """
        if not self._waiting:
            self._fill(timeout)
        if not self._waiting:
            self.arrived = time.perf_counter()
            return b""
        kind, self.arrived, data = self._waiting.popleft()
        if kind == FAILED:
            raise _error(data)
        assert kind == DATA
        return data

    def flush(self) -> None:
        """Nothing: what waited when the port was opened has been thrown away."""

    def close(self) -> None:
        """Let go of the port, gone or not."""
        for end in (self._out, self._in):
            with contextlib.suppress(OSError):
                end.close()
        try:
            self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _fill(self, timeout: float | None) -> None:
        if not select.select([self._in], [], [], timeout)[0]:
            return
        data = os.read(self._in.fileno(), _AT_ONCE)
        if not data:
            raise DisconnectedError(
                f"{self._spec.port}: the process that read it has ended; try again"
            )
        self._data += data
        self._waiting.extend(messages(self._data))


def _error(data: bytes) -> SutaCalibError:
    """The error that `port_process.error_to_bytes` told of."""
    name, _, sentence = data.decode().partition("\n")
    kind = getattr(errors, name, DeviceError)
    # Its sentence is complete: whatever else the class would make of it is not wanted again.
    error: SutaCalibError = kind.__new__(kind)
    Exception.__init__(error, sentence)
    return error
