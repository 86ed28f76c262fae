"""Encoders on a cable: their description, their bytes, their port.

Names are imported when they are first used: a process that only reads a port starts at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.device.bus import Bus
    from suta_calib.device.description import DeviceSpec, JointSpec, read_device
    from suta_calib.device.formats import Decoder, decoder_for
    from suta_calib.device.monitoring import Monitor, stream_report, watch
    from suta_calib.device.reading import Reading, Statistics

_HOMES = {
    "bus": ("Bus",),
    "description": ("DeviceSpec", "JointSpec", "read_device"),
    "formats": ("FORMATS", "Decoder", "Encoder", "Format", "decoder_for"),
    "monitoring": ("Monitor", "stream_report", "watch"),
    "reading": ("Reading", "Statistics"),
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
    "decoder_for",
    "read_device",
    "stream_report",
    "watch",
]

__getattr__ = lazily(__name__, _HOMES)
