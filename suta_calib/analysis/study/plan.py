"""How many measurement sets a calibration needs, and how much its answer varies with them.

Three studies by one runner. *size*: random subsets of s sets are calibrated and judged on held-out
data; the mean error over s says when more sets stop paying. *bootstrap* (Efron 1979,
doi:10.1214/aos/1176344552): sets drawn with replacement tell how the estimates scatter, without a
model of the noise. *monte-carlo*: data simulated at the solution tell whether the standard
deviations that are predicted are those that appear.

Finished trials stand in a CSV file, one line each, so that an interrupted study goes on. The first
line, a comment, says which study it is. Each trial is written in one piece when it is done; a line
that a crash cut off is dropped when the study is resumed. SI units throughout.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Final, Self

from suta_calib.analysis.study.runner import Task, run_trials
from suta_calib.analysis.study.trial import (
    NAMES,
    SAMPLE,
    FullDataFit,
    Kind,
    Sets,
    StudyData,
    Trial,
    sets_of,
)
from suta_calib.arguments import checked
from suta_calib.atomic import only_writer, write_bytes_atomically
from suta_calib.display import Displayable
from suta_calib.errors import JobError, OutputError, SamplesError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import CsvTable, read_csv_table, read_text
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import Progress, solve
from suta_calib.terms import Term

_MARK: Final = "# suta-calib study: "
Done = dict[tuple[int, int], Trial]


def identity(job: CalibrationJob, data: StudyData) -> dict[str, str]:
    """What makes two studies the same: a job is its file's content and that of all it names."""
    files = [job.spec.path, Path(job.spec.arm.urdf)]
    for row in (*job.spec.observations, *job.spec.validation):
        files += [*row.sample_files, *([] if row.artefact is None else [row.artefact])]
        files += [value for value in row.settings.values() if isinstance(value, Path)]
    digests = (hashlib.sha256(path.read_bytes()).digest() for path in files)
    return {
        "kind": data.kind,
        "unit": data.sets.unit,
        "seed": str(data.seed),
        "version": version("suta_calib"),
        "job": hashlib.sha256(b"".join(digests)).hexdigest(),
    }


class StudyLog:
    """Appends trials to a file, which is begun (its folder too) with the first of them.

    Args:
        path: the file.
        identity: what makes two studies the same, by name.
        names: parameters that trials may estimate.
    """

    def __init__(self, path: Path, identity: Mapping[str, str], names: Sequence[str]) -> None:
        self.path, self._identity, self._names = path, identity, tuple(names)
        self._descriptor = -1
        self._goes_on = False
        self._stack = ExitStack()

    def finished(self) -> Done:
        """Trials that a file has already, by (size, number); those to come are added to it."""
        if not self.path.exists():
            return {}
        text = read_text(self.path, JobError)
        complete = text[: text.rfind("\n") + 1]
        lines = complete.splitlines(keepends=True)
        self._refuse_others(lines[0] if lines else "")
        if len(lines) < 2:
            complete = "".join(self._head())
        if complete != text:
            write_bytes_atomically(self.path, complete.encode())
        self._goes_on = True
        if len(lines) <= 2:
            return {}
        table = read_csv_table(self.path)
        done: Done = {}
        for row, problem in enumerate(table.cells("problem")):
            estimates = {}
            for name in self._names:
                value, std = (_number(table, row, column) for column in (name, f"{name}:std"))
                if math.isfinite(value):
                    estimates[name] = (value, std)
            size, number = (int(_number(table, row, name)) for name in ("size", "trial"))
            rms = _number(table, row, "rms_m")
            done[size, number] = Trial(size, number, problem, rms, estimates)
        return done

    def append(self, trial: Trial) -> None:
        """Write one trial; it is in the file when this returns."""
        estimates = [trial.estimates.get(name, (math.nan, math.nan)) for name in self._names]
        numbers = [trial.rms, *(number for pair in estimates for number in pair)]
        numbers_text = (repr(number) if math.isfinite(number) else "" for number in numbers)
        cells = [str(trial.size), str(trial.number), trial.problem, *numbers_text]
        try:
            if self._descriptor < 0:
                if not self._goes_on:
                    self.path.parent.mkdir(parents=True, exist_ok=True)
                    write_bytes_atomically(self.path, "".join(self._head()).encode())
                self._descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND)
                self._stack.callback(os.close, self._descriptor)
            os.write(self._descriptor, _line(cells).encode())
        except OSError as error:
            raise OutputError(f"{self.path}: not written: {error.strerror}") from error

    def __enter__(self) -> Self:
        self._stack.enter_context(only_writer(self.path))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _head(self) -> tuple[str, str]:
        settings = ", ".join(f"{name}={value}" for name, value in self._identity.items())
        columns = [column for name in self._names for column in (name, f"{name}:std")]
        return f"{_MARK}{settings}\n", _line(["size", "trial", "problem", "rms_m", *columns])

    def _refuse_others(self, first: str) -> None:
        """Trials of another study, as the first line of the file says."""
        if first == self._head()[0]:
            return
        parts = first.removeprefix(_MARK).strip().split(", ")
        there = dict(part.split("=", 1) for part in parts if "=" in part)
        differs = [name for name, value in self._identity.items() if there.get(name) != value]
        raise JobError(
            f"trials of another study ({', '.join(differs) or 'another file'} differs)",
            "trials of this job with the same data and options",
            file=self.path,
            line=1,
            hint="leave out --resume to start again, or choose another --out",
        )


def _number(table: CsvTable, row: int, name: str) -> float:
    """The number in a cell; NaN for an empty one, which is no count."""
    cell, counts = table.cells(name)[row], name in ("size", "trial")
    if counts and not cell.isdecimal():
        raise table.refuse(row, name, repr(cell), "a whole number, as the study wrote it")
    try:
        return float(cell) if cell else math.nan
    except ValueError:
        raise table.refuse(row, name, repr(cell), "a number, as the study wrote it") from None


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


