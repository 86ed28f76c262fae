"""Candidates for the next measurement: places in the base frame, and their touches.

A user lists the places that would do in ``candidates.yaml``; else they are searched (`region`).
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import JobError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.measurements.fields import (
    DIRECTION,
    POSE,
    POSITION,
    Field,
    Fields,
    Value,
    cone,
    whole_number,
)
from suta_calib.model.arm import ArmModel
from suta_calib.units import Unit, from_deg, from_mm, key, stored

_MOST: Final = 5000
DEFAULT_CONE: Final = from_deg(60.0)
DOWN: Final = (0.0, 0.0, -1.0)


def _values(takes: str) -> Value:
    """A number, or a list of them of any length, as the file has them."""

    def read(section: YamlSection, key: str) -> list[float]:
        value: Any = section.data[key]
        if not isinstance(value, list):
            return [section.number(key)]
        if not value:
            raise section.refuse("an empty list", "at least one number", at=(key,))
        return section.numbers(key, len(value))

    return Value(takes, read)


# Of ``candidates.yaml``.
GRID_KEYS: Final = Fields(
    *(Field(f"{axis}_mm", _values("mm, or a list"), f"Along {axis}.", True) for axis in "xyz"),
    Field("yaw_deg", _values("deg, or a list"), "Rotation about the vertical; default 0."),
    Field("tilt_deg", _values("deg, or a list"), "Tilt away from the vertical; default 0."),
    Field(
        "towards_deg",
        _values("deg, or a list"),
        "Direction of the tilt in the base frame; default 0.",
    ),
)
POINT_KEYS: Final = Fields(
    POSITION,
    Field(
        "directions",
        whole_number(2, _MOST),
        "Number of directions from which the point is touched.",
    ),
    Field(
        "axis",
        DIRECTION,
        "Mean direction of the tip's z axis, in the base frame; default downwards.",
    ),
    Field(
        "cone_deg",
        cone("positive"),
        "Largest angle between the tip's z axis and axis; default 60.",
    ),
)
POSTURE_KEYS: Final = Fields(
    Field("posture_deg", Value("by joint, deg"), "Readings of the revolute joints."),
    Field("posture_mm", Value("by joint, mm"), "Readings of the prismatic joints."),
)
KEYS: Final = Fields(
    # At most as the command's option has it.
    Field("repeats", whole_number(1, 100), "How often every placement would be measured."),
    Field("placements", Value("by name", inside=POSE), "Where the artefact could be placed."),
    Field(
        "grids",
        Value("by name", inside=GRID_KEYS),
        "Grids of placements of the artefact: every combination of the values.",
    ),
    Field("points", Value("by name", inside=POINT_KEYS), "Points that could be touched."),
    Field(
        "poses",
        Value("by name", inside=POSTURE_KEYS),
        "Postures in which the arm could be measured.",
    ),
)


@dataclass(frozen=True, eq=False)
class Placement(Displayable):
    """An artefact put down somewhere: ``T_base_artefact``.

    ``line`` is that of the candidates file, as of the other places.
    """

    name: str
    position: FloatArray
    rotation: FloatArray
    line: int | None = None
    kind: Literal["placement"] = "placement"

    @property
    def tilt(self) -> float:
        """Angle between the artefact's z axis and the base's, rad."""
        return float(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class TouchPoint(Displayable):
    """One point, or another place without an artefact, touched from many directions.

    Attributes:
        name, kind: of the place and its sort, for the samples' column; a plane is square to
            ``axis``.
        position: (3,) in the base, m.
        directions: how many touches.
        axis: (3,) unit vector in the base, the middle of the tip's z axes.
        cone: largest angle between a tip's z axis and ``axis``, rad.
    """

    name: str
    position: FloatArray
    directions: int
    axis: FloatArray
    cone: float
    line: int | None = None
    kind: str = "point"


@dataclass(frozen=True, eq=False)
class Posture(Displayable):
    """One posture, (joints,) rad or m, in which an instrument or the camera takes a reading."""

    name: str
    readings: FloatArray
    line: int | None = None
    kind: Literal["pose"] = "pose"


Place = Placement | TouchPoint | Posture


@dataclass(frozen=True, eq=False)
class Candidate(Displayable):
    """A place the arm can reach.

    Attributes:
        place: where.
        q: (n, joints) a posture for each different touch, rad (m for prismatic joints).
        marks: (n,) the landmark of each touch; empty for points and postures.
        repeats: how often the touches are gone through.
    """

    place: Place
    q: FloatArray
    marks: tuple[str, ...]
    repeats: int

    @property
    def name(self) -> str:
        """Of the place."""
        return self.place.name

    @property
    def samples(self) -> int:
        """Rows it adds to the data."""
        return len(self.q) * self.repeats

    @property
    def sort(self) -> str:
        """Kind of the candidate, for messages."""
        if isinstance(self.place, Placement):
            return f"placement, {'flat' if self.place.tilt < from_deg(1.0) else 'tilted'}"
        if isinstance(self.place, TouchPoint):
            return f"{self.place.kind} from many directions"
        return "pose"


@dataclass(frozen=True)
class Unreachable:
    """A place that cannot be a candidate, with the reason."""

    name: str
    kind: str
    reason: str


@dataclass(frozen=True, eq=False)
class CandidateFile(Displayable):
    """The candidates file, grids expanded; ``repeats`` of a placement's landmarks, or None."""

    path: Path
    places: tuple[Place, ...]
    repeats: int | None


