"""Where the tip shall be sure: a box in the base frame, and the directions the tool may have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree
from scipy.stats import qmc

from suta_calib.analysis.planning.situation import Situation
from suta_calib.analysis.tip_uncertainty import Sensitivity, sensitivity
from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.units import mm

# Beyond what was touched: a hand's breadth and a half, and as much above as an artefact is wide.
_BESIDE: Final = 0.15
_ABOVE: Final = 0.30
_GRID: Final = 0.01
POSTURES: Final = 240
_STARTS: Final = 6
_CONE: Final = math.radians(45.0)
_FEWEST: Final = 20


@dataclass(frozen=True, eq=False)
class Region:
    """A box and a cone.

    Attributes:
        lower, upper: (3,) corners in the base, m.
        axis: (3,) unit vector, the middle of the tip's z axes in the base.
        cone: largest angle between a tip's z axis and ``axis``, rad.
    """

    lower: FloatArray
    upper: FloatArray
    axis: FloatArray
    cone: float = _CONE

    def __post_init__(self) -> None:
        if not np.all(self.upper > self.lower):
            raise JobError(
                f"a region from {_mm(self.lower)} to {_mm(self.upper)} mm",
                "a lower corner below and an upper one above on every axis",
                where="region",
            )

    @classmethod
    def around(cls, situation: Situation) -> Region:
        """Around what was touched, not below it, with the tool as it was held."""
        rotation, position = situation.tips
        low, high = position.min(axis=0), position.max(axis=0)
        beside = np.array([_BESIDE, _BESIDE, 0.0])
        lower = np.floor((low - beside) / _GRID + 0.5) * _GRID
        upper = np.ceil((high + beside + [0, 0, _ABOVE]) / _GRID - 0.5) * _GRID
        return cls(lower, upper, mean_axis(rotation))

    @classmethod
    def box(cls, lower: FloatArray, upper: FloatArray, situation: Situation) -> Region:
        """A stated box, with the tool as it was held.

        Raises:
            JobError: it has no volume.
        """
        return cls(lower, upper, mean_axis(situation.tips[0]))

    def sensitivity(self, situation: Situation, names: tuple[str, ...], seed: int) -> Sensitivity:
        """The tip all over the region, in directions all over the cone, where the arm reaches.

        Raises:
            JobError: the arm reaches next to nothing of it.
        """
        q = self.postures(situation.kinematics, situation.readings, situation.tips[1], seed)
        return sensitivity(situation.arm, situation.values, names, q)

    def postures(
        self, kinematics: InverseKinematics, visited: FloatArray, tips: FloatArray, seed: int
    ) -> FloatArray:
        """(n, joints) readings with the tip all over the region.

        Args:
            kinematics: of the arm as it is known.
            visited: (m, joints) readings from which the search starts.
            tips: (m, 3) where the tip is in these, m.
            seed: of the draws.

        Raises:
            JobError: the arm reaches next to nothing of the region.
        """
        u = qmc.Halton(5, rng=np.random.default_rng(seed)).random(POSTURES)
        position = self.lower + u[:, :3] * (self.upper - self.lower)
        rotation = directions(self.axis, self.cone, u[:, 3], u[:, 4])
        found = kinematics.solve(
            Targets(position, rotation, "axis"),
            visited[nearest(tips, position)],
            np.random.default_rng(seed),
            _STARTS,
        )
        if found.reached.sum() < _FEWEST:
            raise JobError(
                f"{int(found.reached.sum())} of {POSTURES} postures within reach in the region "
                f"from {_mm(self.lower)} to {_mm(self.upper)} mm",
                f"at least {_FEWEST}",
                where="region",
                hint="give a region the arm reaches with its tool as in the samples",
            )
        return found.q[found.reached]

    def inside(self, position: FloatArray) -> FloatArray:
        """(n,) whether points (n, 3) are in the box."""
        return np.asarray(((position >= self.lower) & (position <= self.upper)).all(axis=1))


def mean_axis(rotation: FloatArray) -> FloatArray:
    """(3,) mean direction of the tips' z axes (n, 3, 3); straight down where there is none."""
    mean = rotation[:, :, 2].mean(axis=0)
    length = float(np.linalg.norm(mean))
    return np.asarray(mean / length) if length > 0.2 else np.array([0.0, 0.0, -1.0])


def directions(axis: FloatArray, cone: float, height: FloatArray, around: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) whose z axes fill a cone evenly.

    Args:
        axis: (3,) unit vector, the cone's middle.
        cone: its half angle, rad.
        height: (n,) numbers from 0, at the middle, to 1, at the edge.
        around: (n,) numbers from 0 to 1.
    """
    lean = np.arccos(1.0 - height * (1.0 - math.cos(cone)))
    angle = 2 * math.pi * around
    turn = lean[:, None] * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    return turning_z_to(axis) @ rotation_from_vector(turn)


def turning_z_to(axis: FloatArray) -> FloatArray:
    """A rotation (3, 3) whose third column is the unit vector ``axis``."""
    sine = float(np.hypot(axis[0], axis[1]))
    about = np.array([-axis[1], axis[0], 0.0]) / sine if sine > 0 else np.array([1.0, 0.0, 0.0])
    return rotation_from_vector(math.atan2(sine, float(axis[2])) * about)


def nearest(visited: FloatArray, wanted: FloatArray) -> FloatArray:
    """(n,) which of the visited points (m, 3) is closest to each of (n, 3)."""
    return np.asarray(KDTree(visited).query(wanted)[1])


def _mm(corner: FloatArray) -> str:
    return "({:.0f}, {:.0f}, {:.0f})".format(*mm(corner))
