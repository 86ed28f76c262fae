"""Encoders on a cable: their description, their bytes, their port.

Names are imported when they are first used: a process that only reads a port starts at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from suta_calib.device.bus import Bus
    from suta_calib.device.description import DeviceSpec, JointSpec, read_device
    from suta_calib.device.protocol import Decoder, decoder_for
    from suta_calib.device.reading import Reading, Statistics

_HOMES = {
    "bus": ("Bus",),
    "description": ("DeviceSpec", "JointSpec", "read_device"),
    "protocol": ("Decoder", "decoder_for"),
    "reading": ("Reading", "Statistics"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Bus",
    "Decoder",
    "DeviceSpec",
    "JointSpec",
    "Reading",
    "Statistics",
    "decoder_for",
    "read_device",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'suta_calib.device' has no attribute '{name}'")
    return getattr(import_module(f"suta_calib.device.{_HOME[name]}"), name)
