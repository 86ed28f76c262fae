"""Notices that nothing comes, or nothing that can be read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.diagnosis import describe_bytes
from suta_calib.errors import DeviceSilentError, WrongFormatError

_KEPT: Final = 4096
# Many boards restart when their port is opened.
_START_FACTOR: Final = 2.0
# Less than this is no evidence against the format.
_FEWEST_BYTES: Final = 16


class Watch:
    """Times of the last byte and the last frame, and what follows from them.

    Args:
        spec: for messages.
        silence: how long there may be nothing, s; twice that for the first byte.
        forgiving: once frames have come, only say what is wrong instead of raising it.
        say: takes one sentence, once per trouble and once when it is over.
    """

    def __init__(
        self, spec: DeviceSpec, silence: float, forgiving: bool, say: Callable[[str], None]
    ) -> None:
        self._spec, self._silence, self._forgiving, self._say = spec, silence, forgiving, say
        self._seen = False
        self.restart(0.0)

    def restart(self, now: float) -> None:
        """Count from now on."""
        self._last_byte = self._last_frame = now
        self._unread_since: float | None = None
        self._any_byte = False
        self._bytes = 0
        self._sample = b""
        self._trouble = ""

    def saw(self, data: bytes, frames: bool, now: float) -> None:
        """Bytes have come, and ``frames`` among them or not."""
        self._last_byte, self._any_byte = now, True
        if frames:
            self._end_trouble(now)
            self._seen, self._last_frame = True, now
            self._unread_since, self._bytes, self._sample = None, 0, b""
            return
        if self._unread_since is None:
            self._unread_since = now
        self._bytes += len(data)
        self._sample = (self._sample + data)[-_KEPT:]

    def check(self, now: float) -> None:
        """Say or raise what is wrong by now.

        Raises:
            DeviceSilentError: no byte for too long.
            WrongFormatError: bytes, but no frame for too long.
        """
        starting = not (self._any_byte or self._seen)
        if now - self._last_byte > self._silence * (_START_FACTOR if starting else 1.0):
            self._report(DeviceSilentError(self._silent(now)), "silent")
        elif self._unread_since is not None and self._bytes >= _FEWEST_BYTES:
            pause = now - self._unread_since
            if pause > self._silence:
                self._report(WrongFormatError(self._unreadable(pause)), "unreadable")

    def _report(self, error: DeviceSilentError | WrongFormatError, trouble: str) -> None:
        if not (self._seen and self._forgiving):
            raise error
        if self._trouble != trouble:
            self._trouble = trouble
            self._say(str(error))

    def _end_trouble(self, now: float) -> None:
        if self._trouble:
            self._trouble = ""
            pause = now - self._last_frame
            self._say(f"{self._spec.port}: frames come again after {pause:.1f} s")

    def _silent(self, now: float) -> str:
        spec, pause = self._spec, now - self._last_byte
        hint = f"check its power, its cable and 'port' in {spec.path}"
        if not self._seen:
            hint = f"check that it is switched on and sends by itself, and 'port' in {spec.path}"
        return (
            f"{spec.port}: found not a single byte in {pause:.1f} s; "
            f"expected {spec.format} at {spec.baudrate} baud; {hint}"
        )

    def _unreadable(self, pause: float) -> str:
        return (
            f"{self._spec.port}: {self._bytes} bytes in {pause:.1f} s, none of them readable: "
            f"{describe_bytes(self._sample, self._spec)}"
        )
