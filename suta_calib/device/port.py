"""The serial port: opened, read and closed, with errors that say what to do."""

from __future__ import annotations

import errno
import os
import select
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.port_errors import opening_error
from suta_calib.errors import DisconnectedError
from suta_calib.extras import load

_AT_ONCE: Final = 1 << 16
# pyserial's classes whose file descriptor can be read directly, by module and name.
_PLAIN: Final = (
    ("serial.serialposix", "Serial"),
    ("serial.urlhandler.protocol_socket", "Serial"),
)


class Port:
    """An open port.

    Args:
        spec: gives the port, any pyserial URL, and the baud rate.

    Attributes:
        arrived: when `read` gave what it gave last, `time.perf_counter`, s.
        keeps: whether what comes while nobody reads is kept with its time of arrival.

    Raises:
        PortNotFoundError, PortBusyError, PortPermissionError: it cannot be opened.
        DeviceFileError: port or baud rate mean nothing to pyserial.
        MissingExtraError: pyserial is not installed.
    """

    keeps = False

    def __init__(self, spec: DeviceSpec) -> None:
        self._name = spec.port
        self.arrived = time.perf_counter()
        serial = load("serial", "device")
        # termios.error, where there is termios, is neither an OSError nor pyserial's.
        self._failures = (OSError, serial.SerialException, *_termios_error())
        try:
            self._serial = serial.serial_for_url(
                spec.port, baudrate=spec.baudrate, timeout=0, exclusive=True
            )
        except (*self._failures, ValueError, OverflowError) as error:
            raise opening_error(spec, error) from None
        self._read: Callable[[float], bytes] = (
            self._read_descriptor if _is_plain(self._serial) else self._read_any
        )

    def read(self, timeout: float) -> bytes:
        """Whatever has arrived; waits for the first byte up to ``timeout`` s, then gives none.

        Raises:
            DisconnectedError: the port is gone.
        """
        try:
            data = self._read(timeout)
            self.arrived = time.perf_counter()
            return data
        except self._failures as error:
            if getattr(error, "errno", None) in (errno.EINTR, errno.EAGAIN):
                return b""
            raise self._gone(error) from None

    def flush(self) -> None:
        """Throw away what has arrived and was not read.

        Raises:
            DisconnectedError: the port is gone.
        """
        try:
            self._serial.reset_input_buffer()
        except self._failures as error:
            raise self._gone(error) from None

    def close(self) -> None:
        """Let go of the port, gone or not."""
        with suppress(*self._failures):
            self._serial.close()

    def _read_descriptor(self, timeout: float) -> bytes:
        """One call for all that is there: pyserial asks the system several times per read."""
        descriptor = self._serial.fileno()
        if not select.select([descriptor], [], [], timeout)[0]:
            return b""
        data = os.read(descriptor, _AT_ONCE)
        if not data:
            raise OSError(errno.EIO, "the other end was closed")
        return data

    def _read_any(self, timeout: float) -> bytes:
        self._serial.timeout = timeout
        first: bytes = self._serial.read(1)
        waiting = self._serial.in_waiting if first else 0
        return first + self._serial.read(waiting) if waiting else first

    def _gone(self, error: Exception) -> DisconnectedError:
        there = "://" in self._name or Path(self._name).exists()
        reason = getattr(error, "strerror", None) or str(error)
        said = "the connection was closed" if there else "the port is gone"
        return DisconnectedError(
            f"{self._name}: {said} ({reason}); check the cable and the device's power"
        )


def _is_plain(serial: Any) -> bool:
    kind = type(serial)
    return os.name == "posix" and (kind.__module__, kind.__name__) in _PLAIN


def _termios_error() -> tuple[type[Exception], ...]:
    try:
        import termios
    except ImportError:
        return ()
    return (termios.error,)
