"""Studies of many jobs: how many sets are enough, how far each answer scatters or drifts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from suta_calib.analysis.study import DriftOptions, Request, drift_study, study_of_job
from suta_calib.analysis.study.trial import NAMES
from suta_calib.fleet.running import During, JobWork, Task, made_from, silently
from suta_calib.fleet.summary import JobResult
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.document import Document
from suta_calib.report.listing import Column
from suta_calib.report.study import drift_document, study_document


def _error_now(row: StudiedJob) -> str:
    return "–" if row.error_now is None else f"{row.error_now:.3g} {row.unit}".rstrip()


def _ratios(row: StudiedJob) -> str:
    return "" if row.ratios is None else "{:.2f} – {:.2f}".format(*row.ratios)


@dataclass(frozen=True)
class StudiedJob(JobResult):
    """What came of one study of many.

    Attributes:
        sets: how many the data have; 0 where the parameters drift.
        trials: of each size, or in all. Both are None without an answer.
        enough: how many sets are enough; None where the curve has not levelled off.
        error_now: mean error with the most sets, or that of the calibration; None if unknown.
        unit: of that error.
        ratios: smallest and largest spread over its prediction; None where there is none.
        days: after which the arm should be calibrated again; None where nothing drifts so far.
    """

    title: ClassVar[str] = "Studies"
    columns: ClassVar[tuple[Column[Any], ...]] = (
        Column("sets", "sets", form="d", optional=True),
        Column("trials", "trials", form="d"),
        Column("enough", "enough", form="d", optional=True),
        Column("error_now", "error", cell=_error_now, numeric=True),
        Column("unit"),
        Column("ratios", "spread / predicted", cell=_ratios, numeric=True, optional=True),
        Column("days", "again after, days", form=".0f", optional=True),
    )

    sets: int | None = None
    trials: int | None = None
    enough: int | None = None
    error_now: float | None = None
    unit: str = ""
    ratios: tuple[float, float] | None = None
    days: float | None = None

    def of_record(self, record: Mapping[str, Any], *, resumed: bool) -> StudiedJob:
        """The same with what the study's JSON says."""
        row = super().of_record(record, resumed=resumed)
        row = replace(row, trials=record["trials"], sets=record.get("sets", 0))
        if "interval_days" in record:
            return replace(row, days=record["interval_days"], error_now=record["now_mm"], unit="mm")
        if "sizes" in record:
            solved = [size for size in record["sizes"] if size["trials"] > size["failed"]]
            key = next((name for name in record["sizes"][0] if name.startswith("mean")), "mean")
            enough, last = record["recommended_size"], solved[-1] if solved else {}
            levelled = solved and enough != last["size"]
            row = replace(row, enough=enough if levelled else None)
            return replace(row, error_now=last.get(key), unit=key.removeprefix("mean_"))
        figures = [p.get("ratio") for p in record["parameters"].values()]
        ratios = [ratio for ratio in figures if ratio is not None]
        errors = record["validation"]
        key = next((name for name in errors if name.startswith("rms")), "rms")
        return replace(
            row,
            error_now=errors[key],
            unit=key.removeprefix("rms_"),
            ratios=(min(ratios), max(ratios)) if ratios else None,
        )

    @property
    def concern(self) -> float:
        """The largest error is looked at first."""
        return self.error_now or 0.0


@dataclass(frozen=True, kw_only=True)
class Study(JobWork):
    """What ``suta-calib study`` does to a job.

    Attributes:
        request: what is drawn, and how often.
        drift: what drifts, in place of that; None where nothing does.
        anyway: study a job whose answer must not be used, too.
    """

    row: ClassVar[type[JobResult]] = StudiedJob

    request: Request = field(default_factory=Request)
    drift: DriftOptions | None = None
    anyway: bool = False

    @property
    def record(self) -> str:
        """By the kind of study."""
        return "drift" if self.drift is not None else NAMES[self.request.kind]

    def read(self, path: Path) -> CalibrationJob:
        """The job."""
        return CalibrationJob.load(path)

    def document(self, job: CalibrationJob, task: Task, during: During = silently) -> Document:
        """The study; finished trials are kept beside it, for an interrupted one to go on."""
        if self.drift is not None:
            with during("walking") as progress:
                solution = job.usable_solution(anyway=self.anyway)
                walks = drift_study(solution, job.validation, self.drift, progress)
            return drift_document(walks).with_data(made_from=self._made_from(job))
        log = task.job.folder / self.request.log_name
        with during("calibrating") as progress:
            study = study_of_job(
                *(job, self.request, log),
                resume=task.resume,
                anyway=self.anyway,
                workers=self.processes,
                dask=task.dask,
                progress=progress,
            )
        return study_document(study).with_data(made_from=self._made_from(job))

    def is_of(self, record: Mapping[str, Any], job: CalibrationJob, folder: Path) -> bool:
        """Whether it was made from the same."""
        del folder
        return bool(record["made_from"] == self._made_from(job))

    def _made_from(self, job: CalibrationJob) -> dict[str, Any]:
        asked = self.request if self.drift is None else self.drift
        return made_from({**asdict(asked), "anyway": self.anyway}, job.files)
