"""What is wrong with a stream: silence, bytes that cannot be read, and what counts tell."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats import FORMATS, format_of
from suta_calib.device.formats.base import is_text
from suta_calib.device.reading import ERROR_ADVICE, ERROR_MEANING, WARNING_MEANING, Statistics
from suta_calib.errors import DeviceSilentError, WrongFormatError

_QUOTED: Final = 40
_BYTES_SHOWN: Final = 16
# So few different bytes are what a line sampled at the wrong speed gives.
_FEW_VALUES: Final = 6


def describe_bytes(data: bytes, spec: DeviceSpec) -> str:
    """``found …; expected …; hint`` about bytes among which there is nothing of the format.

    Args:
        data: some of the bytes that came.
        spec: what was expected, and where the file is that says so.
    """
    form, text = format_of(spec), is_text(data)
    hexadecimal = data[:_BYTES_SHOWN].hex(" ").upper()
    found = f"text such as {_quoted(data)}" if text else f"bytes such as {hexadecimal}"
    baud = f"baudrate ({spec.baudrate}) in {spec.path}"
    others = (each for each in FORMATS.values() if each is not form and each.recognises(data))
    if (other := next(others, None)) is not None:
        hint = f"set 'format: {other.name}' in {spec.path}"
    elif form.near_miss and form.recognises(data):
        found, hint = form.near_miss, f"check the cable, its shield and {baud}"
    else:
        hint = f"check {baud}"
        if len(set(data)) <= _FEW_VALUES and not text:
            hint += " (so few different values: most likely another speed)"
    return f"found {found}; expected {form.expected(len(spec.joints))}; {hint}"


def _quoted(data: bytes) -> str:
    lines = [line for line in re.split(rb"[\r\n]+", data) if line.strip()]
    # The first may have been cut off at its beginning.
    line = lines[1] if len(lines) > 1 else (lines[0] if lines else b"")
    return repr(line[:_QUOTED].decode("ascii"))


def remarks(statistics: Statistics, spec: DeviceSpec) -> list[str]:
    """What is wrong with a stream that does come, most important first; empty where all is well."""
    return [*_flags(statistics), *_words(statistics), *_frames(statistics, spec)]


def _flags(statistics: Statistics) -> list[str]:
    found = []
    for index, name in enumerate(statistics.joints):
        errors, warnings = statistics.error_flags[index], statistics.warning_flags[index]
        if errors:
            share = _share(int(errors), statistics.frames)
            found.append(f"{name}: {ERROR_MEANING} ({share} of readings); {ERROR_ADVICE}")
        elif warnings:
            share = _share(int(warnings), statistics.frames)
            found.append(f"{name}: {WARNING_MEANING} ({share} of readings); {ERROR_ADVICE}")
    return found


def _words(statistics: Statistics) -> list[str]:
    total = statistics.frames + statistics.word_crc_errors
    return [
        f"{name}: the CRC of its encoder words is wrong in {_share(int(count), total)} of frames; "
        "check the cable from this encoder to the controller"
        for name, count in zip(statistics.joints, statistics.joint_crc_errors, strict=True)
        if count
    ]


def _frames(statistics: Statistics, spec: DeviceSpec) -> list[str]:
    found = []
    total = statistics.frames + statistics.frame_crc_errors
    if statistics.frame_crc_errors:
        found.append(
            f"{_share(statistics.frame_crc_errors, total)} of {format_of(spec).damage}; "
            f"check the cable to this computer, its shield and baudrate ({spec.baudrate})"
        )
    elif statistics.lost_frames:
        sent = statistics.frames + statistics.lost_frames
        found.append(
            f"{_share(statistics.lost_frames, sent)} of frames are missing though none is damaged; "
            "the line, or this computer, is too slow for the device's rate"
        )
    return found


def _share(part: int, whole: int) -> str:
    percent = 100.0 * part / max(whole, 1)
    return f"{percent:.2g} %" if percent < 99.5 else "100 %"


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
