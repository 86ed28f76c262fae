"""A calibration that was written to files, with the samples of the job it was made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from suta_calib.assessment import read_assessment
from suta_calib.errors import InputError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.tracking.provenance import made_from
from suta_calib.tracking.uncertainty import numbers, read_json_object, read_uncertainty
from suta_calib.trust.accuracy import fit_own
from suta_calib.units import from_mm
from suta_calib.view.calibrated import Calibrated, term_sets


def read_calibrated(path: Path, *, anyway: bool = False) -> Calibrated:
    """Read a result, and the job that it says it was made from.

    Args:
        path: ``result.json``, or its folder.
        anyway: take one that says of itself that it must not be used.

    Raises:
        InputError: no such result; not converged, or not to be used; or its job is not found, or
            has changed since.
    """
    file = path / "result.json" if path.is_dir() else path
    data = read_json_object(file)
    if "parameters" not in data:
        kind = "a result that is not a calibration of an arm"
        expected = "the result of suta-calib calibrate"
        raise InputError(
            kind, expected, file=file, hint="the report in the same folder has its pictures"
        )
    job = load_job(data, file)
    calibration = read_uncertainty(file, job.arm, anyway=anyway)
    values = {
        name: float(numbers(entry.get("value"), (), file, name))
        for name, entry in data["parameters"].items()
    }
    of_terms = (p.name for term in job.observations for p in term.own_parameters)
    if lacking := next((name for name in (*job.parameters, *of_terms) if name not in values), None):
        raise InputError(
            f"no value of {lacking}",
            f"a value of every unknown of {job.spec.path}",
            file=file,
            where="parameters",
            hint="calibrate again",
        )
    held_out = fit_own(job.validation, job.parameters, values) if job.validation else {}
    return Calibrated(
        str(job.spec.path),
        job.arm,
        values,
        calibration.names,
        calibration.covariance,
        term_sets(job.observations, job.validation, values, held_out),
        _rms(data, file),
        read_assessment(data),
    )


def is_result(path: Path) -> bool:
    """Whether a path is that of a result, or of its folder, and not of a job."""
    return path.is_dir() or path.suffix.lower() == ".json"


def job_of(path: Path) -> CalibrationJob:
    """A job, or that of a result.

    Raises:
        InputError: it cannot be read, or as of `load_job`.
    """
    if not is_result(path):
        return CalibrationJob.load(path)
    file = path / "result.json" if path.is_dir() else path
    return load_job(read_json_object(file), file)


def load_job(data: Mapping[str, Any], file: Path) -> CalibrationJob:
    """The job of a result with all it was made of, by the name that it had when it ran.

    Raises:
        InputError: as `provenance`; or measurements were too large to be copied and are gone.
    """
    origin = made_from(data, file, "the job itself")
    if origin.lacking:
        name, size = next(iter(origin.lacking.items()))
        raise InputError(
            f"no {name}. It was too large ({size >> 20} MB) to be copied into the results",
            f"this file, unchanged, next to the job {origin.named}",
            file=file,
            hint="put the files back, or calibrate again",
        )
    job = CalibrationJob.load(origin.path)
    return replace(job, spec=replace(job.spec, path=origin.named))


def _rms(data: Mapping[str, Any], file: Path) -> dict[str, tuple[float, float]]:
    """By set, before and after, m."""
    metrics = data.get("metrics")
    by_set = {}
    for name, both in metrics.items() if isinstance(metrics, dict) else ():
        entries = [both.get(when) for when in ("before", "after")] if isinstance(both, dict) else []
        rms = [e["rms_mm"] for e in entries if isinstance(e, dict) and "rms_mm" in e]
        if len(rms) == 2:
            before, after = (float(numbers(value, (), file, f"metrics.{name}")) for value in rms)
            by_set[name] = (from_mm(before), from_mm(after))
    return by_set
