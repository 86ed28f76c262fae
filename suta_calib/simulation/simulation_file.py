"""``simulation.yaml`` read and checked: SI units, paths resolved, every key known."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.measurements.yaml_file import Sign
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.simulation.schema import (
    SUFFIX,
    ErrorRow,
    PoseSpec,
    PostureRow,
    SetSpec,
    SimulationSpec,
)
from suta_calib.terms import KINDS, Term
from suta_calib.units import Unit, from_deg, from_mm, stored

_NOISE_KEYS: Final = (
    *("seating_mm", "seating_deg", "encoder_deg", "encoder_mm", "encoder_bits"),
    *("instrument_mm", "instrument_deg", "artefact"),
)
_ERROR_KEYS: Final = tuple(f"{key}_{s}" for key in ("value", "std") for s in SUFFIX.values())
_MOST_BITS: Final = 52
# A name becomes a file's or a folder's, on any system.
_PORTABLE_NAME: Final = re.compile(r"\w[\w.-]*")

T = TypeVar("T")


def read_simulation(path: Path) -> SimulationSpec:
    """Read and check ``simulation.yaml``; paths in it are relative to the file.

    Raises:
        JobError: the file cannot be read, or a key is unknown, missing or unusable; names the
            line and the key.
    """
    top = YamlSection(read_yaml(Path(path), JobError), JobError)
    known = ("arm", "seed", "posture_deg", "posture_mm", "errors", "noise", "sets")
    top.check_keys(known, required=("arm", "sets"))
    arm = top.section("arm")
    arm.check_keys(("urdf", "tip", "base"), required=("urdf", "tip"))
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
    )


def _named(parent: YamlSection, key: str, read: Callable[[str, YamlSection], T]) -> dict[str, T]:
    """What ``read`` makes of every mapping under a key, by names that files can have."""
    listed = parent.section(key)
    for name in listed.data:
        if not _PORTABLE_NAME.fullmatch(name):
            raise listed.refuse(repr(name), "letters, digits, '_', '-' and '.'", at=(name,))
    return {name: read(name, listed.section(name)) for name in listed.data}


def _posture(top: YamlSection) -> tuple[PostureRow, ...]:
    units: tuple[Unit, ...] = ("rad", "m")
    rows = []
    for unit in units:
        key = f"posture_{SUFFIX[unit]}"
        if key not in top:
            continue
        section = top.section(key)
        for joint in section.data:
            reading = stored(section.number(joint), unit)
            line = top.document.line_of(key, joint)
            rows.append(PostureRow(joint, reading, unit, line))
    return tuple(rows)


def _error_row(row: YamlSection) -> ErrorRow:
    row.check_keys(("select", *_ERROR_KEYS), required=("select",))
    value = _by_unit(row, "value")
    std = _by_unit(row, "std")
    if both := value.keys() & std.keys():
        raise row.refuse(f"a value and a std in {'/'.join(sorted(both))}", "one of them")
    if not value and not std:
        raise row.refuse("no size of the error", f"at least one of {', '.join(_ERROR_KEYS)}")
    return ErrorRow(row.texts("select"), value, std, row.line)


def _by_unit(row: YamlSection, key: str) -> dict[str, float]:
    """``value_mm``, ``value_deg``, … as {"m": …, "rad": …}; a std must not be negative."""
    found: dict[str, float] = {}
    for unit, suffix in SUFFIX.items():
        sign: Sign = "non-negative" if key == "std" else "any"
        number = row.optional_number(f"{key}_{suffix}", sign)
        if number is not None:
            found[unit] = stored(number, unit)
    return found


def _noise(section: YamlSection) -> NoiseLevels:
    section.check_keys(_NOISE_KEYS)

    def level(key: str, unit: Unit) -> float:
        return stored(section.optional_number(key, "non-negative") or 0.0, unit)

    bits = section.integer("encoder_bits", 0, minimum=0)
    if bits > _MOST_BITS:
        raise section.refuse(str(bits), f"at most {_MOST_BITS} bits", at=("encoder_bits",))
    return NoiseLevels(
        seating=level("seating_mm", "m"),
        seating_angle=level("seating_deg", "rad"),
        encoder_angle=level("encoder_deg", "rad"),
        encoder_length=level("encoder_mm", "m"),
        encoder_bits=bits,
        instrument=level("instrument_mm", "m"),
        instrument_angle=level("instrument_deg", "rad"),
        artefact=section.flag("artefact"),
    )


def _outliers(section: YamlSection) -> OutlierSpec:
    section.check_keys(("fraction", "size_mm"), required=("fraction", "size_mm"))
    fraction = section.number("fraction", "non-negative")
    if fraction > 1:
        raise section.refuse(f"{fraction:g}", "a share from 0 to 1", at=("fraction",))
    low, high = section.numbers("size_mm", 2)
    if not 0 <= low <= high:
        raise section.refuse(f"[{low:g}, {high:g}]", "[smallest, largest] size", at=("size_mm",))
    return OutlierSpec(fraction, from_mm(low), from_mm(high))


def _set(name: str, section: YamlSection, noise: NoiseLevels) -> SetSpec:
    kind = KINDS[section.choice("kind", KINDS)]
    _check_keys(section, kind)
    touches_artefact = kind.medium == "touch" and kind.needs_artefact
    frames = [frame.key for frame in kind.frames if frame.key in section]
    return SetSpec(
        name,
        kind.kind,
        _noise(section.section("noise")) if "noise" in section else noise,
        _outliers(section.section("outliers")) if "outliers" in section else OutlierSpec(),
        section.existing_file("artefact") if touches_artefact else None,
        _places(section, kind) if kind.place else {},
        section.integer("repeats", SetSpec.repeats, minimum=1),
        section.integer("directions", SetSpec.directions, minimum=1),
        _direction(section) if "axis" in section else None,
        _cone(section),
        section.integer("samples", SetSpec.samples, minimum=1),
        {key: _pose(section.section(key)) for key in frames},
        section.flag("orientation"),
        kind.read_settings(section),
        section.line,
        _seating(section.section("seating")) if "seating" in section else (0.0, 0.0, 0.0),
    )


def _check_keys(section: YamlSection, kind: type[Term]) -> None:
    """Refuse keys that the kind has no use for, and the absence of those it needs."""
    places = f"{kind.place}s"
    known: tuple[str, ...]
    if kind.medium != "touch":
        required = ("samples", *(frame.key for frame in kind.frames if frame.required))
        optional = ("orientation",) if kind.columns.orientation == "optional" else ()
        known = ("samples", *(frame.key for frame in kind.frames), *optional)
    elif kind.needs_artefact:
        required, known = ("artefact", places), ("artefact", places, "repeats", "seating")
    else:
        required, known = (places,), (places, "directions", "axis", "cone_deg")
    own = (*kind.keys, *kind.simulation_keys)
    section.check_keys(("kind", "noise", "outliers", *known, *own), required=required)


def _places(section: YamlSection, kind: type[Term]) -> dict[str, PoseSpec]:
    read = _pose if kind.place_turns else _point
    return _named(section, f"{kind.place}s", lambda _, each: read(each))


def _seating(section: YamlSection) -> tuple[float, float, float]:
    units: dict[str, Unit] = {"x_mm": "m", "y_mm": "m", "rz_deg": "rad"}
    section.check_keys(units)
    x, y, rz = (stored(section.optional_number(k) or 0.0, unit) for k, unit in units.items())
    return x, y, rz


def _point(section: YamlSection) -> PoseSpec:
    section.check_keys(("position_mm",), required=("position_mm",))
    return _pose(section)


def _pose(section: YamlSection) -> PoseSpec:
    section.check_keys(("position_mm", "rotation_rpy_deg"), required=("position_mm",))
    turned = "rotation_rpy_deg" in section
    rpy = np.array(section.numbers("rotation_rpy_deg", 3) if turned else [0.0, 0.0, 0.0])
    position = np.array(section.numbers("position_mm", 3))
    return PoseSpec(rotation_from_rpy(from_deg(rpy)), from_mm(position), section.line)


def _direction(section: YamlSection) -> FloatArray:
    vector = np.array(section.numbers("axis", 3))
    length = np.linalg.norm(vector)
    if not length > 0:
        raise section.refuse("a vector without direction", "a direction", at=("axis",))
    return np.asarray(vector / length, dtype=float)


def _cone(section: YamlSection) -> float:
    cone = section.optional_number("cone_deg", "non-negative")
    if cone is not None and cone > 180:
        raise section.refuse(f"{cone:g}", "at most 180 degrees", at=("cone_deg",))
    return SetSpec.cone if cone is None else from_deg(cone)