def read_candidates(path: str | Path, arm: ArmModel, directions: int = 20) -> CandidateFile:
    """Read places for the planner.

    ``placements: {N1: {position_mm: [x, y, z], rotation_rpy_deg: [r, p, y]}}``; ``points: {F1:
    {position_mm, directions, axis, cone_deg}}``; ``poses: {A1: {posture_deg: {joint_1: 10, …}}}``,
    with ``posture_mm`` for prismatic joints; ``grids: {G: {x_mm: [...], y_mm, z_mm, yaw_deg,
    tilt_deg, towards_deg}}``, every combination of the lists, ``towards_deg`` being the direction
    in the base that the tilt leans to; ``repeats`` of every placement.

    Args:
        path: the file.
        arm: whose joints postures name.
        directions: touches of a point where the file does not say.

    Raises:
        JobError: the file cannot be read, or a key is unknown, missing or unusable; names the
            line and the key.
    """
    top = YamlSection(read_yaml(Path(path), JobError), JobError)
    values = KEYS.read(top)
    places: list[Place] = []
    readers: dict[str, Callable[[str, YamlSection], Sequence[Place]]] = {
        "placements": lambda name, section: [_placement(name, section)],
        "grids": _grid,
        "points": lambda name, section: [_point(name, section, directions)],
        "poses": lambda name, section: [_posture(name, section, arm)],
    }
    for sort, reader in readers.items():
        if sort in top:
            listed = top.section(sort)
            for name in listed.data:
                places += reader(str(name), listed.section(name))
    if not places:
        raise top.refuse("no candidate", f"at least one of {', '.join(KEYS.names[1:])}")
    if len(places) > _MOST:
        raise top.refuse(f"{len(places)} candidates", f"at most {_MOST}", hint="use coarser grids")
    for name, count in Counter(place.name for place in places).items():
        if count > 1:
            raise top.refuse(
                f"two candidates named {name!r}", "a different name for each candidate"
            )
    return CandidateFile(Path(path), tuple(places), values.get("repeats"))


def tilted(yaw: float, tilt: float, towards: float) -> FloatArray:
    """Rotation (3, 3) of an artefact turned by ``yaw``, then leaned by ``tilt``, rad.

    Args:
        yaw: about the vertical.
        tilt: angle between its z axis and the vertical afterwards.
        towards: direction in the base, from the x axis, its z axis then leans to.
    """
    lean = tilt * np.array([-math.sin(towards), math.cos(towards), 0.0])
    return rotation_from_vector(lean) @ rotation_from_rpy([0.0, 0.0, yaw])


def _check_unit(section: YamlSection) -> None:
    if "position" in section:
        raise section.refuse("a position without its unit", "position_mm", at=("position",))


def _placement(name: str, section: YamlSection) -> Placement:
    _check_unit(section)
    return Placement(name, **{"rotation": np.eye(3), **POSE.read(section)}, line=section.line)


def _point(name: str, section: YamlSection, directions: int) -> TouchPoint:
    _check_unit(section)
    defaults = {"directions": directions, "axis": np.array(DOWN), "cone": DEFAULT_CONE}
    return TouchPoint(name, **{**defaults, **POINT_KEYS.read(section)}, line=section.line)


def _posture(name: str, section: YamlSection, arm: ArmModel) -> Posture:
    POSTURE_KEYS.check(section)
    readings: dict[str, float] = {}
    units: tuple[Unit, ...] = ("rad", "m")
    for unit in units:
        if key("posture", unit) not in section:
            continue
        listed = section.section(key("posture", unit))
        for joint in listed.data:
            if joint not in arm.joints:
                hint = did_you_mean(joint, arm.joints)
                expected = ", ".join(arm.joints)
                raise listed.refuse(f"no joint {joint!r}", expected, at=(joint,), hint=hint)
            if arm.units[joint] != unit:
                other = "posture_mm" if unit == "rad" else "posture_deg"
                raise listed.refuse(
                    "a reading in the wrong unit", f"the reading under {other}", at=(joint,)
                )
            readings[joint] = stored(listed.number(joint), unit)
    if missing := [joint for joint in arm.joints if joint not in readings]:
        raise section.refuse(
            f"no reading of {missing[0]}", f"readings of all of {', '.join(arm.joints)}"
        )
    return Posture(name, np.array([readings[joint] for joint in arm.joints]), section.line)


def _grid(name: str, section: YamlSection) -> list[Place]:
    values = GRID_KEYS.read(section)
    axes = [values.get(field.name, [0.0]) for field in GRID_KEYS]
    count = math.prod(len(values) for values in axes)
    if count > _MOST:
        raise section.refuse(f"{count} placements", f"at most {_MOST}", hint="use a coarser grid")
    places: list[Place] = []
    for x, y, z, yaw, tilt, towards in itertools.product(*axes):
        turned = tilted(*(from_deg(angle) for angle in (yaw, tilt, towards)))
        where = from_mm(np.array([x, y, z]))
        places.append(Placement(f"{name}_{len(places) + 1}", where, turned, section.line))
    return places
