"""Which pose rows of numbers without names are: seen by the numbers, or asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.exchange.option import Given
from suta_calib.exchange.plausible_units import (
    RPY,
    open_forms,
    plausible_readings,
    quaternion_order,
)
from suta_calib.exchange.rotations import are_quaternions, is_rotation
from suta_calib.exchange.sheet import Sheet
from suta_calib.exchange.table_roles import (
    ANGLES,
    FIRST,
    GUESS,
    LENGTHS,
    OF_MATRIX,
    OF_THREE,
    ROTATION,
    UNIT,
    PoseColumns,
    open_units,
    settled,
)


def nameless_pose(sheet: Sheet, given: Given) -> tuple[PoseColumns | None, Sheet]:
    """The pose that rows of so many numbers without names are.

    Three numbers are a position; six are one with angles; seven are one with a quaternion; twelve
    and sixteen are the rows of a transform, one below the other or side by side; four are rows of
    4x4 matrices stacked in a column. Behind a 4x4 matrix or in front of it joints may stand; of
    other poses, numbers in front are not looked for. The sheet returned is the one that the pose is
    of: stacked matrices have a row for each.
    """
    count = len(sheet.names)
    # A single number in front is the row's own.
    if count > OF_MATRIX[-1] + 1:
        return _beside_joints(sheet, given)
    if count not in (3, 4, 6, 7, 12, 16):
        return None, sheet
    numbers = sheet.numbers(range(count))
    finite = numbers[np.isfinite(numbers).all(axis=1)]
    if count == 3:
        return PoseColumns("", (0, 1, 2)), sheet
    if count == 4:
        return _stacked(sheet, finite, len(numbers))
    if count in (6, 7):
        return _position_and_rotation(sheet, finite, count - 3, given), sheet
    return _matrix(sheet, finite, given), sheet


def _beside_joints(sheet: Sheet, given: Given) -> tuple[PoseColumns | None, Sheet]:
    """A 4x4 matrix of which nobody can doubt that it is one, and readings of joints."""
    size = OF_MATRIX[-1]
    joints = len(sheet.names) - size
    if any(values is None for values in sheet.values):
        return None, sheet
    for first, rest in ((joints, range(joints)), (0, range(size, size + joints))):
        within = range(first, first + size)
        numbers = sheet.numbers(within)
        numbers = numbers[np.isfinite(numbers).all(axis=1)]
        if not (len(numbers) and np.allclose(numbers[:, -1], 1.0) and _is_transform(numbers)):
            continue
        if _counts(sheet.numbers(rest)):
            return None, sheet
        pose = _matrix(sheet, numbers, given)
        names = list(sheet.names)
        for k, column in enumerate(rest, 1):
            names[column] = f"joint_{k}"
        remark = (
            f"Columns {rest[0] + 1} to {rest[-1] + 1} are treated as readings of joint_1 to "
            f"joint_{joints}, and the others as a 4x4 matrix; name the joints with "
            f"--columns {rest[0] + 1}=NAME,…"
        )
        position, rotation = (
            tuple(first + k for k in columns) for columns in (pose.position, pose.rotation)
        )
        named = replace(sheet, names=tuple(names), remarks=(*sheet.remarks, remark))
        return PoseColumns("", position, rotation, pose.form), named
    return None, sheet


def _counts(numbers: FloatArray) -> bool:
    """Whether a column goes up from each row to the next, as a row's number or its time does."""
    return bool((np.diff(numbers, axis=0) > 0).all(axis=0).any())


def _is_transform(numbers: FloatArray) -> bool:
    blocks = numbers.reshape(-1, 4, 4)
    last = [0.0, 0.0, 0.0]
    by_rows = np.allclose(blocks[:, 3, :3], last, atol=1e-6)
    by_columns = np.allclose(blocks[:, :3, 3], last, atol=1e-6)
    return (by_rows or by_columns) and is_rotation(blocks[:, :3, :3])


def _position_and_rotation(
    sheet: Sheet, numbers: FloatArray, count: int, given: Given
) -> PoseColumns:
    ahead, behind = tuple(range(count)), tuple(range(3, 3 + count))
    orders = {"position": behind, "rotation": ahead}
    if count == 4:
        fitting = [name for name, k in orders.items() if are_quaternions(numbers[:, k])]
        if not fitting:
            problem = (
                "seven numbers per row, but neither the first four nor the last four are a "
                "quaternion"
            )
            hint = "name the columns with --columns 1=x,2=y,…"
            raise sheet.refuse(problem, "a position and a quaternion", hint=hint)
        content = (
            "seven numbers per row, of which both the first and the last four could be a quaternion"
        )
        first = settled(sheet, given, FIRST, fitting, content, likeliest=fitting[0])
        content = (
            "seven numbers per row with a quaternion whose scalar could be its first or its last "
            "number"
        )
        choices = ["xyzw", "wxyz"] if first == "position" else ["wxyz", "xyzw"]
        likeliest = quaternion_order(numbers[:, list(orders[first])])
        form = settled(sheet, given, ROTATION, choices, content, likeliest=likeliest)
    else:
        content = "six numbers per row, three of them a position and three some kind of angles"
        if GUESS in given:
            return _guessed_pose(sheet, numbers, content, given)
        form = settled(sheet, given, ROTATION, OF_THREE, content, likeliest=RPY)
        first = given.text(FIRST, "position")
    position = (0, 1, 2) if first == "position" else tuple(range(count, count + 3))
    return PoseColumns("", position, orders[first], form)


