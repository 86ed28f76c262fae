"""Servos on a bus, which say where they are when they are asked: Dynamixel and Feetech.

Their maker's library speaks the protocol; it is asked in the process that reads the port, and what
it answers goes on as lines of counts. Nothing is ever written to a servo: torque, limits and
offsets stay as they are.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import ClassVar, Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats.lines import LinesFormat
from suta_calib.device.port import Port
from suta_calib.errors import DeviceSilentError, DisconnectedError
from suta_calib.optional_packages import load

EXTRA: Final = "servo"
# So long one may be silent before it is gone, s: a packet is lost now and then.
_SILENT_S: Final = 1.0


class ServoPort(Port):
    """A bus of servos as a port that gives a line of counts for each time they were all asked.

    Raises:
        DeviceSilentError: a servo does not answer.
        MissingExtraError: the library is not installed.
        PortNotFoundError, PortBusyError, PortPermissionError, DeviceFileError: as `Port`.
    """

    def __init__(self, spec: DeviceSpec, form: ServoFormat) -> None:
        sdk = load("dynamixel_sdk", EXTRA)
        super().__init__(spec)
        self._spec, self._form, self._success = spec, form, sdk.COMM_SUCCESS
        self._numbers = [
            k if joint.number is None else joint.number for k, joint in enumerate(spec.joints, 1)
        ]
        # How long bytes of an answer may be waited for at once, s; what the library does else is to
        # look again and again.
        self._serial.timeout = 0.002
        # The port is open already: with this package's errors, and whatever URL it has.
        self._handler = sdk.PortHandler(spec.port)
        self._handler.ser, self._handler.is_open = self._serial, True
        self._handler.tx_time_per_byte = 1e4 / spec.baudrate
        self._packets = sdk.PacketHandler(form.protocol)
        self._begun = False
        for number, joint in zip(self._numbers, spec.joints, strict=True):
            if not self._answers(number):
                self.close()
                raise DeviceSilentError(
                    f"{spec.port}: no answer from servo {number} ({joint.name}); expected an "
                    f"answer from each servo that {spec.path} lists; check its cable, its "
                    f"number, the power of the bus, 'format: {form.name}' and 'baudrate: "
                    f"{spec.baudrate}'"
                )
        # Each by itself: one that misses a packet is not to blame for another that is gone.
        self._heard = dict.fromkeys(self._numbers, time.perf_counter())

    def _answers(self, number: int) -> bool:
        """Whether a servo is heard within the time that one may be silent."""
        end = time.perf_counter() + _SILENT_S
        while isinstance(self._position(number), str):
            if time.perf_counter() > end:
                return False
        return True

    def read(self, timeout: float) -> bytes:
        """A line of counts; none where a servo did not answer.

        Raises:
            DisconnectedError: the port is gone, or a servo has not answered for long.
        """
        del timeout
        counts = list[int]()
        for number in self._numbers:
            answer = self._position(number)
            if isinstance(answer, str):
                if time.perf_counter() - self._heard[number] > _SILENT_S:
                    raise DisconnectedError(
                        f"{self._spec.port}: servo {number} does not answer any more ({answer}); "
                        "check its cable and its power supply"
                    )
                return b""
            counts.append(answer)
            self._heard[number] = time.perf_counter()
        self.arrived = time.perf_counter()
        # What comes before the first end of a line would be taken for half a line.
        before, self._begun = b"" if self._begun else b"\n", True
        return before + ",".join(map(str, counts)).encode() + b"\n"

    def _position(self, number: int) -> int | str:
        """Where a servo is, counts, or why that is not known."""
        form = self._form
        try:
            data, result, _ = self._packets.readTxRx(self._handler, number, form.address, form.size)
        except self._failures as error:
            raise self._gone(error) from None
        finally:
            # The library keeps it for itself where an answer was cut off.
            self._handler.is_using = False
        if result != self._success or len(data) != form.size:
            return str(self._packets.getTxRxResult(result)).strip()
        return form.position(bytes(data))


class ServoFormat(LinesFormat, ABC):
    """Servos of one maker.

    Attributes:
        protocol: version of Dynamixel's protocol that they speak.
        address, size: where the present position is, and of how many bytes.
    """

    units: ClassVar[tuple[str, ...]] = ("counts",)
    extra_columns: ClassVar[bool] = False
    counts_per_turn: ClassVar[int | None] = 4096
    baudrate: ClassVar[int] = 1_000_000
    asked: ClassVar[bool] = True
    protocol: ClassVar[float]
    address: ClassVar[int]
    size: ClassVar[int]

    def port(self, spec: DeviceSpec) -> Port:
        """What asks them."""
        return ServoPort(spec, self)

    @abstractmethod
    def position(self, data: bytes) -> int:
        """The counts in a servo's register."""

    def recognises(self, data: bytes) -> bool:
        """Never: they say nothing by themselves."""
        del data
        return False


class DynamixelFormat(ServoFormat):
    """Dynamixel with protocol 2.0: the X series, MX(2.0), P and Y."""

    name: ClassVar[str] = "dynamixel"
    protocol: ClassVar[float] = 2.0
    address: ClassVar[int] = 132
    size: ClassVar[int] = 4

    def position(self, data: bytes) -> int:
        """Signed: several turns, and homing offsets, lead below zero."""
        return int.from_bytes(data, "little", signed=True)


class FeetechFormat(ServoFormat):
    """Feetech's STS and SMS series, which answer packets of Dynamixel's protocol 1.0."""

    name: ClassVar[str] = "feetech"
    protocol: ClassVar[float] = 1.0
    address: ClassVar[int] = 56
    size: ClassVar[int] = 2

    def position(self, data: bytes) -> int:
        """Magnitude, and the sign in the highest bit."""
        number = int.from_bytes(data, "little")
        return -(number & 0x7FFF) if number & 0x8000 else number
