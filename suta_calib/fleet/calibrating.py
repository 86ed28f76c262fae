"""One job of many in a worker process: what `suta-calib calibrate` does, and never an exception."""

from __future__ import annotations

import json
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any, Final, TypeVar

from suta_calib.atomic import inputs_kept, note_input, recover
from suta_calib.errors import SutaCalibError
from suta_calib.exchange.result import content_digest
from suta_calib.fleet.jobs import FleetJob, fleet_jobs
from suta_calib.fleet.summary import FleetSummary, JobResult
from suta_calib.fleet.workers import Crash, work_through
from suta_calib.job import inputs_copy
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.calibration import calibration_document, versions
from suta_calib.report.files import REPORT, run_record, write_document

Progress = Callable[[int, int], None]
T = TypeVar("T")
RECORD: Final = "result.json"


def calibrate_jobs(
    paths: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    workers: int = 1,
    dask: str | None = None,
    resume: bool = False,
    report: bool = False,
    progress: Progress | None = None,
) -> FleetSummary:
    """Calibrate many jobs, and write the results of each as if it was the only one.

    A job that cannot be read, that fails, or that ends its worker process stops no other.

    Args:
        paths: of the jobs (``calibration.yaml``).
        out: folder below which every job has a folder of results; by default the results of each
            stand beside it.
        workers: processes on this computer.
        dask: address of a Dask cluster that works in their place; its workers must see the files
            under the same paths.
        resume: take the results that are there, if they are whole and the job, every file that it
            reads and the versions of the packages did not change.
        report: whether ``report.html`` is written too, which takes longer than to calibrate.
        progress: called with (jobs done, jobs).

    Returns:
        What came of each job, in the order in which they were given.

    Raises:
        InputError: jobs on several drives, or no cluster at that address.
    """
    began = perf_counter()
    jobs = fleet_jobs([Path(path) for path in paths], None if out is None else Path(out))
    if dask is not None:
        # Workers there start in another folder.
        jobs = [replace(j, path=j.path.absolute(), folder=j.folder.absolute()) for j in jobs]
    tasks = [Task(job, report=report, resume=resume) for job in jobs]
    results: list[JobResult | None] = [None] * len(jobs)
    for done, (number, answer) in enumerate(
        work_through(calibrated, tasks, workers=workers, dask=dask), start=1
    ):
        job = jobs[number]
        results[number] = _crashed(job, answer) if isinstance(answer, Crash) else answer
        if progress is not None:
            progress(done, len(jobs))
    complete = tuple(result for result in results if result is not None)
    return FleetSummary(complete, perf_counter() - began, len(paths) - len(jobs))


def _crashed(job: FleetJob, crash: Crash) -> JobResult:
    error = (
        f"{job.path}: found that the worker process ended twice ({crash.reason}); expected enough "
        "memory for this job; give fewer rows, or use a larger computer"
    )
    return JobResult(job.name, str(job.path), str(job.folder), error=error)


@dataclass(frozen=True)
class Task:
    """What a worker is given.

    Attributes:
        job: to calibrate.
        report: whether a page is written.
        resume: whether a whole result that is there is taken.
    """

    job: FleetJob
    report: bool = False
    resume: bool = False


def calibrated(task: Task) -> JobResult:
    """Calibrate one job and write its results; what goes wrong is in the answer."""
    job, began = task.job, perf_counter()
    row = JobResult(job.name, str(job.path), str(job.folder))
    with warnings.catch_warnings(record=True) as said:
        try:
            record, resumed = _record(task)
            row = row.of_record(record, resumed=resumed)
        except SutaCalibError as error:
            row = replace(row, error=_one_line(error))
        except MemoryError as error:
            row = replace(row, error=f"{job.path}: found too little memory ({_one_line(error)})")
        except OSError as error:
            name = error.filename or job.path
            row = replace(row, error=f"{name}: {error.strerror or _one_line(error)}")
        except Exception as error:  # noqa: BLE001 (a fault that one job meets stops no other)
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            row = replace(
                row,
                error=f"{job.path}: {type(error).__name__} at {where}: {_one_line(error)}. This is "
                "a fault of suta_calib: please report it",
            )
    heard = tuple(_one_line(warning.message) for warning in said)
    return replace(row, warnings=heard, seconds=perf_counter() - began)


def _record(task: Task) -> tuple[dict[str, Any], bool]:
    """The content of ``result.json``, and whether it was there."""
    path, folder = task.job.path, task.job.folder
    with inputs_kept():
        # Before anything is computed: nobody knows what a file holds by then.
        inputs = {}
        if path.is_file():
            note_input(path)
            inputs[str(path)] = sha256(path.read_bytes()).hexdigest()
        job = CalibrationJob.load(path)
        if task.resume and (record := whole_result(folder, job, inputs, report=task.report)):
            return record, True
        answer = calibration_document(job.run())
        if not task.report:
            answer = replace(answer, written="record")
        return write_document(answer, folder, inputs), False


def whole_result(
    folder: Path, job: CalibrationJob, inputs: dict[str, str], *, report: bool
) -> dict[str, Any] | None:
    """The content of ``result.json`` if the folder holds what this job would give once more.

    Args:
        folder: of the results.
        job: as it is now.
        inputs: SHA-256 of the job's file by its path.
        report: whether a page is asked for.

    Returns:
        None where a file is missing, damaged or of another run, where the job, a file that it
        reads or a version changed, or where that cannot be told: a result that did not converge
        has no copy of its inputs, and of large files the copy has the sizes alone.
    """
    recover(folder)
    copy = folder / inputs_copy.NAME
    try:
        record = json.loads((folder / RECORD).read_bytes())
        run, files, hashes = record["run"], dict(record["files"]), dict(record["run"]["sha256"])
        now = sha256(inputs_copy.packed(job.spec.path, job.files)).hexdigest()
        same = (
            run == run_record("result", inputs, hashes) | {"content": content_digest(record)}
            and record["versions"] == versions()
            and hashes[inputs_copy.NAME] == now
            and all((folder / name).is_file() for name in files)
            and all(_digest(folder / name) == value for name, value in hashes.items())
            and not inputs_copy.InputsCopy.read(copy).left_out
        )
        shown = REPORT in files and f"Run {run['id']}" in (folder / REPORT).read_text("utf-8")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, SutaCalibError):
        return None
    return record if same and (shown or not report) else None


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def _one_line(message: object) -> str:
    return " ".join(str(message).split())
