"""``simulation.yaml`` as typed data: SI units, paths resolved, every key checked."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError, ParameterError
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.measurements.keys import POSE
from suta_calib.measurements.samples import TEMPERATURES
from suta_calib.measurements.yaml_file import Sign
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.keys import (
    ARM_KEYS,
    ARM_UNITS,
    ERROR_KEYS,
    NOISE_KEYS,
    OUTLIER_KEYS,
    POINT_KEYS,
    SEAT_KEYS,
    SIMULATION_KEYS,
    set_keys,
)
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.terms import KINDS, Term
from suta_calib.units import Unit, from_deg, from_mm, key, stored

# A name becomes a file's or a folder's, on any system.
# What takes some ten seconds: 8,000 rows a second are simulated of what is seen, and 1,400 of what
# is touched, for each of which a posture is sought.
MOST_SAMPLES: Final = 100_000
# Hundreds of corners each: 120 a second.
MOST_PICTURES: Final = 2000
MOST_DIRECTIONS: Final = 10_000
MOST_REPEATS: Final = 200
_PORTABLE_NAME: Final = re.compile(r"\w[\w.-]*")

T = TypeVar("T")


@dataclass(frozen=True)
class ErrorRow:
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
    """A joint's reading from which the search for a posture starts.

    Attributes:
        joint: its name.
        reading: rad, or m for a prismatic joint.
        unit: of the reading.
        line: line of the row in the file.
    """

    joint: str
    reading: float
    unit: Unit
    line: int | None = None

    @property
    def key(self) -> str:
        """Where the row stands in the file."""
        return f"{key('posture', self.unit)}.{self.joint}"


@dataclass(frozen=True, eq=False)
class PoseSpec:
    """A rigid transform: rotation (3, 3) and position (3,), m; ``line`` says where it stands."""

    rotation: FloatArray
    position: FloatArray
    line: int | None = None


@dataclass(frozen=True, eq=False)
class SetSpec:
    """One folder of simulated samples.

    Attributes:
        name: of the set and of its folder.
        kind: of observation, one of `terms.KINDS`.
        noise: how the measurements scatter.
        outliers: which share of them is grossly wrong.
        artefact: the artefact's file, for the kinds that touch one.
        places: by label, where what is touched stands in the base: the artefact, a point, ….
        repeats: how often each placement of an artefact is gone through.
        directions: how many directions every other place is touched from.
        axis: (3,) unit vector in the base, the middle of the tip's z axes; against the place's own
            z axis by default.
        cone: largest angle between a tip's z axis and ``axis``, rad.
        samples: number of samples of an external instrument or of a camera.
        frames: by key (such as ``base_in_instrument``), the frames of the kind that are stated.
        orientation: whether the instrument sees orientations too.
        settings: what the kind's own keys say, as it has read them.
        marks: by label, where on the tip's link what is seen sits; empty where the tip is seen.
        line: line of the set in the file.
        seating: (3,) how the tip always sits in its sockets: x and y off their axes, m, and the
            turn about the tool's axis, rad.
        temperature: lowest and highest of the arm, °C, where something sees it; None for the
            temperature of its drawing.
    """

    name: str
    kind: str
    noise: NoiseLevels = field(default_factory=NoiseLevels)
    outliers: OutlierSpec = field(default_factory=OutlierSpec)
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

    @property
    def term(self) -> type[Term]:
        """What its samples are observations of."""
        return KINDS[self.kind]

    @property
    def places_key(self) -> str:
        """The key under which the places that are touched stand in the file."""
        return f"{self.term.place}s"


@dataclass(frozen=True)
class SimulationSpec:
    """A whole ``simulation.yaml``.

    Attributes:
        path: the file.
        urdf, tip, base: the nominal arm and the ends of its chain; base None for the root link.
        tip_offset: (3,) where the tip is in the frame that the URDF has for it, m; None for its
            origin.
        seed: of every random number.
        posture: where the first search for a posture starts; joints that are not named start at
            the middle of their range.
        errors: how the true arm departs from the nominal one; later rows win.
        sets: what is measured.
    """

    path: Path
    urdf: Path
    tip: str
    base: str | None
    seed: int
    posture: tuple[PostureRow, ...]
    errors: tuple[ErrorRow, ...]
    sets: tuple[SetSpec, ...]
    tip_offset: FloatArray | None = None

    def on(self, arm: ArmModel) -> ArmModel:
        """The nominal arm with its tip at `tip_offset`.

        Raises:
            JobError: the tip is on a link that moves, and so has no placement of its own.
        """
        if self.tip_offset is None:
            return arm
        try:
            return arm.with_tip_moved(self.tip_offset)
        except ParameterError as problem:
            raise JobError.of(problem, self.path, None) from None


def read_simulation(path: Path) -> SimulationSpec:
    """Read and check ``simulation.yaml``; paths in it are relative to the file.

    Raises:
        JobError: the file cannot be read, or a key is unknown, missing or unusable; names the
            line and the key.
    """
    top = YamlSection(read_yaml(Path(path), JobError), JobError)
    SIMULATION_KEYS.check(top)
    arm = top.section("arm")
    ARM_KEYS.check(arm)
    noise = _noise(top.section("noise")) if "noise" in top else NoiseLevels()
    return SimulationSpec(
        Path(path),
        arm.existing_file("urdf"),
        arm.text("tip"),
        arm.text("base") if "base" in arm else None,
        top.integer("seed", 0, minimum=0),
        _posture(top),
        tuple(_error_row(row) for row in top.sections("errors")) if "errors" in top else (),
        tuple(_named(top, "sets", lambda name, section: _set(name, section, noise)).values()),
        from_mm(np.array(arm.numbers("tip_offset_mm", 3))) if "tip_offset_mm" in arm else None,
    )


def _named(parent: YamlSection, under: str, read: Callable[[str, YamlSection], T]) -> dict[str, T]:
    """What ``read`` makes of every mapping under a key, by names that files can have."""
    listed = parent.section(under)
    for name in listed.data:
        if not _PORTABLE_NAME.fullmatch(name):
            raise listed.refuse(repr(name), "letters, digits, '_', '-' and '.'", at=(name,))
    return {name: read(name, listed.section(name)) for name in listed.data}


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


def _error_row(row: YamlSection) -> ErrorRow:
    ERROR_KEYS.check(row)
    value = _by_unit(row, "value")
    std = _by_unit(row, "std")
    if both := value.keys() & std.keys():
        raise row.refuse(f"a value and a std in {'/'.join(sorted(both))}", "one of them")
    if not value and not std:
        sizes = ", ".join(ERROR_KEYS.names[1:])
        raise row.refuse("no size of the error", f"at least one of {sizes}")
    return ErrorRow(row.texts("select"), value, std, row.line)


def _by_unit(row: YamlSection, name: Literal["value", "std"]) -> dict[str, float]:
    """``value_mm``, ``value_deg``, … as {"m": …, "rad": …}; a std must not be negative."""
    sign: Sign = "non-negative" if name == "std" else "any"
    numbers = {unit: row.optional_number(key(name, unit), sign, unit=unit) for unit in ARM_UNITS}
    return {unit: number for unit, number in numbers.items() if number is not None}


def _noise(section: YamlSection) -> NoiseLevels:
    NOISE_KEYS.check(section)

    def level(name: str, unit: Unit) -> float:
        return section.optional_number(name, "non-negative", unit=unit) or 0.0

    return NoiseLevels(
        seating=level("seating_mm", "m"),
        seating_angle=level("seating_deg", "rad"),
        encoder_angle=level("encoder_deg", "rad"),
        encoder_length=level("encoder_mm", "m"),
        encoder_bits=section.bits("encoder_bits", minimum=0),
        instrument=level("instrument_mm", "m"),
        instrument_angle=level("instrument_deg", "rad"),
        corner=section.optional_number("corner_px", "non-negative") or 0.0,
        artefact=section.flag("artefact"),
    )


def _outliers(section: YamlSection) -> OutlierSpec:
    OUTLIER_KEYS.check(section)
    fraction = section.number("fraction", "non-negative")
    if fraction > 1:
        raise section.refuse(f"{fraction:g}", "a share from 0 to 1", at=("fraction",))
    low, high = section.numbers("size_mm", 2)
    if not 0 <= low <= high:
        raise section.refuse(f"[{low:g}, {high:g}]", "[smallest, largest] size", at=("size_mm",))
    return OutlierSpec(fraction, from_mm(low), from_mm(high))


def _set(name: str, section: YamlSection, noise: NoiseLevels) -> SetSpec:
    kind = KINDS[section.choice("kind", KINDS)]
    set_keys(kind).check(section)
    touches_artefact = kind.medium == "touch" and kind.needs_artefact
    frames = [frame.key for frame in kind.frames if frame.key in section]
    places: dict[str, PoseSpec] = {}
    if kind.place:
        read = partial(_pose, turns=kind.place_turns)
        places = _named(section, f"{kind.place}s", lambda _, entry: read(entry))
    marks: dict[str, PoseSpec] = {}
    if kind.mark and f"{kind.mark}s" in section:
        marks = _named(section, f"{kind.mark}s", lambda _, entry: _pose(entry))
    axis = np.array(section.numbers("axis", 3)) if "axis" in section else None
    if axis is not None and not axis.any():
        raise section.refuse("a vector without direction", "a direction", at=("axis",))
    cone = section.optional_number("cone_deg", "non-negative")
    if cone is not None and cone > 180:
        raise section.refuse(f"{cone:g}", "at most 180 degrees", at=("cone_deg",))
    seating = section.section("seating") if "seating" in section else None
    if seating is not None:
        SEAT_KEYS.check(seating)
    return SetSpec(
        name,
        kind.kind,
        _noise(section.section("noise")) if "noise" in section else noise,
        _outliers(section.section("outliers")) if "outliers" in section else OutlierSpec(),
        section.existing_file("artefact") if touches_artefact else None,
        places,
        section.integer("repeats", SetSpec.repeats, 1, MOST_REPEATS),
        section.integer("directions", SetSpec.directions, 1, MOST_DIRECTIONS),
        None if axis is None else axis / np.linalg.norm(axis),
        SetSpec.cone if cone is None else from_deg(cone),
        section.integer(
            "samples",
            SetSpec.samples,
            1,
            MOST_PICTURES if "image" in kind.columns.labels else MOST_SAMPLES,
        ),
        {key: _pose(section.section(key)) for key in frames},
        section.flag("orientation"),
        kind.read_settings(section),
        marks,
        section.line,
        SetSpec.seating
        if seating is None
        else (
            seating.optional_number("x_mm", unit="m") or 0.0,
            seating.optional_number("y_mm", unit="m") or 0.0,
            seating.optional_number("rz_deg", unit="rad") or 0.0,
        ),
        _temperature(section) if "temperature" in section else None,
    )


def _temperature(section: YamlSection) -> tuple[float, float]:
    """Of a set, °C; refused where no samples file could say it."""
    low, high = section.numbers("temperature", 2)
    coldest, hottest = TEMPERATURES
    if not coldest <= low <= high <= hottest:
        expected = f"[lowest, highest] in °C, from {coldest:g} to {hottest:g}"
        raise section.refuse(f"[{low:g}, {high:g}]", expected, at=("temperature",))
    return low, high


def _pose(section: YamlSection, *, turns: bool = True) -> PoseSpec:
    (POSE if turns else POINT_KEYS).check(section)
    rotation, position = section.rotation(), section.position()
    return PoseSpec(np.eye(3) if rotation is None else rotation, position, section.line)
