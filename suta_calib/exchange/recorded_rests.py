"""Recorded joint readings: where the arm rested, and what was seen of it meanwhile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.acquisition.stops import Complete, StopFinder
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.imported import ImportedRows, pose_columns
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.tracked_bodies import Body
from suta_calib.measurements.csv_table import number_in

SECONDS: Final = Option(
    "seconds", "Shortest duration of a rest, in s; the readings of a rest are averaged.", "N"
)


@dataclass(frozen=True, eq=False)
class RecordedPicture:
    """A picture as a file: its suffix, and its bytes."""

    suffix: str
    data: bytes


@dataclass(frozen=True, eq=False)
class Rest:
    """A time in which the arm rested: from ``begin`` to ``end``, s, all of which was averaged.

    The mean readings are angles (n,), rad; one reading scatters by std (n,), rad.
    """

    angles: FloatArray
    begin: float
    end: float
    std: FloatArray


def shortest_rest(given: Given) -> float:
    """How long a rest is at least, s, by `SECONDS`."""
    seconds = number_in(given.text(SECONDS, "1"))
    longest = 3600.0
    if not 0.0 < seconds < longest:
        raise given.refuse(SECONDS, repr(given.text(SECONDS)), "a number of seconds above 0")
    return seconds


def found_rests(
    path: Path, joints: Sequence[str], time: FloatArray, angles: FloatArray, given: Given
) -> list[Rest]:
    """The rests in a recording, at least one, as ``measure`` finds and averages them.

    Times (n,), s, may be in any order; angles are (n, joints), rad; `SECONDS` says how long a rest
    is at least.
    """
    seconds = shortest_rest(given)
    finder, rests = StopFinder(joints, seconds), list[Rest]()
    fine = np.zeros(len(joints), dtype=np.bool_)
    for k, row in enumerate(np.argsort(time, kind="stable")):
        at = float(time[row])
        for event in finder.feed([Reading(k, at, angles[row], fine, fine, at)]):
            if isinstance(event, Complete):
                mean = event.average
                rests.append(Rest(mean.angles, at - mean.seconds, at, mean.std))
    if not rests:
        problem = f"{len(time)} readings in {np.ptp(time):.1f} s, but no rest of {seconds:g} s"
        expected = "an arm that rests at every pose"
        hint = f"to find shorter rests, give {SECONDS.switch} N"
        raise ForeignFileError(problem, expected, file=path, hint=hint)
    return rests


# Columns of one row by name.
Seen = Mapping[str, float]


def imported_rests(
    path: Path,
    form: str,
    joints: Sequence[str],
    rests: Sequence[Rest],
    seen: Mapping[str, Sequence[Seen | None]] | None = None,
    pictures: Sequence[RecordedPicture | None] | None = None,
) -> ImportedRows:
    """A samples CSV of the rests in a recording.

    A rest in which nothing was ``seen`` of something, or no picture was taken, is left out. What
    was seen of each rest is told by what it is called in messages.
    """
    usable = list(range(len(rests)))
    columns, files = dict[str, NDArray[Any]](), dict[str, bytes]()
    everything: dict[str, Sequence[Any]] = {**(seen or {})}
    if pictures is not None:
        everything["picture"] = pictures
    for what, by_rest in everything.items():
        usable = [k for k in usable if by_rest[k] is not None]
        if not usable:
            problem = f"{len(rests)} rests, but no {what} during any of them"
            raise ForeignFileError(problem, f"{what}s with times of the same clock", file=path)
    for by_rest in (seen or {}).values():
        rows = [row for k in usable if (row := by_rest[k]) is not None]
        columns |= {name: np.array([row[name] for row in rows]) for name in rows[0]}
    if pictures is not None:
        for k in usable:
            if (picture := pictures[k]) is not None:
                files[f"{path.stem}_{k + 1:03d}{picture.suffix}"] = picture.data
        columns["image"] = np.array([*files])
    readings = np.array([rests[k].angles for k in usable])
    return ImportedRows(
        source=path,
        form=form,
        columns={
            **dict(zip(joints, readings.T, strict=True)),
            **columns,
            "time": np.array([rests[k].end for k in usable]),
        },
        dropped=len(rests) - len(usable),
        remarks=("Each row is the mean of a rest.",),
        pictures=files,
    )


def seen_poses(
    time: FloatArray, body: Body, rests: Sequence[Rest], prefix: str
) -> list[Seen | None]:
    """The mean pose of a body during each rest; None where it was not seen."""
    bodies = list[Seen | None]()
    for rest in rests:
        rows = np.flatnonzero((time >= rest.begin) & (time <= rest.end) & body.observed)
        if not len(rows):
            bodies.append(None)
            continue
        during, rotation = body.take(rows), None
        if during.rotation is not None:
            # The rotation nearest to all: that of the mean matrix.
            left, _, right = np.linalg.svd(during.rotation.mean(axis=0))
            rotation = (left @ right)[None]
        columns = pose_columns(during.position.mean(axis=0)[None], rotation, prefix)
        bodies.append({name: float(values[0]) for name, values in columns.items()})
    return bodies
