"""One command for many jobs: each in a worker process, and never an exception.

What a fleet does to each job is a `Work`: a command's options, how it answers on a job, and the row
of that job in the summary. A command for a fleet is one more file with one.
"""

from __future__ import annotations

import json
import traceback
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields, replace
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Self

from suta_calib.atomic import inputs_kept, note_input, recover
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SutaCalibError
from suta_calib.exchange.result import content_digest
from suta_calib.fleet.jobs import FleetJob, fleet_jobs
from suta_calib.fleet.summary import FleetSummary, JobResult
from suta_calib.report.calibration import versions
from suta_calib.report.document import Document
from suta_calib.report.files import run_record, write_document
from suta_calib.report.listing import json_text
from suta_calib.solver.solve import Progress

if TYPE_CHECKING:
    from suta_calib.fleet.workers import Crash

# Called with what is done now, it gives what is told how far that is.
During = Callable[[str], AbstractContextManager[Progress]]


@contextmanager
def silently(what: str) -> Iterator[Progress]:
    """Of many jobs nobody is told how far one of them is."""
    del what
    yield lambda *_: None


@dataclass(frozen=True, kw_only=True)
class Work(Displayable, ABC):
    """What is done to each job of a fleet: a command with its options.

    Attributes:
        report: whether a page is written, which often takes longer than all the rest.
        processes: of each job, on the computer where it is worked on.
    """

    row: ClassVar[type[JobResult]]
    noun: ClassVar[str] = "job"

    report: bool = False
    processes: int = 1

    def elsewhere(self) -> Self:
        """The same with paths that hold in any folder."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        paths: dict[str, Any] = {n: v.absolute() for n, v in values.items() if isinstance(v, Path)}
        return replace(self, **paths)

    @property
    def inputs(self) -> Sequence[Path]:
        """Files that the command line names beside the jobs."""
        return ()

    def refuse_missing(self) -> None:
        """Before any job is begun: all of them would fail alike.

        Raises:
            InputError: a file that the command line names is not there.
        """
        for path in self.inputs:
            if not path.is_file():
                raise InputError("no such file", "an existing file", file=path)

    @property
    @abstractmethod
    def summary(self) -> str:
        """Name of the files that the summary is written to, without their suffix."""

    @abstractmethod
    def result(self, task: Task, row: JobResult) -> JobResult:
        """The row of a job with what came of it; the answer is written."""


@dataclass(frozen=True, kw_only=True)
class JobWork(Work):
    """What is done to each ``calibration.yaml`` of a fleet, as a command of its own would."""

    @property
    @abstractmethod
    def record(self) -> str:
        """Name of the answer's JSON, without its suffix."""

    @property
    def summary(self) -> str:
        """That of the answer, for beside it may be the summary of another command."""
        return f"{self.record}_summary"

    @abstractmethod
    def read(self, path: Path) -> Any:
        """A job and all that it names.

        Raises:
            InputError: one of these files cannot be used.
        """

    @abstractmethod
    def document(self, job: Any, task: Task, during: During = silently) -> Document:
        """The answer on a job.

        Args:
            job: what `read` gave.
            task: where, and how.
            during: is told what is done.
        """

    @abstractmethod
    def is_of(self, record: Mapping[str, Any], job: Any, folder: Path) -> bool:
        """Whether a job as it is now would give the answer that was written, once more."""

    def result(self, task: Task, row: JobResult) -> JobResult:
        """The row of a job with what came of it; the answer is written."""
        with inputs_kept():
            # Before anything is computed: nobody knows what a file holds by then.
            inputs = hashes([task.job.path, *self.inputs])
            job, record = self.read(task.job.path), None
            if task.resume:
                record = whole_record(self, task.job.folder, job, inputs)
            if record is not None:
                return row.of_record(record, resumed=True)
            answer = self.document(job, task)
            if not self.report:
                answer = replace(answer, written="record")
            return row.of_record(write_document(answer, task.job.folder, inputs), resumed=False)


@dataclass(frozen=True)
class Task(Displayable):
    """What a worker is given.

    Attributes:
        work: what is done.
        job: to which.
        resume: whether what is there is taken.
        dask: address of a cluster that does the parts of this one job.
    """

    work: Work
    job: FleetJob
    resume: bool = False
    dask: str | None = None


