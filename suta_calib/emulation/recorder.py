"""What an emulated arm truly did while it was streaming."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.emulation.stream import Emulation


@dataclass(frozen=True, eq=False)
class TrueTrajectory:
    """True readings at the time stamps of the frames, sent or not.

    Attributes:
        time: (n,) device clock, s, not wrapped; a reboot does not show in it.
        motion_time: (n,) time of the motion, s.
        q: (n, joints) true readings, without noise, rad (m).
    """

    time: FloatArray
    motion_time: FloatArray
    q: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    def at(self, time: FloatArray) -> FloatArray:
        """(n, joints) true readings at times of the device's clock (n,), s, interpolated."""
        columns = [np.interp(time, self.time, column) for column in self.q.T]
        return np.stack(columns, axis=-1)


class Recorder:
    """Collects a trajectory block by block.

    Args:
        emulation: the arm.
        first_period: of its stream.
    """

    def __init__(self, emulation: Emulation, first_period: int = 0) -> None:
        self._emulation, self._first = emulation, first_period
        self._blocks: list[tuple[int, FloatArray, FloatArray]] = []

    def __call__(self, number: int, motion_time: FloatArray, q: FloatArray) -> None:
        """Take the next block: number of its first frame, times and readings."""
        self._blocks.append((number, motion_time, q))

    def trajectory(self, count: int) -> TrueTrajectory:
        """The first ``count`` frames: what is computed ahead has not happened."""
        joints = len(self._emulation.device.joints)
        first = self._first
        numbers: NDArray[np.int64] = np.arange(first, first + count)
        time = np.array([self._emulation.time_us(int(number)) for number in numbers]) / 1e6
        at = np.concatenate([np.empty(0), *(block[1] for block in self._blocks)])
        q = np.concatenate([np.empty((0, joints)), *(block[2] for block in self._blocks)])
        return TrueTrajectory(time, at[:count], q[:count])
