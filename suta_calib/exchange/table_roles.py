"""Which columns of a foreign table are a pose, by their names; what those leave open is asked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.plausible_units import (
    RPY,
    open_forms,
    plausible_lengths,
    plausible_rotations,
    quaternion_order,
)
from suta_calib.exchange.rotations import NUMBERS, are_quaternions
from suta_calib.exchange.sheet import Sheet
from suta_calib.measurements.csv_table import SIGMAS

ROTATION: Final = Option(
    "rotation",
    "Kind of orientations: a quaternion (xyzw, wxyz), a rotation vector, a matrix (rows, "
    "columns), or Euler angles in the order of SciPy: xyz about fixed axes, XYZ about moving "
    "axes.",
    choices=tuple(NUMBERS),
)
FIRST: Final = Option(
    "first",
    "What is first in a row of numbers without names.",
    choices=("position", "rotation"),
)
GUESS: Final = Option(
    "guess", "Use the likeliest interpretation if there are several, and show it.", flag=True
)
UNIT: Final = Option(
    "unit",
    "Unit of lengths (m, mm), or of joint readings and Euler angles (rad, deg, ticks).",
    choices=("m", "mm", "rad", "deg", "ticks"),
    several=True,
)
LENGTHS: Final = ("m", "mm")
ANGLES: Final = ("rad", "deg")
ROLE_OPTIONS: Final = (ROTATION, FIRST, GUESS)
# A unit behind a name: x_mm, x [mm], x (mm).
_UNIT: Final = re.compile(r"(.+?)(?:_|\s*[\[(]|\s)(mm|cm|m|deg|°|rad)[\])]?", re.IGNORECASE)


def _spelt(letters: str, spellings: str) -> tuple[tuple[str, ...], ...]:
    """Names of the numbers of something: each spelling with a letter in place of ``?``."""
    return tuple(
        tuple(spelling.replace("?", letter) for letter in letters) for spelling in spellings.split()
    )


_POSITIONS: Final = _spelt("xyz", "? t? p? pos_? pos? position_? position.? translation.?")
_QUATERNIONS: Final = (
    *_spelt("xyzw", "q? quat_? rot_? orientation_? orientation.? rotation.?"),
    ("qx", "qy", "qz", "q0"),
)
# Names that only count: the scalar is the first of them or the last, or they are no quaternion.
_COUNTED: Final = (*_spelt("0123", "q? quat_?"), *_spelt("1234", "q? quat_?"))
_FIGAROH: Final = (("phix", "phiy", "phiz"),)
_ANGLES: Final = (
    *(tuple(names.split()) for names in ("rx ry rz", "roll pitch yaw", "a b c")),
    *_FIGAROH,
)
_MATRICES: Final = tuple(
    tuple(f"{letter}{row}{column}" for row in range(k, k + 3) for column in range(k, k + 3))
    for letter in "rmt"
    for k in (0, 1)
)
# Where the position stands in such a matrix, if it is one of a transform.
_FOURTH: Final = tuple(
    tuple(f"{letter}{row}{k + 3}" for row in range(k, k + 3)) for letter in "rmt" for k in (0, 1)
)
# The columns of a rotation as robotics calls them: normal, orientation, approach.
_AXES: Final = (tuple(letter + axis for letter in "noa" for axis in "xyz"),)
_ORIENTATIONS: Final = (*_QUATERNIONS, *_MATRICES, *_AXES, *_ANGLES)
# Prefixes of x, y, z for the standard deviation of a position.
_SPREADS: Final = ("sigma_", "std_")
# Forms of angles of these names: KUKA's A turns about Z; rx, ry, rz may be any.
_USUAL_ANGLES: Final = {"roll": (RPY,), "a": ("ZYX",)}
# Forms of three numbers.
OF_THREE: Final = [form for form, count in NUMBERS.items() if count == 3]
# Numbers of a transform, which may have names that say nothing.
OF_MATRIX: Final = (12, 16)


@dataclass(frozen=True)
class PoseColumns:
    """Columns of one pose.

    Attributes:
        prefix: in front of their names, which tells several poses of a table apart.
        position: three of them.
        rotation: as many as the form has numbers, or none.
        form: of the rotation (`rotations.NUMBERS`); empty for none.
        unit: that the position's names give; empty for none.
        angle: the same of the rotation's.
    """

    prefix: str
    position: tuple[int, ...]
    rotation: tuple[int, ...] = ()
    form: str = ""
    unit: str = ""
    angle: str = ""


def plain_name(name: str) -> tuple[str, str]:
    """A column's name without the unit behind it, and that unit: ``x [mm]`` is x in mm."""
    match = _UNIT.fullmatch(name)
    if match is None:
        return name, ""
    unit = match[2].lower().replace("°", "deg")
    return match[1].strip(), unit


