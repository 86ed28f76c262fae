"""Files of the JHU CIS stereotactic navigation problem, read by their common prefix.

Johns Hopkins University, 600.455/655 Computer Integrated Surgery, programming assignments 1 and 2.
A file is a header of counts and the file's own name, separated by commas, then one point a row,
``x, y, z`` in mm with two decimals. Points are in m inside this package.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Self

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import extent
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.files import read_text
from suta_calib.measurements.pose_files import OTHER_UNIT
from suta_calib.units import from_mm, mm

# Both spellings are in circulation.
EM_FIDUCIALS: Final = ("em-fiducials", "em-fiducialss")
_COUNT: Final = re.compile(r"[0-9]{1,9}")
Counts = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class CalibrationMarkers:
    """Where the markers are, m; as seen (N_frames, …), in the tracker that sees them.

    Attributes:
        base: (N_D, 3) optical markers on the EM tracker's base, in the EM tracker.
        optical: (N_A, 3) optical markers on the calibration object, in it.
        em: (N_C, 3) EM markers on the calibration object, in it.
    """

    base: FloatArray
    optical: FloatArray
    em: FloatArray


@dataclass(frozen=True, eq=False)
class OpticalPivot:
    """An optical probe turned about its tip: markers (N_frames, …, 3) in the optical tracker, m."""

    base: FloatArray
    probe: FloatArray


@dataclass(frozen=True, eq=False)
class Output1:
    """What the first assignment asks for.

    Attributes:
        em_post: (3,) post by the EM probe, in the EM tracker, m.
        optical_post: (3,) post by the optical probe, in the EM tracker, m.
        expected: (N_frames, N_C, 3) where the EM markers should have been seen, m.
    """

    em_post: FloatArray
    optical_post: FloatArray
    expected: FloatArray


def read_calibration_body(path: Path) -> CalibrationMarkers:
    """``-calbody.txt``: header ``N_D, N_A, N_C, name``, then the points in that order."""
    counts, points = _read(path, ("N_D", "N_A", "N_C"), sum)
    return CalibrationMarkers(*_split(points, counts))


def read_calibration_readings(path: Path) -> CalibrationMarkers:
    """``-calreadings.txt``: header ``N_D, N_A, N_C, N_frames, name``, then frame by frame."""
    (*counts, frames), points = _read(path, ("N_D", "N_A", "N_C", "N_frames"), _by_frame)
    return CalibrationMarkers(*_split(points.reshape(frames, -1, 3), counts))


def read_optical_pivot(path: Path) -> OpticalPivot:
    """``-optpivot.txt``: header ``N_D, N_H, N_frames, name``, then frame by frame."""
    (*counts, frames), points = _read(path, ("N_D", "N_H", "N_frames"), _by_frame)
    return OpticalPivot(*_split(points.reshape(frames, -1, 3), counts))


def read_em_frames(path: Path) -> FloatArray:
    """``-empivot.txt``, ``-em-fiducials.txt``, ``-EM-nav.txt``: header ``N_G, N_frames, name``.

    Returns:
        (N_frames, N_G, 3) markers of the EM probe in the EM tracker, m.
    """
    (_, frames), points = _read(path, ("N_G", "N_frames"), math.prod)
    return points.reshape(frames, -1, 3)


def read_points(path: Path) -> FloatArray:
    """``-ct-fiducials.txt``, ``-output2.txt``: header ``N, name``; (N, 3) points in CT, m."""
    return _read(path, ("N",), sum)[1]


def read_output1(path: Path) -> Output1:
    """``-output1.txt``: header ``N_C, N_frames, name``; the posts, then frame by frame."""
    (_, frames), points = _read(path, ("N_C", "N_frames"), lambda n: math.prod(n) + 2)
    return Output1(points[0], points[1], points[2:].reshape(frames, -1, 3))


def output1_text(output: Output1, name: str) -> str:
    """``-output1.txt``, whose own name its header ends with."""
    frames, markers = output.expected.shape[:2]
    posts = np.stack([output.em_post, output.optical_post])
    return points_text((markers, frames), name, posts, output.expected)


def points_text(counts: Counts, name: str, *points: FloatArray) -> str:
    """A header that begins with counts and ends with the file's name; a row for every point, m."""
    rows = mm(np.concatenate([p.reshape(-1, 3) for p in points]))
    # Adding zero takes the sign off what was rounded to −0.00.
    rounded = np.round(rows, 2) + 0.0
    lines = [", ".join(f"{value:8.2f}" for value in row) for row in rounded]
    return "\n".join([", ".join([*map(str, counts), name]), *lines]) + "\n"


