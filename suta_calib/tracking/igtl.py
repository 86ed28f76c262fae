"""Poses as OpenIGTLink TRANSFORM messages, for 3D Slicer, PLUS and others.

`pyigtl` makes the messages. Its server is not used: it serves one client at a time, polls its
socket for 10 ms before it sends, blocks on a client that does not read, and takes over the
process's signals.
"""

from __future__ import annotations

import contextlib
import errno
import math
import selectors
import socket
import struct
import threading
import time
from ipaddress import ip_address
from typing import Any, Final

import numpy as np
import pyigtl

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError, OutputError
from suta_calib.tracking.publisher import Publisher
from suta_calib.tracking.tracker import TrackedPose
from suta_calib.units import deg, mm

# Bytes the kernel may keep for a client: a client that falls behind further loses messages, and
# one that catches up sees nothing older than these.
SEND_BUFFER: Final = 1 << 16


class _Client:
    """One connection; what is left of a message that was half sent comes before the next."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.rest = b""
        self.gone = False
        self.stuck_since = math.inf
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    def send(self, message: bytes) -> bool:
        """Whether the message was taken; a message is sent whole or not at all."""
        if self.rest:
            self.rest = self._send(self.rest)
            if self.rest:
                return False
        left = self._send(message)
        self.rest = b"" if len(left) == len(message) else left
        return len(left) < len(message)

    def has_hung_up(self) -> bool:
        """Read and forget what the client says, which it does no more once it has gone."""
        try:
            return not self.connection.recv(1 << 16)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:
            return True

    def _send(self, data: bytes) -> bytes:
        """What the kernel did not take of it."""
        try:
            left = data[self.connection.send(data) :]
            self.stuck_since = math.inf
            return left
        except (BlockingIOError, InterruptedError):
            self.stuck_since = min(self.stuck_since, time.perf_counter())
            return data
        except OSError:
            self.gone = True
            return data


class IgtlPublisher(Publisher):
    """An OpenIGTLink server: every client that is connected receives every pose, in mm.

    Clients come and go in a thread of their own; what they send is read and ignored. A client
    that does not read loses messages: whole ones, so that what it does receive stays readable.

    Poses that are not valid are not sent, as the protocol's TRANSFORM has no way to say so. The
    time stamp is the moment the frame arrived, UTC.

    Where the calibration's covariance is known, a SENSOR message follows each TRANSFORM with the
    same time stamp: six standard deviations, of the tip's x, y, z in mm and of turns about the
    base's x, y, z in degrees. Its device name is that of the TRANSFORM with "Std" at its end, for
    clients that keep the last message of each name. Clients that know no SENSOR leave it out.

    Args:
        port: port to listen at; 0 for any free one.
        device_name: of the messages, at most 20 ASCII characters.
        host: address to listen at: this computer's own, which nobody else reaches, by default;
            empty for all.
        most_clients: so many are served; whoever comes later is hung up on.
        patience: a client that takes nothing for so long is hung up on, s.

    Attributes:
        invalid: poses that were not sent because they were not valid.
        port: it listens at.
        public: address and port at which others on the network can read; empty where nobody can.

    Raises:
        InputError: a device name that is empty, longer than 20 characters or not printable ASCII.
        OutputError: the port cannot be listened at.
    """

    name = "igtl"

    def __init__(
        self,
        port: int,
        device_name: str = "TipToBase",
        host: str = "127.0.0.1",
        *,
        most_clients: int = 32,
        patience: float = 5.0,
    ) -> None:
        super().__init__()
        longest = 20  # the field's size in the protocol's header
        fits = 0 < len(device_name) <= longest
        if not (fits and device_name.isascii() and device_name.isprintable()):
            expected = f"1 to {longest} ASCII characters"
            raise InputError(repr(device_name), expected, where="--igtl-name")
        self._device_name = device_name
        self._std_name = device_name[: longest - len("Std")] + "Std"
        self._most_clients, self._patience = most_clients, patience
        self.invalid = self._connections = 0
        self._held: list[bytes] = []
        try:
            self._listener = socket.create_server((host, port), backlog=16)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise OutputError(
                f"--igtl: cannot listen at port {port} of {host or 'this machine'}: {reason}; "
                "expected a free port; choose another"
            ) from None
        address, self.port = self._listener.getsockname()[:2]
        self.public = "" if ip_address(address).is_loopback else f"{address}:{self.port}"
        # A tuple that one thread replaces and nobody changes: the sender walks along it unlocked.
        self._clients: tuple[_Client, ...] = ()
        self._wake, self._woken = socket.socketpair()
        self._thread = threading.Thread(target=self._serve, name="broadcast", daemon=True)
        self._thread.start()

    def publish(self, pose: TrackedPose) -> None:
        """Make its message, which `flush` sends."""
        if not pose.valid:
            self.invalid += 1
            return
        if not self._clients:
            return
        matrix = np.eye(4)
        matrix[:3, :3] = pose.rotation
        matrix[:3, 3] = mm(pose.position)
        message = pyigtl.TransformMessage(
            matrix, timestamp=pose.host_time, device_name=self._device_name
        )
        data = bytes(message.pack())
        if pose.std is not None and pose.turn_std is not None:
            std = np.concatenate([mm(pose.std), deg(pose.turn_std)])
            data += bytes(SensorMessage(std, pose.host_time, self._std_name).pack())
        self._held.append(data)

    def flush(self) -> None:
        """Send to everybody who can take it at once."""
        if not self._held:
            return
        message, clients = b"".join(self._held), self._clients
        taken = sum(client.send(message) for client in clients)
        lost = len(clients) - taken
        self.published += taken * len(self._held)
        self.dropped += lost * len(self._held)
        self._held.clear()
        late = time.perf_counter() - self._patience
        for client in clients if lost else ():
            if client.gone or client.stuck_since < late:
                # The serving thread sees the end of file and takes it from its selector.
                with contextlib.suppress(OSError):
                    client.connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Send the last rests as far as they go, hang up, stop listening."""
        with contextlib.suppress(OSError):  # closed already
            self._wake.send(b"x")
        self._thread.join(timeout=5)
        for end in (self._wake, self._woken, self._listener):
            end.close()

    def statistics(self) -> dict[str, Any]:
        """Messages sent over all clients, messages lost by clients that did not read."""
        counts = {"clients": len(self._clients), "connected": self._connections}
        return super().statistics() | counts | {"invalid": self.invalid}

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            listen_at = 0.0
            while True:
                pause = max(listen_at - time.perf_counter(), 0.0) if listen_at else None
                events = selector.select(pause)
                if listen_at and time.perf_counter() >= listen_at:
                    selector.register(self._listener, selectors.EVENT_READ)
                    listen_at = 0.0
                for key, _ in events:
                    client = key.data
                    if key.fileobj is self._woken:
                        clients, self._clients = self._clients, ()
                        for client in clients:
                            client.connection.close()
                        return
                    if key.fileobj is self._listener:
                        # A computer that has no socket left to give is asked again later.
                        if not self._welcome(selector):
                            selector.unregister(self._listener)
                            listen_at = time.perf_counter() + 0.5
                    elif client.has_hung_up():
                        self._clients = tuple(c for c in self._clients if c is not client)
                        selector.unregister(client.connection)
                        client.connection.close()

    def _welcome(self, selector: selectors.BaseSelector) -> bool:
        """Let in whoever asks; False where the computer has no socket left to give."""
        try:
            connection, _ = self._listener.accept()
        except OSError as error:
            return error.errno not in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
        if len(self._clients) >= self._most_clients:
            connection.close()
            return True
        try:
            client = _Client(connection)
        except OSError:
            connection.close()
            return True
        selector.register(connection, selectors.EVENT_READ, client)
        self._connections += 1
        self._clients = (*self._clients, client)
        return True


class SensorMessage(pyigtl.messages.MessageBase):  # type: ignore[misc]
    """Numbers of a sensor, which pyigtl has no message for.

    OpenIGTLink 2, SENSOR: ``larray u8 | status u8 | unit u64 | larray x float64``, big-endian. At
    most 255 numbers; they have no one unit, and the field for it says none (0).
    """

    def __init__(self, data: FloatArray, timestamp: float, device_name: str) -> None:
        super().__init__(timestamp=timestamp, device_name=device_name)
        self._message_type = "SENSOR"
        self._data = data

    def _pack_content(self) -> bytes:
        return struct.pack(">BBQ", len(self._data), 0, 0) + self._data.astype(">f8").tobytes()
