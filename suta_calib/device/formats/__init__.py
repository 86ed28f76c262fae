"""The formats that a device may send, by the names they have in device.yaml."""

from __future__ import annotations

from typing import Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats.base import Decoder, Encoder, Format, Sample
from suta_calib.device.formats.frames import encode_frame
from suta_calib.device.formats.lines import encode_line
from suta_calib.registry import all_classes

__all__ = [
    "FORMATS",
    "Decoder",
    "Encoder",
    "Format",
    "Sample",
    "decoder_for",
    "encode_frame",
    "encode_line",
    "format_of",
]

FORMATS: Final[dict[str, Format]] = {
    name: form() for name, form in all_classes("device_formats", Format, __name__).items()
}


def format_of(spec: DeviceSpec) -> Format:
    """The format that ``device.yaml`` names."""
    return FORMATS[spec.format]


def decoder_for(spec: DeviceSpec) -> Decoder:
    """A decoder of what this device sends."""
    return format_of(spec).decoder(spec)
