"""Readings of a simulated arm: rests joined by smooth motions, without any port."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from suta_calib.acquisition.replay import RecordingEnded
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import Artefact
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, Targets

RATE = 768.0
NOISE = 2e-5
PLACE = np.array([0.45, 0.0, 0.0])
POSTURE = np.radians([15, 175, 160, 110, -90, -125])


@dataclass
class Script:
    """Postures over time; ``readings`` makes the stream of them."""

    start: FloatArray
    rate: float = RATE
    noise: float = NOISE
    seed: int = 0
    angles: list[FloatArray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.now = np.array(self.start, dtype=float)

    def rest(self, seconds: float) -> Script:
        self.angles += [self.now] * round(seconds * self.rate)
        return self

    def move(self, to: Sequence[float] | FloatArray, seconds: float = 0.8) -> Script:
        s = np.linspace(0, 1, round(seconds * self.rate))
        blend = 10 * s**3 - 15 * s**4 + 6 * s**5
        way = wrap(np.asarray(to, dtype=float) - self.now)
        self.angles += [self.now + b * way for b in blend]
        self.now = np.array(to, dtype=float)
        return self

    def readings(self) -> list[Reading]:
        random = np.random.default_rng(self.seed)
        exact = np.array(self.angles)
        noisy = wrap(exact + self.noise * random.standard_normal(exact.shape))
        return [reading(row, k / self.rate, k) for k, row in enumerate(noisy)]


def reading(
    angles: Sequence[float] | FloatArray, time: float, sequence: int = 0, flags: Sequence[int] = ()
) -> Reading:
    error = np.zeros(len(angles), dtype=bool)
    error[list(flags)] = True
    return Reading(
        sequence, time, np.array(angles, dtype=float), error, np.zeros(len(angles), bool), time
    )


def postures_on(arm: ArmModel, artefact: Artefact) -> dict[str, FloatArray]:
    """Readings on every landmark of an artefact, of an arm that is a little off its URDF."""
    marks = artefact.landmarks
    truth = {"joint_2.offset": 0.004, "joint_4.z": arm.parameters["joint_4.z"].nominal + 0.002}
    targets = Targets(
        np.array([mark.position for mark in marks.values()]) + PLACE,
        np.array([mark.rotation for mark in marks.values()]),
    )
    found = InverseKinematics(arm, truth).solve(targets, POSTURE, np.random.default_rng(0))
    assert found.reached.all()
    return dict(zip(marks, found.q, strict=True))


class Replay:
    """A source of readings that have all been made beforehand; of none it is a silent device."""

    def __init__(self, readings: Sequence[Reading], piece: int = 40) -> None:
        self._readings, self._piece, self._next = readings, piece, 0

    def read(self, timeout: float = 0.1) -> list[Reading]:
        del timeout
        if self._readings and self._next >= len(self._readings):
            raise RecordingEnded
        first, self._next = self._next, self._next + self._piece
        return list(self._readings[first : self._next])
