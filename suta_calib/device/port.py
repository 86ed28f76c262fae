"""The serial port: which names are accepted; opened, read, closed, with errors that say what to do.

pyserial's URLs may do more than open a port: ``spy://PORT?file=FILE`` overwrites a file, ``alt://``
picks one of its classes, ``logging=`` changes how the whole program logs. A ``device.yaml`` comes
with other people's data, so only what is listed here is handed to pyserial.
"""

from __future__ import annotations

import errno
import os
import re
import select
import stat
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import serial
from serial.tools import list_ports

from suta_calib.device.description import DeviceSpec
from suta_calib.errors import (
    DeviceFileError,
    DisconnectedError,
    PortBusyError,
    PortNotFoundError,
    PortPermissionError,
    SutaCalibError,
)

# A name, an IPv4 address, or an IPv6 address in brackets; and a port number.
_SERVER: Final = r"(?:[\w.-]+|\[[0-9a-f:.]+\]):(\d{1,5})/?"
# Options of a telnet server's port (RFC 2217) that concern the connection alone.
_TELNET_OPTION: Final = r"(?:ign_set_control|poll_modem|timeout=\d{1,3}(?:\.\d+)?)"
# hwgrep takes a regular expression, and some take for ever: plain text is enough for a USB number
# (2341:0043), a serial number or a name.
_HARDWARE: Final = r"[\w:=. -]{1,100}(?:&n=\d{1,2})?"
URLS: Final = {
    "socket": (_SERVER, "socket://host:port"),
    "rfc2217": (
        rf"{_SERVER}(?:\?{_TELNET_OPTION}(?:&{_TELNET_OPTION})*)?",
        "rfc2217://host:port, without options other than ign_set_control, poll_modem, timeout=S",
    ),
    "loop": (r"", "loop://"),
    "hwgrep": (_HARDWARE, "hwgrep:// and a part of the port's name, USB number or serial number"),
}
PORT_FORMS: Final = (
    "the name of a port (/dev/ttyACM0, COM3, a pseudo-terminal, a link to one) or a URL: "
    + ", ".join(f"{scheme}://" for scheme in URLS)
)
# pyserial's classes whose file descriptor can be read directly, by module and name.
_PLAIN: Final = (
    ("serial.serialposix", "Serial"),
    ("serial.urlhandler.protocol_hwgrep", "Serial"),
    ("serial.urlhandler.protocol_socket", "Serial"),
)


class Port:
    """An open port, by a name or one of `URLS`.

    Attributes:
        arrived: when `read` gave what it gave last, `time.perf_counter`, s.

    Raises:
        PortNotFoundError, PortBusyError, PortPermissionError: it cannot be opened.
        DeviceFileError: a port's name that is not accepted, or a baud rate that means nothing.
    """

    def __init__(self, spec: DeviceSpec) -> None:
        self._name = spec.port
        if (expected := expected_name(spec.port)) is not None:
            raise DeviceFileError(repr(spec.port), expected, file=spec.path, where="port")
        if (subsystem := other_device(spec.port)) is not None:
            raise PortNotFoundError(
                f"{spec.port}: found something that is not a serial port (a device of "
                f"{subsystem!r}); expected one; check 'port' in {spec.path}"
            )
        self.arrived = time.perf_counter()
        self._failures: tuple[type[Exception], ...] = (OSError, serial.SerialException)
        with suppress(ImportError):
            import termios

            # Neither an OSError nor pyserial's.
            self._failures += (termios.error,)
        try:
            self._serial = serial.serial_for_url(
                spec.port, baudrate=spec.baudrate, timeout=0, exclusive=True
            )
        except (*self._failures, ValueError, OverflowError) as error:
            raise opening_error(spec, error) from None
        kind = type(self._serial)
        plain = os.name == "posix" and (kind.__module__, kind.__name__) in _PLAIN
        self._read = self._read_descriptor if plain else self._read_any

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
        """Throw away what has arrived and was not read; errors of `read`."""
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
        data = os.read(descriptor, 1 << 16)
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
        event = "the connection was closed" if there else "the port disappeared"
        return DisconnectedError(
            f"{self._name}: {event} ({reason}); check the cable and the device's power"
        )


