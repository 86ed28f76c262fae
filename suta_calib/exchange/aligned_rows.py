"""Two recordings with clocks of their own as one samples or poses file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.clock import Clock
from suta_calib.exchange.clock_alignment import ClockAlignment, Recorded, align_clocks
from suta_calib.exchange.imported import Imported, ImportedRows
from suta_calib.exchange.moving_rows import MovingRows, joined
from suta_calib.exchange.pose_table import with_command
from suta_calib.exchange.tracked_bodies import PAIR, Body
from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.measurements.csv_table import rotation_columns
from suta_calib.measurements.pose_files import OTHER_UNIT
from suta_calib.model.arm import ArmModel
from suta_calib.units import ms, text
from suta_calib.words import listed

_TIME: Final = "time"


@dataclass(frozen=True, eq=False, kw_only=True)
class AlignedRows(ImportedRows):
    """Rows of two recordings, at the times of the one with fewer; the other is interpolated.

    Attributes:
        alignment: of the second clock with the first, whose times the rows have.
        other: file of the second recording.
        interpolated: file of the recording that is interpolated.
    """

    alignment: ClockAlignment
    other: Path
    interpolated: Path

    @property
    def sentence(self) -> str:
        """How many rows, and what was added to the second clock."""
        a = self.alignment
        return (
            f"{super().sentence}. To the times of {self.other.name} {a.shift:+.4f} s "
            f"± {ms(a.shift_std):.2g} ms were added (at its time {a.at:.3f} s), and "
            f"{1e6 * a.drift:+.0f} ± {1e6 * a.drift_std:.2g} ppm of the time since then"
        )


def aligned(first: Imported, second: Imported, arm: ArmModel | None = None) -> AlignedRows:
    """Join two recordings of one motion, whose clocks are their own.

    Args:
        first: poses, or the readings of an arm's joints.
        second: poses of what is rigidly connected to the first, or fixed where it moves.
        arm: whose joints were recorded, and whose tip carries what was seen; None for poses.

    Returns:
        Samples of the arm with the pose that was seen, or pairs of poses ``a_…``, ``b_…``, at the
        times of the first clock.

    Raises:
        ForeignFileError: no times, no orientations, recordings of different motions, or a motion
            that does not tell the shift.
    """
    of_first = _series(first, arm)
    try:
        of_second = _series(second, None)
    except ForeignFileError as problem:
        raise with_command(problem, second.source) from None
    first_body, second_body = _recorded(of_first), _recorded(of_second)
    alignment = align_clocks(first_body, second_body)
    _check_scale(alignment, of_second.path)
    prefixes = ("", "") if arm is not None else PAIR
    clocks = alignment.first_times, alignment.second_times
    rows = joined(of_first, of_second, prefixes, *clocks)
    return AlignedRows(
        source=first.source,
        form=first.form,
        columns=rows.columns,
        dropped=rows.dropped,
        notes=(*_notes(alignment, of_first, of_second), *first.notes, *second.notes),
        remarks=(*_remarks(alignment, of_first, of_second, rows.interpolated), *first.remarks),
        alignment=alignment,
        other=second.source,
        interpolated=rows.interpolated.path,
    )


def _recorded(rows: MovingRows) -> Recorded:
    assert rows.body is not None
    return Recorded(rows.path, rows.clock, rows.body)


def _series(imported: Imported, arm: ArmModel | None) -> MovingRows:
    """A recording that can be aligned.

    Raises:
        ForeignFileError: it is no recording of poses, or of the arm's joints.
    """
    path = imported.source
    if not isinstance(imported, ImportedRows):
        raise ForeignFileError(imported.sentence, "a recording with times", file=path)
    columns = imported.columns
    numbers = {n: v for n, v in columns.items() if v.dtype.kind == "f"}
    if _TIME not in numbers:
        expected = "a column 'time' (s)"
        hint = "name it with --columns NAME=time, or --columns 'NAME=time [ms]'"
        raise ForeignFileError(listed(list(columns), 16), expected, file=path, hint=hint)
    clock = Clock.of(path, numbers[_TIME])
    joints = dict[str, FloatArray]()
    if arm is not None:
        missing = [name for name in arm.joints if name not in numbers]
        if missing:
            expected = f"columns of the arm's joints: {listed(list(arm.joints), 12)}"
            found = f"columns {listed(list(columns), 16)}, without {listed(missing)}"
            raise ForeignFileError(found, expected, file=path)
        joints = {name: numbers[name][clock.rows] for name in arm.joints}
        rotation, position = arm.forward(np.column_stack(list(joints.values())))
        body, used = Body(position, rotation), {*joints}
    else:
        body, used = _body(path, columns, clock)
    recorded = Recorded(path, clock, body)
    tame = recorded if arm is not None else recorded.without_wild_poses()
    beside = {n: v for n, v in columns.items() if n not in used and n != _TIME}
    return MovingRows(path, tame.clock, joints, tame.body, beside)


def _body(path: Path, columns: Any, clock: Clock) -> tuple[Body, set[str]]:
    """The one body that columns tell of, at the times of a clock, and their names."""
    prefixes = [name[:-1] for name in columns if name == "x" or name.endswith("_x")]
    prefixes = [p for p in prefixes if all(p + axis in columns for axis in "xyz")]
    posed = [p for p in prefixes if all(name in columns for name in rotation_columns(p))]
    if len(posed) != 1:
        found = (
            f"{len(posed)} poses in each row"
            if posed
            else "positions without orientations"
            if prefixes
            else f"columns {listed(list(columns), 16)}"
        )
        hint = (
            "import each pose by itself first"
            if posed
            else "without an orientation nothing is known of how far the body turned"
            if prefixes
            else "for the readings of an arm's joints, give --urdf and --tip"
        )
        raise ForeignFileError(found, "one pose in each row", file=path, hint=hint)
    if "target" in columns and len(names := np.unique(columns["target"])) > 1:
        found = f"{len(names)} targets: {listed([*map(str, names)])}"
        hint = "choose one with --body NAME when importing this file first"
        raise ForeignFileError(found, "one", file=path, hint=hint)
    (prefix,) = posed
    places, turns = [prefix + axis for axis in "xyz"], list(rotation_columns(prefix))
    position = np.column_stack([columns[name] for name in places])[clock.rows]
    quaternion = np.column_stack([columns[name] for name in turns])[clock.rows]
    return Body(position, rotation_from_quaternion(quaternion)), {*places, *turns}


def _check_scale(alignment: ClockAlignment, path: Path) -> None:
    least, most = OTHER_UNIT
    scale = alignment.scale
    if least < scale < most or least < 1.0 / scale < most:
        found = f"lengths that are {scale:.4g} times those of the other recording"
        hint = "one of the two is in mm: import it by itself with --unit mm first"
        raise ForeignFileError(found, "lengths in m in both", file=path, hint=hint)


def _notes(alignment: ClockAlignment, first: MovingRows, second: MovingRows) -> list[str]:
    """What must be known of the alignment, one sentence each."""
    notes = [*first.clock.notes, *second.clock.notes]
    # Lengths of two recordings may differ so much before it is told.
    scales = (0.95, 1.05)
    least, most = scales
    if alignment.step is not None:
        size, where = alignment.step
        notes.append(
            f"The clocks jump against each other: that of {second.path.name} by "
            f"about {ms(size):+.0f} ms near its time {where:.1f} s. One shift and one drift do not "
            "fit both parts: cut the recordings there and align the parts by themselves."
        )
    if alignment.scale < least or alignment.scale > most:
        notes.append(
            f"Lengths in {second.path.name} are {alignment.scale:.3g} times those in "
            f"{first.path.name}. The shift does not depend on that, but a calibration "
            "does: check the unit, and the size of the marker or board."
        )
    # Correlation of the travel along the axes of the motions that two rigidly connected bodies
    # exceed.
    same_travel = 0.5
    if alignment.travel < same_travel:
        notes.append(
            "Both turn alike, but do not travel alike along the axes they turn about (correlation "
            f"{alignment.travel:.2f}). The shift holds; a calibration of these poses will not. "
            "Check the order of the quaternion, and whether the rotation of one is inverted and "
            "its position is not."
        )
    # Standard deviation of a time, s, from which on it is told.
    unsure = 5e-3
    if alignment.worst_std > unsure:
        notes.append(
            f"A time is known to ± {ms(alignment.worst_std):.2g} ms only. "
            f"{_effect(alignment, first)} To know it better, start and stop more often, and turn "
            "faster."
        )
    return notes


def _effect(alignment: ClockAlignment, first: MovingRows) -> str:
    assert first.body is not None
    ways = np.linalg.norm(np.diff(first.body.position, axis=0), axis=1)
    speed = float(np.quantile(ways / np.diff(first.clock.time), 0.95))
    way = text(speed * alignment.worst_std, "m", with_unit=True)
    return f"At {speed:.2g} m/s, which 95 % of the rows do not exceed, this is {way} at the tip."


def _remarks(
    alignment: ClockAlignment, first: MovingRows, second: MovingRows, fast: MovingRows
) -> tuple[str, ...]:
    clocks = (first.clock, second.clock)
    remarks = [
        f"Both cover {alignment.overlap:.4g} s. No time there is worse than "
        f"± {ms(alignment.worst_std):.2g} ms. {_effect(alignment, first)}",
        f"{fast.path.name} is interpolated at the times of the other recording.",
    ]
    return (*remarks, *(remark for clock in clocks for remark in clock.remarks))