@dataclass(frozen=True, eq=False)
class NavigationData:
    """Data of the second assignment: fiducials in CT and by the EM probe, and navigation frames.

    Attributes:
        ct_fiducials: (N_B, 3) in CT, m.
        em_fiducials: (N_B, N_G, 3) EM probe's markers while its tip is in each fiducial, m.
        em_nav: (N_frames, N_G, 3) EM probe's markers while navigating, m.
    """

    ct_fiducials: FloatArray
    em_fiducials: FloatArray
    em_nav: FloatArray


@dataclass(frozen=True, eq=False)
class StereotacticData(Displayable):
    """The given files.

    Attributes:
        prefix: what the paths of all files begin with.
        body: markers on the calibration object and on the EM tracker's base.
        readings: the same as seen by both trackers.
        em_pivot: (N_frames, N_G, 3) EM probe turned about its tip, in the EM tracker, m.
        optical_pivot: the optical probe turned about its tip.
        navigation: of the second assignment, if asked for and there.
    """

    prefix: Path
    body: CalibrationMarkers
    readings: CalibrationMarkers
    em_pivot: FloatArray
    optical_pivot: OpticalPivot
    navigation: NavigationData | None = None

    @property
    def name(self) -> str:
        """What the names of all files begin with."""
        return self.prefix.name

    @property
    def em_uses(self) -> dict[str, FloatArray]:
        """Markers (N_frames, N_G, 3) of the EM probe as read, by what they are for, m."""
        given = self.navigation
        nav = {} if given is None else {"em_fiducials": given.em_fiducials, "em_nav": given.em_nav}
        return {"em_pivot": self.em_pivot, **nav}

    @classmethod
    def read(cls, prefix: str | Path, *, navigation: bool = False) -> Self:
        """Read the files whose names begin with ``prefix``, and check that they fit together.

        Args:
            prefix: such as ``data/pa1-debug-a`` for ``data/pa1-debug-a-calbody.txt``.
            navigation: also the second assignment's three files, if all of them are there.

        Raises:
            SamplesError: a file is missing, malformed, or its counts differ from another file's.

        Warns:
            UserWarning: only some of the second assignment's files are there: they are not read.
        """
        calbody = path_of(prefix, "calbody")
        if not calbody.is_file():
            raise SamplesError(
                "no such file",
                "a file that exists",
                file=calbody,
                hint="PREFIX is the part of the name before -calbody.txt",
            )
        body = read_calibration_body(calbody)
        path = path_of(prefix, "calreadings")
        readings = read_calibration_readings(path)
        for name, part in (("N_D", "base"), ("N_A", "optical"), ("N_C", "em")):
            observed, expected = getattr(readings, part), getattr(body, part)
            agree(path, name, observed.shape[1], "markers", len(expected), calbody)
            same_size(path, observed, calbody, expected)
        em_pivot = read_em_frames(path_of(prefix, "empivot"))
        path = path_of(prefix, "optpivot")
        optical_pivot = read_optical_pivot(path)
        agree(path, "N_D", optical_pivot.base.shape[1], "markers", len(body.base), calbody)
        same_size(path, optical_pivot.base, calbody, body.base)
        data = cls(Path(prefix), body, readings, em_pivot, optical_pivot)
        return data._with_navigation(prefix) if navigation else data

    def _with_navigation(self, prefix: str | Path) -> Self:
        spellings = [path_of(prefix, kind) for kind in EM_FIDUCIALS]
        em_path = next(filter(os.path.lexists, spellings), spellings[0])
        paths = path_of(prefix, "ct-fiducials"), em_path, path_of(prefix, "EM-nav")
        if missing := [str(path) for path in paths if not os.path.lexists(path)]:
            if len(missing) < len(paths):
                warnings.warn(f"no navigation: there is no {', no '.join(missing)}", stacklevel=2)
            return self
        ct_path, _, nav_path = paths
        ct, fiducials, nav = read_points(ct_path), read_em_frames(em_path), read_em_frames(nav_path)
        agree(em_path, "N_frames", len(fiducials), "fiducials", len(ct), ct_path)
        markers, pivot = self.em_pivot.shape[1], path_of(prefix, "empivot")
        agree(em_path, "N_G", fiducials.shape[1], "markers", markers, pivot)
        agree(nav_path, "N_G", nav.shape[1], "markers", markers, pivot)
        for path, frames in ((em_path, fiducials), (nav_path, nav)):
            same_size(path, frames, pivot, self.em_pivot)
        return replace(self, navigation=NavigationData(ct, fiducials, nav))


