"""Which jobs a fleet has, what each is called, and where its results are written."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from glob import glob, has_magic
from pathlib import Path

from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.report.files import results_for, results_of_its_own


@dataclass(frozen=True)
class FleetJob(Displayable):
    """One job of many.

    Attributes:
        name: in the summary: its folder below the one that all jobs share.
        path: of the ``calibration.yaml``, as it was given.
        folder: where its results are written.
    """

    name: str
    path: Path
    folder: Path


def with_patterns_read(paths: Sequence[Path]) -> list[Path]:
    """Patterns such as ``robots/*/calibration.yaml`` become the files that match them."""
    found = list[Path]()
    for path in paths:
        is_pattern = has_magic(str(path)) and not path.exists()
        # Not `Path.glob`, which takes no absolute pattern.
        matches = sorted(glob(str(path))) if is_pattern else []  # noqa: PTH207
        # What matches nothing is a job that is not there, and is named as such.
        found += map(Path, matches) if matches else [path]
    return found


def common_folder(paths: Sequence[Path]) -> Path:
    """The folder below which all jobs stand.

    Raises:
        InputError: they are on several drives.
    """
    folders = [os.path.abspath(path.parent) for path in paths]  # noqa: PTH100 (links are kept)
    try:
        common = os.path.commonpath(folders)
    except ValueError:
        raise InputError(
            "jobs on several drives", "jobs that share a folder", hint="run a command for each"
        ) from None
    relative = os.path.relpath(common)
    return Path(common if relative.startswith("..") else relative)


def fleet_jobs(paths: Sequence[Path], out: Path | None = None) -> list[FleetJob]:
    """The jobs with their names and their folders of results; one that is named twice comes once.

    Args:
        paths: of the jobs.
        out: folder below which every job has a folder of its name; by default the results of each
            stand where they would if it was the only one.

    Raises:
        InputError: the jobs are on several drives.
    """
    once = dict[str, Path]()
    for path in paths:
        once.setdefault(os.path.realpath(path), path)
    each = list(once.values())
    common = os.path.abspath(common_folder(each))  # noqa: PTH100
    folders = [os.path.abspath(path.parent) for path in each]  # noqa: PTH100
    count = Counter(folders)
    jobs, taken = list[FleetJob](), set[str]()
    for path, folder in zip(each, folders, strict=True):
        below = Path(os.path.relpath(folder, common))
        name = below if count[folder] == 1 else below / path.name
        named = name.as_posix() if name.parts else Path(folder).name or path.stem
        place = results_for(path) if out is None else out / named
        if out is None and os.path.realpath(place) in taken:
            place = results_of_its_own(path)
        if os.path.realpath(place) in taken:
            place = place.with_name(f"results-{path.name}")
        taken.add(os.path.realpath(place))
        jobs.append(FleetJob(named, path, place))
    return jobs