def expected_name(port: str) -> str | None:
    """What a port's name should have been, for a message; None where pyserial may have it."""
    scheme, separator, rest = port.partition("://")
    if "\0" in port or (separator and scheme.lower() not in URLS):
        return PORT_FORMS
    if not separator:
        return None
    pattern, expected = URLS[scheme.lower()]
    match = re.fullmatch(pattern, rest, re.IGNORECASE | re.ASCII)
    largest_server_port = 65535
    if match is None or (match.groups() and int(match[1]) > largest_server_port):
        return expected
    return None


def other_device(port: str) -> str | None:
    """What sort of device a name opens, where that is no serial port.

    To open some devices does something already: ``/dev/watchdog`` restarts the computer. Linux
    says of each which subsystem (``misc``, ``input``) it belongs to; of a pseudo-terminal nothing.
    """
    try:
        status = Path(port).stat()
        if not stat.S_ISCHR(status.st_mode):
            return None
        major, minor = os.major(status.st_rdev), os.minor(status.st_rdev)
        subsystem = Path(f"/sys/dev/char/{major}:{minor}/subsystem").readlink().name
    except (OSError, ValueError, AttributeError):
        return None
    return None if subsystem == "tty" else subsystem


_ABSENT: Final = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR)
_BUSY: Final = (errno.EBUSY, errno.EAGAIN)
_FORBIDDEN: Final = (errno.EACCES, errno.EPERM)


def opening_error(spec: DeviceSpec, error: Exception) -> SutaCalibError:
    """The error to raise for what pyserial said when it opened ``spec.port``."""
    number = getattr(error, "errno", None)
    text = " ".join(str(error).split())
    if isinstance(error, ValueError | OverflowError):
        if isinstance(error, OverflowError) or "baud" in text.lower():
            value, expected, key = f"{spec.baudrate}", "a baud rate this port supports", "baudrate"
        else:
            value, expected, key = f"{spec.port!r}", "a pyserial URL", "port"
        return DeviceFileError(f"{value} ({text})", expected, file=spec.path, where=key)
    if number in _ABSENT:
        link, ports = Path(spec.port), existing_ports()
        gone = (
            f"a link to {link.readlink()}, which does not exist any more"
            if link.is_symlink()
            else ""
        )
        expected = (
            f"one of: {', '.join(ports)}" if ports else "a serial port; this computer has none"
        )
        return PortNotFoundError(
            f"{spec.port}: found {gone or 'no such port'}; expected {expected}; check the cable, "
            f"and 'port' in {spec.path}"
        )
    if number in _BUSY or (os.name == "nt" and "PermissionError" in text):
        by = ", ".join(_users(spec.port)) or "another program"
        return PortBusyError(
            f"{spec.port}: found it in use by {by}; expected a port that no other program reads; "
            "close the other program"
        )
    if number in _FORBIDDEN:
        return _forbidden(spec)
    hint = "check"
    if spec.port.startswith("socket://"):
        problem = f"found no answer ({text}); expected a device server there"
        hint = "check that it runs, and"
    elif Path(spec.port).exists():
        problem = f"found something that is not a serial port ({text}); expected one"
    else:
        problem = f"the port cannot be opened ({text})"
    return PortNotFoundError(f"{spec.port}: {problem}; {hint} 'port' in {spec.path}")


def existing_ports() -> list[str]:
    """Names of this computer's serial ports, with what the system says about them."""
    return [
        p.device
        if p.description in (None, "", "n/a", p.device)
        else f"{p.device} ({p.description})"
        for p in sorted(list_ports.comports())
    ]


def _forbidden(spec: DeviceSpec) -> PortPermissionError:
    hint = "ask the administrator of this computer"
    if os.name == "posix":
        group = "dialout"  # the usual one, where the port's own cannot be found out
        with suppress(OSError, KeyError):
            group = Path(spec.port).group()
        hint = f"run once: sudo usermod -a -G {group} $USER, then log out and in again"
    return PortPermissionError(
        f"{spec.port}: found no permission to open it; expected a port that this user may read; "
        f"{hint}"
    )


def _users(port: str) -> list[str]:
    """Programs that hold the port open, as far as Linux lets us see."""
    target, users = os.path.realpath(port), set()
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if str(link.readlink()) == target:
                process = link.parents[1]
                name = (process / "comm").read_text(encoding="utf-8").strip()
                users.add(f"{name} (process {process.name})")
        except OSError:
            continue
    return sorted(users)
