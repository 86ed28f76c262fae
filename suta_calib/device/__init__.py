"""Encoders on a cable: their description, their bytes, their port."""

from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec, JointSpec, read_device
from suta_calib.device.protocol import Decoder, decoder_for
from suta_calib.device.reading import Reading, Statistics

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
