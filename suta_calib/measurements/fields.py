"""The keys of a YAML file, each stated once: read, checked and documented from one `Field`.

A dataclass that a mapping of a file becomes states the keys in its fields (`keyed`), and `read_as`
makes one of a mapping. Where a mapping becomes no class of its own, `Fields` lists the keys.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import MISSING, dataclass
from functools import cache, cached_property
from itertools import chain
from typing import Any, Final, TypeVar, cast

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.inputs import UrdfFile, XacroFile
from suta_calib.measurements.yaml_file import LARGEST_WHOLE, Sign, YamlSection, shown
from suta_calib.units import SHOWN, Unit, from_deg, key, stored

T = TypeVar("T")


@dataclass(frozen=True)
class Value:
    """What the value of a key is.

    Attributes:
        takes: in words, such as ``file``, ``mm`` or ``rows``.
        read: makes a value in SI of a key that is there, or refuses it; None for a key that is
            read together with others.
        inside: the keys of the mapping, or of every row or named mapping, that is the value.
        unit: SI, of a number; the file has the unit that a reader sees, and its key says so.
    """

    takes: str
    read: Callable[[YamlSection, str], Any] | None = None
    inside: Fields | None = None
    unit: Unit = "1"


@dataclass(frozen=True)
class Field:
    """One key of a mapping.

    Attributes:
        name: as it stands in the file.
        value: what it takes.
        about: what it says, and what holds without it.
        required: whether it must be there.
        given_attribute: what its value is called in the package; its name without the unit by
            default.
    """

    name: str
    value: Value
    about: str
    required: bool = False
    given_attribute: str = ""

    @property
    def attribute(self) -> str:
        """What its value is called in the package, where it is in SI."""
        return self.given_attribute or self.name.removesuffix(SHOWN[self.value.unit].suffix)


class Fields:
    """The keys that one mapping of a file may have.

    Args:
        fields: each name once, in the order in which they are shown; a function stands for those
            that take long to find out, and is asked when they are needed.
    """

    def __init__(self, *fields: Field | Callable[[], Iterable[Field]]) -> None:
        self._given: Final = fields

    def __iter__(self) -> Iterator[Field]:
        return iter(self._fields)

    @cached_property
    def _fields(self) -> tuple[Field, ...]:
        parts = ((part,) if isinstance(part, Field) else part() for part in self._given)
        return tuple(chain.from_iterable(parts))

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(field.name for field in self)

    @property
    def required(self) -> tuple[str, ...]:
        """Names of those that must be there."""
        return tuple(field.name for field in self if field.required)

    def check(self, section: YamlSection) -> None:
        """Refuse any other key in a mapping, and the absence of those that must be there."""
        section.check_keys(self.names, self.required)

    def values(self, section: YamlSection, without: Collection[str] = ()) -> dict[str, Any]:
        """The values of the keys that are there, by attribute; other keys are not looked at."""
        return {
            field.attribute: field.value.read(section, field.name)
            for field in self
            if field.value.read and field.name in section and field.attribute not in without
        }

    def read(self, section: YamlSection, without: Collection[str] = ()) -> dict[str, Any]:
        """`check`, then `values`."""
        self.check(section)
        return self.values(section, without)


def keyed(value: Value | Field, about: str = "", default: Any = MISSING, name: str = "") -> Any:
    """A field of a dataclass that is a key of a file.

    Args:
        value: what the key takes; or the key, where several classes have it.
        about: what it says, and what holds without it.
        default: of the dataclass's field, in SI; a function makes it anew each time. The key must
            be there without it.
        name: in the file; that of the dataclass's field, with the unit's suffix, without it.
    """
    if isinstance(value, Value):
        value = Field(name, value, about, required=default is MISSING)
    made: dict[str, Any] = {"default_factory" if callable(default) else "default": default}
    return dataclasses.field(**made, metadata={Field: value})


@cache
def fields_of(cls: Any) -> Fields:
    """The keys that the fields of a dataclass state."""
    return Fields(
        *(
            dataclasses.replace(
                field,
                name=field.name or key(part.name, field.value.unit),
                given_attribute=part.name,
            )
            for part in dataclasses.fields(cls)
            for field in [part.metadata.get(Field)]
            if field is not None
        )
    )


def read_as(cls: type[T], section: YamlSection, /, **more: Any) -> T:
    """A dataclass made of a mapping whose keys its fields state."""
    fields: Fields = fields_of(cast(Any, cls))
    return cls(**fields.read(section, more), **more)


# ── what a key takes ─────────────────────────────────────────────────────────────────────────
def quantity(unit: Unit = "1", sign: Sign = "any", takes: str = "") -> Value:
    """A finite number, in SI once it is read.

    Args:
        unit: SI; the file has the unit that a reader sees (mm, deg, …).
        sign: that it must have.
        takes: what the reference says of it; the unit, or ``number``, without it.
    """
    return Value(
        takes or SHOWN[unit].unit or "number",
        lambda section, name: stored(section.number(name, sign), unit),
        unit=unit,
    )


def whole_number(minimum: int, maximum: int = LARGEST_WHOLE) -> Value:
    """A whole number from ``minimum`` to ``maximum``."""
    return Value("whole number", lambda section, name: section.integer(name, minimum, maximum))


def bits(minimum: int) -> Value:
    """Of an encoder."""
    return Value("whole number", lambda section, name: section.bits(name, minimum))


def choice(options: Collection[str], takes: str = "text") -> Value:
    """One of a few words."""
    return Value(takes, lambda section, name: section.choice(name, options))


def mapping(of: Any) -> Value:
    """A mapping: an object of a dataclass whose fields state its keys, or values by attribute."""

    def read(section: YamlSection, name: str) -> Any:
        below = section.section(name)
        return of.read(below) if isinstance(of, Fields) else read_as(of, below)

    return Value("mapping", read, of if isinstance(of, Fields) else fields_of(of))


def cone(sign: Sign) -> Value:
    """Half the opening of a cone."""

    def read(section: YamlSection, name: str) -> float:
        angle = section.number(name, sign)
        if angle > 180:
            raise section.refuse(f"{angle:g}", "at most 180 degrees", at=(name,))
        return from_deg(angle)

    return Value("deg", read, unit="rad")


def _direction(section: YamlSection, name: str) -> FloatArray:
    vector = np.array(section.numbers(name, 3))
    if not vector.any():
        raise section.refuse("a vector of length zero", "a direction", at=(name,))
    return np.asarray(vector / np.linalg.norm(vector))


DIRECTION: Final = Value("x, y, z", _direction)


def rows(read: Callable[[YamlSection], Any], inside: Fields, least: int = 1) -> Value:
    """What ``read`` makes of each mapping of a list with ``least`` (0 or 1) at least."""
    return Value(
        "rows", lambda section, name: tuple(map(read, section.sections(name, least))), inside
    )


TEXT: Final = Value("text", YamlSection.text)
TEXTS: Final = Value("names or globs", YamlSection.texts)
FLAG: Final = Value("true or false", YamlSection.flag)
FILE: Final = Value("file", YamlSection.existing_file)
FILES: Final = Value("files", YamlSection.files)
XYZ_MM: Final = Value("x, y, z in mm", YamlSection.position, unit="m")
XYZ_DEG: Final = Value(
    "x, y, z in deg",
    lambda section, name: from_deg(np.array(section.numbers(name, 3))),
    unit="rad",
)
RPY_DEG: Final = Value("roll, pitch, yaw in deg", YamlSection.rotation)
LENGTH: Final = quantity("m", "positive")
LENGTH_OR_0: Final = quantity("m", "non-negative")
ANGLE: Final = quantity("rad", "positive")
ANGLE_OR_0: Final = quantity("rad", "non-negative")

# ── keys that several files have ─────────────────────────────────────────────────────────────
_XACRO: Final = Fields(
    Field("file", FILE, "The .xacro file.", required=True),
    Field("args", Value("values by name"), "Values of its arguments.", required=True),
)


def urdf_file(section: YamlSection, name: str) -> UrdfFile:
    """The file of a URDF, or a .xacro file with its arguments."""
    if not isinstance(section.data.get(name), dict):
        return section.existing_file(name)
    below = section.section(name)
    _XACRO.check(below)
    file, values = below.existing_file("file"), below.section("args")
    if file.suffix.lower() != ".xacro":
        raise below.refuse(
            "args for a file that is not a .xacro", "only the name of the file", at=("args",)
        )
    arguments = dict[str, str]()
    for argument, value in values.data.items():
        if not isinstance(value, str | int | float):
            raise values.refuse(shown(value), "text, a number, true or false", at=(argument,))
        # As xacro writes them.
        arguments[str(argument)] = str(value).lower() if isinstance(value, bool) else str(value)
    return XacroFile(file, arguments)


URDF: Final = Field(
    "urdf",
    Value("file, or a mapping", urdf_file, _XACRO),
    "The arm's URDF; or a .xacro file that makes it, with values of its arguments: {file: "
    "ur.urdf.xacro, args: {ur_type: ur5e}}.",
    required=True,
)
TIP: Final = Field("tip", TEXT, "Link or frame of the tip.", required=True)
BASE: Final = Field("base", TEXT, "First link of the chain; default: the root link of the URDF.")
GRAVITY: Final = Field(
    "gravity",
    DIRECTION,
    "Direction of gravity along the axes of the URDF's root link, for an arm on a wall or a "
    "ceiling; default: [0, 0, -1]. Compliances depend on it.",
)
POSITION: Final = Field("position_mm", XYZ_MM, "Position of its origin.", required=True)
ROTATION: Final = Field(
    "rotation_rpy_deg",
    RPY_DEG,
    "Its orientation, as in a URDF; default: not rotated.",
    given_attribute="rotation",
)
POSE: Final = Fields(POSITION, ROTATION)