def named_poses(sheet: Sheet, names: Sequence[str], given: Given) -> list[PoseColumns]:
    """The poses that columns are named as, in the order of their prefixes."""
    plain: dict[str, tuple[int, str]] = {}
    for k, name in enumerate(names):
        bare, unit = plain_name(name)
        plain.setdefault(bare.lower(), (k, unit))
    first_columns = {k for k, _ in plain.values()}
    twice = {plain_name(name)[0].lower() for k, name in enumerate(names) if k not in first_columns}
    poses = list[PoseColumns]()
    # The x of ``orientation.x`` is no position, nor is that of ``sigma_x``.
    other = {name for _, columns in _with_prefix(plain, _ORIENTATIONS) for name in columns}
    other |= {*SIGMAS}
    places = {name: at for name, at in plain.items() if name not in other}
    # A transform and nothing else is looked at as numbers: whatever its columns are called, its
    # last row or column tells how it stands.
    sets = _POSITIONS if len(names) in OF_MATRIX else (*_POSITIONS, *_FOURTH)
    for prefix, triple in _with_prefix(places, sets):
        if prefix in _SPREADS:
            continue
        if any(prefix == pose.prefix for pose in poses):
            earlier = [names[k] for pose in poses if pose.prefix == prefix for k in pose.position]
            raise _refused(
                sheet, f"{', '.join(earlier)} and {', '.join(triple)}, which are both a position"
            )
        position, unit = _numbers(sheet, plain, triple)
        rotation, angle, form = _named_rotation(sheet, plain, prefix, given)
        poses.append(PoseColumns(prefix, position, rotation, form, unit, angle))
        for column in (*position, *rotation):
            if (bare := plain_name(names[column])[0].lower()) in twice:
                raise _refused(sheet, f"several columns of {bare!r} in different units")
    return poses


def _with_prefix(
    plain: Mapping[str, tuple[int, str]], sets: Sequence[Sequence[str]]
) -> Iterator[tuple[str, list[str]]]:
    """Prefixes with which all names of a set are there, each column taken once."""
    taken: set[str] = set()
    # The longest names first: ``pos_x`` is not an ``x`` of something called ``pos_``.
    for names in sorted(sets, key=lambda columns_of: -len(columns_of[0])):
        for column in list(plain):
            prefix = column.removesuffix(names[0])
            columns = [prefix + name for name in names]
            if not column.endswith(names[0]) or (prefix and prefix[-1] not in "_. :/"):
                continue
            if all(name in plain for name in columns) and not taken & set(columns):
                taken |= set(columns)
                yield prefix, columns


def _numbers(
    sheet: Sheet, plain: Mapping[str, tuple[int, str]], names: Sequence[str]
) -> tuple[tuple[int, ...], str]:
    """Columns of some numbers, and the unit that all of their names give."""
    units = {plain[name][1] for name in names}
    if len(units) > 1:
        stated_units = ", ".join(f"{name} in {plain[name][1] or 'no unit'}" for name in names)
        raise _refused(sheet, f"columns {stated_units}")
    return tuple(plain[name][0] for name in names), units.pop()


def _refused(sheet: Sheet, problem: str) -> ForeignFileError:
    """Error about names that contradict each other, to be raised by the caller."""
    expected = "each number of a pose only once, and all of one kind in the same unit"
    hint = "name the right columns with --columns 1=x,2=qx,…, and give the others different names"
    return sheet.refuse(problem, expected, hint=hint)


def _named_rotation(
    sheet: Sheet, plain: Mapping[str, tuple[int, str]], prefix: str, given: Given
) -> tuple[tuple[int, ...], str, str]:
    """Columns of the orientation with a prefix, the unit of its angles, and its form."""
    kinds = (
        *((_QUATERNIONS, "xyzw"), (_MATRICES, "rows"), (_AXES, "columns")),
        *((_FIGAROH, "" if ROTATION in given else RPY), (_ANGLES, "")),
    )
    for names, form in ((names, form) for sets, form in kinds for names in sets):
        present = [prefix + name for name in names]
        if not all(name in plain for name in present):
            continue
        columns, angle = _numbers(sheet, plain, present)
        if form:
            return columns, angle, form
        content = (
            f"orientations in columns {', '.join(present)}, which could be several kinds of angles"
        )
        if GUESS in given and ROTATION not in given:
            form, angle = _guessed_angles(sheet, columns, angle, names, given)
            given.note_guess(ROTATION, form, content)
            return columns, angle, form
        return columns, angle, settled(sheet, given, ROTATION, OF_THREE, content, likeliest=RPY)
    for names in _COUNTED:
        present = [prefix + name for name in names]
        if not all(name in plain for name in present) or not _is_quaternion(sheet, plain, present):
            continue
        content = (
            f"a quaternion in columns {', '.join(present)}, whose scalar could be the first or "
            "the last"
        )
        columns, angle = _numbers(sheet, plain, present)
        likeliest = quaternion_order(_whole_rows(sheet.numbers(columns)))
        order = settled(sheet, given, ROTATION, ["wxyz", "xyzw"], content, likeliest=likeliest)
        return columns, angle, order
    for names in _QUATERNIONS:
        gone = [prefix + name for name in names if prefix + name not in plain]
        if len(gone) == 1:
            there = ", ".join(prefix + name for name in names if prefix + name in plain)
            problem = f"columns {there}, but no {gone[0]}"
            expected = "all four numbers of a quaternion, or none"
            hint = f"name it with --columns NAME={gone[0]}"
            raise sheet.refuse(problem, expected, hint=hint)
    return (), "", ""


