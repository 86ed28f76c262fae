"""The region in which the tip must be accurate: a box and a cone; and places to try there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import Final

import numpy as np
from scipy.spatial import KDTree
from scipy.stats import qmc

from suta_calib.analysis.planning.candidates import (
    DEFAULT_CONE,
    Place,
    Placement,
    Posture,
    TouchPoint,
    tilted,
)
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.trust.tip import Sensitivity, sensitivity
from suta_calib.units import deg, from_deg, from_mm, mm

POSTURES: Final = 240
# What a person sets with a ruler.
_LENGTH_STEP: Final = 0.01


@dataclass(frozen=True, eq=False)
class Region(Displayable):
    """A box and a cone of directions.

    Attributes:
        lower, upper: (3,) corners in the base, m.
        axis: (3,) unit vector, the middle of the tip's z axes in the base.
        cone: largest angle between a tip's z axis and ``axis``, rad.
    """

    lower: FloatArray
    upper: FloatArray
    axis: FloatArray
    cone: float = from_deg(45.0)

    def __post_init__(self) -> None:
        if not np.all(self.upper > self.lower):
            raise JobError(
                f"a region from {_corner_text(self.lower)} to {_corner_text(self.upper)} mm",
                "a lower corner that is below the upper corner on every axis",
                where="region",
            )

    @classmethod
    def around(cls, situation: Situation) -> Region:
        """Around what was touched, not below it, with the tool as it was held."""
        rotation, position = situation.tips
        low, high = position.min(axis=0), position.max(axis=0)
        # A hand's breadth and a half, and as much above as an artefact is wide.
        beside, above, grid = np.array([0.15, 0.15, 0.0]), np.array([0.0, 0.0, 0.3]), 0.01
        lower = np.floor((low - beside) / grid + 0.5) * grid
        upper = np.ceil((high + beside + above) / grid - 0.5) * grid
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

        An arm of few joints has its tool there as it can. One that cannot bring its tip to any
        place, or next to none with the tool as it was held on average, has it where it gets to, in
        postures drawn at random.

        Args:
            kinematics: of the arm as it is known.
            visited: (m, joints) readings from which the search starts.
            tips: (m, 3) where the tip is in these, m.
            seed: of the draws.

        Raises:
            JobError: the arm reaches next to nothing of the region.
        """
        fewest, reached = 20, visited[:0]
        if kinematics.attainable["position"]:
            u = qmc.Halton(5, seed=np.random.default_rng(seed)).random(POSTURES)
            position = self.lower + u[:, :3] * (self.upper - self.lower)
            rotation = directions(self.axis, self.cone, u[:, 3], u[:, 4])
            answer = kinematics.solve(
                Targets(position, rotation, kinematics.most("axis")),
                visited[nearest(tips, position)],
                np.random.default_rng(seed),
                starts=6,
            )
            reached = answer.q[answer.reached]
        if len(reached) < fewest:
            reached = self._at_random(kinematics, seed)
        if len(reached) < fewest:
            raise JobError(
                f"{len(reached)} of {POSTURES} postures within reach in the region from "
                f"{_corner_text(self.lower)} to {_corner_text(self.upper)} mm",
                f"at least {fewest}",
                where="region",
                hint="give a region that the arm reaches with the tool orientations of the samples",
            )
        return reached

    def _at_random(self, kinematics: InverseKinematics, seed: int) -> FloatArray:
        """Postures anywhere within the limits that have the tip in the region."""
        # So many that those with the tip in the region are enough.
        q = kinematics.random_readings(np.random.default_rng(seed), 20_000)
        _, position = kinematics.arm.forward(q, kinematics.values)
        return q[self.inside(position)][:POSTURES]

    def inside(self, position: FloatArray) -> BoolArray:
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
    return rotation_from_vector(vector_turning_z_to(axis)) @ rotation_from_vector(turn)


def nearest(visited: FloatArray, points: FloatArray) -> FloatArray:
    """(n,) which of the visited points (m, 3) is closest to each of (n, 3)."""
    return np.asarray(KDTree(visited).query(points)[1])


def _corner_text(corner: FloatArray) -> str:
    return "({:.0f}, {:.0f}, {:.0f})".format(*mm(corner))


@dataclass(frozen=True)
class Pool:
    """How many places to try, and how far the artefact may be tilted (rad; 0: flat ones only)."""

    placements: int = 240
    points: int = 40
    poses: int = 200
    most_tilt: float = from_deg(40.0)


