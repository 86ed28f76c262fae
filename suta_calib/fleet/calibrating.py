"""Calibrations of many arms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar, Final

from suta_calib.fleet.running import During, JobWork, Task, silently
from suta_calib.fleet.summary import JobResult
from suta_calib.job import inputs_copy
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.calibration import calibration_document, versions
from suta_calib.report.document import Document
from suta_calib.report.listing import Column

# States in which a parameter has a value of its own.
_ESTIMATED: Final = ("identified", "prior", "at_bound")


def _rms(which: str) -> Column[Any]:
    def cell(result: CalibratedJob) -> str:
        value = getattr(result, which)
        return "–" if value is None else f"{value:.3g} {result.unit}"

    return Column(which, which.removeprefix("rms_"), cell=cell, numeric=True)


@dataclass(frozen=True)
class CalibratedJob(JobResult):
    """What came of one calibration of many.

    Attributes:
        data: what the errors are of: ``validation``, or ``calibration`` if nothing is held out.
        unit: of the errors, as in ``result.json``: mm, deg or px.
        rms_before: of these errors with the nominal arm; None where there is no value.
        rms_after: the same with the calibrated arm.
        count: of these errors.
        estimated: how many parameters have a value.
        unidentified: how many the data cannot determine. These three are None without an answer.
    """

    title: ClassVar[str] = "Jobs, with the RMS of their errors"
    columns: ClassVar[tuple[Column[Any], ...]] = (
        _rms("rms_before"),
        _rms("rms_after"),
        Column("unit"),
        Column("data", "of"),
        Column("count"),
        Column("estimated", "estimated", form="d"),
        Column("unidentified"),
    )

    data: str = ""
    unit: str = ""
    rms_before: float | None = None
    rms_after: float | None = None
    count: int | None = None
    estimated: int | None = None
    unidentified: int | None = None

    def of_record(self, record: Mapping[str, Any], *, resumed: bool) -> CalibratedJob:
        """The same with what ``result.json`` says."""
        metrics = record.get("metrics") or {}
        data = "validation" if (metrics.get("validation") or {}).get("by_term") else "calibration"
        figures = metrics.get(data) or {}
        before, after = (figures.get(which) or {} for which in ("before", "after"))
        key = next((name for name in before if name.startswith("rms_")), "")
        states = [p["state"] for p in (record.get("parameters") or {}).values()]
        return replace(
            super().of_record(record, resumed=resumed),
            data=data,
            unit=key.removeprefix("rms_"),
            rms_before=before.get(key),
            rms_after=after.get(key),
            count=int(before.get("count") or 0),
            estimated=sum(state in _ESTIMATED for state in states),
            unidentified=len(record.get("unidentified") or ()),
        )


@dataclass(frozen=True, kw_only=True)
class Calibrate(JobWork):
    """What ``suta-calib calibrate`` does to a job."""

    row: ClassVar[type[JobResult]] = CalibratedJob

    @property
    def record(self) -> str:
        """It is the job's result."""
        return "result"

    @property
    def summary(self) -> str:
        """The one that has no other name."""
        return "summary"

    def read(self, path: Path) -> CalibrationJob:
        """The job."""
        return CalibrationJob.load(path)

    def document(self, job: CalibrationJob, task: Task, during: During = silently) -> Document:
        """The calibration."""
        del task
        with during("solving") as progress:
            return calibration_document(job.run(progress))

    def is_of(self, record: Mapping[str, Any], job: CalibrationJob, folder: Path) -> bool:
        """Whether ``inputs.zip`` is of the same files.

        A result that did not converge has no such copy, and of large files the copy has the sizes
        alone: that these are the same cannot be told.
        """
        now = sha256(inputs_copy.packed(job.spec.path, job.files)).hexdigest()
        return (
            record["versions"] == versions()
            and record["run"]["sha256"][inputs_copy.NAME] == now
            and not inputs_copy.InputsCopy.read(folder / inputs_copy.NAME).left_out
        )