def run_jobs(
    work: JobWork,
    paths: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    workers: int = 1,
    dask: str | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> FleetSummary:
    """Do the same to many jobs, and write the results of each as if it was the only one.

    A job that cannot be read, that fails, or that ends its worker process stops no other.

    Args:
        work: what is done, such as `Calibrate`.
        paths: of the jobs (``calibration.yaml``).
        out: folder below which every job has a folder of results; by default the results of each
            stand beside it.
        workers: processes on this computer.
        dask: address of a Dask cluster that works in their place; its workers must see the files
            under the same paths.
        resume: take the results that are there, if they are whole and the job, every file that it
            reads, the options and the versions of the packages did not change.
        progress: called with (jobs done, jobs).

    Returns:
        What came of each job, in the order in which they were given.

    Raises:
        InputError: jobs on several drives, a file beside them that is not there, or no cluster at
            that address.
        FleetInterrupted: Ctrl-C; it has what is done.
    """
    jobs = fleet_jobs([Path(path) for path in paths], None if out is None else Path(out))
    if dask is not None:
        # Workers there start in another folder.
        jobs = [replace(j, path=j.path.absolute(), folder=j.folder.absolute()) for j in jobs]
    fleet = run_fleet(work, jobs, workers=workers, dask=dask, resume=resume, progress=progress)
    return replace(fleet, repeated=len(paths) - len(jobs))


class FleetInterrupted(KeyboardInterrupt):
    """Somebody ended a fleet while it was at work.

    Args:
        done: what came of the jobs that were done.
    """

    def __init__(self, done: FleetSummary) -> None:
        super().__init__()
        self.done = done


def run_fleet(
    work: Work,
    jobs: Sequence[FleetJob],
    *,
    workers: int = 1,
    dask: str | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> FleetSummary:
    """The same of jobs whose names and folders are known: `run_jobs`."""
    # Loads what one job does not need.
    from suta_calib.fleet.workers import Crash, work_through

    work.refuse_missing()
    began = perf_counter()
    # Processes that no job would have are shared between the jobs.
    share = 1 if dask is not None else workers // max(len(jobs), 1)
    work = replace(work if dask is None else work.elsewhere(), processes=max(share, 1))
    results: list[JobResult | None] = [None] * len(jobs)
    tasks = [Task(work, job, resume) for job in jobs]

    def summary() -> FleetSummary:
        complete = tuple(result for result in results if result is not None)
        left, seconds = len(jobs) - len(complete), perf_counter() - began
        return FleetSummary(complete, seconds, unfinished=left, name=work.summary, noun=work.noun)

    try:
        for done, (number, answer) in enumerate(
            work_through(done_to, tasks, workers=workers, dask=dask), start=1
        ):
            job = jobs[number]
            results[number] = crashed(work, job, answer) if isinstance(answer, Crash) else answer
            if progress is not None:
                progress(done, len(jobs))
    except KeyboardInterrupt:
        raise FleetInterrupted(summary()) from None
    return summary()


def crashed(work: Work, job: FleetJob, crash: Crash) -> JobResult:
    """The row of a job whose worker process ended."""
    error = (
        f"{job.path}: found that the worker process ended twice ({crash.reason}); expected enough "
        f"memory for this {work.noun}; give fewer rows, or use a larger computer"
    )
    return replace(begun(work, job), error=error)


def begun(work: Work, job: FleetJob) -> JobResult:
    """The row of a job of which nothing is known yet."""
    return work.row(job.name, str(job.path), str(job.folder))


def done_to(task: Task) -> JobResult:
    """Do the work on one job; what goes wrong is in the answer."""
    row = begun(task.work, task.job)
    return guarded(row, lambda: task.work.result(task, row))


def guarded(row: JobResult, work: Callable[[], JobResult]) -> JobResult:
    """The row that some work gives, or this one with what went wrong."""
    began = perf_counter()
    with warnings.catch_warnings(record=True) as said:
        try:
            row = work()
        except Exception as error:  # noqa: BLE001 (a fault that one job meets stops no other)
            row = replace(row, verdict="failed", error=reason_of(error, row.job))
    heard = tuple(dict.fromkeys(_one_line(warning.message) for warning in said))
    return replace(row, warnings=(*row.warnings, *heard), seconds=perf_counter() - began)


def reason_of(error: Exception, job: str) -> str:
    """Why there is no answer, in one line."""
    if isinstance(error, SutaCalibError):
        return _one_line(error)
    if isinstance(error, MemoryError):
        return f"{job}: found too little memory ({_one_line(error)})"
    if isinstance(error, OSError):
        return f"{error.filename or job}: {error.strerror or _one_line(error)}"
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}"
    return (
        f"{job}: {type(error).__name__} at {where}: {_one_line(error)}. This is a fault of "
        "suta_calib: please report it"
    )


def hashes(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of those that are files; these are not written over by then."""
    found = {}
    for path in paths:
        if path.is_file():
            note_input(path)
            found[str(path)] = _digest(path)
    return found


def made_from(options: Mapping[str, Any], files: Iterable[Path]) -> dict[str, Any]:
    """What an answer is made from, as its JSON says it: the same would give the same.

    Args:
        options: of the command.
        files: whatever was read.
    """
    content = sha256()
    for path in files:
        if path.is_file():
            content.update(f"{path.name}\0{_digest(path)}\0".encode())
    told = {"options": options, "files_sha256": content.hexdigest(), "versions": versions()}
    answer: dict[str, Any] = json.loads(json_text(told))
    return answer


def whole_record(
    work: JobWork, folder: Path, job: Any, inputs: Mapping[str, str]
) -> dict[str, Any] | None:
    """The content of an answer's JSON, if the folder holds what this job would give once more.

    Args:
        work: whose answer it is.
        folder: of the results.
        job: as it is now.
        inputs: SHA-256 of the files that the command line names, the job's first, by their paths.

    Returns:
        None where a file is missing, damaged or of another run, where the job, a file that it
        reads, an option or a version changed, or where that cannot be told.
    """
    recover(folder)
    try:
        record = json.loads((folder / f"{work.record}.json").read_bytes())
        run, files, written = record["run"], dict(record["files"]), dict(record["run"]["sha256"])
        same = (
            run == run_record(work.record, inputs, written) | {"content": content_digest(record)}
            and all((folder / name).is_file() for name in files)
            and all(_digest(folder / name) == value for name, value in written.items())
            and work.is_of(record, job, folder)
        )
        pages = [folder / n for n in files if n.startswith("report") and n.endswith(".html")]
        shown = any(f"Run {run['id']}" in page.read_text("utf-8") for page in pages)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, SutaCalibError):
        return None
    return record if same and (shown or not work.report) else None


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def _one_line(message: object) -> str:
    return " ".join(str(message).split())
