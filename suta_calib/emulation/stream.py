"""The device an emulated arm is, and the bytes it sends, and when: no port, no clock.

The bytes are the same for the same seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.device.description import FRAME_COUNTS_PER_TURN, DeviceSpec, JointSpec
from suta_calib.device.formats import FORMATS, Sample, format_of
from suta_calib.display import Displayable
from suta_calib.emulation.faults import Damage, Faults, Flag
from suta_calib.emulation.motion import ExtraNumbers, Motion
from suta_calib.errors import InputError

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel

# Old frames come when the host has flushed and begun to read: this long after the opening, s,
# with the clock of this long ago, from an arm that has been turned by this much since, rad.
STALE_AFTER: Final = 0.03
STALE_AGE: Final = 5.0
STALE_TURN: Final = 0.3


# What device.yaml says of such a device.
EMULATED: Final = "An emulated arm: there is no hardware behind this port."


def device_of(
    arm: ArmModel,
    *,
    form: str = "frames",
    unit: str = "counts",
    counts_per_turn: int = FRAME_COUNTS_PER_TURN,
    signs: Sequence[int] = (),
    baudrate: int = 921600,
    extra_columns: Sequence[str] = (),
) -> DeviceSpec:
    """One encoder for each joint of an arm, from base to tip; it has no port yet.

    Args:
        arm: whose joints.
        form: one of `FORMATS`.
        unit: of lines: ``counts``, ``rad`` or ``deg``.
        counts_per_turn: of one turn, in counts.
        signs: +1 or -1 for each joint; all +1 by default.
        baudrate: for ``device.yaml``: a pseudo-terminal has none.
        extra_columns: names of what is sent after the joints.

    Raises:
        InputError: a unit or counts that the format cannot have, a number of signs that is not that
            of the joints, a joint that slides where angles are sent, or a format of joints only.
    """
    if extra_columns and not FORMATS[form].extra_columns:
        capable = " or ".join(name for name, other in FORMATS.items() if other.extra_columns)
        raise InputError(f"{form} with {', '.join(extra_columns)}", capable, where="format")
    if (refused := FORMATS[form].refusal(unit, counts_per_turn)) is not None:
        description = f"{form} with {counts_per_turn} counts per turn, in {unit}"
        raise InputError(description, refused[1], where=refused[0])
    for joint in arm.readings:
        if joint.type == "prismatic" and unit != "rad":
            raise InputError(
                f"prismatic joint {joint.name!r}",
                "revolute joints: an encoder word is an angle",
                file=arm.chain.path,
                line=joint.line,
                hint="send it as lines in rad, which also contain lengths in metres",
            )
    chosen = list(signs) or [1] * len(arm.joints)
    if len(chosen) != len(arm.joints):
        raise InputError(f"{len(chosen)} signs", f"{len(arm.joints)}, one per joint")
    joints = tuple(map(JointSpec, arm.joints, chosen))
    extra = tuple(extra_columns)
    return DeviceSpec(Path("device.yaml"), "", baudrate, form, unit, counts_per_turn, joints, extra)


@dataclass(frozen=True, eq=False)
class Emulation(Displayable):
    """Everything about an emulated arm but the port.

    Attributes:
        device: names, signs and format of what it sends.
        motion: what the arm does.
        rate: frames per second.
        noise: standard deviation of a reading, rad (m): one number, or (joints,).
        faults: what goes wrong.
        seed: of noise and faults.
        first_sequence: of the frame when the device is switched on.
        first_time_us: of the device's clock then, µs.
        extra: what the device sends beside the joints.
    """

    device: DeviceSpec
    motion: Motion
    rate: float = 768.0
    noise: float | FloatArray = 1.7e-5
    faults: Faults = field(default_factory=Faults)
    seed: int = 0
    first_sequence: int = 0
    first_time_us: int = 0
    extra: ExtraNumbers | None = None

    def __post_init__(self) -> None:
        if not 0 < self.rate <= 1e5:
            raise InputError(f"{self.rate:g} Hz", "a rate up to 100000 Hz")
        names = self.device.names
        self.faults.check_joints(names)
        joints = self.motion.readings(np.zeros(1)).shape[1]
        if joints != len(names):
            raise InputError(f"a motion of {joints} joints", f"the {len(names)} of the device")
        extra, columns = self.extra.columns if self.extra else (), self.device.extra_columns
        if extra != columns:
            raise InputError(f"numbers {', '.join(extra) or 'none'}", f"those of {columns}")

    def time_us(self, period: int) -> int:
        """The device's clock that many periods after it was switched on, µs, not wrapped."""
        return self.first_time_us + round(1e6 * period / self.rate)


def frames(emulation: Emulation, seconds: float = math.inf) -> Iterator[tuple[float, bytes]]:
    """What an arm sends: when (s after the start, non-decreasing), and the bytes.

    Args:
        emulation: the arm.
        seconds: how long.
    """
    for due, data in packets(emulation):
        if due >= seconds:
            return
        if data:
            yield due, data