def _whole_rows(numbers: FloatArray) -> FloatArray:
    """Rows in which no number is missing."""
    return numbers[np.isfinite(numbers).all(axis=1)]


def _guessed_angles(
    sheet: Sheet, columns: Sequence[int], unit: str, names: Sequence[str], given: Given
) -> tuple[str, str]:
    """Form and unit of angles, by their names and numbers."""
    finite = _whole_rows(sheet.numbers(columns))
    forms = _USUAL_ANGLES.get(names[0], open_forms())
    units = open_units(given, ANGLES, unit)
    readings = plausible_rotations(finite, forms, units) if len(finite) else []
    if len(readings) == 1:
        return readings[0]
    choices = " or ".join(f"{form} in {angle}" for form, angle in readings)
    problem = f"columns {', '.join(names)}, which could be {choices or 'no angles of a usual form'}"
    expected = "only one kind that fits their numbers"
    hint = f"give {ROTATION.switch} vector or an order of Euler angles, and {UNIT.switch} rad|deg"
    raise sheet.refuse(problem, expected, hint=hint)


def guessed_length(sheet: Sheet, position: FloatArray, given: Given) -> str:
    """Unit of positions (n, 3) of which nothing says it."""
    finite = _whole_rows(position)
    if not len(finite):
        return "m"
    described = f"positions about {float(np.median(np.linalg.norm(finite, axis=1))):.4g} away"
    unit = next(iter(plausible_lengths(finite, LENGTHS)), "")
    if not unit:
        raise _no_guess(sheet, f"{described}, in m or mm", "m|mm")
    if unit != "m":
        given.note_guess(UNIT, unit, described)
    return unit


def guessed_angle(sheet: Sheet, form: str, numbers: FloatArray, given: Given) -> str:
    """Unit of angles (n, 3) of which nothing says it."""
    finite = _whole_rows(numbers)
    if not len(finite):
        return "rad"
    described = f"angles up to {float(np.abs(finite).max()):.4g}"
    unit = next((unit for _, unit in plausible_rotations(finite, [form], ANGLES)), "")
    if not unit:
        raise _no_guess(sheet, f"{described}, in rad or degrees", "rad|deg")
    given.note_guess(UNIT, unit, described)
    return unit


def _no_guess(sheet: Sheet, problem: str, choices: str) -> ForeignFileError:
    hint = f"give {UNIT.switch} {choices}"
    return sheet.refuse(problem, "numbers that allow only one unit", hint=hint)


def open_units(given: Given, units: Sequence[str], stated: str = "") -> Sequence[str]:
    """Those of some units that the options, or else a name, leave open."""
    asked = [unit for unit in given.texts(UNIT) if unit in units]
    return asked or ([stated] if stated in units else units)


def _is_quaternion(
    sheet: Sheet, plain: Mapping[str, tuple[int, str]], names: Sequence[str]
) -> bool:
    """Whether the numbers of some columns, all of them numbers, have together the length one."""
    columns = [plain[name][0] for name in names]
    if any(sheet.values[k] is None for k in columns):
        return False
    numbers = _whole_rows(sheet.numbers(columns))
    return bool(len(numbers)) and are_quaternions(numbers)


def settled(
    sheet: Sheet,
    given: Given,
    option: Option,
    choices: Sequence[str],
    content: str,
    *,
    likeliest: str = "",
) -> str:
    """What an option says, or the only choice; with ``--guess`` the likeliest, if there is one."""
    if option in given:
        chosen = given.text(option)
        if chosen not in choices:
            raise ForeignFileError(
                f"{content}, interpreted as {chosen}", " or ".join(choices), file=sheet.path
            )
        return chosen
    if len(choices) == 1:
        return choices[0]
    if GUESS in given and likeliest:
        given.note_guess(option, likeliest, content)
        return likeliest
    shown = choices if len(choices) <= 8 else (*choices[:8], "…")
    expected = "the kind to be given"
    hint = f"give {option.switch} {'|'.join(shown)}" + (", or --guess" if likeliest else "")
    raise sheet.refuse(content, expected, hint=hint)
