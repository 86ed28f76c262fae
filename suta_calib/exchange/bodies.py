"""Bodies and markers that an instrument followed, and the poses CSV of some of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import ForeignFileError, did_you_mean
from suta_calib.exchange.imported import ImportedRows, distance_note, pose_columns
from suta_calib.exchange.option import Given, Option
from suta_calib.words import listed

BODY: Final = Option(
    "body",
    "Which of the bodies or markers; a glob may name several, told apart in a column target.",
    "NAME",
)
REFERENCE: Final = Option(
    "reference",
    "Body that the pose is told relative to, row by row; for tables also a second file.",
    "NAME|FILE",
)
PREFIX: Final = Option("prefix", "In front of the pose's columns: a_ or b_ for hand-eye.", "TEXT")
INVERT: Final = Option("invert", "The poses are those of the instrument in the tool.", flag=True)
BODY_OPTIONS: Final = (BODY, REFERENCE, PREFIX, INVERT)


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
        return Body(np.zeros_like(self.position), _identity(len(self.position))).relative_to(self)


def _bare(name: str) -> str:
    return name.rstrip("_. :/").lower()


def _identity(n: int) -> FloatArray:
    return np.broadcast_to(np.eye(3), (n, 3, 3))


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
        """The poses CSV that the options ask for.

        Args:
            form: name of the format.
            given: `BODY_OPTIONS`.
            prefix: in front of the pose's columns where the options do not say.

        Raises:
            ForeignFileError: no such body, several and none was named, a marker where a pose is
                needed, or no row in which all was seen.
        """
        reference = self._one(given.text(REFERENCE)) if REFERENCE in given else None
        names = self._chosen(given.text(BODY), reference)
        names = [name for name in names if name != reference]
        if not names:
            raise given.refuse(
                REFERENCE, f"{reference!r}, the body itself", "another body than --body"
            )
        prefix, parts, dropped = given.text(PREFIX, prefix), list[dict[str, NDArray[Any]]](), 0
        for name in names:
            body, observed = self.bodies[name], self.bodies[name].observed
            if reference is not None:
                frame = self._posed(reference, "a reference")
                observed = observed & frame.observed
                body = body.take(observed).relative_to(frame.take(observed))
            else:
                body = body.take(observed)
            if INVERT in given:
                self._posed(name, "what is inverted")
                body = body.inverse()
            columns = {} if self.time is None else {"time": self.time[observed]}
            columns |= {column: values[observed] for column, values in self.beside.items()}
            columns |= pose_columns(body.position, body.rotation, prefix)
            if len(names) > 1:
                columns["target"] = np.full(int(observed.sum()), name)
            parts.append(columns)
            dropped += int((~observed).sum())
        together = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        position = np.stack([together[prefix + axis] for axis in "xyz"], axis=1)
        of = listed(names) + (f" in {reference}" if reference is not None else "")
        note = distance_note(position, self.unit)
        return ImportedRows(
            source=self.path,
            form=form,
            columns=together,
            dropped=dropped,
            notes=(note,) if note else (),
            remarks=(f"The pose of {of}; lengths are {self.unit}.",),
        )

    def _chosen(self, pattern: str, reference: str | None) -> list[str]:
        if not pattern:
            bodies = [name for name in self.bodies if name != reference]
            if len(bodies) > 1:
                raise ForeignFileError(
                    f"{len(self.bodies)} bodies or markers: {listed(list(self.bodies))}",
                    "one, or the name of those that are meant",
                    file=self.path,
                    hint="say which with --body NAME, and --reference NAME for what it is seen "
                    "relative to",
                )
            return bodies or list(self.bodies)
        names = [name for name in self.bodies if fnmatchcase(name, pattern)]
        names = names or [self._one(pattern)]
        if len({self.bodies[name].rotation is None for name in names}) > 1:
            problem = f"bodies and markers of the name {pattern!r}"
            raise ForeignFileError(problem, "either", file=self.path, where=BODY.switch)
        return names

    def _one(self, name: str) -> str:
        # Of a table they are what stands in front of the columns' names: Tool of Tool.x.
        candidates = [body for body in self.bodies if _bare(body) == _bare(name)]
        if name not in self.bodies and len(candidates) == 1:
            return candidates[0]
        if name not in self.bodies:
            raise ForeignFileError(
                f"no body or marker {name!r}",
                f"one of {listed(list(self.bodies), 12)}",
                file=self.path,
                hint=did_you_mean(name, self.bodies),
            )
        return name

    def _posed(self, name: str, as_what: str) -> Body:
        if self.bodies[name].rotation is None:
            problem = f"{name!r}, a marker, as {as_what}"
            raise ForeignFileError(problem, "a body with an orientation", file=self.path)
        return self.bodies[name]
