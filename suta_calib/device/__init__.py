"""Encoders on a cable: their description, their bytes, their port.

Names are imported when they are first used: a process that only reads a port starts at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.device.bus import Bus
    from suta_calib.device.description import DeviceSpec, JointSpec, read_device
    from suta_calib.device.formats import Decoder, decoder_for, encode_frame, encode_line
    from suta_calib.device.formats.words import frame_crc
    from suta_calib.device.monitoring import Monitor, stream_report, watch
    from suta_calib.device.reading import Reading, Statistics
    from suta_calib.device.units import angles_from_counts

_HOMES = {
    "bus": ("Bus",),
    "description": ("DeviceSpec", "JointSpec", "read_device"),
    "formats": (
        "FORMATS",
        "Decoder",
        "Encoder",
        "Format",
        "decoder_for",
        "encode_frame",
        "encode_line",
    ),
    "formats.words": ("frame_crc",),
    "monitoring": ("Monitor", "stream_report", "watch"),
    "reading": ("Reading", "Statistics"),
    "units": ("angles_from_counts",),
}

__all__ = [
    "FORMATS",
    "Bus",
    "Decoder",
    "DeviceSpec",
    "Encoder",
    "Format",
    "JointSpec",
    "Monitor",
    "Reading",
    "Statistics",
    "angles_from_counts",
    "decoder_for",
    "encode_frame",
    "encode_line",
    "frame_crc",
    "read_device",
    "stream_report",
    "watch",
]

__getattr__ = lazily(__name__, _HOMES)
