"""Plausible interpretations of six numbers of a pose, for ``import --guess``.

A guess is taken where one reading of the numbers is plausible and no other: angles within a turn,
rotation vectors of a norm within half a turn, positions at a distance at which arms and trackers
work, and rotations that do not change more from row to row than in another form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.exchange.rotations import EULER
from suta_calib.units import from_deg

VECTOR: Final = "vector"
# Order of Euler angles if it is not stated: roll, pitch, yaw of URDF and ROS.
RPY: Final = "xyz"


class Interpretation(NamedTuple):
    """How six numbers may be read: what stands ``first``, position or rotation; form and units.

    The form is ``vector`` or an order of Euler angles.
    """

    first: str
    form: str
    length: str
    angle: str

    def __str__(self) -> str:
        kind = "a rotation vector" if self.form == VECTOR else "Euler angles"
        parts = [f"a position in {self.length}", f"{kind} in {self.angle}"]
        return " and ".join(parts if self.first == "position" else reversed(parts))


def plausible_lengths(position: FloatArray, units: Sequence[str]) -> list[str]:
    """Units in which positions (n, 3) are at a plausible distance."""
    distance = float(np.median(np.linalg.norm(position, axis=1)))
    # Median distance from the origin, in the unit, of positions that are an arm's or a tracker's.
    distances = {"m": (0.003, 10.0), "mm": (100.0, 10_000.0)}
    return [unit for unit in units if distances[unit][0] <= distance <= distances[unit][1]]


def quaternion_order(numbers: FloatArray) -> str:
    """``xyzw`` or ``wxyz`` of quaternions (n, 4), empty where their numbers do not say it.

    Many programs choose the sign so that the scalar is never negative. Where all others have both
    signs, it is the scalar that is not: a short motion may keep the sign of others, too.
    """
    negative = np.mean(numbers < 0.0, axis=0)
    # Share of rows in which a number must have a sign, to be said to have it.
    few = 0.1
    both_signs = (negative > few) & (negative < 1.0 - few)
    if not negative[0] and both_signs[1:].all():
        return "wxyz"
    return "xyzw" if not negative[3] and both_signs[:3].all() else ""


def plausible_rotations(
    numbers: FloatArray, forms: Sequence[str], units: Sequence[str]
) -> list[tuple[str, str]]:
    """Forms and units in which three numbers (n, 3) are plausible rotations.

    Of several orders of Euler angles the first that is left stands for all; degrees are none where
    they are so few that they may be rad, and of rotation vectors only where Euler angles are none.
    """
    most, norm = np.abs(numbers).max(), np.linalg.norm(numbers, axis=1).max()
    plausible = list[tuple[str, str]]()
    # Rounding of what is written.
    rounded = 1.005
    turns = {"rad": math.tau, "deg": 360.0}
    for unit in units:
        if unit == "deg" and "rad" in units and most <= turns["rad"]:
            continue
        turn = turns[unit] * rounded
        within = [form for form in forms if (2 * norm if form == VECTOR else most) <= turn]
        fitting = _fitting_neighbours(numbers, within, unit)
        euler = [form for form in fitting if form != VECTOR][:1]
        vector = [VECTOR] if VECTOR in fitting and not (euler and unit == "deg") else []
        plausible += [(form, unit) for form in (*euler, *vector)]
    return plausible


def _fitting_neighbours(numbers: FloatArray, forms: Sequence[str], unit: str) -> list[str]:
    """Forms of which no step from row to row is far larger than the largest of another form.

    Where a motion passes half a turn, numbers jump, and are near each other in the right form only.
    """
    # A form of rotation fits its neighbours worse than another where its largest step from row to
    # row is so many times as large, and larger than steps of recorded motions are, rad.
    worse, step = 3.0, 0.5
    # Rows that tell something, and that are looked at for steps.
    least_rows, rows = 5, 2000
    if len(numbers) < least_rows or len(forms) < 2:
        return list(forms)
    angles = from_deg(numbers[:rows]) if unit == "deg" else numbers[:rows]
    steps = {form: _largest_step(form, angles) for form in forms}
    most = max(step, worse * min(steps.values()))
    return [form for form in forms if steps[form] <= most]


def _largest_step(form: str, angles: FloatArray) -> float:
    """Angle, rad, of the largest turn between neighbouring rows of angles (n, 3), rad."""
    vector = form == VECTOR
    rotation = Rotation.from_rotvec(angles) if vector else Rotation.from_euler(form, angles)
    return float((rotation[:-1].inv() * rotation[1:]).magnitude().max())


def plausible_readings(
    numbers: FloatArray,
    firsts: Sequence[str],
    forms: Sequence[str],
    lengths: Sequence[str],
    angles: Sequence[str],
) -> list[Interpretation]:
    """Readings of six numbers (n, 6) a row that are plausible, the likeliest first."""
    readings = list[Interpretation]()
    for first in firsts:
        position, rotation = numbers[:, :3], numbers[:, 3:]
        if first == "rotation":
            position, rotation = rotation, position
        rotations = plausible_rotations(rotation, forms, angles)
        units = plausible_lengths(position, lengths)
        readings += [
            Interpretation(first, form, length, angle)
            for (form, angle), length in product(rotations, units)
        ]
    return readings


def open_forms() -> tuple[str, ...]:
    """Every form of three numbers, roll, pitch and yaw before the others."""
    return (RPY, *(form for form in EULER if form != RPY), VECTOR)
