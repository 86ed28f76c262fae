"""An arm that is swept by hand, as readings without any port."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from device_stand_in import POSTURE, reading

from suta_calib.acquisition.sweep import Moment, Moments, PostureDistance, thinned
from suta_calib.acquisition.sweep_contact import Surface, TipContact, contact
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.emulation import HandSweep, swept_by_hand
from suta_calib.emulation.faults import Faults
from suta_calib.emulation.motion import Motion
from suta_calib.emulation.truth import drawn_truth
from suta_calib.model.arm import ArmModel
from suta_calib.terms import KINDS

URDF = Path(__file__).parents[2] / "urdf" / "suta.urdf"
SEAT = 1e-4


@cache
def suta() -> ArmModel:
    return ArmModel.from_urdf(URDF, "tip")


@cache
def hand_motion(
    seed: int = 1, faults: str = "", seconds: float = 24.0, size: float = 0.0, seat: float = SEAT
) -> Motion:
    """The SUTA with its tip in a socket, or on a plate; it is not as its URDF says."""
    both = Faults.parse(faults)
    how = HandSweep(0.5, size, seconds, seating=seat, lifts=both.lifts, slips=both.slips)
    truth = drawn_truth(suta(), seed)
    return swept_by_hand(suta(), truth, how, posture=POSTURE, seed=seed)


def hand_readings(motion: Motion, rate: float = 768.0, noise: float = 1.7e-5) -> list[Reading]:
    time = np.arange(0.0, motion.end, 1.0 / rate)
    q = motion.readings(time)
    q = q + noise * np.random.default_rng(0).standard_normal(q.shape)
    return [reading(row, t, k) for k, (row, t) in enumerate(zip(q, time.tolist(), strict=True))]


def moments_of(readings: list[Reading]) -> list[Moment]:
    source = Moments()
    return [*source.feed(readings), *source.rest()]


def postures_of(moments: list[Moment]) -> tuple[FloatArray, FloatArray]:
    """Which moments count, and their strokes."""
    return thinned(PostureDistance(suta()), moments, [True] * len(moments))


def contact_of(moments: list[Moment], kind: str = "fixed_point") -> TipContact:
    return contact(Surface(suta(), KINDS[kind], {}), moments, *postures_of(moments))
