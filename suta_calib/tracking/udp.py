"""Poses as UDP datagrams, one JSON object each."""

from __future__ import annotations

import json
import socket
from typing import Any

from suta_calib.errors import InputError
from suta_calib.tracking.pose import TrackedPose
from suta_calib.tracking.publisher import Publisher


class UdpPublisher(Publisher):
    """Sends every pose to one address; nobody need be there.

    A pose that is not valid is sent without numbers, ``"valid": false``, and names the joints.

    Args:
        host: name or address, also of a broadcast.
        port: 1 … 65535.

    Raises:
        InputError: the name has no address.
    """

    name = "udp"

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(
                f"{host!r} ({reason})", "a host that can be reached", where="--udp"
            ) from None
        self._address = found[4]
        self._socket = socket.socket(*found[:3])
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)

    def publish(self, pose: TrackedPose) -> None:
        """Send one datagram, or drop it where the network takes none at the moment."""
        try:
            self._socket.sendto(datagram(pose), self._address)
        except OSError:
            self.dropped += 1
        else:
            self.published += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def datagram(pose: TrackedPose) -> bytes:
    """A pose as one JSON object in UTF-8: metres, seconds, quaternion x y z w."""
    return json.dumps(pose_dict(pose), ensure_ascii=False, separators=(",", ":")).encode()


def pose_dict(pose: TrackedPose) -> dict[str, Any]:
    """A pose as JSON data: m, s; what a pose that is not valid lacks is null."""
    valid = pose.valid
    content: dict[str, Any] = {
        "sequence": pose.sequence,
        "time": pose.time,
        "host_time": pose.host_time,
        "valid": valid,
        "position": pose.position.tolist() if valid else None,
        "quaternion": pose.quaternion.tolist() if valid else None,
        "std": None if pose.std is None else pose.std.tolist(),
    }
    if pose.errors:
        content["errors"] = list(pose.errors)
    if pose.warnings:
        content["warnings"] = list(pose.warnings)
    return content
