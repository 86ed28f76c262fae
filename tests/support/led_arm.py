"""An arm on a port that goes where a test leads it, and stays there: nothing hangs on the clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.device.device_file import device_text
from suta_calib.emulation.motion import Motion, minimum_jerk
from suta_calib.emulation.stream import Emulation, device_of, packets
from suta_calib.emulation.terminal import PseudoTerminal
from suta_calib.model.arm import ArmModel


class Led(Motion):
    """Rests until it is told to go elsewhere, and goes there by the clock of its device.

    Attributes:
        goal: (joints,) where it goes, rad; set from another thread.
    """

    def __init__(self, posture: FloatArray) -> None:
        self.goal = self._from = self._to = posture
        self._begin = 0.0

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) at times (n,), later from call to call."""
        goal = self.goal
        if goal is not self._to:
            self._from, self._to, self._begin = self._at(time[:1])[0], goal, float(time[0])
        return self._at(time)

    def _at(self, time: FloatArray) -> FloatArray:
        move_s = 0.5
        share = minimum_jerk(np.clip((time - self._begin) / move_s, 0.0, 1.0))
        return np.asarray(self._from + share[:, None] * (self._to - self._from))


class LedArm:
    """Its port, and whoever leads it; a context manager.

    Args:
        arm: whose joints.
        postures: (joints,) readings by name, rad.
        folder: where `device` is written.
    """

    def __init__(self, arm: ArmModel, postures: Mapping[str, FloatArray], folder: Path) -> None:
        self._postures = postures
        self._motion = Led(next(iter(postures.values())) + 0.1)
        device = replace(device_of(arm), port=str(folder / "port"))
        self._emulation = Emulation(device, self._motion, rate=256.0)
        self._terminal = PseudoTerminal(folder / "port")
        self._plugged, self._over = True, False
        self.device = folder / "device.yaml"
        self.device.write_text(device_text(device, "An arm that a test leads."))
        self._thread = threading.Thread(target=self._play, daemon=True)

    def __enter__(self) -> Self:
        self._terminal.__enter__()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()
        self._terminal.close()

    def go(self, name: str, off: FloatArray | float = 0.0) -> None:
        """To a posture, or so far from it, rad."""
        self._motion.goal = self._postures[name] + off

    def plug(self, plugged: bool) -> None:
        """Pull the cable out, or plug it in."""
        self._plugged = plugged

    def _play(self) -> None:
        began, open_now = time.perf_counter(), True
        for due, packet in packets(self._emulation):
            while (early := began + due - time.perf_counter()) > 0:
                time.sleep(early)
            if self._plugged != open_now:
                open_now = self._plugged
                (self._terminal.open if open_now else self._terminal.close)()
            # A reader that lags loses nothing.
            while not self._over and self._terminal.heard() and not self._terminal.write(packet):
                time.sleep(0.002)
            if self._over:
                return
