"""The job that a written calibration was made from."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from suta_calib.arm_keys import ArmSpec, read_arm
from suta_calib.errors import InputError, JobError
from suta_calib.job import inputs_copy
from suta_calib.job.inputs_copy import InputsCopy
from suta_calib.measurements.yaml_file import YamlSection, read_yaml

# Folders of copies that were unpacked: they are removed when the program ends, for an arm goes on
# to read its URDF.
_unpacked: Final[list[tempfile.TemporaryDirectory[str]]] = []


@dataclass(frozen=True)
class MadeFrom:
    """The job of a result.

    Attributes:
        path: its file, with all it names beside it: where it was, or unpacked from the copy in the
            results.
        named: its file as it was called when it ran.
        lacking: files that it names and that were too large for the copy, with their sizes, bytes,
            where they are not at their place any more.
    """

    path: Path
    named: Path
    lacking: Mapping[str, int]


def made_from(data: Mapping[str, Any], file: Path, otherwise: str) -> MadeFrom:
    """The job that a result was made from, with its files as they were then.

    Results of earlier versions have no copy of their inputs; then the job is where it was, or
    beside the results, if it is still what it was. A message says what may be given ``otherwise``.

    Raises:
        InputError: the result names no job, or the job is gone or was changed since; or the copy
            of its inputs is not of this result.
    """
    run = data.get("run")
    run = run if isinstance(run, dict) else {}
    inputs, hashes = run.get("inputs"), run.get("sha256")
    if not isinstance(inputs, dict) or not inputs:
        raise InputError(
            "no job from which it was made",
            "run.inputs, as suta-calib calibrate writes it",
            file=file,
            where="run",
            hint=f"give {otherwise}",
        )
    named = Path(next(iter(inputs)))
    written = hashes.get(inputs_copy.NAME) if isinstance(hashes, dict) else None
    archive = file.with_name(inputs_copy.NAME)
    if written is None or not archive.is_file():
        return MadeFrom(_in_place(inputs, file, otherwise), named, {})
    if hashlib.sha256(archive.read_bytes()).hexdigest() != written:
        raise InputError(
            "a copy of inputs that does not belong to this result",
            f"the {inputs_copy.NAME} that was written with {file.name}",
            file=archive,
            hint="copy the whole folder of results, or calibrate again",
        )
    copy = InputsCopy.read(archive)
    # Where they were, or where the job's folder was moved to with the results in it.
    for folder in (copy.folder, *list(file.resolve().parents)[1:4]):
        if copy.is_at(folder):
            return MadeFrom(folder / copy.job, named, {})
    place = tempfile.TemporaryDirectory(prefix="suta-calib-")
    _unpacked.append(place)
    return MadeFrom(copy.extract(Path(place.name)), named, copy.left_out)


def _in_place(inputs: Mapping[str, Any], file: Path, otherwise: str) -> Path:
    name, sha256 = next(iter(inputs.items()))
    places = [Path(name), *(up / Path(name).name for up in (file.parent.parent, file.parent))]
    there = [job for job in places if job.is_file()]
    for job in there:
        if hashlib.sha256(job.read_bytes()).hexdigest() == sha256:
            return job
    raise InputError(
        f"{there[0]}, which was changed since the calibration" if there else f"no job {name}",
        "the unchanged job from which it was made",
        file=file,
        where="run.inputs",
        hint=f"calibrate again, or give {otherwise}",
    )


def arm_of_job(origin: MadeFrom) -> ArmSpec:
    """The arm of a result's job; the samples may be gone."""
    return read_arm(YamlSection(read_yaml(origin.path, JobError), JobError))
