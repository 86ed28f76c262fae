"""``simulation.yaml`` read and checked: SI units, paths resolved, every key known."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.simulation.schema import (
    KINDS,
    SUFFIX,
    TOUCHED_ARTEFACT,
    ErrorRow,
    PoseSpec,
    PostureRow,
    SetSpec,
    SimulationSpec,
)
from suta_calib.units import Unit

_COMMON_KEYS: Final = ("kind", "noise", "outliers")
_KEYS_OF_KIND: Final = {
    "pairwise_distance": ("artefact", "placements", "repeats", "seating"),
    "landmark": ("artefact", "placements", "repeats", "seating"),
    "fixed_point": ("points", "directions", "axis", "cone_deg"),
    "tracked_point": ("samples", "base_in_instrument", "orientation"),
    "hand_eye": ("samples", "eye_in_tip", "target_in_base"),
}
_NOISE_KEYS: Final = (
    *("seating_mm", "seating_deg", "encoder_deg", "encoder_mm", "encoder_bits"),
    *("instrument_mm", "instrument_deg", "artefact"),
)
_ERROR_KEYS: Final = tuple(f"{key}_{s}" for key in ("value", "std") for s in SUFFIX.values())
_MOST_BITS: Final = 52
_M_PER_MM: Final = 1e-3
_RAD_PER_DEG: Final = math.pi / 180
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
    units: tuple[tuple[str, Unit, float], ...] = (
        ("posture_deg", "rad", _RAD_PER_DEG),
        ("posture_mm", "m", _M_PER_MM),
    )
    rows = []
    for key, unit, scale in units:
        if key not in top:
            continue
        section = top.section(key)
        for joint in section.data:
            reading = scale * section.number(joint)
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
        scale = _M_PER_MM if unit == "m" else _RAD_PER_DEG
        sign = "non-negative" if key == "std" else "any"
        number = row.optional_number(f"{key}_{suffix}", sign, scale)  # type: ignore[arg-type]
        if number is not None:
            found[unit] = number
    return found


def _noise(section: YamlSection) -> NoiseLevels:
    section.check_keys(_NOISE_KEYS)

    def level(key: str, scale: float) -> float:
        return section.optional_number(key, "non-negative", scale) or 0.0

    bits = section.integer("encoder_bits", 0, minimum=0)
    if bits > _MOST_BITS:
        raise section.refuse(str(bits), f"at most {_MOST_BITS} bits", at=("encoder_bits",))
    return NoiseLevels(
        seating=level("seating_mm", _M_PER_MM),
        seating_angle=level("seating_deg", _RAD_PER_DEG),
        encoder_angle=level("encoder_deg", _RAD_PER_DEG),
        encoder_length=level("encoder_mm", _M_PER_MM),
        encoder_bits=bits,
        instrument=level("instrument_mm", _M_PER_MM),
        instrument_angle=level("instrument_deg", _RAD_PER_DEG),
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
    return OutlierSpec(fraction, low * _M_PER_MM, high * _M_PER_MM)


def _set(name: str, section: YamlSection, noise: NoiseLevels) -> SetSpec:
    kind = section.choice("kind", KINDS)
    section.check_keys((*_COMMON_KEYS, *_KEYS_OF_KIND[kind]), required=_required(kind))
    touches = kind in TOUCHED_ARTEFACT
    return SetSpec(
        name,
        kind,
        _noise(section.section("noise")) if "noise" in section else noise,
        _outliers(section.section("outliers")) if "outliers" in section else OutlierSpec(),
        section.existing_file("artefact") if touches else None,
        _named(section, "placements", lambda _, each: _pose(each)) if touches else None,
        section.integer("repeats", 1, minimum=1),
        _named(section, "points", lambda _, each: _point(each)) if kind == "fixed_point" else None,
        section.integer("directions", SetSpec.directions, minimum=1),
        _direction(section) if "axis" in section else None,
        _cone(section),
        section.integer("samples", SetSpec.samples, minimum=1),
        _optional_pose(section, "base_in_instrument"),
        section.flag("orientation"),
        _optional_pose(section, "eye_in_tip"),
        _optional_pose(section, "target_in_base"),
        section.line,
        _seating(section.section("seating")) if "seating" in section else (0.0, 0.0, 0.0),
    )


def _seating(section: YamlSection) -> tuple[float, float, float]:
    keys = ("x_mm", "y_mm", "rz_deg")
    section.check_keys(keys)
    scales = (_M_PER_MM, _M_PER_MM, _RAD_PER_DEG)
    x, y, rz = (
        section.optional_number(key, scale=scale) or 0.0
        for key, scale in zip(keys, scales, strict=True)
    )
    return x, y, rz


def _required(kind: str) -> tuple[str, ...]:
    if kind in TOUCHED_ARTEFACT:
        return ("artefact", "placements")
    if kind == "hand_eye":
        return ("samples", "eye_in_tip", "target_in_base")
    return ("points",) if kind == "fixed_point" else ("samples",)


def _optional_pose(section: YamlSection, key: str) -> PoseSpec | None:
    return _pose(section.section(key)) if key in section else None


def _point(section: YamlSection) -> PoseSpec:
    section.check_keys(("position_mm",), required=("position_mm",))
    return _pose(section)


def _pose(section: YamlSection) -> PoseSpec:
    section.check_keys(("position_mm", "rotation_rpy_deg"), required=("position_mm",))
    turned = "rotation_rpy_deg" in section
    rpy = np.deg2rad(section.numbers("rotation_rpy_deg", 3)) if turned else np.zeros(3)
    position = _M_PER_MM * np.array(section.numbers("position_mm", 3))
    return PoseSpec(rotation_from_rpy(rpy), position, section.line)


def _direction(section: YamlSection) -> FloatArray:
    vector = np.array(section.numbers("axis", 3))
    length = np.linalg.norm(vector)
    if not length > 0:
        raise section.refuse("a vector without direction", "a direction", at=("axis",))
    return np.asarray(vector / length, dtype=float)


def _cone(section: YamlSection) -> float:
    cone = section.optional_number("cone_deg", "non-negative", _RAD_PER_DEG)
    if cone is not None and cone > math.pi:
        raise section.refuse(f"{math.degrees(cone):g}", "at most 180 degrees", at=("cone_deg",))
    return SetSpec.cone if cone is None else cone
