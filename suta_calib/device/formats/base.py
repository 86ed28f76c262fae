"""What a format says of itself: how its bytes become readings, and readings become its bytes.

A new format is one file here with a subclass of `Format`, or an entry point of another package in
the group ``suta_calib.device_formats``; nothing else names it.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.device.description import DeviceSpec
from suta_calib.device.port import Port
from suta_calib.device.reading import NO_EXTRA, Reading, Statistics


class Decoder(ABC):
    """Turns bytes into readings; the pieces they arrive in make no difference.

    Args:
        spec: the device.

    Attributes:
        statistics: what has passed through so far.
    """

    def __init__(self, spec: DeviceSpec) -> None:
        self.statistics = Statistics(spec.names)
        self._spec = spec
        self._signs = spec.signs
        self._buffer = bytearray()

    @abstractmethod
    def feed(self, data: bytes, arrival: float) -> list[Reading]:
        """Take the next bytes and give the readings they complete.

        Args:
            data: any number of bytes, cut anywhere.
            arrival: `time.perf_counter` when the last of them had been read, s.

        Raises:
            WrongFormatError: good frames of another number of joints, or counts that do not fit.
        """

    @abstractmethod
    def resume(self, after: Reading | None) -> None:
        """Begin anew after an interruption: bytes of before do not belong to bytes to come.

        Args:
            after: the last good reading; time goes on from it by this computer's clock, whatever
                the device's clock says, and sequence numbers by one.
        """


class Sample(NamedTuple):
    """What a device sends of one moment.

    Attributes:
        sequence: number of the sample.
        time_us: the device's clock, µs.
        values: (joints,) as `Encoder.values` gives them.
        error: (joints,) where the encoder raises its error flag.
        warning: (joints,) the same for its warning flag.
        extra: (m,) numbers of `DeviceSpec.extra_columns`.
    """

    sequence: int
    time_us: int
    values: NDArray[Any]
    error: BoolArray
    warning: BoolArray
    extra: FloatArray = NO_EXTRA


class Encoder(ABC):
    """Turns angles into bytes: what the device would send."""

    def __init__(self, spec: DeviceSpec) -> None:
        self._spec = spec

    def values(self, angles: FloatArray) -> NDArray[np.number]:
        """What is sent for angles (n, joints), rad: as many values."""
        return self._spec.values(angles)

    @abstractmethod
    def packet(self, sample: Sample) -> bytes:
        """The bytes of one sample."""


class Format(ABC):
    """One way in which a device says where its joints are.

    Attributes:
        name: ``format`` in device.yaml.
        decoder, encoder: what its bytes are read and, for an emulated device, made with.
        units: what ``unit`` in device.yaml may be, the default first.
        counts_per_turn: the default of that key; None where lines in counts must say it.
        most_joints: how many joints it can carry; None for any number.
        geared: whether a joint may have a ``ratio`` and ``counts_per_turn`` of its own.
        extra_columns: whether it can carry other numbers than those of joints.
        has_clock: whether it carries the device's own clock and a number for every sample.
        damaged: what samples are called that came damaged, in the plural.
        damage: the same as a predicate: ``5 % of`` …
        near_miss: what was seen where bytes look like this format and none can be believed.
        header: bytes that a sample begins with, where it is binary.
        baudrate: the default of that key.
        asked: whether the device speaks only when it is asked, each joint by its number; then
            `port` asks, and there is nothing to emulate.
    """

    name: ClassVar[str]
    decoder: ClassVar[type[Decoder]]
    encoder: ClassVar[type[Encoder]]
    units: ClassVar[tuple[str, ...]] = ("counts",)
    counts_per_turn: ClassVar[int | None] = None
    most_joints: ClassVar[int | None] = None
    geared: ClassVar[bool] = False
    extra_columns: ClassVar[bool] = False
    has_clock: ClassVar[bool]
    damaged: ClassVar[str]
    damage: ClassVar[str]
    near_miss: ClassVar[str] = ""
    header: ClassVar[bytes] = b""
    baudrate: ClassVar[int] = 921600
    asked: ClassVar[bool] = False

    def port(self, spec: DeviceSpec) -> Port:
        """What gives the bytes, opened.

        Raises:
            SutaCalibError: as `Port`.
        """
        return Port(spec)

    @abstractmethod
    def expected(self, numbers: int) -> str:
        """What bytes of a device should be, in words: with so many joints and extra columns."""

    @abstractmethod
    def recognises(self, data: bytes) -> bool:
        """Whether these bytes are likelier to be of this format than noise."""

    def refusal(self, unit: str, counts_per_turn: int) -> tuple[str, str] | None:
        """The key of device.yaml that this format cannot have, and what it expects there."""
        del counts_per_turn
        return None if unit in self.units else ("unit", " or ".join(self.units))


def is_text(data: bytes) -> bool:
    """Whether these bytes are printable ASCII."""
    return re.fullmatch(rb"[\t\r\n\x20-\x7e]*", data) is not None
