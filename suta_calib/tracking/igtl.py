"""Poses as OpenIGTLink TRANSFORM messages, for 3D Slicer, PLUS and others.

`pyigtl` makes the messages. Its server is not used: it serves one client at a time, polls its
socket for 10 ms before it sends, blocks on a client that does not read, and takes over the
process's signals.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from suta_calib.errors import InputError
from suta_calib.extras import load
from suta_calib.tracking.broadcast import Broadcast
from suta_calib.tracking.pose import TrackedPose
from suta_calib.tracking.publisher import Publisher

# The field's size in the protocol's header.
LONGEST_NAME: Final = 20
DEFAULT_NAME: Final = "TipToBase"
_MM: Final = 1e3


class IgtlPublisher(Publisher):
    """An OpenIGTLink server: every client that is connected receives every pose, in mm.

    Poses that are not valid are not sent, as the protocol's TRANSFORM has no way to say so. The
    time stamp is the moment the frame arrived, UTC.

    Args:
        port: port to listen at; 0 for any free one.
        device_name: of the messages, at most 20 ASCII characters.
        host: address to listen at; empty for all.

    Attributes:
        invalid: poses that were not sent because they were not valid.

    Raises:
        InputError: a device name that does not fit.
        OutputError: the port cannot be listened at.
        MissingExtraError: pyigtl is not installed.
    """

    name = "igtl"

    def __init__(self, port: int, device_name: str = DEFAULT_NAME, host: str = "") -> None:
        super().__init__()
        check_device_name(device_name)
        self._message = load("pyigtl", "device").TransformMessage
        self._device_name = device_name
        self.invalid = 0
        self._broadcast = Broadcast(host, port)
        self.port = self._broadcast.port

    def publish(self, pose: TrackedPose) -> None:
        """Send to everybody who can take it at once."""
        if not pose.valid:
            self.invalid += 1
            return
        if not self._broadcast.clients:
            return
        taken, lost = self._broadcast.send(self._packed(pose))
        self.published += taken
        self.dropped += lost

    def close(self) -> None:
        """Hang up."""
        self._broadcast.close()

    def statistics(self) -> dict[str, Any]:
        """Messages sent over all clients, messages lost by clients that did not read."""
        connections = {"clients": self._broadcast.clients, "connected": self._broadcast.connections}
        return super().statistics() | connections | {"invalid": self.invalid}

    def _packed(self, pose: TrackedPose) -> bytes:
        matrix = np.eye(4)
        matrix[:3, :3] = pose.rotation
        matrix[:3, 3] = _MM * pose.position
        message = self._message(matrix, timestamp=pose.host_time, device_name=self._device_name)
        return bytes(message.pack())


def check_device_name(name: str) -> None:
    """Refuse a name that the protocol's header cannot carry.

    Raises:
        InputError: empty, longer than 20 characters, or not printable ASCII.
    """
    if not (0 < len(name) <= LONGEST_NAME and name.isascii() and name.isprintable()):
        raise InputError(f"{name!r}", f"1 to {LONGEST_NAME} ASCII characters", where="--igtl-name")