def _guessed_pose(sheet: Sheet, numbers: FloatArray, content: str, given: Given) -> PoseColumns:
    """The only reading of six numbers a row that is plausible."""
    firsts = [given.text(FIRST)] if FIRST in given else ["position", "rotation"]
    forms = [given.text(ROTATION)] if ROTATION in given else open_forms()
    units = open_units(given, LENGTHS), open_units(given, ANGLES)
    readings = plausible_readings(numbers, firsts, forms, *units) if len(numbers) else []
    if len(readings) != 1:
        choices = "; ".join(map(str, readings)) or "none that fits an arm or a tracker"
        problem = f"{content}; plausible interpretations: {choices}"
        expected = "exactly one plausible interpretation"
        hint = f"give {FIRST.switch}, {ROTATION.switch} and {UNIT.switch} mm,deg"
        raise sheet.refuse(problem, expected, hint=hint)
    first, form, length, angle = readings[0]
    for option, value in ((FIRST, first), (ROTATION, form), (UNIT, f"{length},{angle}")):
        if option not in given:
            given.note_guess(option, value, content)
    ahead, behind = (0, 1, 2), (3, 4, 5)
    if first == "rotation":
        ahead, behind = behind, ahead
    return PoseColumns("", ahead, behind, form, length, angle)


def _matrix(sheet: Sheet, numbers: FloatArray, given: Given) -> PoseColumns:
    """Twelve or sixteen numbers: a transform row by row or column by column."""
    width = numbers.shape[1] // 4
    by_rows = (tuple(4 * row + column for row in range(3) for column in range(3)), (3, 7, 11))
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
        problem = (
            f"{4 * width} numbers per row, which are not a transform, neither by rows nor "
            "by columns"
        )
        expected = "a rotation matrix with a position"
        raise sheet.refuse(problem, expected)
    same = {name: numbers[:, arranged[name][0] + arranged[name][1]].tobytes() for name in fitting}
    if ROTATION in given and given.text(ROTATION) == "rows" and "rows" not in fitting:
        fitting = [name for name in fitting if name == "rotation-position"] or fitting
    if len(set(same.values())) == 1:
        chosen = fitting[0]
    elif ROTATION in given:
        chosen = next((n for n in fitting if n.startswith(given.text(ROTATION))), fitting[0])
    else:
        content = (
            f"{4 * width} numbers per row, which are a transform as {' and as '.join(fitting)}"
        )
        asked = ["columns" if n == "columns" else "rows" for n in fitting]
        ways = list(dict.fromkeys(asked))
        answer = settled(sheet, given, ROTATION, ways, content, likeliest=ways[0])
        chosen = next(n for n, a in zip(fitting, asked, strict=True) if a == answer)
    rotation, position = arranged[chosen]
    return PoseColumns("", position, rotation, "rows")


def _stacked(sheet: Sheet, numbers: FloatArray, rows: int) -> tuple[PoseColumns | None, Sheet]:
    """4x4 matrices one below the other: a row for each, in which they stand by rows."""
    if len(numbers) != rows or rows % 4:
        return None, sheet
    blocks = numbers.reshape(-1, 4, 4)
    remark = "4x4 matrices, stacked."
    if not np.allclose(blocks[:, 3], [0, 0, 0, 1], atol=1e-6):
        blocks, remark = blocks.swapaxes(1, 2), "4x4 matrices, stacked, each by columns."
    if not np.allclose(blocks[:, 3], [0, 0, 0, 1], atol=1e-6):
        return None, sheet
    names = tuple(str(k + 1) for k in range(16))
    columns = tuple(blocks.reshape(-1, 16).T)
    remarks = (*sheet.remarks, remark)
    stacked = replace(sheet, names=names, lines=sheet.lines[::4], values=columns, remarks=remarks)
    rotation = tuple(4 * row + column for row in range(3) for column in range(3))
    return PoseColumns("", (3, 7, 11), rotation, "rows"), stacked
