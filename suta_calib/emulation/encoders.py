"""From angles to what a device sends, frame by frame or line by line."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.device.description import DeviceSpec
from suta_calib.device.protocol import (
    counts_from_angles,
    encode_frame,
    encode_line,
    values_from_angles,
)


class Encoder(Protocol):
    """One format of a device."""

    def values(self, angles: FloatArray) -> NDArray[Any]:
        """What is sent for angles (n, joints), rad: as many values."""

    def packet(
        self,
        sequence: int,
        time_us: int,
        values: NDArray[Any],
        error: BoolArray,
        warning: BoolArray,
    ) -> bytes:
        """The bytes of one sample."""


class FrameEncoder:
    """Binary frames with sequence number, clock, flags and checksums."""

    def __init__(self, device: DeviceSpec) -> None:
        self._device = device

    def values(self, angles: FloatArray) -> NDArray[Any]:
        """Positions in counts."""
        return np.asarray(counts_from_angles(self._device, angles))

    def packet(
        self,
        sequence: int,
        time_us: int,
        values: NDArray[Any],
        error: BoolArray,
        warning: BoolArray,
    ) -> bytes:
        """One frame."""
        return encode_frame(sequence, time_us, values.tolist(), error, warning)


class LineEncoder:
    """Lines of text, which carry neither clock nor flags."""

    def __init__(self, device: DeviceSpec) -> None:
        self._device = device

    def values(self, angles: FloatArray) -> NDArray[Any]:
        """Counts, or signed angles in (-π, π], in the device's unit."""
        return np.asarray(values_from_angles(self._device, angles))

    def packet(
        self,
        sequence: int,
        time_us: int,
        values: NDArray[Any],
        error: BoolArray,
        warning: BoolArray,
    ) -> bytes:
        """One line."""
        del sequence, time_us, error, warning
        return encode_line(values.tolist(), self._device)


def encoder_for(device: DeviceSpec) -> Encoder:
    """The format a device is described to send."""
    return FrameEncoder(device) if device.format == "frames" else LineEncoder(device)
