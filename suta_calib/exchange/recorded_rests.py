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
from suta_calib.exchange.bodies import Body
from suta_calib.exchange.imported import ImportedRows, pose_columns
from suta_calib.exchange.option import Given, Option
from suta_calib.measurements.csv_table import number_in

SECONDS: Final = Option("seconds", "How long a rest is at least, s; it is averaged.", "N")
_USUAL: Final = "1"


@dataclass(frozen=True, eq=False)
class RecordedPicture:
    """A picture as a file.

    Attributes:
        suffix: of the file.
        data: its bytes.
    """

    suffix: str
    data: bytes


@dataclass(frozen=True, eq=False)
class Rest:
    """A time in which the arm rested.

    Attributes:
        angles: (n,) mean reading of each joint, rad.
        begin: of the time that was averaged, s.
        end: of it.
    """

    angles: FloatArray
    begin: float
    end: float


def rests_of(
    joints: Sequence[str], time: FloatArray, angles: FloatArray, seconds: float
) -> list[Rest]:
    """The rests in a recording, as ``measure`` finds and averages them.

    Args:
        joints: names.
        time: (n,) s, that increases.
        angles: (n, joints), rad.
        seconds: that a rest lasts at least.
    """
    finder, rests = StopFinder(joints, seconds), list[Rest]()
    fine = np.zeros(len(joints), dtype=np.bool_)
    for k, (at, row) in enumerate(zip(time.tolist(), angles, strict=True)):
        for event in finder.feed([Reading(k, at, row, fine, fine, at)]):
            if isinstance(event, Complete):
                begin = at - event.average.seconds
                rests.append(Rest(event.average.angles, begin, at))
    return rests


def seconds_of(given: Given) -> float:
    """How long a rest is at least, s.

    Raises:
        InputError: no positive number.
    """
    seconds = number_in(given.text(SECONDS, _USUAL))
    longest = 3600.0
    if not 0.0 < seconds < longest:
        raise given.refuse(SECONDS, repr(given.text(SECONDS)), "a number of seconds above 0")
    return seconds


def found_rests(
    path: Path, joints: Sequence[str], time: FloatArray, angles: FloatArray, given: Given
) -> list[Rest]:
    """The rests in a recording, at least one.

    Args:
        path: of the recording.
        joints: names.
        time: (n,) s, in any order.
        angles: (n, joints), rad.
        given: `SECONDS`.

    Raises:
        ForeignFileError: nowhere did the arm rest for so long.
    """
    seconds = seconds_of(given)
    order = np.argsort(time, kind="stable")
    rests = rests_of(joints, time[order], angles[order], seconds)
    if not rests:
        raise ForeignFileError(
            f"{len(time)} readings in {np.ptp(time):.1f} s, and no rest of {seconds:g} s",
            "an arm that stands still at every pose",
            file=path,
            hint=f"a shorter one is found with {SECONDS.switch} N",
        )
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

    A rest in which nothing was seen, or no picture was taken, is left out.

    Args:
        path: of the recording.
        form: name of its format.
        joints: names.
        rests: `found_rests`.
        tracked: what was seen of the arm, (m,) s and m rows.
        prefix: in front of the pose's columns.
        pictures: of each rest.

    Raises:
        ForeignFileError: nothing was seen, or no picture was taken, during any rest.
    """
    means = [None if tracked is None else _mean(*tracked, rest) for rest in rests]
    usable = [k for k in range(len(rests)) if tracked is None or means[k] is not None]
    if not usable:
        problem = f"{len(rests)} rests, and no pose during any of them"
        raise ForeignFileError(problem, "poses by the same clock", file=path)
    if pictures is not None:
        usable = [k for k in usable if pictures[k] is not None]
        if not usable:
            problem = f"{len(rests)} rests, and no picture during any of them"
            raise ForeignFileError(problem, "pictures by the same clock", file=path)
    columns, files = dict[str, NDArray[Any]](), dict[str, bytes]()
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
    of_joints: Mapping[str, NDArray[Any]] = dict(zip(joints, readings.T, strict=True))
    return ImportedRows(
        source=path,
        form=form,
        columns={**of_joints, **columns, "time": np.array([rests[k].end for k in usable])},
        dropped=len(rests) - len(usable),
        remarks=("Each row is the mean over a rest.",),
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
