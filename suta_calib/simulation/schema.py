"""``simulation.yaml`` as typed data: its keys, SI units, paths resolved, everything checked."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from suta_calib.arguments import checked
from suta_calib.arm_keys import CHAIN_KEYS, ROBOTS, ArmSpec, read_arm
from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.measurements.fields import (
    ANGLE_OR_0,
    DIRECTION,
    FILE,
    FLAG,
    POSE,
    POSITION,
    TEXTS,
    XYZ_MM,
    Field,
    Fields,
    Value,
    choice,
    cone,
    fields_of,
    mapping,
    quantity,
    rows,
    whole_number,
)
from suta_calib.measurements.samples import TEMPERATURES
from suta_calib.measurements.yaml_file import Sign
from suta_calib.simulation.motion import MotionSpec
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.terms import KINDS, Term
from suta_calib.units import REFERENCE_TEMPERATURE, Unit, key, stored

T = TypeVar("T")

# A name becomes a file's or a folder's, on any system.
PORTABLE_NAME: Final = re.compile(r"\w[\w.-]*")


@dataclass(frozen=True, eq=False)
class PoseSpec(Displayable):
    """A rigid transform: rotation (3, 3) and position (3,), m; ``line`` says where it stands."""

    rotation: FloatArray
    position: FloatArray
    line: int | None = None


@dataclass(frozen=True)
class ErrorRow(Displayable):
    """True departure from nominal of the parameters that some names or globs select.

    Attributes:
        select: names, globs, or the word ``geometric``.
        value: by unit, the departure itself, m, rad or rad/(N·m).
        std: by unit, the standard deviation it is drawn with, likewise.
        line: line of the row in the file.
    """

    select: tuple[str, ...]
    value: dict[str, float]
    std: dict[str, float]
    line: int | None = None


@dataclass(frozen=True)
class PostureRow:
    """A joint's reading from which the search for a posture starts."""

    joint: str  # its name
    reading: float  # rad, or m for a prismatic joint
    unit: Unit  # of the reading
    line: int | None = None  # line of the row in the file

    @property
    def key(self) -> str:
        """Where the row stands in the file."""
        return f"{key('posture', self.unit)}.{self.joint}"


@dataclass(frozen=True, eq=False)
class SetSpec(Displayable):
    """One folder of simulated samples: the keys of a set (`set_keys`), in SI.

    Attributes:
        name: of the set and of its folder.
        places: by label, where what is touched stands in the base: the artefact, a point, ….
        axis: (3,) unit vector in the base; None for the place's own z axis turned round.
        frames: by key (such as ``base_in_instrument``), the frames of the kind that are stated.
        settings: what the kind's own keys say, as it has read them.
        marks: by label, where on the tip's link what is seen sits; empty where the tip is seen.
        line: line of the set in the file.
        seating: (3,) how the tip always sits in its sockets: x and y off their axes, m, and the
            turn about the tool's axis, rad.
        temperature: lowest and highest of the arm, °C; None where no file says.
        payloads: masses that the tip carries, one of them in each sample, kg; empty for none.
        payload_place: (3,) where their centre is in the frame of the tip, m.
        lean: of links with a tilt sensor, standard deviation about either horizontal axis, rad.
        motion: how the arm moves while it is seen; None for one that rests at each row.
        chain: whose samples they are, where the arm has several chains.
        base_chain: the chain from whose tip it is seen or touched; empty for its own base.
        link: as of `ObservationSpec`.
    """

    name: str
    kind: str
    noise: NoiseLevels = field(default_factory=NoiseLevels)
    outliers: OutlierSpec = field(default_factory=lambda: OutlierSpec(0.0, (0.0, 0.0)))
    artefact: Path | None = None
    places: Mapping[str, PoseSpec] = field(default_factory=dict)
    repeats: int = 1
    directions: int = 20
    axis: FloatArray | None = None
    cone: float = math.pi / 3
    samples: int = 100
    frames: Mapping[str, PoseSpec] = field(default_factory=dict)
    orientation: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    marks: Mapping[str, PoseSpec] = field(default_factory=dict)
    line: int | None = None
    seating: tuple[float, float, float] = (0.0, 0.0, 0.0)
    temperature: tuple[float, float] | None = None
    payloads: tuple[float, ...] = ()
    payload_place: tuple[float, ...] = (0.0, 0.0, 0.0)
    lean: float = 0.0
    motion: MotionSpec | None = None
    chain: str = ""
    base_chain: str = ""
    link: str = ""

    @property
    def term(self) -> type[Term]:
        """What its samples are observations of."""
        return KINDS[self.kind]

    @property
    def places_key(self) -> str:
        """The key under which the places that are touched stand in the file."""
        return f"{self.term.place}s"


