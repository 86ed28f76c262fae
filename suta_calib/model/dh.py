"""Denavit-Hartenberg tables: of any serial chain, and a URDF of any table.

Both conventions in use are written here with all four numbers of a row as one transform:

    classic (Denavit and Hartenberg 1955)  T_i = Rz(θ_i) Tz(d_i) Tx(a_i) Rx(α_i)
    modified (Craig 1986, "MDH")           T_i = Rx(α_{i-1}) Tx(a_{i-1}) Rz(θ_i) Tz(d_i)

with ``θ_i = reading + theta`` for a revolute joint and ``d_i = reading + d`` for a prismatic one.
Their product is the same chain of screws along z and x, cut at another place: the numbers of a
modified table are those of the classic one with a and α a row further down.

A table is found from the lines that the joints move about, together with the z axes of the base
and of the tip: between each two lines lies a common normal (x), which gives a and α, and along
each line the next normal gives θ and d. What stands between the base and the first joint, and
between the last one and the tip, are rows without a reading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import UrdfError
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy, rotation_from_vector, wrap
from suta_calib.model.arm import ArmModel
from suta_calib.model.urdf import joint_text

Convention = Literal["classic", "modified"]
DhMotion = Literal["revolute", "prismatic", "fixed"]

_MEETING: Final = 1e-12


@dataclass(frozen=True)
class DhRow(Displayable):
    """One row of a table.

    Attributes:
        joint: name of the joint, or of what the row without a reading stands for.
        motion: ``revolute`` (the reading adds to theta), ``prismatic`` (to d), or ``fixed``.
        theta: angle about z, rad.
        d: distance along z, m.
        a: distance along x, m; in a modified table the one before the joint (a_{i-1}).
        alpha: angle about x, rad; likewise (α_{i-1}).
    """

    joint: str
    motion: DhMotion
    theta: float
    d: float
    a: float
    alpha: float


@dataclass(frozen=True)
class DhTable(Displayable):
    """A Denavit-Hartenberg table from the base to the tip.

    Attributes:
        convention: where a and α stand, ``classic`` or ``modified``.
        rows: from base to tip; fixed rows before the first joint and after the last one hold what
            stands between them and the base or the tip.

    Raises:
        UrdfError: no row moves, or two joints have one name.
    """

    convention: Convention
    rows: tuple[DhRow, ...]

    def __post_init__(self) -> None:
        if not self.joints:
            raise UrdfError("a DH table without moving joints", "a revolute or prismatic row")
        twice = {name for name in self.joints if self.joints.count(name) > 1}
        if twice:
            raise UrdfError(f"the joint {min(twice)!r} twice", "one row for each joint")

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the rows that have a reading, in the order of the readings."""
        return tuple(row.joint for row in self.rows if row.motion != "fixed")

    def poses(self, q: ArrayLike) -> FloatArray:
        """The tip in the base for each reading.

        Args:
            q: (n, joints) or (joints,) readings, rad or m.

        Returns:
            Transforms ``T_base_tip``, (n, 4, 4), or (4, 4) for a single reading.
        """
        readings = np.asarray(q, dtype=float)
        if readings.shape[-1:] != (len(self.joints),):
            raise UrdfError(
                f"readings of shape {readings.shape}", f"{len(self.joints)} numbers: {self.joints}"
            )
        poses = np.array([self._pose(reading) for reading in np.atleast_2d(readings)])
        return poses[0] if readings.ndim == 1 else poses

    def _pose(self, q: FloatArray) -> FloatArray:
        pose, reading = np.eye(4), iter(q)
        for row in self.rows:
            moved = 0.0 if row.motion == "fixed" else float(next(reading))
            theta = row.theta + (moved if row.motion == "revolute" else 0.0)
            d = row.d + (moved if row.motion == "prismatic" else 0.0)
            along_z, along_x = _screw(2, theta, d), _screw(0, row.alpha, row.a)
            pose = pose @ (along_z @ along_x if self.convention == "classic" else along_x @ along_z)
        return pose

    def urdf(self, name: str = "arm") -> str:
        """A URDF of the table: joints about (or along) z, links without shape, the link ``tip``.

        The origin of a joint holds what the rows before it leave and its own θ and d, so that a
        classic table's d_i is found as the parameter ``<next joint>.z``. Revolute joints are
        continuous, because a table knows no limits; a slide gets ±10 m.

        Args:
            name: of the robot.
        """
        parts = [f'<?xml version="1.0" encoding="utf-8"?>\n<robot name={quoteattr(name)}>']
        parts.append('  <link name="base_link"/>')
        before, parent = np.eye(4), "base_link"
        for row in self.rows:
            along_z, along_x = _screw(2, row.theta, row.d), _screw(0, row.alpha, row.a)
            classic = self.convention == "classic"
            if row.motion == "fixed":
                before = before @ (along_z @ along_x if classic else along_x @ along_z)
                continue
            turn = row.motion == "revolute"
            # What commutes with the joint's motion may stand on either side of it. The classic
            # d of a turn goes beyond it, where the next joint's origin shows it as its z.
            behind = _screw(2, 0.0, row.d) if classic and turn else np.eye(4)
            placed = before @ (np.eye(4) if classic else along_x) @ along_z @ np.linalg.inv(behind)
            child = f"{row.joint}_link"
            motion, limits = ("continuous", None) if turn else ("prismatic", (-10.0, 10.0))
            ends = row.joint, motion, parent, child
            parts.append(joint_text(*ends, placed, axis="0 0 1", limits=limits, number=_number))
            parts.append(f"  <link name={quoteattr(child)}/>")
            before, parent = behind @ (along_x if classic else np.eye(4)), child
        parts.append(joint_text("tip_joint", "fixed", parent, "tip", before, number=_number))
        parts.append('  <link name="tip"/>\n</robot>\n')
        return "\n".join(parts)


