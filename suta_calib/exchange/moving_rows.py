"""Recordings of a moving arm: rows at the times of one of them, the other interpolated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.clock import Between, Clock
from suta_calib.exchange.imported import ImportedRows, pose_columns
from suta_calib.exchange.option import Option
from suta_calib.exchange.tracked_bodies import Body
from suta_calib.geometry.numbers import wrap
from suta_calib.geometry.screws import motion_from_twist, twist_from_motion

MOVING: Final = Option(
    "moving",
    "Rows of a moving arm at the recorded times, in place of the means of its rests.",
    flag=True,
)


@dataclass(frozen=True, eq=False)
class MovingRows:
    """A recording of joint readings, or of the poses of one body.

    Attributes:
        path: its file.
        clock: of its rows.
        joints: readings (n,) by name, rad or m; none of a recording of poses.
        body: its n poses, or those of the joints' arm; None where that is not known.
        beside: further columns, (k,) of all rows of the file.
    """

    path: Path
    clock: Clock
    joints: Mapping[str, FloatArray]
    body: Body | None
    beside: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def rows(self, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Columns at some of its rows."""
        if self.joints or self.body is None:
            return {name: values[rows] for name, values in self.joints.items()}
        body = self.body.take(rows)
        return pose_columns(body.position, body.rotation)

    def between(self, between: Between) -> dict[str, FloatArray]:
        """Columns at times between its rows: readings by the shorter way round."""
        if not self.joints and self.body is not None:
            body = poses_between(self.body, between)
            return pose_columns(body.position, body.rotation)
        columns = dict[str, FloatArray]()
        for name, values in self.joints.items():
            about = values[between.rows[:, 1]]
            away = wrap(values[between.rows] - about[:, None])
            columns[name] = about + (between.weights * away).sum(axis=1)
        return columns


def poses_between(body: Body, between: Between) -> Body:
    """Poses between rows, on SE(3); those of a row where nothing is known."""
    first = body.take(between.rows[:, 1])
    if body.rotation is None or first.rotation is None:
        away = body.position[between.rows] - first.position[:, None]
        return Body(first.position + (between.weights[..., None] * away).sum(axis=1))
    twist = np.zeros((len(between.rows), 6))
    for k in (0, 2, 3):
        step = body.take(between.rows[:, k]).relative_to(first)
        assert step.rotation is not None
        twist += between.weights[:, [k]] * twist_from_motion(step.rotation, step.position)
    turn, way = motion_from_twist(twist)
    position = first.position + (first.rotation @ way[..., None])[..., 0]
    return Body(position, first.rotation @ turn)


class Joined(NamedTuple):
    """Columns of two recordings at the times of the first clock.

    The rows are those of the slower one, but for ``dropped`` ones that the other does not cover.
    """

    columns: dict[str, NDArray[Any]]
    dropped: int
    interpolated: MovingRows


def joined(
    first: MovingRows,
    second: MovingRows,
    prefixes: Sequence[str],
    first_times: Callable[[FloatArray], FloatArray] = np.asarray,
    second_times: Callable[[FloatArray], FloatArray] = np.asarray,
) -> Joined:
    """Both recordings at the times of the one with fewer rows.

    Args:
        first: of the clock of the rows.
        second: of another clock, or the same one.
        prefixes: of the columns of either.
        first_times: times of the second clock on the first.
        second_times: times of the first clock on the second.

    Raises:
        ForeignFileError: they have no time in common.
    """
    coarser = second.clock.step > first.clock.step
    slow, fast = (second, first) if coarser else (first, second)
    time = slow.clock.time
    other = first_times(time) if coarser else second_times(time)
    every_row = Between.of(fast.clock, other)
    rows = np.flatnonzero(every_row.known)
    if not len(rows):
        problem = f"no row at a time that {fast.path.name} covers"
        raise ForeignFileError(problem, "recordings that overlap", file=slow.path)
    between = Between(every_row.rows[rows], every_row.weights[rows], every_row.known[rows])
    at_rows, interpolated = slow.rows(rows), fast.between(between)
    ours, theirs = (interpolated, at_rows) if coarser else (at_rows, interpolated)
    columns: dict[str, NDArray[Any]] = {"time": (other if coarser else time)[rows]}
    for prefix, part in zip(prefixes, (ours, theirs), strict=True):
        columns |= {prefix + name: values for name, values in part.items()}
    for name, values in slow.beside.items():
        columns.setdefault(name, values[slow.clock.rows[rows]])
    return Joined(columns, len(time) - len(rows), fast)


def moving_arm(
    path: Path,
    form: str,
    joints: Mapping[str, FloatArray],
    time: FloatArray,
    seen: tuple[FloatArray, Body] | None = None,
    prefix: str = "",
) -> ImportedRows:
    """Samples of a moving arm: readings (n,) at times (n,), s, and poses of the same clock."""
    order = np.argsort(time, kind="stable")
    clock = Clock.of(path, time[order])
    readings = {name: values[order][clock.rows] for name, values in joints.items()}
    arm = MovingRows(path, clock, readings, None)
    notes, remarks = clock.notes, clock.remarks
    if seen is None:
        columns: dict[str, NDArray[Any]] = {"time": clock.time, **readings}
        return ImportedRows(source=path, form=form, columns=columns, notes=notes, remarks=remarks)
    at, body = seen
    posed = np.flatnonzero(body.observed)
    posed = posed[np.argsort(at[posed], kind="stable")]
    if not len(posed):
        raise ForeignFileError("no pose", "poses of the same clock", file=path)
    of_body = Clock.of(path, at[posed])
    tracked = MovingRows(path, of_body, {}, body.take(posed[of_body.rows]))
    rows = joined(arm, tracked, ("", prefix))
    which = "Poses" if rows.interpolated is tracked else "Readings"
    return ImportedRows(
        source=path,
        form=form,
        columns=rows.columns,
        dropped=rows.dropped,
        notes=tuple(dict.fromkeys((*notes, *of_body.notes))),
        remarks=(f"{which} are interpolated at the times of the others.", *remarks),
    )