@dataclass(frozen=True)
class SimulationSpec(Displayable):
    """A whole ``simulation.yaml``.

    Attributes:
        path: the file.
        arm: the nominal arm, or the chains of a robot.
        seed: of every random number.
        posture: where the first search for a posture starts; joints that are not named start at
            the middle of their range.
        errors: how the true arm departs from the nominal one; later rows win.
        sets: what is measured.
    """

    path: Path
    arm: ArmSpec
    seed: int
    posture: tuple[PostureRow, ...]
    errors: tuple[ErrorRow, ...]
    sets: tuple[SetSpec, ...]


def named(parent: YamlSection, under: str, read: Callable[[str, YamlSection], T]) -> dict[str, T]:
    """What ``read`` makes of every mapping under a key, by names that files can have."""
    listed = parent.section(under)
    for name in listed.data:
        if not PORTABLE_NAME.fullmatch(name):
            raise listed.refuse(repr(name), "letters, digits, '_', '-' and '.'", at=(name,))
    return {name: read(name, listed.section(name)) for name in listed.data}


def _read_pose(section: YamlSection, keys: Fields = POSE) -> PoseSpec:
    return PoseSpec(**{"rotation": np.eye(3), **keys.read(section)}, line=section.line)


def _poses(keys: Fields = POSE) -> Value:
    """Poses by label."""
    return Value(
        "by label",
        lambda section, name: named(section, name, lambda _, entry: _read_pose(entry, keys)),
        keys,
    )


def _read_temperature(section: YamlSection, name: str) -> tuple[float, float]:
    """Of a set, °C; refused where no samples file could say it."""
    low, high = section.numbers(name, 2)
    coldest, hottest = TEMPERATURES
    if not coldest <= low <= high <= hottest:
        expected = f"[lowest, highest] in °C, from {coldest:g} to {hottest:g}"
        raise section.refuse(f"[{low:g}, {high:g}]", expected, at=(name,))
    return low, high


def _read_masses(section: YamlSection, name: str) -> tuple[float, ...]:
    """Of which each is zero or more, kg."""
    given = section.data.get(name)
    masses = section.numbers(name, max(len(given), 1) if isinstance(given, list) else 1)
    for index, mass in enumerate(masses):
        if mass < 0:
            raise section.refuse(f"{mass:g}", "a mass in kg, 0 or more", at=(name, index))
    return tuple(masses)


def _read_seat(section: YamlSection, name: str) -> tuple[float, ...]:
    offsets = SEAT_KEYS.read(section.section(name))
    return tuple(offsets.get(field.attribute, 0.0) for field in SEAT_KEYS)


# A point has no orientation.
POINT_KEYS: Final = Fields(POSITION)
# Of what an arm's parameters may be.
ARM_UNITS: Final[tuple[Unit, ...]] = ("m", "rad", "rad/Nm", "kg", "1/K", "1")
_SIZES: Final[tuple[tuple[str, Sign, str], ...]] = (
    ("value", "any", "The difference from nominal."),
    ("std", "non-negative", "Standard deviation of the random differences from nominal."),
)
ERROR_KEYS: Final = Fields(
    Field(
        "select",
        TEXTS,
        "The parameters that differ from nominal; geometric means the same as in "
        "calibration.yaml. Later rows override earlier ones.",
        required=True,
    ),
    *(
        Field(key(name, unit), quantity(unit, sign), about, given_attribute=key(name, unit))
        for name, sign, about in _SIZES
        for unit in ARM_UNITS
    ),
)