def _number(value: float) -> str:
    # What multiplying matrices makes of a zero is smaller, m and rad.
    return repr(0.0 if abs(value) < 1e-15 else float(value))


def dh_table(
    arm: ArmModel,
    values: Mapping[str, float] | None = None,
    convention: Convention = "classic",
    like: DhTable | None = None,
) -> DhTable:
    """The DH table of an arm: of any chain of revolute, continuous, prismatic and fixed joints.

    Every chain has one, and it is not unique: each common normal may point either way, parallel
    lines have many, and a slide's line may pass anywhere. Here normals point so that α lies in
    [0, π], of parallel lines the normal with d = 0 is taken, and a slide's line passes through its
    joint's origin. Two joints that are nearly but not exactly parallel have their normal far away:
    the table then holds huge numbers that nearly cancel, which is the convention's and not the
    arm's (Hayati 1983 is the usual way out). Eccentricity and compliance have no place in a table.

    Args:
        arm: the chain.
        values: parameter values by name, such as ``solution.values``; nominal where not given.
            Offsets are part of θ (d of a slide).
        convention: ``classic`` or ``modified``.
        like: a table of the same joints, for instance the arm's nominal one as published: every
            normal points as there and every θ is within half a turn of the one there, so that rows
            can be compared number by number.

    Raises:
        UrdfError: ``like`` has other joints, or a closed loop moves a joint of the arm.
    """
    if arm.chain.loops:
        expected = "an arm without closed loops: a table has no place for them"
        raise UrdfError("a closed loop", expected, file=arm.chain.path)
    lines = _lines(arm, values or {})
    twists = _wanted_twists(like, [line.name for line in lines]) if like is not None else {}
    last = len(lines) - 1
    start, x = lines[0].point, lines[0].x
    theta, d, a, alpha = (np.zeros(last + 1) for _ in range(4))
    for k, line in enumerate(lines):
        normal = _CommonNormal(line.x, line.point, line.point, 0.0, 0.0)
        if k < last:
            normal = _normal(line, lines[k + 1], start, x, lines[last] if k == last - 1 else None)
            twist = twists.get(line.name, normal.alpha)
            if abs(wrap(normal.alpha - twist)) > abs(wrap(-normal.alpha - twist)):
                normal = normal._replace(x=-normal.x, a=-normal.a, alpha=-normal.alpha)
        theta[k] = math.atan2(float(np.cross(x, normal.x) @ line.z), float(x @ normal.x))
        d[k] = float((normal.foot - start) @ line.z)
        a[k], alpha[k] = normal.a, normal.alpha
        start, x = normal.landing, normal.x
    if convention == "modified":
        a, alpha = np.roll(a, 1), np.roll(alpha, 1)
    cells = np.stack([theta, d, a, alpha], axis=1)
    cells[np.abs(cells) < _MEETING] = 0.0
    about = {row.joint: row.theta for row in like.rows} if like is not None else {}
    turns = np.array([about.get(line.name, 0.0) for line in lines])
    cells[:, 0] = turns + wrap(cells[:, 0] - turns)
    rows = (
        DhRow(line.name, line.motion, *map(float, row))
        for line, row in zip(lines, cells, strict=True)
        if line.motion != "fixed" or row.any()
    )
    return DhTable(convention, tuple(rows))


