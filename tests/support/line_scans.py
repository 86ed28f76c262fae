"""Profiles of a line scanner on a hand, over a ball on a table or over the table alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements.profiles import Profiles, profiles_of

# The scanner in the hand, and what it looks at: in the base, m.
X = rotation_from_vector([0.3, -0.5, 1.2]), np.array([0.03, -0.04, 0.12])
BALL = np.array([0.6, 0.1, 0.2])


@dataclass
class LineScans:
    """What was recorded: poses of the hand as its controller has them, and profiles."""

    rotation: FloatArray
    position: FloatArray
    scans: list[str]
    profiles: Profiles

    def changed(self, scan: str, points: FloatArray) -> Profiles:
        """The profiles with other points in one of them."""
        of = self.profiles
        other = of.scan != scan
        names = np.concatenate([of.scan[other], np.full(len(points), scan)])
        return profiles_of(names, np.concatenate([of.point[other], points]))


def line_scans(
    seed: int,
    *,
    radius: float | None = 0.02,
    count: int = 16,
    hand: float = 2e-4,
    points: float = 3e-5,
    tilt: float = 0.45,
) -> LineScans:
    """Scans of a ball on a table, or of the table alone where no radius is given.

    Args:
        seed: of everything.
        radius: of the ball, m.
        count: of the scans.
        hand: standard deviation of the hand's position per axis, m; of its turn four times that in
            rad per m.
        points: of a point along the beam, m.
        tilt: of the scanner, rad.
    """
    random = np.random.default_rng(seed)
    down = np.diag([1.0, -1.0, -1.0])
    eye = rotation_from_vector(random.uniform(-tilt, tilt, (count, 3))) @ down
    at = np.column_stack(
        [
            random.uniform(-0.02, 0.02, count),
            random.uniform(-0.75, 0.75, count) * (radius or 0.02),
            random.uniform(0.12, 0.2, count),
        ]
    )
    origin = BALL - np.einsum("nij,nj->ni", eye, at)
    x = np.linspace(-0.05, 0.05, 240)
    # The table, a radius below the ball's centre.
    height = (origin[:, 2] - BALL[2] + (radius or 0.0))[:, None] + eye[:, 2, :1] * x
    z = -height / eye[:, 2, 2:]
    if radius is not None:
        section = np.sqrt(np.maximum(radius**2 - at[:, 1:2] ** 2, 0.0))
        aside = np.abs(x - at[:, :1])
        on_ball = at[:, 2:] - np.sqrt(np.maximum(section**2 - aside**2, 0.0))
        z = np.where(aside < 0.95 * section, on_ball, z)
    z = z + points * random.standard_normal(z.shape)
    rotation = eye @ X[0].T
    position = origin - rotation @ X[1]
    turn = 4.0 * hand * random.standard_normal((count, 3))
    position = position + hand * random.standard_normal((count, 3))
    names = [f"s{k}" for k in range(count)]
    of_points = np.stack([np.tile(x, (count, 1)), z], axis=2).reshape(-1, 2)
    profiles = profiles_of(np.repeat(names, len(x)), of_points)
    return LineScans(rotation @ rotation_from_vector(turn), position, names, profiles)