def _error_row(row: YamlSection) -> ErrorRow:
    numbers = ERROR_KEYS.read(row)
    value, std = (
        {str(unit): numbers[key(name, unit)] for unit in ARM_UNITS if key(name, unit) in numbers}
        for name in ("value", "std")
    )
    if both := value.keys() & std.keys():
        raise row.refuse(f"a value and a std in {'/'.join(sorted(both))}", "only one of them")
    if not value and not std:
        sizes = ", ".join(ERROR_KEYS.names[1:])
        raise row.refuse("no size of the error", f"at least one of {sizes}")
    return ErrorRow(numbers["select"], value, std, row.line)


SEAT_KEYS: Final = Fields(
    Field("x_mm", quantity("m"), "Constant offset of the tip from the socket's axis, along x."),
    Field("y_mm", quantity("m"), "Constant offset of the tip from the socket's axis, along y."),
    Field("rz_deg", quantity("rad"), "Constant rotation of the tip about the tool's axis."),
)
_NOISE: Final = "Standard deviations of the noise; default 0"


def set_keys(kind: type[Term]) -> Fields:
    """The keys of a set of one kind of observation."""
    measured = {*kind.measured_keys}
    kind_keys = (*(key for key in kind.keys if key.name not in measured), *kind.simulation_keys)
    return Fields(*common_set_keys(kind), *kind_keys)


def common_set_keys(kind: type[Term]) -> Fields:
    """The keys of a set beside those that the kind itself reads."""
    return Fields(
        Field("kind", choice(KINDS), "Kind of the observation.", required=True),
        *CHAIN_KEYS,
        Field("noise", mapping(NoiseLevels), f"{_NOISE}; replaces the noise of the file."),
        Field("outliers", mapping(OutlierSpec), "Outliers among the samples; default none."),
        *_medium_keys(kind),
    )


def _medium_keys(kind: type[Term]) -> tuple[Field, ...]:
    """What follows from whether a tip touches or something sees."""
    if kind.medium != "touch":
        pose = Value("mapping", lambda section, name: _read_pose(section.section(name)), POSE)
        frames = (
            Field(frame.key, pose, f"{frame.about[0].upper()}{frame.about[1:]}.", frame.required)
            for frame in kind.frames
        )
        optional = kind.columns.orientation == "optional"
        turned = "Whether orientations are measured too."
        marks = f"Position of each {kind.mark} on the tip's link; default: the tip itself."
        # Some ten seconds: 8,000 rows a second are simulated, but 120 pictures with their corners.
        most = 2000 if "image" in kind.columns.labels else 100_000
        return (
            Field("samples", whole_number(1, most), "Number of samples.", required=True),
            Field(
                "temperature",
                Value("lowest, highest in °C", _read_temperature),
                "Temperature of the arm, random for every sample and written to a column. "
                f"Default: {REFERENCE_TEMPERATURE:g}, without a column.",
            ),
            Field(
                "payload_kg",
                Value("list in kg", _read_masses),
                "Masses that the tip carries, one of them at random in every sample, written to "
                "columns. Default: none, without columns.",
                given_attribute="payloads",
            ),
            Field(
                "payload_position_mm",
                XYZ_MM,
                "Position of their centre in the frame of the tip; default: its origin.",
                given_attribute="payload_place",
            ),
            Field(
                "motion",
                mapping(MotionSpec),
                "The arm moves smoothly while it is seen, and the samples have a column time. "
                "Default: it rests at each row.",
            ),
            Field(
                "lean_deg",
                ANGLE_OR_0,
                "Lean of each link with a tilt sensor about either horizontal axis: standard "
                "deviation of what is random in every sample. Default: 0.",
                given_attribute="lean",
            ),
            *frames,
            *([Field("orientation", FLAG, turned)] if optional else []),
            *(
                [Field(f"{kind.mark}s", _poses(), marks, given_attribute="marks")]
                if kind.mark
                else []
            ),
        )
    where = Field(
        f"{kind.place}s",
        _poses(POSE if kind.place_turns else POINT_KEYS),
        f"Pose of each {kind.place} in the base frame.",
        required=True,
        given_attribute="places",
    )
    if kind.needs_artefact:
        return (
            Field("artefact", FILE, "The artefact.yaml of the touched artefact.", required=True),
            where,
            Field(
                "repeats",
                whole_number(1, 200),
                "How often each placement is measured; default 1.",
            ),
            Field(
                "seating",
                Value("mapping", _read_seat, SEAT_KEYS),
                "Constant error of the seated tip in its sockets.",
            ),
        )
    return (
        where,
        Field(
            "directions",
            # Of 1,400 a second, for each of which a posture is sought.
            whole_number(1, 10_000),
            "Number of directions from which each place is touched; default 20.",
        ),
        Field(
            "axis",
            DIRECTION,
            "Mean direction of the tip's z axis, in the base frame; default: opposite to the "
            "place's z axis.",
        ),
        Field(
            "cone_deg",
            cone("non-negative"),
            "Largest angle between the tip's z axis and axis; default 60.",
        ),
    )


