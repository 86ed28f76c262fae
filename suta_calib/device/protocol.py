"""Bytes ↔ readings, without any port: what every format has in common.

A new format is one class with `Decoder`'s two methods and a row in `decoder_for`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from suta_calib.device.description import DeviceSpec
from suta_calib.device.frame_layout import encode_frame
from suta_calib.device.frames import FramesDecoder
from suta_calib.device.lines import LinesDecoder, encode_line
from suta_calib.device.reading import Reading, Statistics
from suta_calib.device.units import counts_from_angles, values_from_angles

__all__ = [
    "Decoder",
    "counts_from_angles",
    "decoder_for",
    "encode_frame",
    "encode_line",
    "values_from_angles",
]


class Decoder(Protocol):
    """Turns bytes into readings; the pieces they arrive in make no difference.

    Attributes:
        statistics: what has passed through so far.
    """

    statistics: Statistics

    def feed(self, data: bytes, arrival: float) -> list[Reading]:
        """Take the next bytes and give the readings they complete.

        Args:
            data: any number of bytes, cut anywhere.
            arrival: `time.perf_counter` when the last of them had been read, s.

        Raises:
            WrongFormatError: good frames of another number of joints, or counts that do not fit.
        """
        ...

    def resume(self, after: Reading | None) -> None:
        """Begin anew after an interruption: bytes of before do not belong to bytes to come.

        Args:
            after: the last good reading; time goes on from it by this computer's clock, whatever
                the device's clock says, and sequence numbers by one.
        """
        ...


def decoder_for(spec: DeviceSpec) -> Decoder:
    """The decoder of the format that ``device.yaml`` names."""
    decoders: dict[str, Callable[[DeviceSpec], Decoder]] = {
        "frames": FramesDecoder,
        "lines": LinesDecoder,
    }
    return decoders[spec.format](spec)
