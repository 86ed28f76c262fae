"""A job's file written into another folder, so that it means the same files there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import yaml

from suta_calib.errors import JobError, OutputError, SamplesError
from suta_calib.measurements import YamlSection, read_yaml, write_text
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.measurements.files import expand
from suta_calib.terms import KINDS
from suta_calib.terms.given_pose import POSE_KEYS

# Values of these keys are names, also where a file is called alike.
_NAMES: Final = frozenset({"kind", "select", "tip", "base", "chain", "link", "label"})


def job_for_other_samples(job: Path, target: Path) -> Path:
    """Write a job as ``target``, beside which its samples are to be.

    Whatever else it names stays where it is.

    Returns:
        The new file.

    Raises:
        JobError: the job cannot be read.
        OutputError: the file cannot be written.
    """
    try:
        target.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"{target.parent}: not made: {error.strerror}") from error
    return _write(_with_paths(_read(job), job.parent, lambda pattern: pattern), target)


def job_so_far(job: Path, target: Path) -> Path | None:
    """A job of the rows that have samples now, without poses of places that have none.

    Returns:
        The job itself where all have some; ``target`` where some have none, written for it;
        None where no row to be fitted has any.

    Raises:
        JobError: the job cannot be read.
        OutputError: the file cannot be written.
    """
    written = _with_paths(
        _read(job), job.parent, lambda pattern: str(_absolute(job.parent / pattern))
    )
    groups = [group for group in ("observations", "validation") if group in written]
    rows = {
        group: [_of_places(row) for row in written[group] if _measured(row)] for group in groups
    }
    if not rows.get("observations"):
        return None
    if all(rows[group] == written[group] for group in groups):
        return job
    merged = {key: rows.get(key, part) for key, part in written.items()}
    return _write(
        {key: part for key, part in merged.items() if part or key != "validation"}, target
    )


def _read(job: Path) -> dict[str, Any]:
    content: dict[str, Any] = YamlSection(read_yaml(Path(job), JobError), JobError).data
    return content


def _write(content: Any, target: Path) -> Path:
    write_text(target, yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    return target


def _with_paths(content: Any, folder: Path, place: Callable[[str], str], key: str = "") -> Any:
    """The same with the names of files there are made absolute, and those of samples placed."""
    if isinstance(content, dict):
        return {name: _with_paths(part, folder, place, name) for name, part in content.items()}
    if isinstance(content, list):
        return [_with_paths(part, folder, place, key) for part in content]
    if not isinstance(content, str) or key in _NAMES:
        return content
    if key == "samples":
        return place(content)
    path = folder / content
    return str(_absolute(path)) if path.is_file() else content


def _absolute(path: Path) -> Path:
    """Without links being followed: a job may lie beside its files by one."""
    return path.absolute()


def _measured(row: Any) -> bool:
    """Whether files of samples are there that a row names."""
    try:
        _files(row)
    except SamplesError:
        return False
    return True


def _files(row: Any) -> list[Path]:
    patterns = row.get("samples", ())
    patterns = [patterns] if isinstance(patterns, str) else patterns
    return [file for pattern in patterns for file in expand(pattern, Path())]


def _of_places(row: Any) -> Any:
    """A row that states poses by label: of those places that its samples have."""
    kind, poses = KINDS.get(row.get("kind")), row.get("pose")
    if kind is None or not kind.place or not isinstance(poses, dict):
        return row
    if not {*POSE_KEYS.names}.isdisjoint(poses):
        return row
    there = set[str]()
    try:
        for file in _files(row):
            there.update(map(str, read_csv_table(file).labels(kind.place, "a label column")))
    except SamplesError:
        return row
    kept = {label: pose for label, pose in poses.items() if str(label) in there}
    rest = {key: part for key, part in row.items() if key != "pose"}
    return rest | ({"pose": kept} if kept else {})
