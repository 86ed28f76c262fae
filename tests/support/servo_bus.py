"""Servos on a bus, emulated: a pseudo-terminal that answers packets as they do."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from types import TracebackType
from typing import Self

import anycrc

_HEADER_2 = b"\xff\xff\xfd\x00"
_READ = 2


class ServoBus:
    """Servos of one protocol whose registers are read; what is written to them is an error.

    Args:
        protocol: 1 or 2, of Dynamixel's.
        registers: bytes of the present position, by the servo's number.
        address: where they are.

    Attributes:
        port: name of the pseudo-terminal.
        registers: may be changed at any time; a servo that is taken out answers no more.
        noisy: answer with a wrong checksum every so many packets; 0 for never.
        other: packets that were no question for a position.
    """

    def __init__(self, protocol: int, registers: dict[int, bytes], address: int) -> None:
        self.registers, self.noisy = dict(registers), 0
        self.other = list[bytes]()
        self._protocol, self._address = protocol, address
        self._count = 0

    def __enter__(self) -> Self:
        self._end, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._end)
        os.close(self._slave)

    def _serve(self) -> None:
        data = b""
        while not self._stop.is_set():
            if not select.select([self._end], [], [], 0.02)[0]:
                continue
            data += os.read(self._end, 1000)
            while (cut := self._packet(data)) is not None:
                packet, data = data[:cut], data[cut:]
                if answer := self._answer(packet):
                    os.write(self._end, answer)

    def _packet(self, data: bytes) -> int | None:
        """Length of the packet at the beginning; None where it is not whole."""
        if self._protocol == 1:
            whole = 4 + data[3] if len(data) > 3 else 4
        else:
            whole = 7 + int.from_bytes(data[5:7], "little") if len(data) > 6 else 7
        return whole if len(data) >= max(whole, 6) else None

    def _answer(self, packet: bytes) -> bytes:
        if self._protocol == 1:
            number, what, asked = packet[2], packet[4], tuple(packet[5:-1])
            assert packet[-1] == ~sum(packet[2:-1]) & 0xFF
        else:
            number, what = packet[4], packet[7]
            asked = tuple(int.from_bytes(packet[k : k + 2], "little") for k in (8, 10))
            assert int.from_bytes(packet[-2:], "little") == crc(packet[:-2])
        value = self.registers.get(number)
        if what != _READ or (value is not None and asked != (self._address, len(value))):
            self.other.append(packet)
            return b""
        return b"" if value is None else self._status(number, value)

    def _status(self, number: int, value: bytes) -> bytes:
        self._count += 1
        wrong = self.noisy and self._count % self.noisy == 0
        if self._protocol == 1:
            body = bytes([number, len(value) + 2, 0]) + value
            return b"\xff\xff" + body + bytes([(~sum(body) + wrong) & 0xFF])
        length = (len(value) + 4).to_bytes(2, "little")
        body = _HEADER_2 + bytes([number]) + length + b"\x55\x00" + value
        return body + (crc(body) ^ wrong).to_bytes(2, "little")


def crc(data: bytes) -> int:
    """Of protocol 2.0: polynomial 0x8005, nothing reflected, from 0."""
    return int(anycrc.CRC(16, 0x8005, 0, False, False, 0).calc(data))
