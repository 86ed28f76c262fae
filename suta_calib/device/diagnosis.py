"""What is wrong with a stream: silence, bytes that cannot be read, and what counts tell."""

from __future__ import annotations

import re
from collections.abc import Callable

from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats import FORMATS, format_of
from suta_calib.device.formats.base import is_text
from suta_calib.device.reading import ERROR_ADVICE, ERROR_MEANING, WARNING_MEANING, Statistics
from suta_calib.errors import DeviceError, DeviceSilentError, WrongFormatError


def describe_bytes(data: bytes, spec: DeviceSpec) -> str:
    """``found …; expected …; hint`` about bytes among which there is nothing of the format."""
    form, text = format_of(spec), is_text(data)
    other_formats = (other for other in FORMATS.values() if other is not form)
    other = next((other for other in other_formats if other.recognises(data)), None)
    if text:
        lines = [line for line in re.split(rb"[\r\n]+", data) if line.strip()]
        # The first may have been cut off at its beginning.
        line = lines[1] if len(lines) > 1 else b"".join(lines)
        description = f"text such as {line[:40].decode('ascii')!r}"
    else:
        # From the beginning of a frame, where one is recognised.
        start = 0 if other is None else max(data.find(other.header), 0)
        description = f"bytes such as {data[start : start + 16].hex(' ').upper()}"
    baud = f"baudrate ({spec.baudrate}) in {spec.path}"
    if other is not None:
        hint = f"set 'format: {other.name}' in {spec.path}"
    elif form.near_miss and form.recognises(data):
        description, hint = form.near_miss, f"check the cable, its shield and {baud}"
    else:
        hint = f"check {baud}"
        # So few different bytes are what a line sampled at the wrong speed gives.
        if len(set(data)) <= 6 and not text:
            hint += " (only few different values: probably another speed)"
    return f"found {description}; expected {form.expected(spec.numbers)}; {hint}"


def remarks(statistics: Statistics, spec: DeviceSpec) -> list[str]:
    """What is wrong with a stream that does come, most important first; empty where all is well."""
    s, sentences = statistics, []
    for name, errors, warnings in zip(s.joints, s.error_flags, s.warning_flags, strict=True):
        if errors or warnings:
            what = ERROR_MEANING if errors else WARNING_MEANING
            share = _share(int(errors or warnings), s.frames)
            sentences.append(f"{name}: {what} ({share} of readings); {ERROR_ADVICE}")
    for name, count in zip(s.joints, s.joint_crc_errors, strict=True):
        if count:
            sentences.append(
                f"{name}: the CRC of its encoder words is wrong in "
                f"{_share(int(count), s.frames + s.word_crc_errors)} of frames; check the cable "
                "from this encoder to the controller"
            )
    if s.frame_crc_errors:
        share = _share(s.frame_crc_errors, s.frames + s.frame_crc_errors)
        sentences.append(
            f"{share} of {format_of(spec).damage}; check the cable to this computer, its shield "
            f"and baudrate ({spec.baudrate})"
        )
    elif s.lost_frames:
        sentences.append(
            f"{_share(s.lost_frames, s.frames + s.lost_frames)} of frames are missing although "
            "none is damaged; the connection or this computer is too slow for the device's rate"
        )
    return sentences


def _share(part: int, total: int) -> str:
    percent = 100.0 * part / max(total, 1)
    return f"{percent:.2g} %" if percent < 99.5 else "100 %"


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
        self._trouble: type[DeviceError] | None = None

    def saw(self, data: bytes, frames: bool, now: float) -> None:
        """Bytes have come, and ``frames`` among them or not."""
        self._last_byte, self._any_byte = now, True
        if frames:
            if self._trouble:
                self._trouble, pause = None, now - self._last_frame
                self._say(f"{self._spec.port}: frames received again after {pause:.1f} s")
            self._seen, self._last_frame = True, now
            self._unread_since, self._bytes, self._sample = None, 0, b""
            return
        if self._unread_since is None:
            self._unread_since = now
        self._bytes += len(data)
        self._sample = (self._sample + data)[-4096:]

    def check(self, now: float) -> None:
        """Say or raise what is wrong by now: no byte, or bytes but no frame, for too long."""
        # Fewer bytes are no evidence against the format; many boards restart when their port is
        # opened.
        fewest_bytes, start_factor = 16, 2.0
        starting = not (self._any_byte or self._seen)
        spec, pause = self._spec, now - self._last_byte
        if pause > self._silence * (start_factor if starting else 1.0):
            hint = "that the device is switched on and sends by itself,"
            silent = (
                f"{spec.port}: no byte received in {pause:.1f} s; expected {spec.format} at "
                f"{spec.baudrate} baud; check {('its power, its cable' if self._seen else hint)} "
                f"and 'port' in {spec.path}"
            )
            self._report(DeviceSilentError(silent))
        elif self._unread_since is not None and self._bytes >= fewest_bytes:
            pause = now - self._unread_since
            if pause > self._silence:
                unreadable = (
                    f"{spec.port}: {self._bytes} bytes in {pause:.1f} s, none of them in the "
                    f"expected format: {describe_bytes(self._sample, spec)}"
                )
                self._report(WrongFormatError(unreadable))

    def _report(self, error: DeviceSilentError | WrongFormatError) -> None:
        if not (self._seen and self._forgiving):
            raise error
        if self._trouble is not type(error):
            self._trouble = type(error)
            self._say(str(error))
