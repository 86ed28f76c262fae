"""Bodies and markers that an instrument followed, its files, and the poses CSV of some of them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import ForeignFileError, did_you_mean
from suta_calib.exchange.cells import TableRow, numbers_of, read_foreign_text, rows_of_text
from suta_calib.exchange.imported import ImportedRows, checked_places, distance_notes, pose_columns
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.truncated import COMPLETE, check_end_of_rows
from suta_calib.words import listed

BODY: Final = Option(
    "body",
    "Name of the body or marker; m* selects several, and a column target then names each.",
    "NAME",
)
REFERENCE: Final = Option(
    "reference",
    "Body in whose frame the pose is given, row by row; for tables also a second file.",
    "NAME|FILE",
)
PREFIX: Final = Option(
    "prefix", "Prefix of the columns of the pose: a_ or b_ for hand-eye.", "TEXT"
)
INVERT: Final = Option(
    "invert",
    "Invert the poses: they are those of the instrument in the frame of the tool.",
    flag=True,
)
BODY_OPTIONS: Final = (BODY, REFERENCE, PREFIX, INVERT)
# In front of the columns of poses of hand-eye files, which stand side by side.
PAIR: Final = ("a_", "b_")


@dataclass(frozen=True, eq=False)
class Body:
    """What was seen of one body, or of one marker.

    Attributes:
        position: (n, 3), m; NaN where it was not seen.
        rotation: (n, 3, 3), NaN where it was not seen; None for a marker.
    """

    position: FloatArray
    rotation: FloatArray | None = None

    @property
    def observed(self) -> BoolArray:
        """(n,) where all of it was measured."""
        observed = np.isfinite(self.position).all(axis=1)
        if self.rotation is not None:
            observed &= np.isfinite(self.rotation).all(axis=(1, 2))
        return np.asarray(observed)

    def take(self, rows: NDArray[Any]) -> Body:
        """Some of its rows."""
        rotation = None if self.rotation is None else self.rotation[rows]
        return Body(self.position[rows], rotation)

    def relative_to(self, reference: Body) -> Body:
        """``T_reference_body``; both with rotations that are known."""
        assert reference.rotation is not None
        back = np.swapaxes(reference.rotation, 1, 2)
        position = (back @ (self.position - reference.position)[..., None])[..., 0]
        return Body(position, None if self.rotation is None else back @ self.rotation)

    def inverse(self) -> Body:
        """``T_body_instrument`` of ``T_instrument_body``."""
        assert self.rotation is not None
        back = np.swapaxes(self.rotation, 1, 2)
        return Body((back @ (0.0 - self.position)[..., None])[..., 0], back)


def _bare(name: str) -> str:
    """What stands in front of the columns' names in a table: Tool of Tool.x."""
    return name.rstrip("_. :/") or name