def candidate_pool(
    situation: Situation, region: Region, pool: Pool, repeats: int, seed: int
) -> tuple[Place, ...]:
    """Placements (with an artefact), points, and postures (with an instrument or a camera).

    Half of the placements are flat, half of all stand on the table, that is at the height of the
    lowest present placement. A point is touched as often as a placement would be.
    """
    taken = situation.labels
    names = (k for k in count(1) if not {f"N{k}", f"F{k}", f"A{k}"} & taken)
    places: list[Place] = []
    if situation.touching is not None:
        places += _placements(situation, region, pool, names, seed)
    if situation.sighted is None or situation.touching is not None:
        places += _points(situation, region, pool, repeats, names, seed)
    if situation.sighted is not None:
        places += _postures(situation, region, pool, names, seed)
    return tuple(places)


def _placements(
    situation: Situation, region: Region, pool: Pool, names: Iterator[int], seed: int
) -> list[Place]:
    assert situation.artefact is not None
    u = qmc.Halton(6, seed=np.random.default_rng(seed)).random(pool.placements)
    floor = min(float(p.position[2]) for p in situation.placements)
    landmarks = np.array([m.position for m in situation.artefact.landmarks.values()])
    foot = landmarks * [1.0, 1.0, 0.0]
    places: list[Place] = []
    # What a person sets with a protractor.
    yaw_step = from_deg(15.0)
    tilt_step = from_deg(5.0)
    for k, row in enumerate(u):
        flat = k % 2 == 0 or pool.most_tilt < tilt_step
        most = 0.0 if flat else pool.most_tilt
        least = min(from_deg(10.0), most)
        # Yaw, tilt, and where it leans to, in steps one can set.
        yaw = yaw_step * round((2 * math.pi * row[3] - math.pi) / yaw_step)
        tilt = tilt_step * round((least + row[4] * (most - least)) / tilt_step)
        turned = tilted(yaw, tilt, yaw_step * round(2 * math.pi * row[5] / yaw_step))
        where = region.lower + row[:3] * (region.upper - region.lower)
        lowest = floor - float((foot @ turned.T)[:, 2].min())
        # On the table, or on something that is put under it; the table's height is what it is.
        where[2] = max(where[2], lowest)
        rounded = _LENGTH_STEP * np.round(where / _LENGTH_STEP)
        if k % 4 < 2:
            rounded[2] = from_mm(math.ceil(mm(lowest) - 1e-6))
        places.append(Placement(f"N{next(names)}", rounded, turned))
    return places


def _points(
    situation: Situation, region: Region, pool: Pool, repeats: int, names: Iterator[int], seed: int
) -> list[Place]:
    u = qmc.Halton(3, seed=np.random.default_rng(seed + 1)).random(pool.points)
    marks = 1 if situation.artefact is None else len(situation.artefact.landmarks)
    touches = max(2 if marks > 1 else 20, repeats * marks)
    within = region.lower + u * (region.upper - region.lower)
    kind = situation.places.place
    return [
        TouchPoint(f"F{next(names)}", where, touches, region.axis, DEFAULT_CONE, kind=kind)
        for where in _LENGTH_STEP * np.round(within / _LENGTH_STEP)
    ]


def _first(rows: FloatArray, fitting: Callable[[FloatArray], BoolArray], count: int) -> FloatArray:
    """The first ``count`` rows that fit, or all that do; no more are looked at than it takes."""
    fitting_rows = rows[:0]
    # A thousand are asked about at once.
    for chunk in np.array_split(rows, math.ceil(len(rows) / 1000) or 1):
        fitting_rows = np.concatenate([fitting_rows, chunk[fitting(chunk)]])
        if len(fitting_rows) >= count:
            break
    return fitting_rows[:count]


def _postures(
    situation: Situation, region: Region, pool: Pool, names: Iterator[int], seed: int
) -> list[Place]:
    """Anywhere within the limits, the tip in the region where enough of them have it there."""
    rng = np.random.default_rng(seed + 2)
    chance = 1.0 if situation.sighted is None else situation.sighted.chance
    q = situation.kinematics.random_readings(rng, int(50 * pool.poses / chance))
    _, position = situation.arm.forward(q, situation.values)
    chosen = _first(q[region.inside(position)], situation.in_sight, pool.poses)
    if len(chosen) < pool.poses / 4:
        chosen = _first(q, situation.in_sight, pool.poses)
    turning = [joint.type != "prismatic" for joint in situation.arm.readings]
    limits = np.array([(joint.lower, joint.upper) for joint in situation.arm.readings])
    # In whole degrees, within the limits.
    rounded = np.clip(from_deg(np.round(deg(chosen))), *limits.T)
    return [Posture(f"A{next(names)}", row) for row in np.where(turning, rounded, chosen)]
