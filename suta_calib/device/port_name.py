"""Which names of ports are accepted: those that open a port, and do nothing else.

pyserial's URLs may do more than that: ``spy://PORT?file=FILE`` overwrites a file, ``alt://`` picks
one of its classes, ``logging=`` changes how the whole program logs. A ``device.yaml`` comes with
other people's data, so only what is listed here is handed to pyserial.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Final

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
        "rfc2217://host:port, with no other options than ign_set_control, poll_modem, timeout=S",
    ),
    "loop": (r"", "loop://"),
    "hwgrep": (_HARDWARE, "hwgrep:// and a part of the port's name, USB number or serial number"),
}
PORT_FORMS: Final = (
    "the name of a port (/dev/ttyACM0, COM3, a pseudo-terminal, a link to one) or a URL: "
    + ", ".join(f"{scheme}://" for scheme in URLS)
)


def expected_name(port: str) -> str | None:
    """What a port's name should have been.

    Args:
        port: as ``device.yaml`` gives it.

    Returns:
        For a message; None where the name may be handed to pyserial.
    """
    if "\0" in port:
        return PORT_FORMS
    scheme, separator, rest = port.partition("://")
    if not separator:
        return None
    if scheme.lower() not in URLS:
        return PORT_FORMS
    pattern, expected = URLS[scheme.lower()]
    match = re.fullmatch(pattern, rest, re.IGNORECASE | re.ASCII)
    largest_server_port = 65535
    if match is None or (match.groups() and int(match[1]) > largest_server_port):
        return expected
    return None


def other_device(port: str) -> str | None:
    """What sort of device a name opens, where that is no serial port.

    To open some devices does something already: ``/dev/watchdog`` restarts the computer. Linux
    says of each which subsystem it belongs to; of a pseudo-terminal it says nothing.

    Returns:
        The subsystem (``misc``, ``input``); None for a port, and where the system does not say.
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
