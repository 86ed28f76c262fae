"""Series of poses by name: the poses of one body, or the pairs of a hand-eye calibration."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.imported import ImportedRows, checked_places
from suta_calib.exchange.option import Given
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY, PAIR, REFERENCE, Body, Recording
from suta_calib.units import from_mm
from suta_calib.words import listed

# What people call the robot's pose, and what the eye sees.
_OF_HAND: Final = re.compile(
    r"robot|hand|effector|gripper|flange|tool|tcp|(^|_)(ee|a|fPe|base)(_|$)", re.I
)
_OF_TARGET: Final = re.compile(
    r"track|tag|target|object|marker|board|pattern|chess|(^|_)(b|cPo)(_|$)|obj|sensor|cam|eye",
    re.I,
)


@dataclass(frozen=True, eq=False)
class PoseSeries:
    """Poses of one name.

    Attributes:
        numbers: (n, 3, 4) rotation and position, in the file's unit.
        frames: (n,) what the file calls each of them: numbers, or names of pictures.
        lines: (n,) in the file.
    """

    numbers: FloatArray
    frames: Sequence[int | str]
    lines: Sequence[int]

    @property
    def inverted(self) -> PoseSeries:
        """The poses that lead back."""
        turned = np.swapaxes(self.numbers[:, :, :3], 1, 2)
        return replace(self, numbers=np.dstack([turned, -turned @ self.numbers[:, :, 3:]]))

    def body(self, path: Path, unit: str) -> Body:
        """In m, with rotations that are some.

        Raises:
            ForeignFileError: a matrix that is no rotation, or a place that is too far.
        """
        position = self.numbers[:, :, 3] if unit == "m" else from_mm(self.numbers[:, :, 3])
        rotation = rotations_from("rows", self.numbers[:, :, :3].reshape(-1, 9), path, self.lines)
        return Body(checked_places(path, self.lines, position), rotation)


def imported_series(
    path: Path, form: str, series: Mapping[str, PoseSeries], given: Given, unit: str = "m"
) -> ImportedRows:
    """Pairs ``a_…``, ``b_…`` of two series of as many poses, or the series of ``--body``.

    Args:
        path: the file.
        form: name of its format.
        series: at least one, by name, in the file's order.
        given: options of `BODY_OPTIONS` and `UNIT`.
        unit: of lengths where `UNIT` is not given.

    Raises:
        ForeignFileError: series of other frames that should be pairs.
        InputError: another unit than m and mm, or a body that there is none of.
    """
    unit = given.text(UNIT, unit)
    if unit not in ("m", "mm"):
        raise given.refuse(UNIT, repr(unit), "m or mm")
    other = "mm" if unit == "m" else "m"
    unit_text = f"in {unit}"
    if UNIT not in given:
        command = f"suta-calib import {shlex.quote(str(path))} --unit {other} --out poses.csv"
        unit_text += f" (if they are {other}: {command})"
    pair = len(series) == len(PAIR) and BODY not in given
    if pair or REFERENCE in given:
        _check_frames(path, series)
    bodies = {name: of.body(path, unit) for name, of in series.items()}
    if pair:
        return _pairs(path, form, series, bodies, unit_text)
    # Of one body its own frames; of several, those that they have in common.
    chosen = [series[name] for name in series if name == given.text(BODY)] or [*series.values()]
    frames = chosen[0].frames
    same = all([*of.frames] == [*frames] for of in chosen)
    beside = _numbered(frames) if same else {}
    return Recording(path, bodies, None, unit_text, beside).imported(form, given)


def _check_frames(path: Path, series: Mapping[str, PoseSeries]) -> None:
    first, *rest = series.values()
    if any([*of.frames] != [*first.frames] for of in rest):
        lengths = " and ".join(f"{len(of.frames)} {name}" for name, of in series.items())
        everywhere = set.intersection(*(set(of.frames) for of in series.values()))
        lone = [
            f"{frame} has only a pose of {name}"
            for name, of in series.items()
            for frame in of.frames
            if frame not in everywhere
        ]
        # All of them say nothing: the series are of other numbers altogether.
        where = f" (sample {listed(lone, 3)}; samples count from 0)" if everywhere and lone else ""
        raise ForeignFileError(
            f"different numbers of poses: {lengths}{where}",
            "the same number of poses in each series, because they are pairs",
            file=path,
            hint="complete or delete this sample; check for missing or infinite numbers. Or choose "
            f"one series with {BODY.switch} {next(iter(series))}",
        )


def _pairs(
    path: Path,
    form: str,
    series: Mapping[str, PoseSeries],
    bodies: Mapping[str, Body],
    unit_text: str,
) -> ImportedRows:
    """Rows of a hand-eye problem; by their names, or else in the file's order."""
    hand, target = _roles(list(bodies))
    certain = (hand, target) == _roles([target, hand])
    recording = Recording(path, {hand: bodies[hand], target: bodies[target]}, None, unit_text)
    rows = recording.pairs(form)
    taken = (
        f"{hand} is treated as the hand in the base (a_), {target} as the target in the eye (b_)"
    )
    rows = replace(
        rows,
        columns={**rows.columns, **_numbered(series[hand].frames)},
        lines=tuple(series[hand].lines),
        remarks=(*rows.remarks, *([f"{taken}."] if certain else [])),
    )
    if certain:
        return rows
    other = f"{taken}. If that is wrong, choose each series with {BODY.switch}."
    return replace(rows, notes=(other, *rows.notes))


def _numbered(frames: Sequence[int | str]) -> dict[str, NDArray[Any]]:
    """The column that names each row as the source does: a picture's name, or a number."""
    return {"image" if isinstance(frames[0], str) else "frame": np.array(frames)}


def _roles(names: Sequence[str]) -> tuple[str, str]:
    """The hand's and the target's series: as given, unless their names say the opposite."""
    first, second = names
    of_hand = [bool(_OF_HAND.search(name)) for name in names]
    of_target = [bool(_OF_TARGET.search(name)) for name in names]
    turned = of_hand == [False, True] or (of_hand[0] == of_hand[1] and of_target == [True, False])
    return (second, first) if turned else (first, second)
