"""Which columns of a foreign table are a pose: told by their names, by their numbers, or asked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.rotations import NUMBERS, is_rotation
from suta_calib.exchange.sheet import Sheet
from suta_calib.measurements.csv_table import SIGMAS
from suta_calib.records import dataclass

ROTATION: Final = Option(
    "rotation",
    "What orientations are: a quaternion (xyzw, wxyz), a rotation vector, a matrix (rows, "
    "columns), or Euler angles in an order as SciPy has it: xyz about fixed axes, XYZ about own.",
    choices=tuple(NUMBERS),
)
FIRST: Final = Option(
    "first",
    "What stands first in a row of numbers without names.",
    choices=("position", "rotation"),
)
GUESS: Final = Option(
    "guess", "Take the likeliest where a file leaves a choice, and say what was taken.", flag=True
)
ROLE_OPTIONS: Final = (ROTATION, FIRST, GUESS)
# A unit behind a name: x_mm, x [mm], x (mm).
_UNIT: Final = re.compile(r"(.+?)(?:_|\s*[\[(]|\s)(mm|cm|m|deg|°|rad)[\])]?", re.IGNORECASE)
_POSITIONS: Final = (
    ("x", "y", "z"),
    ("tx", "ty", "tz"),
    ("px", "py", "pz"),
    ("pos_x", "pos_y", "pos_z"),
    ("posx", "posy", "posz"),
    ("position_x", "position_y", "position_z"),
    ("position.x", "position.y", "position.z"),
    ("translation.x", "translation.y", "translation.z"),
)
_QUATERNIONS: Final = (
    ("qx", "qy", "qz", "qw"),
    ("qx", "qy", "qz", "q0"),
    ("quat_x", "quat_y", "quat_z", "quat_w"),
    ("rot_x", "rot_y", "rot_z", "rot_w"),
    ("orientation_x", "orientation_y", "orientation_z", "orientation_w"),
    ("orientation.x", "orientation.y", "orientation.z", "orientation.w"),
    ("rotation.x", "rotation.y", "rotation.z", "rotation.w"),
)
# Names that only count: the scalar is the first of them or the last, or they are no quaternion.
_COUNTED: Final = (
    ("q0", "q1", "q2", "q3"),
    ("q1", "q2", "q3", "q4"),
    ("quat_0", "quat_1", "quat_2", "quat_3"),
    ("quat_1", "quat_2", "quat_3", "quat_4"),
)
_ANGLES: Final = (("rx", "ry", "rz"), ("roll", "pitch", "yaw"), ("a", "b", "c"))
_MATRICES: Final = tuple(
    tuple(f"{letter}{row}{column}" for row in range(k, k + 3) for column in range(k, k + 3))
    for letter in ("r", "m", "t")
    for k in (0, 1)
)
# Where the position stands in such a matrix, if it is one of a transform.
_FOURTH: Final = tuple(
    tuple(f"{letter}{row}{k + 3}" for row in range(k, k + 3))
    for letter in ("r", "m", "t")
    for k in (0, 1)
)
# The columns of a rotation as robotics calls them: normal, orientation, approach.
_AXES: Final = (tuple(letter + axis for letter in "noa" for axis in "xyz"),)
_ORIENTATIONS: Final = (*_QUATERNIONS, *_MATRICES, *_AXES, *_ANGLES)
# In front of x, y, z that say how sure a position is.
_SPREADS: Final = ("sigma_", "std_")
# How far the length of a quaternion may be from one.
_UNIT_LENGTH: Final = 0.01
_MOST_CHOICES: Final = 8
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
    """The poses that columns are named as, in the order of their prefixes.

    Args:
        sheet: for messages.
        names: of the columns, as they are to be understood.
        given: `ROLE_OPTIONS`.

    Raises:
        ForeignFileError: orientations whose names leave open what they are.
    """
    plain: dict[str, tuple[int, str]] = {}
    for k, name in enumerate(names):
        bare, unit = plain_name(name)
        plain.setdefault(bare.lower(), (k, unit))
    kept = {k for k, _ in plain.values()}
    twice = {plain_name(name)[0].lower() for k, name in enumerate(names) if k not in kept}
    found = list[PoseColumns]()
    # The x of ``orientation.x`` is no position, nor is that of ``sigma_x``.
    other = {name for _, whole in _with_prefix(plain, _ORIENTATIONS) for name in whole}
    other |= {*SIGMAS}
    places = {name: at for name, at in plain.items() if name not in other}
    # A transform and nothing else is looked at as numbers: whatever its columns are called, its
    # last row or column tells how it stands.
    sets = _POSITIONS if len(names) in OF_MATRIX else (*_POSITIONS, *_FOURTH)
    for prefix, triple in _with_prefix(places, sets):
        if prefix in _SPREADS:
            continue
        if any(prefix == each.prefix for each in found):
            earlier = [names[k] for each in found if each.prefix == prefix for k in each.position]
            raise _refused(sheet, f"{', '.join(earlier)} and {', '.join(triple)}, both a position")
        position, unit = _numbers(sheet, plain, triple)
        rotation, angle, form = _named_rotation(sheet, plain, prefix, given)
        found.append(PoseColumns(prefix, position, rotation, form, unit, angle))
        for column in (*position, *rotation):
            if (bare := plain_name(names[column])[0].lower()) in twice:
                raise _refused(sheet, f"several columns of {bare!r}, in units of their own")
    return found


def _with_prefix(
    plain: Mapping[str, tuple[int, str]], sets: Sequence[Sequence[str]]
) -> Iterator[tuple[str, list[str]]]:
    """Prefixes with which all names of a set are there, each column taken once."""
    taken: set[str] = set()
    # The longest names first: ``pos_x`` is not an ``x`` of something called ``pos_``.
    for names in sorted(sets, key=lambda each: -len(each[0])):
        for column in list(plain):
            prefix = column.removesuffix(names[0])
            whole = [prefix + name for name in names]
            if not column.endswith(names[0]) or (prefix and prefix[-1] not in "_. :/"):
                continue
            if all(name in plain for name in whole) and not taken & set(whole):
                taken |= set(whole)
                yield prefix, whole


def _numbers(
    sheet: Sheet, plain: Mapping[str, tuple[int, str]], names: Sequence[str]
) -> tuple[tuple[int, ...], str]:
    """Columns of some numbers, and the unit that all of their names give."""
    units = {plain[name][1] for name in names}
    if len(units) > 1:
        told = ", ".join(f"{name} in {plain[name][1] or 'no unit'}" for name in names)
        raise _refused(sheet, f"columns {told}")
    return tuple(plain[name][0] for name in names), units.pop()


def _refused(sheet: Sheet, found: str) -> ForeignFileError:
    """Error about names that contradict each other, to be raised by the caller."""
    return ForeignFileError(
        found,
        "each number of a pose once, all of a kind in one unit",
        file=sheet.path,
        line=sheet.lines[0],
        hint="name the columns that are meant with --columns 1=x,2=qx,…, and others by other names",
    )


def _named_rotation(
    sheet: Sheet, plain: Mapping[str, tuple[int, str]], prefix: str, given: Given
) -> tuple[tuple[int, ...], str, str]:
    kinds = ((_QUATERNIONS, "xyzw"), (_MATRICES, "rows"), (_AXES, "columns"), (_ANGLES, ""))
    for sets, form in kinds:
        for names in sets:
            whole = [prefix + name for name in names]
            if not all(name in plain for name in whole):
                continue
            columns, angle = _numbers(sheet, plain, whole)
            if form:
                return columns, angle, form
            seen = f"orientations in columns {', '.join(whole)}, which may be any of many angles"
            asked = [each for each, count in NUMBERS.items() if count == 3]
            return columns, angle, settled(sheet, given, ROTATION, asked, seen, likeliest="xyz")
    for names in _COUNTED:
        whole = [prefix + name for name in names]
        if not all(name in plain for name in whole) or not _is_quaternion(sheet, plain, whole):
            continue
        seen = f"a quaternion in columns {', '.join(whole)}, whose scalar may be the first or last"
        columns, angle = _numbers(sheet, plain, whole)
        return columns, angle, settled(sheet, given, ROTATION, ["wxyz", "xyzw"], seen)
    for names in _QUATERNIONS:
        gone = [prefix + name for name in names if prefix + name not in plain]
        if len(gone) == 1:
            there = ", ".join(prefix + name for name in names if prefix + name in plain)
            raise ForeignFileError(
                f"columns {there} and no {gone[0]}",
                "all four numbers of a quaternion, or none",
                file=sheet.path,
                line=sheet.lines[0],
                hint=f"name it with --columns NAME={gone[0]}",
            )
    return (), "", ""


def _is_quaternion(
    sheet: Sheet, plain: Mapping[str, tuple[int, str]], names: Sequence[str]
) -> bool:
    """Whether the numbers of some columns, all of them numbers, have together the length one."""
    columns = [plain[name][0] for name in names]
    if any(sheet.values[k] is None for k in columns):
        return False
    length = np.linalg.norm(sheet.numbers(columns), axis=1)
    known = length[np.isfinite(length)]
    return bool(len(known) and np.all(np.abs(known - 1.0) < _UNIT_LENGTH))


def settled(
    sheet: Sheet,
    given: Given,
    option: Option,
    choices: Sequence[str],
    seen: str,
    *,
    likeliest: str = "",
) -> str:
    """What an option says, or the only choice; with ``--guess`` the likeliest.

    Args:
        sheet: for messages.
        given: the options.
        option: that settles it.
        choices: that the file allows, the likeliest first unless it is named.
        seen: what was found that leaves them open.
        likeliest: of the choices.

    Raises:
        ForeignFileError: several are left, and nobody says which.
    """
    if option in given:
        chosen = given.text(option)
        if chosen not in choices:
            raise ForeignFileError(
                f"{seen}, read as {chosen}", " or ".join(choices), file=sheet.path
            )
        return chosen
    if len(choices) == 1 or GUESS in given:
        return likeliest or choices[0]
    shown = choices if len(choices) <= _MOST_CHOICES else (*choices[:_MOST_CHOICES], "…")
    raise ForeignFileError(
        seen,
        "that it be said which",
        file=sheet.path,
        line=sheet.lines[0],
        hint=f"say {option.switch} {'|'.join(shown)}, or --guess",
    )


def nameless_pose(sheet: Sheet, given: Given) -> tuple[PoseColumns | None, Sheet]:
    """The pose that rows of so many numbers without names are.

    Three numbers are a position; six are one with angles; seven are one with a quaternion; twelve
    and sixteen are the rows of a transform, one below the other or side by side; four are rows of
    4x4 matrices stacked in a column. Numbers in front, such as a row's own, are not looked for.

    Args:
        sheet: without a header.
        given: `ROLE_OPTIONS`.

    Returns:
        The columns, and the sheet they are of: that of stacked matrices has a row for each. None
        where so many numbers are no pose.

    Raises:
        ForeignFileError: numbers that leave open what they are, or cells that are none.
    """
    count = len(sheet.names)
    if count not in (3, 4, 6, 7, 12, 16):
        return None, sheet
    numbers = sheet.numbers(range(count))
    known = numbers[np.isfinite(numbers).all(axis=1)]
    if count == 3:
        return PoseColumns("", (0, 1, 2)), sheet
    if count == 4:
        return _stacked(sheet, known, len(numbers))
    if count in (6, 7):
        return _position_and_rotation(sheet, known, count - 3, given), sheet
    return _matrix(sheet, known, given), sheet


def _position_and_rotation(
    sheet: Sheet, numbers: FloatArray, count: int, given: Given
) -> PoseColumns:
    ahead, behind = tuple(range(count)), tuple(range(3, 3 + count))
    orders = {"position": behind, "rotation": ahead}
    if count == 4:
        lengths = {name: np.linalg.norm(numbers[:, k], axis=1) for name, k in orders.items()}
        fitting = [
            name for name, one in lengths.items() if np.all(np.abs(one - 1.0) < _UNIT_LENGTH)
        ]
        if not fitting:
            said = "seven numbers a row, no four of which, first or last, are a quaternion"
            raise ForeignFileError(
                said,
                "a position and a quaternion",
                file=sheet.path,
                line=sheet.lines[0],
                hint="say which columns are what with --columns 1=x,2=y,…",
            )
        seen = "seven numbers a row, of which the first and the last four may be a quaternion"
        first = settled(sheet, given, FIRST, fitting, seen)
        seen = "seven numbers a row, a quaternion whose scalar may be its first or its last number"
        choices = ["xyzw", "wxyz"] if first == "position" else ["wxyz", "xyzw"]
        form = settled(sheet, given, ROTATION, choices, seen)
    else:
        seen = "six numbers a row, of which three are a position and three may be any angles"
        asked = [each for each, numbers_ in NUMBERS.items() if numbers_ == 3]
        form = settled(sheet, given, ROTATION, asked, seen, likeliest="xyz")
        first = given.text(FIRST, "position")
    position = (0, 1, 2) if first == "position" else tuple(range(count, count + 3))
    return PoseColumns("", position, orders[first], form)


def _matrix(sheet: Sheet, numbers: FloatArray, given: Given) -> PoseColumns:
    """Twelve or sixteen numbers: a transform row by row or column by column."""
    width = numbers.shape[1] // 4
    by_rows = (
        tuple(4 * row + column for row in range(3) for column in range(3)),
        (3, 7, 11),
    )
    by_columns = (
        tuple(width * column + row for row in range(3) for column in range(3)),
        tuple(3 * width + row for row in range(3)),
    )
    flat = (tuple(range(9)), (9, 10, 11))
    arranged = {"rows": by_rows, "columns": by_columns}
    if width == 3:
        # Nine numbers of a rotation by rows and a position behind them are as usual.
        arranged["rotation-position"] = flat
    fitting = [
        name
        for name, (rotation, _) in arranged.items()
        if is_rotation(numbers[:, rotation].reshape(-1, 3, 3))
    ]
    if width == 4:
        last = {"rows": (12, 13, 14, 15), "columns": (3, 7, 11, 15)}
        fitting = [n for n in fitting if np.allclose(numbers[:, last[n]], [0, 0, 0, 1], atol=1e-6)]
    if not fitting:
        raise ForeignFileError(
            f"{4 * width} numbers a row, which are no transform by rows or by columns",
            "a rotation matrix with a position",
            file=sheet.path,
            line=sheet.lines[0],
        )
    same = {name: numbers[:, arranged[name][0] + arranged[name][1]].tobytes() for name in fitting}
    if ROTATION in given and given.text(ROTATION) == "rows" and "rows" not in fitting:
        fitting = [name for name in fitting if name == "rotation-position"] or fitting
    if len(set(same.values())) == 1:
        chosen = fitting[0]
    elif ROTATION in given:
        chosen = next((n for n in fitting if n.startswith(given.text(ROTATION))), fitting[0])
    else:
        seen = f"{4 * width} numbers a row, which are a transform as {' and as '.join(fitting)}"
        asked = ["columns" if n == "columns" else "rows" for n in fitting]
        answer = settled(sheet, given, ROTATION, list(dict.fromkeys(asked)), seen)
        chosen = next(n for n, a in zip(fitting, asked, strict=True) if a == answer)
    rotation, position = arranged[chosen]
    return PoseColumns("", position, rotation, "rows")


def _stacked(sheet: Sheet, numbers: FloatArray, rows: int) -> tuple[PoseColumns | None, Sheet]:
    """4x4 matrices one below the other: a row for each, in which they stand by rows."""
    if len(numbers) != rows or rows % 4:
        return None, sheet
    blocks = numbers.reshape(-1, 4, 4)
    told = "4x4 matrices, stacked."
    if not np.allclose(blocks[:, 3], [0, 0, 0, 1], atol=1e-6):
        blocks, told = blocks.swapaxes(1, 2), "4x4 matrices, stacked, each by columns."
    if not np.allclose(blocks[:, 3], [0, 0, 0, 1], atol=1e-6):
        return None, sheet
    names = tuple(str(k + 1) for k in range(16))
    columns = tuple(blocks.reshape(-1, 16).T)
    seen = (*sheet.seen, told)
    whole = replace(sheet, names=names, lines=sheet.lines[::4], values=columns, seen=seen)
    rotation = tuple(4 * row + column for row in range(3) for column in range(3))
    return PoseColumns("", (3, 7, 11), rotation, "rows"), whole
