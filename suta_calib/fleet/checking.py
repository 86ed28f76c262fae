"""Checks of many robots: is each calibration still right, by new rows of its own?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from suta_calib.assessment import Assessment, judged
from suta_calib.atomic import inputs_kept
from suta_calib.check import FALSE_ALARM, Check
from suta_calib.check.history import recall, remembered
from suta_calib.check.pose_answers import PoseAnswer
from suta_calib.check.read_back import ReadBack, read_answer
from suta_calib.errors import InputError
from suta_calib.fleet.robots import FleetRobot
from suta_calib.fleet.running import FleetInterrupted, Task, Work, hashes, run_fleet
from suta_calib.fleet.summary import FleetSummary, JobResult, Verdict
from suta_calib.report.check import check_document
from suta_calib.report.files import write_document
from suta_calib.report.listing import Column
from suta_calib.solver.solve import Progress
from suta_calib.terms import Term
from suta_calib.units import Unit, text, unit_name


@dataclass(frozen=True)
class CheckedRobot(JobResult):
    """What came of the check of one robot of many.

    Attributes:
        rows: new ones that were looked at; None where it failed before.
        bad_rows: of these, those that agree with nothing else.
        rms: of their errors, of the first kind; None where there is no value.
        unit: of these errors, m, rad or px.
        changed: what did.
        amount: by how much the first of these did, ± its standard deviation.
        p: chance of such rows if nothing changed.
    """

    title: ClassVar[str] = "Robots"
    columns: ClassVar[tuple[Column[Any], ...]] = (
        Column("rows", "rows", form="d"),
        Column("bad_rows"),
        Column(
            "rms", "RMS", unit=lambda row: row.unit, cell=lambda row: row.rms_text, numeric=True
        ),
        Column("unit", None, lambda row: unit_name(row.unit)),
        Column("changed", "changed", lambda row: ", ".join(row.changed), optional=True),
        Column("amount", "by", optional=True),
        Column("p", "p", form=".2g"),
    )

    rows: int | None = None
    bad_rows: int | None = None
    rms: float | None = None
    unit: Unit = "m"
    changed: tuple[str, ...] = ()
    amount: str = ""
    p: float | None = None

    @property
    def rms_text(self) -> str:
        """With its unit."""
        return "–" if self.rms is None else text(self.rms, self.unit, with_unit=True)

    def of_check(self, check: Check) -> CheckedRobot:
        """The same with an answer."""
        first = next(iter(check.before), None)
        rms = None if first is None or not math.isfinite(first[1]) else first[1]
        return replace(
            self.of_assessment(check.assessment),
            rows=check.rows,
            bad_rows=len(check.bad_rows),
            rms=rms,
            unit="m" if first is None else first[2],
            changed=tuple(change.what for change in check.changed),
            amount=next((change.amount for change in check.changed), ""),
            p=check.p,
        )

    @property
    def concern(self) -> float:
        """The less likely by chance, the earlier it is looked at."""
        return -1.0 if self.p is None else -self.p


@dataclass(frozen=True)
class CheckedFleet(FleetSummary):
    """What came of the checks of many robots.

    Attributes:
        false_alarm: probability that sound rows of one robot are said to show a change.
    """

    false_alarm: float = FALSE_ALARM

    @property
    @judged
    def assessment(self) -> Assessment:
        """Which robots changed, which could not be checked, and how many chance explains."""
        counts, count = self.counts, len(self.results)
        robots = f"{count:,} robot{'s' * (count != 1)}"
        parts = [f"{counts['bad']:,} of {robots} changed"]
        parts += [f"{counts['failed']:,} could not be checked"] * bool(counts["failed"])
        words: dict[Verdict, str] = {"bad": "Changed", "failed": "Not checked"}
        return self.judged_by(", ".join(parts), words, [self.by_chance])

    @property
    def expected(self) -> float:
        """How many sound robots of so many are said to have changed, on average at most."""
        return self.false_alarm * (len(self.results) - self.counts["failed"])

    @property
    def by_chance(self) -> str:
        """What the false-alarm probability of each means for all of them."""
        count = len(self.results) - self.counts["failed"]
        each, all_of_them = f"{100 * self.false_alarm:.3g} %", self.false_alarm / max(count, 1)
        sentence = f"The probability of a false alarm is {each} for each robot"
        if count < 2:
            return f"{sentence}."
        return (
            f"{sentence}, whatever the others do: of {count:,} sound robots {self.expected:.2g} on "
            f"average are said to have changed. --false-alarm {all_of_them:.2g} makes it {each} "
            "for all together, and finds small changes later."
        )


@dataclass(frozen=True, kw_only=True)
class CheckRobots(Work):
    """What ``suta-calib check`` does to a robot.

    Attributes:
        board: in the pictures, where it is not the job's.
        camera: that took them, for a job with the poses of a target.
        false_alarm: probability that sound rows are said to show a change.
        history: whether ``checks.jsonl`` beside the result has a line of it.
        written: whether the answer has a folder.
        anyway: check a result that must not be used, too.
    """

    row: ClassVar[type[JobResult]] = CheckedRobot
    noun: ClassVar[str] = "robot"

    board: Path | None = None
    camera: Path | None = None
    false_alarm: float = FALSE_ALARM
    history: bool = True
    written: bool = False
    anyway: bool = False

    @property
    def summary(self) -> str:
        """Beside it may be the summary of a calibration."""
        return "check_summary"

    @property
    def inputs(self) -> Sequence[Path]:
        """Those of the pictures."""
        return [path for path in (self.board, self.camera) if path is not None]

    def read(self, path: Path) -> ReadBack | PoseAnswer:
        """A result."""
        return read_answer(path, anyway=self.anyway)

    def terms(
        self, answer: ReadBack | PoseAnswer, robot: FleetRobot, files: Sequence[Path]
    ) -> list[Term]:
        """New rows of a robot.

        Raises:
            InputError: they cannot be used, or options that such a result does not take.
        """
        if isinstance(answer, ReadBack):
            return answer.terms(files, like=robot.like, board=self.board, camera=self.camera)
        if robot.like or self.inputs:
            raise InputError(
                f"a result of {answer.command.name}",
                "no like, --board or --camera, which are for rows of a job",
                file=answer.file,
            )
        return answer.terms(files)

    def result(self, task: Task, row: JobResult) -> JobResult:
        """The row of a robot with what its rows show."""
        robot = task.job
        assert isinstance(robot, FleetRobot)
        with inputs_kept():
            inputs = self.hashes_of(robot)
            answer = self.read(robot.path)
            terms = self.terms(answer, robot, robot.samples)
            check = answer.checker.checking(terms, self.false_alarm).run()
            return self.concluded(robot, row, answer, check, inputs)

    def hashes_of(self, robot: FleetRobot) -> dict[str, str]:
        """SHA-256 of the files that are given for a robot."""
        return hashes([robot.path, *robot.samples, *self.inputs])

    def concluded(
        self,
        robot: FleetRobot,
        row: JobResult,
        answer: ReadBack | PoseAnswer,
        check: Check,
        inputs: Mapping[str, str],
    ) -> JobResult:
        """The row of a robot with the answer of its check, which is remembered, and written."""
        if self.history:
            check = remembered(check, robot.samples, answer.file)
        if self.written:
            document = check_document(check, answer.title, recall(answer.file.parent))
            if not self.report:
                document = replace(document, written="record")
            write_document(document, robot.folder, inputs)
        assert isinstance(row, CheckedRobot)
        return row.of_check(check)


def check_robots(
    work: CheckRobots,
    robots: Sequence[FleetRobot],
    *,
    workers: int = 1,
    dask: str | None = None,
    progress: Progress | None = None,
) -> CheckedFleet:
    """Hold the calibration of each of many robots against new rows of its own.

    Args:
        work: how.
        robots: of `read_robots`.
        workers: processes on this computer.
        dask: address of a Dask cluster that works in their place; its workers must see the files
            under the same paths.
        progress: called with (robots done, robots).

    Raises:
        InputError: no cluster at that address.
        FleetInterrupted: Ctrl-C; it has what is done.
    """
    if dask is not None:
        # Workers there start in another folder.
        robots = [robot.absolute() for robot in robots]
    try:
        fleet = run_fleet(work, robots, workers=workers, dask=dask, progress=progress)
    except FleetInterrupted as interrupted:
        done = interrupted.done
        checked = summary_of(work, done.results, done.seconds)
        raise FleetInterrupted(replace(checked, unfinished=done.unfinished)) from None
    return summary_of(work, fleet.results, fleet.seconds)


def summary_of(work: CheckRobots, results: Sequence[JobResult], seconds: float) -> CheckedFleet:
    """What came of the checks."""
    return CheckedFleet(
        tuple(results), seconds, name=work.summary, noun=work.noun, false_alarm=work.false_alarm
    )
