"""The job that a written calibration was made from."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from suta_calib.errors import InputError


def job_of(data: Mapping[str, Any], file: Path, otherwise: str) -> Path:
    """The job's file, where it was or beside the results, if it is still what it was.

    Args:
        data: of ``result.json``.
        file: it came from.
        otherwise: what else may be given in the job's place, for the message's hint.

    Raises:
        InputError: the result names no job, or the job is gone or was changed since.
    """
    run = data.get("run")
    inputs = run.get("inputs") if isinstance(run, dict) else None
    if not isinstance(inputs, dict) or not inputs:
        raise InputError(
            "no job that it was made from",
            "run.inputs, as suta-calib calibrate writes it",
            file=file,
            where="run",
            hint=f"give {otherwise}",
        )
    name, sha256 = next(iter(inputs.items()))
    places = [Path(name), *(up / Path(name).name for up in (file.parent.parent, file.parent))]
    there = [job for job in places if job.is_file()]
    for job in there:
        if hashlib.sha256(job.read_bytes()).hexdigest() == sha256:
            return job
    raise InputError(
        f"{there[0]}, which was changed since" if there else f"no job {name}",
        "the job that it was made from, as it was",
        file=file,
        where="run.inputs",
        hint=f"calibrate again, or give {otherwise}",
    )