def path_of(prefix: str | Path, kind: str) -> Path:
    """The file of one kind, such as ``calbody``."""
    return Path(f"{prefix}-{kind}.txt")


def agree(path: Path, name: str, count: int, what: str, expected: int, other: Path) -> None:
    """Refuse a file whose header gives another count (``name``) than there is in another file."""
    if count != expected:
        problem = f"{expected}: {other.name} has {expected} {what}"
        raise SamplesError(str(count), problem, file=path, line=1, where=name)


def same_size(path: Path, points: FloatArray, other: Path, expected: FloatArray) -> None:
    """Refuse a file in which a rigid body (..., n, 3) has the size of another unit."""
    size, expected_size = (
        extent(body.reshape(-1, *body.shape[-2:])[0]) for body in (points, expected)
    )
    ratio = size / expected_size if expected_size > 0 else 1.0
    if OTHER_UNIT[0] < max(ratio, 1 / ratio if ratio else 1.0) < OTHER_UNIT[1]:
        raise SamplesError(
            f"markers {ratio:.4g} times as far apart as those of the same body in {other}",
            "the same distances in both files, in mm",
            file=path,
            hint="one of the files is in another unit",
        )


def _by_frame(counts: Counts) -> int:
    return sum(counts[:-1]) * counts[-1]


def _split(points: FloatArray, counts: Counts | list[int]) -> list[FloatArray]:
    """Points of one frame, or of all, by the cloud they belong to."""
    return np.split(points, np.cumsum(counts)[:-1], axis=-2)


def _read(
    path: Path, names: tuple[str, ...], expected: Callable[[Counts], int]
) -> tuple[Counts, FloatArray]:
    """Counts of the header, and the ``expected(counts)`` points (rows, 3), m, below it."""
    # Not splitlines(): it also breaks at form feeds, and line numbers must be an editor's.
    layout = f"'{', '.join((*names, 'name'))}'"
    lines = re.split(r"\r\n|\r|\n", read_text(path, SamplesError).rstrip())
    if lines == [""]:
        raise SamplesError("an empty file", f"a header {layout} and points", file=path)
    header, *rows = lines
    cells = [cell.strip() for cell in header.split(",", len(names))]
    if len(cells) <= len(names):
        raise SamplesError(
            f"the header {header[:60]!r}", f"{layout}, separated by commas", file=path, line=1
        )
    for name, cell in zip(names, cells[:-1], strict=True):
        if not _COUNT.fullmatch(cell) or int(cell) == 0:
            raise SamplesError(
                repr(cell[:40]), "a whole number from 1", file=path, line=1, where=name
            )
    counts = tuple(map(int, cells[:-1]))
    row_count = expected(counts)
    points = [[number_in(cell) for cell in row.split(",")] for row in rows]
    for line, values in enumerate(points[:row_count], 2):
        # mm; beyond this it is no position of a marker, and its square must stay a number.
        if len(values) != 3 or not all(abs(value) <= 1e9 for value in values):
            cut = line == len(lines) and len(values) < 3
            raise SamplesError(
                repr(rows[line - 2][:60]),
                "three numbers x, y, z in mm",
                file=path,
                line=line,
                hint="the file ends in the middle of a row" if cut else "",
            )
    if len(rows) != row_count:
        counts_text = ", ".join(map("{} = {}".format, names, counts))
        raise SamplesError(
            f"{len(rows)} rows of points",
            f"{row_count}, as the header states {counts_text}",
            file=path,
            line=min(len(rows), row_count) + 2,
            hint="the file was cut off" if len(rows) < row_count else "delete the surplus rows",
        )
    return counts, from_mm(np.array(points))
