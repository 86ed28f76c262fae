"""``simulation.yaml`` as typed data: SI units, paths resolved, every key checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError, ParameterError
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.model.arm import ArmModel
from suta_calib.showing import Displayable
from suta_calib.simulation.keys import (
    ARM_UNITS,
    ERROR_KEYS,
    SIMULATION_KEYS,
    PoseSpec,
    common_set_keys,
    named,
    set_keys,
)
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.terms import KINDS, Term
from suta_calib.units import Unit, key, stored


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
    """One folder of simulated samples: the keys of a set (`keys.set_keys`), in SI.

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


def read_simulation(path: str | Path) -> SimulationSpec:
    """Read and check ``simulation.yaml``; paths in it are relative to the file.

    Raises:
        JobError: the file cannot be read, or a key is unknown, missing or unusable; names the
            line and the key.
    """
    top = YamlSection(read_yaml(Path(path), JobError), JobError)
    values = SIMULATION_KEYS.read(top)
    noise = values.get("noise", NoiseLevels())
    return SimulationSpec(
        Path(path),
        **{"base": None, **values["arm"]},
        seed=values.get("seed", 0),
        posture=_posture(top),
        errors=tuple(map(_error_row, top.sections("errors"))) if "errors" in top else (),
        sets=tuple(named(top, "sets", lambda name, section: _set(name, section, noise)).values()),
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


def _error_row(row: YamlSection) -> ErrorRow:
    numbers = ERROR_KEYS.read(row)
    value, std = (
        {str(unit): numbers[key(name, unit)] for unit in ARM_UNITS if key(name, unit) in numbers}
        for name in ("value", "std")
    )
    if both := value.keys() & std.keys():
        raise row.refuse(f"a value and a std in {'/'.join(sorted(both))}", "one of them")
    if not value and not std:
        sizes = ", ".join(ERROR_KEYS.names[1:])
        raise row.refuse("no size of the error", f"at least one of {sizes}")
    return ErrorRow(numbers["select"], value, std, row.line)


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