@dataclass(frozen=True, eq=False)
class Recording:
    """Everything an instrument's file holds.

    Attributes:
        path: the file.
        bodies: by name, in the file's order, n rows each.
        time: (n,) s, or None.
        unit: of lengths in the file, and who says so, for messages.
        beside: further columns of the same rows.
    """

    path: Path
    bodies: Mapping[str, Body]
    time: FloatArray | None
    unit: str
    beside: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def imported(self, form: str, given: Given, prefix: str = "") -> ImportedRows:
        """The poses CSV that the options ask for."""
        reference = self._one(given.text(REFERENCE)) if REFERENCE in given else None
        names = [name for name in self._chosen(given.text(BODY), reference) if name != reference]
        if not names:
            problem = f"{reference!r}, which is the body itself"
            raise given.refuse(REFERENCE, problem, "another body than --body")
        prefix, parts, dropped = given.text(PREFIX, prefix), list[dict[str, NDArray[Any]]](), 0
        for name in names:
            body, observed = self.bodies[name], self.bodies[name].observed
            if reference is not None:
                frame = self._posed(reference, "a reference")
                observed = observed & frame.observed
                body = body.relative_to(frame)
            body = body.take(observed)
            if INVERT in given:
                self._posed(name, "the body to invert")
                body = body.inverse()
            columns = {} if self.time is None else {"time": self.time[observed]}
            columns |= {column: values[observed] for column, values in self.beside.items()}
            columns |= pose_columns(body.position, body.rotation, prefix)
            if len(names) > 1:
                columns["target"] = np.full(int(observed.sum()), _bare(name))
            parts.append(columns)
            dropped += int((~observed).sum())
        together = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        position = np.stack([together[prefix + axis] for axis in "xyz"], axis=1)
        of = listed([*map(_bare, names)]) + (f" in {reference}" if reference is not None else "")
        return ImportedRows(
            source=self.path,
            form=form,
            columns=together,
            dropped=dropped,
            notes=distance_notes(position, f"lengths {self.unit}"),
            remarks=(f"Pose of {of}; lengths are {self.unit}.",),
        )

    def pairs(self, form: str) -> ImportedRows:
        """Rows of a hand-eye problem: two bodies of as many poses, and what stands beside them."""
        columns = dict(self.beside)
        prefixes = self.bodies if set(self.bodies) == set(PAIR) else PAIR
        for prefix, body in zip(prefixes, self.bodies.values(), strict=True):
            columns |= pose_columns(body.position, body.rotation, prefix)
        asked = [
            distance_notes(body.position, f"lengths {self.unit}") for body in self.bodies.values()
        ]
        notes, remarks = tuple(chain(*asked)), (f"Lengths are {self.unit}.",)
        return ImportedRows(
            source=self.path, form=form, columns=columns, notes=notes, remarks=remarks
        )

    def _chosen(self, pattern: str, reference: str | None) -> list[str]:
        if not pattern:
            bodies = [name for name in self.bodies if name != reference]
            if len(bodies) > 1:
                raise ForeignFileError(
                    f"{len(self.bodies)} bodies or markers: {listed([*map(_bare, self.bodies)])}",
                    "one body, or the name of the bodies to read",
                    file=self.path,
                    hint="choose it with --body NAME, and with --reference NAME the body in "
                    "whose frame it is given",
                )
            return bodies or list(self.bodies)
        names = [name for name in self.bodies if fnmatchcase(name, pattern)]
        names = names or [self._one(pattern)]
        if len({self.bodies[name].rotation is None for name in names}) > 1:
            problem = f"both bodies and markers with the name {pattern!r}"
            raise ForeignFileError(problem, "either", file=self.path, where=BODY.switch)
        return names

    def _one(self, name: str) -> str:
        same = [body for body in self.bodies if _bare(body).lower() == _bare(name).lower()]
        if name in self.bodies or len(same) == 1:
            return name if name in self.bodies else same[0]
        problem, hint = f"no body or marker {name!r}", did_you_mean(name, self.bodies)
        expected = f"one of {listed([*map(_bare, self.bodies)], 12)}"
        raise ForeignFileError(problem, expected, file=self.path, hint=hint)

    def _posed(self, name: str, as_what: str) -> Body:
        if self.bodies[name].rotation is None:
            problem = f"{name!r}, a marker, as {as_what}"
            raise ForeignFileError(problem, "a body with an orientation", file=self.path)
        return self.bodies[name]


class InstrumentReader(Reader):
    """A text file of an instrument: bodies and markers in columns, a frame in each row.

    Attributes:
        separator: between cells.
    """

    options: ClassVar[tuple[Option, ...]] = (*BODY_OPTIONS, COMPLETE)
    separator: ClassVar[str] = ","

    def read(self, path: Path, given: Given) -> ImportedRows:
        """The pose of the body that is asked for, in m; frames without it are left out."""
        text = read_foreign_text(path)
        separator = self.separator_of(text)
        check_end_of_rows(path, text, separator, given)
        rows = rows_of_text(path, text, separator)
        if not rows:
            raise self.strange(path, "only comments", "frames")
        return self.recording(path, rows, given).imported(self.name, given)

    def separator_of(self, text: str) -> str:
        """What stands between the cells of a text."""
        del text
        return self.separator

    @abstractmethod
    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Everything the file holds."""

    def strange(
        self, path: Path, problem: str, expected: str, line: int | None = None
    ) -> Exception:
        """Error that a file is not what it seems, to be raised by the caller."""
        hint = f"check that the file is {self.summary}; another --format, or table, may fit"
        return ForeignFileError(problem, expected, file=path, line=line, hint=hint)


def body_of(
    path: Path,
    rows: Sequence[TableRow],
    position: Sequence[int],
    rotation: Sequence[int],
    form: str,
    scale: float,
    angle: float = 1.0,
) -> Body:
    """A body in some columns; none of a rotation for a marker.

    ``scale`` is in m per unit of the position, ``angle`` in rad per unit of angles.
    """
    lines = [row.line for row in rows]
    places = checked_places(path, lines, scale * numbers_of(path, rows, position))
    if not rotation:
        return Body(places)
    return Body(places, rotations_from(form, angle * numbers_of(path, rows, rotation), path, lines))


def column_of_time(path: Path, rows: Sequence[TableRow], column: int | None) -> FloatArray | None:
    """(n,) s in a column, or None where there is none or a time is missing."""
    if column is None:
        return None
    time = numbers_of(path, rows, [column])[:, 0]
    return time if np.isfinite(time).all() else None