def _wanted_twists(like: DhTable, names: Sequence[str]) -> dict[str, float]:
    """The angle between each row's line and the next one's in another table, by the row's name."""
    moving = list(names[1:-1])
    if list(like.joints) != moving:
        problem = f"a table of the joints {', '.join(like.joints)}"
        expected = f"a table of the same joints as the arm's: {', '.join(moving)}"
        raise UrdfError(problem, expected, where="like")
    twists = [row.alpha for row in like.rows]
    if like.convention == "modified":
        twists = [*twists[1:], 0.0]
    return {row.joint: twist for row, twist in zip(like.rows, twists, strict=True)}


class _Line(NamedTuple):
    """A line of the chain at zero readings, in the base: (3,) point, unit z and a unit x on it."""

    name: str
    motion: DhMotion
    point: FloatArray
    z: FloatArray
    x: FloatArray


class _CommonNormal(NamedTuple):
    """From ``foot`` on one line to ``landing`` on the next: (3,) unit x, a in m, alpha in rad."""

    x: FloatArray
    foot: FloatArray
    landing: FloatArray
    a: float
    alpha: float


def _lines(arm: ArmModel, values: Mapping[str, float]) -> list[_Line]:
    """The base's z axis, the joints' lines, the tip's z axis."""
    pose = np.eye(4)
    lines = [_Line("base", "fixed", pose[:3, 3], pose[:3, 2], pose[:3, 0])]
    origins = arm.origins(values)
    for joint in arm.chain.joints:
        xyz, rpy = origins[joint.name]
        pose = pose @ homogeneous(rotation_from_rpy(rpy), xyz)
        if joint.moving:
            motion: DhMotion = "prismatic" if joint.type == "prismatic" else "revolute"
            axis = pose[:3, :3] @ joint.axis
            lines.append(_Line(joint.name, motion, pose[:3, 3], axis, axis))
    return [*lines, _Line("tip", "fixed", pose[:3, 3], pose[:3, 2], pose[:3, 0])]


def _normal(
    line: _Line, following: _Line, start: FloatArray, x: FloatArray, tip: _Line | None
) -> _CommonNormal:
    """The common normal of two lines."""
    cross = np.cross(line.z, following.z)
    sine, between = float(np.linalg.norm(cross)), following.point - line.point
    # Sine of the angle between lines that count as parallel, and the distance, m, of lines that
    # meet: rounding of the URDF's numbers along a chain, and far below what any table is written
    # with.
    parallel = 1e-11
    if sine > parallel:
        direction = cross / sine
        foot = line.point + line.z * float(np.cross(between, following.z) @ cross) / sine**2
        landing = following.point + following.z * float(np.cross(between, line.z) @ cross) / sine**2
        a = float((landing - foot) @ direction)
        return _CommonNormal(
            direction, foot, landing, a, math.atan2(sine, float(line.z @ following.z))
        )
    # Parallel: the normal through where the last one landed, along x where the lines are one.
    across = following.point - start
    across = across - line.z * float(across @ line.z)
    a = float(np.linalg.norm(across))
    alpha = 0.0 if float(line.z @ following.z) > 0 else math.pi
    if a > _MEETING:
        return _CommonNormal(across / a, start, start + across, a, alpha)
    return _CommonNormal(x if tip is None else tip.x, start, start, 0.0, alpha)


def _screw(axis: Literal[0, 2], angle: float, distance: float) -> FloatArray:
    """A turn about x (0) or z (2), rad, and a shift along it, m."""
    unit = np.eye(3)[axis]
    return homogeneous(rotation_from_vector(angle * unit), distance * unit)
