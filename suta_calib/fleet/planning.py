"""Plans of many measurements: what to measure next for each arm, or for a check of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from suta_calib.analysis import planning
from suta_calib.arrays import FloatArray
from suta_calib.check import Checker
from suta_calib.check.design import design_check
from suta_calib.check.read_back import ReadBack, read_back
from suta_calib.fleet.running import During, JobWork, Task, made_from, silently
from suta_calib.fleet.summary import JobResult
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.check_design import NAME as CHECK_DESIGN
from suta_calib.report.check_design import check_design_document
from suta_calib.report.document import Document
from suta_calib.report.listing import Column
from suta_calib.report.plan import NAME as PLAN
from suta_calib.report.plan import plan_document
from suta_calib.tracking.read_back import is_result
from suta_calib.units import from_mm
from suta_calib.words import listed

Purpose = Literal["calibration", "check"]


@dataclass(frozen=True)
class PlannedJob(JobResult):
    """What came of one plan of many.

    Attributes:
        tip: uncertainty of the tip in the region with the present data, m; None of a check.
        then: the same with what is to be measured.
        unidentified: how many parameters the present data cannot determine; None without a plan.
        worthwhile: how many measurements pay; None if all that were looked at do.
        chosen: what to measure, best first.
    """

    title: ClassVar[str] = "Plans"
    columns: ClassVar[tuple[Column[Any], ...]] = (
        Column("tip", "tip now, mm", unit="m", optional=True),
        Column("then", "then, mm", unit="m", optional=True),
        Column("unidentified", "unidentified", form="d"),
        Column("worthwhile"),
        Column(
            "chosen",
            "measure",
            lambda row: ", ".join(row.chosen),
            cell=lambda row: listed(row.chosen, 2),
        ),
    )

    tip: float | None = None
    then: float | None = None
    unidentified: int | None = None
    worthwhile: int | None = None
    chosen: tuple[str, ...] = ()

    def of_record(self, record: Mapping[str, Any], *, resumed: bool) -> PlannedJob:
        """The same with what ``plan.json`` or ``plan_check.json`` says."""
        row = super().of_record(record, resumed=resumed)
        row = replace(row, chosen=tuple(choice["name"] for choice in record["chosen"]))
        if "predicted" not in record:
            return row
        before, after = (record["predicted"][when] for when in ("before", "after"))
        return replace(
            row,
            tip=from_mm(before["tip_mm"]),
            then=from_mm(after["tip_mm"]),
            unidentified=len(before["unidentified"]),
            worthwhile=record["stop"]["worthwhile"],
        )

    @property
    def concern(self) -> float:
        """Where the tip is least certain, most is to be gained."""
        return self.tip or 0.0


@dataclass(frozen=True, kw_only=True)
class PlanNext(JobWork):
    """What ``suta-calib plan`` does to a job.

    Attributes:
        purpose: to calibrate better, or to check a calibration later.
        chain: of the job's robot, where it has several.
        count: of measurements; None for what suits the purpose.
        candidates: file of places; None for those within the region.
        region: (2, 3) corners, m; None for one around what was touched.
        options: of a plan for a calibration, but for ``count`` and ``seed``.
        seed: of the search.
    """

    row: ClassVar[type[JobResult]] = PlannedJob

    purpose: Purpose = "calibration"
    chain: str = ""
    count: int | None = None
    candidates: Path | None = None
    region: FloatArray | None = None
    options: planning.PlanOptions = field(default_factory=planning.PlanOptions)
    seed: int = 0

    @property
    def record(self) -> str:
        """``plan`` or ``plan_check``."""
        return PLAN if self.purpose == "calibration" else CHECK_DESIGN

    @property
    def inputs(self) -> Sequence[Path]:
        """The candidates."""
        return [] if self.candidates is None else [self.candidates]

    def read(self, path: Path) -> CalibrationJob | ReadBack:
        """A job; for a check, a result too."""
        if self.purpose == "check" and is_result(path):
            return read_back(path)
        return CalibrationJob.load(path)

    def document(
        self, job: CalibrationJob | ReadBack, task: Task, during: During = silently
    ) -> Document:
        """The plan."""
        del task
        answer = (
            self._for_check(job, during) if self.purpose == "check" else self._plan(job, during)
        )
        return answer.with_data(made_from=self._made_from(job))

    def is_of(
        self, record: Mapping[str, Any], job: CalibrationJob | ReadBack, folder: Path
    ) -> bool:
        """Whether it was made from the same."""
        del folder
        return bool(record["made_from"] == self._made_from(job))

    def _made_from(self, job: CalibrationJob | ReadBack) -> dict[str, Any]:
        files = job.files if isinstance(job, CalibrationJob) else (job.file, *job.job.files)
        options = {
            "for": self.purpose,
            "chain": self.chain,
            "count": self.count,
            "region": None if self.region is None else self.region.tolist(),
            "seed": self.seed,
            **(asdict(self.options) if self.purpose == "calibration" else {}),
        }
        return made_from(options, [*files, *self.inputs])

    def _plan(self, job: CalibrationJob | ReadBack, during: During) -> Document:
        assert isinstance(job, CalibrationJob)
        with during("calibrating") as progress:
            situation = planning.situation_of_job(job, progress, self.chain)
        options, places = replace(self.options, count=self.count or 3, seed=self.seed), None
        if self.candidates is not None:
            places, options = planning.candidate_places(self.candidates, situation, options)
        where = self._region(situation)
        with during("planning") as progress:
            chosen = planning.plan(situation, options, places, where, progress)
        return plan_document(chosen)

    def _for_check(self, job: CalibrationJob | ReadBack, during: During) -> Document:
        """What would show most of what may change."""
        if isinstance(job, ReadBack):
            checker = job.checker
        else:
            with during("calibrating") as progress:
                checker = Checker(job.usable_solution(progress))
        solution = checker.solution
        situation = planning.Situation.of(solution.problem, solution, "", self.chain)
        count, places = self.count or 5, None
        if self.candidates is not None:
            options = planning.PlanOptions(count)
            places, _ = planning.candidate_places(self.candidates, situation, options)
        where = self._region(situation)
        design = design_check(situation, checker, count, places, where, self.seed)
        return check_design_document(design)

    def _region(self, situation: planning.Situation) -> planning.Region | None:
        if self.region is None:
            return None
        return planning.Region.box(self.region[0], self.region[1], situation)
