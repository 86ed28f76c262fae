"""Recorded joint readings: where the arm rested, and what was seen of it meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
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

    The mean readings are angles (n,), rad.
    """

    angles: FloatArray
    begin: float
    end: float


def found_rests(
    path: Path, joints: Sequence[str], time: FloatArray, angles: FloatArray, given: Given
) -> list[Rest]:
    """The rests in a recording, at least one, as ``measure`` finds and averages them.

    Times (n,), s, may be in any order; angles are (n, joints), rad; `SECONDS` says how long a rest
    is at least.
    """
    seconds = number_in(given.text(SECONDS, "1"))
    longest = 3600.0
    if not 0.0 < seconds < longest:
        raise given.refuse(SECONDS, repr(given.text(SECONDS)), "a number of seconds above 0")
    finder, rests = StopFinder(joints, seconds), list[Rest]()
    fine = np.zeros(len(joints), dtype=np.bool_)
    for k, row in enumerate(np.argsort(time, kind="stable")):
        at = float(time[row])
        for event in finder.feed([Reading(k, at, angles[row], fine, fine, at)]):
            if isinstance(event, Complete):
                rests.append(Rest(event.average.angles, at - event.average.seconds, at))
    if not rests:
        problem = f"{len(time)} readings in {np.ptp(time):.1f} s, but no rest of {seconds:g} s"
        expected = "an arm that rests at every pose"
        hint = f"to find shorter rests, give {SECONDS.switch} N"
        raise ForeignFileError(problem, expected, file=path, hint=hint)
    return rests


def imported_rests(
    path: Path,
    form: str,
    joints: Sequence[str],
    rests: Sequence[Rest],
    tracked: tuple[FloatArray, Body] | None = None,
    prefix: str = "",
    pictures: Sequence[RecordedPicture | None] | None = None,
) -> ImportedRows:
    """A samples CSV of the rests in a recording.

    A rest in which nothing was seen, or no picture was taken, is left out. What was ``tracked`` of
    the arm are times (m,), s, and m poses; pictures are of each rest.
    """
    usable = list(range(len(rests)))
    columns, files = dict[str, NDArray[Any]](), dict[str, bytes]()
    means = [] if tracked is None else [_mean(*tracked, rest) for rest in rests]
    for what, each in (("pose", means if tracked is not None else None), ("picture", pictures)):
        if each is not None:
            usable = [k for k in usable if each[k] is not None]
            if not usable:
                problem = f"{len(rests)} rests, but no {what} during any of them"
                raise ForeignFileError(problem, f"{what}s with times of the same clock", file=path)
    if tracked is not None:
        bodies = [mean for k in usable if (mean := means[k]) is not None]
        position = np.array([body.position[0] for body in bodies])
        turned = [body.rotation[0] for body in bodies if body.rotation is not None]
        columns |= pose_columns(position, np.array(turned) if turned else None, prefix)
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


def _mean(time: FloatArray, body: Body, rest: Rest) -> Body | None:
    """What was seen during a rest, as one; None where nothing was."""
    rows = np.flatnonzero((time >= rest.begin) & (time <= rest.end) & body.observed)
    if not len(rows):
        return None
    during = body.take(rows)
    position = during.position.mean(axis=0)[None]
    if during.rotation is None:
        return Body(position)
    # The rotation nearest to all: that of the mean matrix.
    left, _, right = np.linalg.svd(during.rotation.mean(axis=0))
    return Body(position, (left @ right)[None])
