"""Places to try where the user names none: all over the region, flat and tilted, and points."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Final

import numpy as np
from scipy.stats import qmc

from suta_calib.analysis.planning.candidates import (
    DEFAULT_CONE,
    Place,
    Placement,
    Point,
    Posture,
    tilted,
)
from suta_calib.analysis.planning.region import Region
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray
from suta_calib.units import from_deg, from_mm, mm

# What a person sets with a ruler and a protractor.
_LENGTH_STEP: Final = 0.01
_YAW_STEP: Final = from_deg(15.0)
_TILT_STEP: Final = from_deg(5.0)
_LEAST_TILT: Final = from_deg(10.0)
_POSES_IN_REGION: Final = 4


@dataclass(frozen=True)
class Pool:
    """How many places to try, and how far the artefact may be tilted.

    Attributes:
        placements, points, poses: how many of each.
        most_tilt: largest tilt of the artefact, rad; 0 for flat ones only.
    """

    placements: int = 240
    points: int = 40
    poses: int = 200
    most_tilt: float = from_deg(40.0)


def generated(
    situation: Situation, region: Region, pool: Pool, repeats: int, seed: int
) -> tuple[Place, ...]:
    """Placements (with an artefact), points, and postures (with an instrument or a camera).

    Half of the placements are flat, half of all stand on the table, that is at the height of the
    lowest present placement. A point is touched as often as a placement would be.
    """
    names = _names(situation.labels)
    found: list[Place] = []
    if situation.touching is not None:
        found += _placements(situation, region, pool, names, seed)
    if situation.seen is None or situation.touching is not None:
        found += _points(situation, region, pool, repeats, names, seed)
    if situation.seen is not None:
        found += _postures(situation, region, pool, names, seed)
    return tuple(found)


def _placements(
    situation: Situation, region: Region, pool: Pool, names: Iterator[int], seed: int
) -> list[Place]:
    assert situation.artefact is not None
    u = qmc.Halton(6, seed=np.random.default_rng(seed)).random(pool.placements)
    floor = min(float(p.position[2]) for p in situation.placements)
    landmarks = np.array([m.position for m in situation.artefact.landmarks.values()])
    foot = landmarks * [1.0, 1.0, 0.0]
    found: list[Place] = []
    for k, row in enumerate(u):
        flat = k % 2 == 0 or pool.most_tilt < _TILT_STEP
        turned = tilted(*_turns(row, 0.0 if flat else pool.most_tilt))
        where = region.lower + row[:3] * (region.upper - region.lower)
        lowest = floor - float((foot @ turned.T)[:, 2].min())
        # On the table, or on something that is put under it.
        where[2] = lowest if k % 4 < 2 else max(where[2], lowest)
        found.append(Placement(f"N{next(names)}", _rounded(where, flat=k % 4 < 2), turned))
    return found


def _turns(row: FloatArray, most_tilt: float) -> tuple[float, float, float]:
    """Yaw, tilt, and where it leans to, in steps one can set."""
    yaw = _YAW_STEP * round((2 * math.pi * row[3] - math.pi) / _YAW_STEP)
    least = min(_LEAST_TILT, most_tilt)
    tilt = _TILT_STEP * round((least + row[4] * (most_tilt - least)) / _TILT_STEP)
    return yaw, tilt, _YAW_STEP * round(2 * math.pi * row[5] / _YAW_STEP)


def _rounded(where: FloatArray, *, flat: bool) -> FloatArray:
    """To whole centimetres; the height of what stands on the table is what it is."""
    found = _LENGTH_STEP * np.round(where / _LENGTH_STEP)
    if flat:
        found[2] = from_mm(math.ceil(mm(where[2]) - 1e-6))
    return np.asarray(found)


def _points(
    situation: Situation,
    region: Region,
    pool: Pool,
    repeats: int,
    names: Iterator[int],
    seed: int,
) -> list[Place]:
    u = qmc.Halton(3, seed=np.random.default_rng(seed + 1)).random(pool.points)
    marks = 1 if situation.artefact is None else len(situation.artefact.landmarks)
    touches = max(20, repeats * marks) if marks == 1 else repeats * marks
    where = _LENGTH_STEP * np.round(
        (region.lower + u * (region.upper - region.lower)) / _LENGTH_STEP
    )
    return [
        Point(
            f"F{next(names)}",
            position,
            max(2, touches),
            region.axis,
            DEFAULT_CONE,
            kind=situation.places.place,
        )
        for position in where
    ]


def _postures(
    situation: Situation, region: Region, pool: Pool, names: Iterator[int], seed: int
) -> list[Place]:
    """Anywhere within the limits, the tip in the region where enough of them have it there."""
    rng = np.random.default_rng(seed + 2)
    q = situation.kinematics.random_readings(rng, 50 * pool.poses)
    _, position = situation.arm.forward(q, situation.values)
    inside = q[region.inside(position).astype(bool)]
    chosen = (inside if len(inside) >= pool.poses / _POSES_IN_REGION else q)[: pool.poses]
    step = from_deg(1.0)
    return [Posture(f"A{next(names)}", _whole(situation, row, step)) for row in chosen]


def _whole(situation: Situation, q: FloatArray, step: float) -> FloatArray:
    """Readings in whole degrees, within the limits."""
    joints = situation.arm.chain.moving
    return np.array(
        [
            value
            if joint.type == "prismatic"
            else np.clip(step * round(value / step), joint.lower, joint.upper)
            for joint, value in zip(joints, q, strict=True)
        ]
    )


def _names(taken: frozenset[str]) -> Iterator[int]:
    """Numbers that make no name which is taken."""
    return (k for k in count(1) if not {f"N{k}", f"F{k}", f"A{k}"} & taken)
