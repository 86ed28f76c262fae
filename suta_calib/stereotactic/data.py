"""Everything a stereotactic navigation problem consists of, read by the files' common prefix."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Self

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.stereotactic.cis_files import (
    CalibrationBody,
    CalibrationReadings,
    OpticalPivot,
    read_calibration_body,
    read_calibration_readings,
    read_em_frames,
    read_optical_pivot,
    read_points,
)

# Both spellings are in circulation.
EM_FIDUCIALS: Final = ("em-fiducials", "em-fiducialss")


@dataclass(frozen=True, eq=False)
class NavigationData:
    """The second assignment: fiducials in CT and by the EM probe, and where the probe went.

    Attributes:
        ct_fiducials: (N_B, 3) in CT, m.
        em_fiducials: (N_B, N_G, 3) EM probe's markers while its tip is in each fiducial, m.
        em_nav: (N_frames, N_G, 3) EM probe's markers while navigating, m.
    """

    ct_fiducials: FloatArray
    em_fiducials: FloatArray
    em_nav: FloatArray


@dataclass(frozen=True, eq=False)
class StereotacticData:
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
    body: CalibrationBody
    readings: CalibrationReadings
    em_pivot: FloatArray
    optical_pivot: OpticalPivot
    navigation: NavigationData | None = None

    @property
    def name(self) -> str:
        """What the names of all files begin with."""
        return self.prefix.name

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
                hint="PREFIX is what stands before -calbody.txt",
            )
        body = read_calibration_body(calbody)
        path = path_of(prefix, "calreadings")
        readings = read_calibration_readings(path)
        for name, part in (("N_D", "base"), ("N_A", "optical"), ("N_C", "em")):
            found, expected = getattr(readings, part).shape[1], len(getattr(body, part))
            agree(path, name, found, "markers", expected, calbody)
        em_pivot = read_em_frames(path_of(prefix, "empivot"))
        path = path_of(prefix, "optpivot")
        optical_pivot = read_optical_pivot(path)
        agree(path, "N_D", optical_pivot.base.shape[1], "markers", len(body.base), calbody)
        data = cls(Path(prefix), body, readings, em_pivot, optical_pivot)
        return data._with_navigation(prefix) if navigation else data

    def _with_navigation(self, prefix: str | Path) -> Self:
        ct_path, nav_path = path_of(prefix, "ct-fiducials"), path_of(prefix, "EM-nav")
        spellings = [path_of(prefix, kind) for kind in EM_FIDUCIALS]
        em_path = next(filter(os.path.lexists, spellings), spellings[0])
        paths = (ct_path, em_path, nav_path)
        if missing := [str(path) for path in paths if not os.path.lexists(path)]:
            if len(missing) < len(paths):
                warnings.warn(f"no navigation: there is no {', no '.join(missing)}", stacklevel=2)
            return self
        ct, fiducials, nav = read_points(ct_path), read_em_frames(em_path), read_em_frames(nav_path)
        agree(em_path, "N_frames", len(fiducials), "fiducials", len(ct), ct_path)
        markers, pivot = self.em_pivot.shape[1], path_of(prefix, "empivot")
        agree(em_path, "N_G", fiducials.shape[1], "markers", markers, pivot)
        agree(nav_path, "N_G", nav.shape[1], "markers", markers, pivot)
        return replace(self, navigation=NavigationData(ct, fiducials, nav))


def path_of(prefix: str | Path, kind: str) -> Path:
    """The file of one kind, such as ``calbody``."""
    return Path(f"{prefix}-{kind}.txt")


def agree(path: Path, name: str, found: int, what: str, expected: int, other: Path) -> None:
    """Refuse a file whose header gives another count than there is in another file.

    Args:
        path: the file.
        name: of the count in its header.
        found: what it says.
        what: is counted, as a reader is told.
        expected: the other file's count.
        other: the other file.

    Raises:
        SamplesError: the counts differ.
    """
    if found != expected:
        raise SamplesError(
            str(found),
            f"{expected}: {other.name} has {expected} {what}",
            file=path,
            line=1,
            where=name,
        )
