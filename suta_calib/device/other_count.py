"""Frames that are good but for the number of joints: the wrong ``device.yaml``, not noise."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.device.crc import frame_crc
from suta_calib.device.description import DeviceSpec
from suta_calib.device.frame_layout import CRC, FIELDS_AT, HEADER, WORDS_AT, frame_size
from suta_calib.device.words import unpack_words
from suta_calib.errors import WrongFormatError

# Once a device has sent frames of the right count, damage is likelier than a change of device.
_ENOUGH_LATER: Final = 3


class OtherCount:
    """Watches for frames of another number of joints while none of the right number come."""

    def __init__(self, spec: DeviceSpec) -> None:
        self._spec = spec
        self._buffer = bytearray()
        self._enough = 1
        self._in_a_row = 0

    def feed(self, data: bytes, *, seen: bool) -> None:
        """Take the next bytes; ``seen``: frames of the right number ended among them.

        Raises:
            WrongFormatError: names both counts.
        """
        if seen:
            self._buffer.clear()
            self._enough, self._in_a_row = _ENOUGH_LATER, 0
        else:
            self._buffer += data
            del self._buffer[: self._search()]

    def _search(self) -> int:
        """Look at every frame that is complete; up to where the buffer is done with."""
        buffer, at = self._buffer, 0
        while (at := buffer.find(HEADER, at)) >= 0:
            if at + WORDS_AT > len(buffer):
                return at
            count = buffer[at + WORDS_AT - 1]
            end = at + frame_size(count)
            if end > len(buffer):
                return at
            at = self._found(count, end) if self._is_other_frame(at, end, count) else at + 1
        return len(buffer) - buffer.endswith(HEADER[:1])

    def _is_other_frame(self, at: int, end: int, count: int) -> bool:
        if count in (0, len(self._spec.joints)):
            return False
        (crc,) = CRC.unpack_from(self._buffer, end - CRC.size)
        if frame_crc()(self._buffer[at + FIELDS_AT : end - CRC.size]) != crc:
            return False
        words = np.frombuffer(bytes(self._buffer[at + WORDS_AT : end - CRC.size]), dtype="<u4")
        return bool(unpack_words(words).good.all())

    def _found(self, count: int, end: int) -> int:
        self._in_a_row += 1
        if self._in_a_row >= self._enough:
            self._buffer.clear()
            expected = len(self._spec.joints)
            raise WrongFormatError(
                f"{self._spec.port}: found frames of {count} joint{'s' * (count != 1)}; "
                f"expected {expected}, as many as {self._spec.path} lists under 'joints'; "
                "list there every joint the device sends, in its order"
            )
        return end