SIMULATION_KEYS: Final = Fields(
    Field(
        "arm",
        Value("mapping", inside=fields_of(ArmSpec)),
        "The nominal arm: as in calibration.yaml.",
    ),
    ROBOTS,
    Field("seed", whole_number(0), "Seed of all random numbers; default 0."),
    Field(
        "posture_deg",
        Value("by joint, deg"),
        "Start of the first search for a posture; default: the middle of each joint's range.",
    ),
    Field("posture_mm", Value("by joint, mm"), "The same for prismatic joints."),
    Field("errors", rows(_error_row, ERROR_KEYS), "How the true arm differs from the nominal one."),
    Field("noise", mapping(NoiseLevels), f"{_NOISE}."),
    Field(
        "sets",
        Value("by name"),
        "The sets of measurements. Each set becomes a folder of samples with its name. Its keys "
        "depend on its kind.",
        required=True,
    ),
)


@checked
def read_simulation(path: str | Path) -> SimulationSpec:
    """Read and check ``simulation.yaml``; paths in it are relative to the file.

    Raises:
        JobError: the file cannot be read, or a key is unknown, missing or unusable; names the
            line and the key.
    """
    top = YamlSection(read_yaml(Path(path), JobError), JobError)
    values = SIMULATION_KEYS.read(top)
    noise = values.get("noise", NoiseLevels())
    arm = read_arm(top)
    sets = named(top, "sets", lambda name, section: _set(name, section, noise))
    for name, plan in sets.items():
        arm.check_chain(top.section("sets").section(name), plan.chain, plan.base_chain)
    arm, of_chains = arm.on_links([*sets.values()])
    return SimulationSpec(
        Path(path),
        arm,
        seed=values.get("seed", 0),
        posture=_posture(top),
        errors=values.get("errors", ()),
        sets=tuple(of_chains),
    )


def _posture(top: YamlSection) -> tuple[PostureRow, ...]:
    units: tuple[Unit, ...] = ("rad", "m")
    rows = []
    for unit in units:
        where = key("posture", unit)
        if where not in top:
            continue
        section = top.section(where)
        for joint in section.data:
            reading = stored(section.number(joint), unit)
            rows.append(PostureRow(joint, reading, unit, top.document.line_of(where, joint)))
    return tuple(rows)


def _set(name: str, section: YamlSection, noise: NoiseLevels) -> SetSpec:
    kind = KINDS[section.choice("kind", KINDS)]
    set_keys(kind).check(section)
    values = {"noise": noise, **common_set_keys(kind).values(section)}
    return SetSpec(
        name,
        frames={frame.key: values.pop(frame.key) for frame in kind.frames if frame.key in values},
        settings=kind.read_settings(section),
        line=section.line,
        **values,
    )
