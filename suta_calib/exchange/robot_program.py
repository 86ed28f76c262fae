"""Positions in programs of robot controllers: joint positions and poses, found by their shape."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.external_axes import EXTERNAL_UNIT, ExternalAxes
from suta_calib.exchange.imported import ImportedRows, checked_places, pose_columns
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import NUMBERS, rotations_from
from suta_calib.exchange.truncated import COMPLETE, check_end_of_program
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.files import lines_of
from suta_calib.units import from_deg, from_mm
from suta_calib.words import listed

WHAT: Final = Option(
    "what", "Kind of positions to read, if the file has both.", choices=("joints", "poses")
)
NAMES: Final = Option(
    "joint_names", "Names of the joints, in their order.", "joint_1,…", several=True
)
# A number as all of these languages write it; one way only, or long ones would take for ever.
NUMBER: Final = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
# The digit of a name, as in A1, is no number.
_NUMBERS: Final = re.compile(rf"(?<![A-Za-z\d.]){NUMBER}", re.ASCII)
# What a position is given to: ``p10 := ``, ``XP1=``.
_NAME: Final = re.compile(r"(\w+)\s*:?=\s*$")


class _Positions(NamedTuple):
    """Positions of one kind: lines, names (empty where they have none), and their numbers.

    External axes are by name of each position.
    """

    lines: list[int]
    names: list[str]
    numbers: FloatArray
    external: list[Mapping[str, float]]


class ProgramReader(Reader):
    """A program, or a list of positions, of one controller's language.

    Attributes:
        joint_pattern: matches one joint position; its first group holds the numbers.
        pose_pattern: the same for a pose.
        comment: begins a comment.
        opening: matches the beginning of a block of the program.
        closing: matches the end of one.
        last_word: matches such an end that is no beginning of another word; closing where None.
        settings: matches what sets something other than a position, up to its end.
        metric: whether lengths are in m and angles in rad, not in mm and degrees.
        pose_form: of the orientation behind the position (`rotations.NUMBERS`).
    """

    options: ClassVar[tuple[Option, ...]] = (WHAT, NAMES, EXTERNAL_UNIT, COMPLETE)
    joint_pattern: ClassVar[re.Pattern[str]]
    pose_pattern: ClassVar[re.Pattern[str]]
    comment: ClassVar[str]
    opening: ClassVar[re.Pattern[str]]
    closing: ClassVar[re.Pattern[str]]
    last_word: ClassVar[re.Pattern[str] | None] = None
    settings: ClassVar[re.Pattern[str] | None] = None
    metric: ClassVar[bool] = False
    pose_form: ClassVar[str]

    def external(self, position: str) -> Mapping[str, float]:
        """External axes by name in the text behind the numbers of a position."""
        del position
        return {}

    def read(self, path: Path, given: Given) -> ImportedRows:
        """A row for each position, in the program's order, with its line and its name."""
        text = read_foreign_text(path)
        by_kind = {
            "joints": self._positions(path, text, self.joint_pattern),
            "poses": self._positions(path, text, self.pose_pattern),
        }
        there = [what for what, positions in by_kind.items() if positions.lines]
        what = given.text(WHAT)
        if not what and len(there) > 1:
            counts = " and ".join(f"{len(by_kind[kind].lines)} {kind}" for kind in there)
            hint = f"choose with {WHAT.switch} joints or {WHAT.switch} poses"
            raise ForeignFileError(counts, "only one of them", file=path, hint=hint)
        what = what or next(iter(there), "")
        if what not in there:
            problem = f"no {what or 'positions'}"
            raise ForeignFileError(problem, f"positions in {self.summary}", file=path)
        ends = self.comment, self.opening, self.closing, self.last_word or self.closing
        check_end_of_program(path, text, given, *ends)
        lines, labels, numbers, external = by_kind[what]
        axes = ExternalAxes.of(path, lines, external)
        beside: dict[str, NDArray[Any]] = {"line": np.array(lines)}
        if any(labels):
            beside["name"] = np.array(labels)
        if what == "poses":
            position, turn = numbers[:, :3], numbers[:, 3:]
            if not self.metric:
                position = from_mm(position)
                turn = from_deg(turn) if NUMBERS[self.pose_form] == 3 else turn
            rotation = rotations_from(self.pose_form, turn, path, lines)
            position = checked_places(path, lines, position)
            more, notes = axes.columns(axes.used((), 0), (), given, required=False)
            columns = {**pose_columns(position, rotation), **more, **beside}
            return ImportedRows(source=path, form=self.name, columns=columns, notes=tuple(notes))
        count = numbers.shape[1]
        names = given.texts(NAMES) or tuple(f"joint_{k + 1}" for k in range(count))
        used = axes.used(names, count)
        if len(names) not in (count, count + len(used)) or len(set(names)) < len(names):
            with_them = f", or {count + len(used)} with {listed(used)}" if used else ""
            expected = f"{count} different ones{with_them}"
            raise given.refuse(NAMES, f"{len(names)} names", expected)
        more, notes = axes.columns(used, names[count:], given, required=True)
        angles = numbers if self.metric else from_deg(numbers)
        columns = {**dict(zip(names[:count], angles.T, strict=True)), **more, **beside}
        return ImportedRows(source=path, form=self.name, columns=columns, notes=tuple(notes))

    def _positions(self, path: Path, text: str, pattern: re.Pattern[str]) -> _Positions:
        """Each match: a pattern takes as many numbers from each."""
        lines, names, rows = list[int](), list[str](), list[list[float]]()
        external = list[Mapping[str, float]]()
        longest = 20_000
        for number, line in enumerate(lines_of(text), 1):
            if len(line) > longest:
                problem = f"a line of {len(line)} characters"
                raise ForeignFileError(problem, "a program", file=path, line=number)
            content = line.partition(self.comment)[0]
            if self.settings is not None:
                content = self.settings.sub("", content)
            for match in pattern.finditer(content):
                row = [number_in(number_text) for number_text in _NUMBERS.findall(match[1])]
                if not np.isfinite(row).all():
                    problem = repr(match[1][:40])
                    raise ForeignFileError(problem, "finite numbers", file=path, line=number)
                name = _NAME.search(content[: match.start()])
                lines.append(number)
                names.append("" if name is None else name[1])
                rows.append(row)
                external.append(self.external(content[match.end(1) :]))
        return _Positions(lines, names, np.array(rows), external)
