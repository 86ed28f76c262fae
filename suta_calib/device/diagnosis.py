"""What bytes look like that are not what was expected, and what a user should make of counts."""

from __future__ import annotations

import re
from typing import Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.frame_layout import HEADER
from suta_calib.device.reading import Statistics
from suta_calib.device.words import ERROR_ADVICE, ERROR_MEANING, WARNING_MEANING

_TEXT: Final = re.compile(rb"[\t\r\n\x20-\x7e]*")
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
    expected, baud = _expected(spec), f"baudrate ({spec.baudrate}) in {spec.path}"
    if _TEXT.fullmatch(data):
        hint = f"set 'format: lines' in {spec.path}" if spec.format == "frames" else f"check {baud}"
        return f"found text such as {_quoted(data)}; expected {expected}; {hint}"
    found = f"found bytes such as {data[:_BYTES_SHOWN].hex(' ').upper()}"
    if data.count(HEADER) > 1 + len(data) // 1000:
        if spec.format == "lines":
            return f"{found}; expected {expected}; set 'format: frames' in {spec.path}"
        return (
            f"found frame headers AA 55, but no frame whose CRC fits; expected {expected}; "
            f"check the cable, its shield and {baud}"
        )
    likely = " (so few different values: most likely another speed)"
    return f"{found}; expected {expected}; check {baud}" + likely * (len(set(data)) <= _FEW_VALUES)


def _expected(spec: DeviceSpec) -> str:
    count = len(spec.joints)
    if spec.format == "frames":
        return f"frames AA 55 … of {count} joints"
    return f"lines of {count} numbers with commas between"


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
        what = "lines are no lists of numbers" if spec.format == "lines" else "frames are damaged"
        found.append(
            f"{_share(statistics.frame_crc_errors, total)} of {what}; "
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
