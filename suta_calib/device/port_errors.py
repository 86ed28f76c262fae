"""Why a port cannot be opened, and what to do about it."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

from suta_calib.device.description import DeviceSpec
from suta_calib.errors import (
    DeviceError,
    DeviceFileError,
    PortBusyError,
    PortNotFoundError,
    PortPermissionError,
    SutaCalibError,
)
from suta_calib.extras import load

_ABSENT: Final = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR)
_BUSY: Final = (errno.EBUSY, errno.EAGAIN)
_FORBIDDEN: Final = (errno.EACCES, errno.EPERM)


def opening_error(spec: DeviceSpec, error: Exception) -> SutaCalibError:
    """The error to raise for what pyserial said when it opened ``spec.port``."""
    number = getattr(error, "errno", None)
    text = " ".join(str(error).split())
    if isinstance(error, ValueError | OverflowError):
        return _meaningless(spec, text, isinstance(error, OverflowError) or "baud" in text.lower())
    if number in _ABSENT:
        return _not_found(spec)
    if number in _BUSY or (os.name == "nt" and "PermissionError" in text):
        return _busy(spec)
    if number in _FORBIDDEN:
        return _forbidden(spec)
    return _other(spec, text)


def existing_ports() -> list[str]:
    """Names of this computer's serial ports, with what the system says about them."""
    ports = load("serial.tools.list_ports", "device").comports()
    said = {port.device: port.description for port in sorted(ports)}
    return [
        name if description in (None, "", "n/a", name) else f"{name} ({description})"
        for name, description in said.items()
    ]


def _not_found(spec: DeviceSpec) -> PortNotFoundError:
    link = Path(spec.port)
    found = f"a link to {link.readlink()}, which is gone" if link.is_symlink() else "no such port"
    ports = existing_ports()
    expected = f"one of: {', '.join(ports)}" if ports else "a serial port; this computer has none"
    return PortNotFoundError(
        f"{spec.port}: found {found}; expected {expected}; "
        f"check the cable, and 'port' in {spec.path}"
    )


def _busy(spec: DeviceSpec) -> PortBusyError:
    users = _users(spec.port)
    by = f" by {', '.join(users)}" if users else " by another program"
    return PortBusyError(
        f"{spec.port}: found it in use{by}; expected a port nobody reads; close the other program"
    )


def _forbidden(spec: DeviceSpec) -> PortPermissionError:
    hint = "ask whoever looks after this computer"
    if os.name == "posix":
        group = _group(spec.port)
        hint = f"for good: sudo usermod -a -G {group} $USER, then log out and in again"
    return PortPermissionError(
        f"{spec.port}: found no permission to open it; expected a port this user may read; {hint}"
    )


def _meaningless(spec: DeviceSpec, text: str, about_speed: bool) -> DeviceFileError:
    return DeviceFileError(
        f"{spec.baudrate} ({text})" if about_speed else f"{spec.port!r} ({text})",
        "a baud rate this port supports" if about_speed else "a pyserial URL",
        file=spec.path,
        where="baudrate" if about_speed else "port",
    )


def _other(spec: DeviceSpec, text: str) -> DeviceError:
    if spec.port.startswith("socket://"):
        return PortNotFoundError(
            f"{spec.port}: found nobody answering ({text}); expected a device server there; "
            f"check that it runs, and 'port' in {spec.path}"
        )
    if Path(spec.port).exists():
        return PortNotFoundError(
            f"{spec.port}: found something that is no serial port ({text}); "
            f"expected one; check 'port' in {spec.path}"
        )
    return PortNotFoundError(
        f"{spec.port}: it cannot be opened ({text}); check 'port' in {spec.path}"
    )


def _group(port: str) -> str:
    """The group that owns the port; the usual one where that cannot be found out."""
    try:
        return Path(port).group()
    except (OSError, KeyError):
        return "dialout"


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