@dataclass(frozen=True, eq=False)
class StudyPlan(Displayable):
    """Which trials to run.

    Attributes:
        data: what each of them needs.
        sizes: how many sets are drawn, ascending; all of them for the other kinds.
        trials: of each size.
        left_out: sizes that were asked for and that these data are too few for.
        solution: with all data, by the job's own options; None for the study of sizes.
    """

    data: StudyData
    sizes: tuple[int, ...]
    trials: int
    left_out: tuple[int, ...] = ()
    solution: Solution | None = None

    @property
    def tasks(self) -> list[Task]:
        """Size and number of every trial."""
        return [(size, number) for size in self.sizes for number in range(self.trials)]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that trials estimate; none in the study of sizes."""
        return () if self.data.reference is None else tuple(self.data.reference.given)


@dataclass(frozen=True)
class Request(Displayable):
    """What the user asked for.

    Attributes:
        kind: of study.
        trials: of each size.
        sizes: how many sets to draw; None for what suits the data.
        unit: what one set is; None for what suits the data.
        seed: of all trials.
        tolerance: part by which a size's mean error may exceed the largest size's.
    """

    kind: Kind = "size"
    trials: int = 100
    sizes: tuple[int, ...] | None = None
    unit: str | None = None
    seed: int = 0
    tolerance: float = 0.05

    @property
    def log_name(self) -> str:
        """What the file of finished trials is called."""
        return f"{NAMES[self.kind]}.trials.csv"


@checked
def plan_study(
    parameters: ParameterSet,
    terms: Sequence[Term],
    validation: Sequence[Term],
    options: SolverOptions,
    request: Request,
    solution: Solution | None = None,
) -> StudyPlan:
    """Decide what to draw, and solve with all data where the study compares with that.

    Args:
        parameters: the arm's unknowns.
        terms: the observations.
        validation: held-out terms, may be none.
        options: of the solver for all data; a trial has one start, from nominal.
        request: what is asked for.
        solution: with all data, where it is known already.

    Raises:
        SamplesError: too few sets, or none of the sizes is possible.
        JobError: the calibration with all data does not converge: nothing to compare trials with.
    """
    sets = sets_of(terms, request.unit)
    once = replace(options, starts=1, seed=0, confirm=False)
    solver = once.build_solver()
    if isinstance(solver, GaussNewton):
        # A step fewer: errors of held-out rows are right to a millionth of their size then.
        once = replace(once, solver=replace(solver, settled=1e-10))
    data = StudyData(
        request.kind, request.seed, parameters, tuple(terms), tuple(validation), sets, once
    )
    if request.kind == "size":
        sizes, left_out = _sizes(request.sizes, sets, all_sets=bool(validation))
        return StudyPlan(data, sizes, request.trials, left_out)
    solution = solution or solve(Problem(terms, parameters), options)
    if not solution.converged:
        raise JobError(
            f"a calibration with all data that is {solution.sentence}",
            f"a converged calibration, for comparison with the {request.kind} trials",
            hint="run 'calibrate' and 'observe' on this job",
        )
    with_reference = replace(data, reference=FullDataFit.of(solution))
    return StudyPlan(with_reference, (len(sets),), request.trials, (), solution)


@checked
def run_study(
    plan: StudyPlan,
    log: StudyLog | None = None,
    *,
    resume: bool = False,
    workers: int = 1,
    dask: str | None = None,
    progress: Progress | None = None,
) -> tuple[Trial, ...]:
    """Run every trial of a plan that is not in the log yet.

    Args:
        plan: of `plan_study`.
        log: where finished trials are written and, to resume, read.
        resume: go on with the trials in the log.
        workers: processes on this computer.
        dask: address of a Dask scheduler to run on instead.
        progress: called with (trials done, trials).

    Returns:
        One trial for each task of the plan, in its order, whatever order they were done in.

    Raises:
        JobError: the log is of another study.
        InputError: no Dask scheduler answers, or its workers cannot run a trial.
    """
    done, tasks = log.finished() if log is not None and resume else {}, plan.tasks
    left = [task for task in tasks if task not in done]
    count = len(tasks) - len(left)
    for trial in run_trials(plan.data, left, workers=workers, dask=dask):
        if log is not None:
            log.append(trial)
        done[trial.size, trial.number] = trial
        count += 1
        if progress is not None:
            progress(count, len(tasks))
    return tuple(done[task] for task in tasks)


def _sizes(
    asked: tuple[int, ...] | None, sets: Sets, *, all_sets: bool
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Sizes to study, and those asked for that cannot be; all sets where others are held out."""
    largest = len(sets) if all_sets else len(sets) - 1
    # The error over one or two validation sets is not representative of the arm.
    # Of the sets, where those not drawn are what is held out, unless the user asks for more.
    judgeable = largest if all_sets else max(1, int(0.8 * len(sets)))
    if asked is not None:
        sizes = sorted(set(asked))
    elif sets.unit == SAMPLE:
        sizes = sorted({max(1, round(judgeable * k / 10)) for k in range(1, 11)})
    else:
        sizes = list(range(1, min(judgeable, 10) + 1))
    possible = tuple(size for size in sizes if size <= largest)
    if not possible:
        held_out = (
            "" if all_sets else ", one of them for validation: the job has no validation data"
        )
        raise SamplesError(
            f"sizes from {sizes[0]} for {len(sets)} sets{held_out}",
            f"sizes up to {largest}",
            where="--sizes",
        )
    return possible, tuple(size for size in sizes if size > largest)
