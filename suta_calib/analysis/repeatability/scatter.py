"""How far visits to one point scatter: of the tip, of its orientation, and of every joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.analysis.repeatability.intervals import ScatterEstimate, spread
from suta_calib.arrays import FloatArray
from suta_calib.units import Unit

# ISO 9283: thirty cycles; and how many standard deviations make a repeatability.
CYCLES: Final = 30
SIGMAS: Final = 3.0
LEAST_VISITS: Final = 3


@dataclass(frozen=True)
class PositionScatter:
    """Position repeatability of the tip, ISO 9283:1998, 7.2.2: all lengths in m.

    Attributes:
        count: visits.
        barycentre: (3,) mean position, in the base.
        mean: mean distance to the barycentre.
        std: of these distances, about their mean, with n - 1.
        rp: ``mean + 3 std``, the standard's RP.
        rms: root mean square of the distances.
        maximum: the largest of them.
        axis_std: (3,) standard deviation along the base's axes, with n - 1.
    """

    count: int
    barycentre: tuple[float, float, float]
    mean: float
    std: float
    rp: ScatterEstimate
    rms: ScatterEstimate
    maximum: float
    axis_std: tuple[float, float, float]

    @classmethod
    def of(cls, position: FloatArray) -> PositionScatter:
        """Of positions (n, 3), n at least three."""
        centre, sides = position.mean(axis=0), position.std(axis=0, ddof=1)
        size = distances(position)
        return cls(
            len(position),
            (float(centre[0]), float(centre[1]), float(centre[2])),
            float(size.mean()),
            float(size.std(ddof=1)),
            spread(_rp, position),
            spread(_rms, position),
            float(size.max()),
            (float(sides[0]), float(sides[1]), float(sides[2])),
        )


def distances(position: FloatArray) -> FloatArray:
    """Distance (n,) of each position (n, 3) to their barycentre, m."""
    return np.asarray(np.linalg.norm(position - position.mean(axis=0), axis=1))


def _rp(position: FloatArray) -> float:
    size = distances(position)
    return float(size.mean() + SIGMAS * size.std(ddof=1))


def _rms(position: FloatArray) -> float:
    return float(np.sqrt(np.mean(distances(position) ** 2)))


@dataclass(frozen=True)
class OrientationScatter:
    """Orientation repeatability of the tip, ISO 9283:1998, 7.2.2: angles in rad.

    Attributes:
        rpa, rpb, rpc: three standard deviations of the turn about the tip's x, y and z axis away
            from the mean orientation (the standard states them with ±).
        rms: root mean square of the whole angle.
    """

    rpa: float
    rpb: float
    rpc: float
    rms: float

    @classmethod
    def of(cls, rotation: FloatArray) -> OrientationScatter:
        """Of orientations (n, 3, 3), n at least two."""
        turns = Rotation.from_matrix(rotation)
        away = (turns.mean().inv() * turns).as_rotvec()
        a, b, c = SIGMAS * away.std(axis=0, ddof=1)
        rms = np.sqrt(np.mean(np.sum(away**2, axis=1)))
        return cls(float(a), float(b), float(c), float(rms))


@dataclass(frozen=True)
class JointScatter:
    """How far one joint's readings scatter, rad (m for a prismatic joint).

    Attributes:
        joint: its name.
        unit: rad or m.
        mean: on the circle.
        std: with n - 1; three of them are its repeatability.
        peak_to_peak: from the smallest to the largest.
        tip: what one standard deviation moves the tip, m.
    """

    joint: str
    unit: Unit
    mean: float
    std: ScatterEstimate
    peak_to_peak: float
    tip: float


def joint_scatter(joint: str, unit: Unit, readings: FloatArray, lever: float) -> JointScatter:
    """Of readings (n,), n at least three; ``lever`` is how far a unit moves the tip, m."""
    mean, away = deviations(readings, unit)
    std = spread(_std, away)
    return JointScatter(joint, unit, mean, std, float(np.ptp(away)), lever * std.value)


def _std(values: FloatArray) -> float:
    return float(values.std(ddof=1))


def deviations(readings: FloatArray, unit: Unit) -> tuple[float, FloatArray]:
    """Mean of readings (n,) and what each deviates from it (n,): for angles on the circle.

    Args:
        readings: rad, within less than half a turn of each other, across ±π or not; or m.
        unit: ``rad`` or ``m``.
    """
    if unit == "m":
        return float(readings.mean()), readings - readings.mean()
    middle = float(np.angle(np.mean(np.exp(1j * readings))))
    away = np.angle(np.exp(1j * (readings - middle)))
    return float(np.angle(np.exp(1j * (middle + away.mean())))), away - away.mean()


def median_angle(readings: FloatArray) -> float:
    """An angle in the middle of most readings (n,), rad, wherever on the circle they lie."""
    return float(np.angle(np.median(np.cos(readings)) + 1j * np.median(np.sin(readings))))