def packets(
    emulation: Emulation,
    first_period: int = 0,
    motion_time: Callable[[FloatArray], FloatArray] | None = None,
    log: Callable[[FloatArray, FloatArray], None] | None = None,
) -> Iterator[tuple[float, bytes]]:
    """One packet for every period: when it is due, and its bytes, empty where nothing is sent.

    Args:
        emulation: the arm.
        first_period: periods that passed since the device was switched on.
        motion_time: from time on this stream, (n,) s, to time of a motion that is held up.
        log: told of every block: times of the motion (n,), and true readings (n, joints).
    """
    block = 32  # frames that are computed ahead: 40 ms at 768 Hz
    source = _Source(emulation, first_period)
    for number in count(0, block):
        time = np.arange(number, number + block) / emulation.rate
        at = motion_time(time) if motion_time else time
        true = emulation.motion.readings(at)
        if log:
            log(at, true)
        yield from source.block(number, time, at, true)


class _Source:
    """Turns true readings into packets; keeps the random numbers in step with the frames."""

    def __init__(self, emulation: Emulation, first_period: int) -> None:
        self._emulation, self._first = emulation, first_period
        self._encoder = format_of(emulation.device).encoder(emulation.device)
        self._noise = np.random.default_rng([emulation.seed, 1])
        self._extra_noise = np.random.default_rng([emulation.seed, 3])
        self._skips = np.random.default_rng([emulation.seed, 2])
        self._damage = Damage(emulation.faults, emulation.seed)
        self._stale_at = math.ceil(STALE_AFTER * emulation.rate)
        self._stale: NDArray[Any] | None = None

    def block(
        self, number: int, time: FloatArray, at: FloatArray, true: FloatArray
    ) -> list[tuple[float, bytes]]:
        """Packets from ``number`` on, as many as there are times of the stream and the motion."""
        emulation = self._emulation
        noise = np.broadcast_to(emulation.noise, true.shape[1:])
        readings = true + noise * self._noise.standard_normal(true.shape)
        if self._stale is None:
            self._stale = self._encoder.values(readings[:1] + STALE_TURN)[0]
        values = self._encoder.values(readings)
        extra = np.zeros((len(time), 0))
        if emulation.extra is not None:
            extra = emulation.extra.readings(at)
            noise = self._extra_noise.standard_normal(extra.shape)
            extra = extra + emulation.extra.noise * noise
        skipped = self._skips.random(len(time)) < emulation.faults.skip
        packets = []
        for k, t in enumerate(time.tolist()):
            data = b"" if skipped[k] else self._packet(number + k, t, values[k], extra[k])
            # What is held back is sent later.
            held = [window.end for window in emulation.faults.holds if t in window]
            packets.append((max([t, *held]), data))
        return packets

    def _packet(self, number: int, time: float, values: NDArray[Any], extra: FloatArray) -> bytes:
        faults = self._emulation.faults
        firsts = (math.ceil(gap.start * self._emulation.rate) for gap in faults.gaps)
        if any(0 <= number - n < g.count for n, g in zip(firsts, faults.gaps, strict=True)):
            return b""
        if any(time in window for window in (*faults.stalls, *faults.absences)):
            return b""
        if faults.stale and number <= self._stale_at:
            return self._old_frames() if number == self._stale_at else b""
        error, warning = self._flags(faults.errors, time), self._flags(faults.warnings, time)
        sample = Sample(*self._clock(number, time), values, error, warning, extra)
        data = self._encoder.packet(sample)
        if any(time in window for window in faults.bursts):
            return self._damage.garbage(len(data))
        return self._damage(data)

    def _clock(self, number: int, time: float) -> tuple[int, int]:
        """Sequence number and device clock, µs; anew after a reboot."""
        emulation = self._emulation
        ends = [window.end for window in emulation.faults.reboots if window.end <= time]
        if ends:
            period = number - math.ceil(max(ends) * emulation.rate)
            return period, round(1e6 * period / emulation.rate)
        period = self._first + number
        return emulation.first_sequence + period, emulation.time_us(period)

    def _old_frames(self) -> bytes:
        assert self._stale is not None
        none = self._flags((), 0.0)
        age = round(STALE_AGE * self._emulation.rate)
        numbers = range(-age, self._emulation.faults.stale - age)
        extra = np.zeros(len(self._emulation.device.extra_columns))
        samples = (Sample(*self._clock(n, 0.0), self._stale, none, none, extra) for n in numbers)
        return b"".join(map(self._encoder.packet, samples))

    def _flags(self, flags: Sequence[Flag], time: float) -> BoolArray:
        raised = {flag.joint for flag in flags if time in flag.window}
        return np.array([name in raised for name in self._emulation.device.names])
