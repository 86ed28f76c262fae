"""Where poses go, and the simplest of these places: UDP datagrams."""

from __future__ import annotations

import json
import socket
from abc import ABC, abstractmethod
from typing import Any, Self

from suta_calib.errors import InputError
from suta_calib.tracking.tracker import TrackedPose


class Publisher(ABC):
    """Takes poses and never makes the tracker wait.

    Attributes:
        name: what it is called in statistics.
        published: poses handed over.
        dropped: poses nobody could take in time.
    """

    name: str = ""

    def __init__(self) -> None:
        self.published = 0
        self.dropped = 0

    @abstractmethod
    def publish(self, pose: TrackedPose) -> None:
        """Hand one pose over, valid or not, and return at once."""

    def flush(self) -> None:  # noqa: B027 (most hand over each pose as it comes)
        """Hand over what `publish` has held back: no more poses come at the moment."""

    @abstractmethod
    def close(self) -> None:
        """Finish what was begun; a second time does nothing."""

    def statistics(self) -> dict[str, Any]:
        """Counts for JSON."""
        return {"published": self.published, "dropped": self.dropped}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


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
            address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(f"{host!r} ({reason})", "a reachable host", where="--udp") from None
        self._address = address[4]
        self._socket = socket.socket(*address[:3])
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
    if pose.shift is not None and pose.shift_std is not None:
        content["recalibrated"] = {
            "shift": pose.shift.tolist(),
            "std": pose.shift_std.tolist(),
        }
    if pose.errors:
        content["errors"] = list(pose.errors)
    if pose.warnings:
        content["warnings"] = list(pose.warnings)
    return content
