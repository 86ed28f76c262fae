"""What came of many jobs: a row for each, and one verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from suta_calib.assessment import Assessment, judged, read_assessment
from suta_calib.display import Displayable
from suta_calib.report.document import Document, File, Part, Text
from suta_calib.report.listing import Column, Listing, Tone, csv_text, written
from suta_calib.words import listed

Verdict = Literal["good", "care", "bad", "failed"]
# The worst first: what somebody has to look at.
VERDICTS: Final[tuple[Verdict, ...]] = ("failed", "bad", "care", "good")
_TONE: Final[dict[Verdict, Tone]] = {"failed": "bad", "bad": "bad", "care": "care", "good": "good"}
# States in which a parameter has a value of its own.
_ESTIMATED: Final = ("identified", "prior", "at_bound")


@dataclass(frozen=True)
class JobResult(Displayable):
    """What came of one job of many.

    Attributes:
        name: of the job in the fleet.
        job: path of its file.
        folder: where its results are.
        verdict: of its answer; ``failed`` where it has none.
        sentence: of the verdict.
        notes: of the verdict.
        data: what the errors are of: ``validation``, or ``calibration`` if nothing is held out.
        unit: of the errors, as in ``result.json``: mm, deg or px.
        rms_before: of these errors with the nominal arm; None where there is no value.
        rms_after: the same with the calibrated arm.
        count: of these errors.
        estimated: how many parameters have a value.
        unidentified: how many the data cannot determine.
        error: why there is no answer.
        warnings: what was said beside it.
        seconds: from reading to the last file.
        resumed: whether the results were there, and nothing was computed.
    """

    name: str
    job: str
    folder: str
    verdict: Verdict = "failed"
    sentence: str = ""
    notes: tuple[str, ...] = ()
    data: str = ""
    unit: str = ""
    rms_before: float | None = None
    rms_after: float | None = None
    count: int = 0
    estimated: int = 0
    unidentified: int = 0
    error: str = ""
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    resumed: bool = False

    def of_record(self, record: Mapping[str, Any], *, resumed: bool) -> JobResult:
        """The same with what ``result.json`` says."""
        assessment, metrics = read_assessment(record), record.get("metrics") or {}
        data = "validation" if (metrics.get("validation") or {}).get("by_term") else "calibration"
        figures = metrics.get(data) or {}
        before, after = (figures.get(which) or {} for which in ("before", "after"))
        key = next((name for name in before if name.startswith("rms_")), "")
        states = [p["state"] for p in (record.get("parameters") or {}).values()]
        return replace(
            self,
            verdict=assessment.level,
            sentence=assessment.sentence,
            notes=assessment.notes,
            data=data,
            unit=key.removeprefix("rms_"),
            rms_before=before.get(key),
            rms_after=after.get(key),
            count=int(before.get("count") or 0),
            estimated=sum(state in _ESTIMATED for state in states),
            unidentified=len(record.get("unidentified") or ()),
            resumed=resumed,
        )

    @property
    def in_a_line(self) -> str:
        """The job, and its verdict."""
        return f"{self.name}: {self.verdict}"

    @property
    def reason(self) -> str:
        """Why it has no answer, or one that must not be used; what must be known, in short."""
        if self.verdict == "good":
            return ""
        return self.error or next(iter(self.notes), self.sentence)


@dataclass(frozen=True)
class FleetSummary(Displayable):
    """What came of many jobs.

    Attributes:
        results: of each, in the order in which they were given.
        seconds: all together.
        repeated: how often a job was named once more.
    """

    results: tuple[JobResult, ...]
    seconds: float
    repeated: int = 0

    @property
    def counts(self) -> dict[Verdict, int]:
        """How many jobs have each verdict, the worst first."""
        found = Counter(result.verdict for result in self.results)
        return {verdict: found[verdict] for verdict in VERDICTS}

    def of(self, verdict: Verdict) -> list[str]:
        """Names of the jobs with a verdict."""
        return [result.name for result in self.results if result.verdict == verdict]

    @property
    @judged
    def assessment(self) -> Assessment:
        """The worst of all."""
        few, counts, count = 3, self.counts, len(self.results)
        usable = f"{counts['good']:,} good" + f", {counts['care']:,} care" * (counts["care"] > 0)
        jobs = f"{count:,} job{'s' * (count != 1)}"
        if unusable := counts["failed"] + counts["bad"]:
            sentence = (
                f"{unusable:,} of {jobs} gave nothing that may be used ({counts['bad']:,} bad, "
                f"{counts['failed']:,} failed); the others did: {usable}"
            )
        else:
            sentence = f"{jobs}: {usable}"
        failed, bad, care = self.of("failed"), self.of("bad"), self.of("care")
        return Assessment.of(
            sentence,
            bad=[
                *([f"Failed: {listed(failed, few)}."] if failed else []),
                *([f"Bad: {listed(bad, few)}."] if bad else []),
            ],
            care=[f"Care: {listed(care, few)}."] if care else [],
            facts=[*self._facts()],
        )

    @property
    def exit_code(self) -> int:
        """Of the command: 2 if a job has no answer, 1 if one must not be used, or else 0."""
        return 2 if self.of("failed") else self.assessment.exit_code

    def _facts(self) -> Iterator[str]:
        if taken := sum(result.resumed for result in self.results):
            yield f"{taken:,} results were there and whole, and were not computed again."
        if self.repeated:
            times = "once" if self.repeated == 1 else f"{self.repeated:,} times"
            yield f"A job was named {times} more than once, and is computed once."

    @property
    def in_a_line(self) -> str:
        """How many have which verdict."""
        return self.assessment.sentence


def _rms(which: str) -> Column[JobResult]:
    def cell(result: JobResult) -> str:
        value = getattr(result, which)
        return "–" if value is None else f"{value:.3g} {result.unit}"

    return Column(which, which.removeprefix("rms_"), cell=cell, numeric=True)


RESULTS: Final = Listing[JobResult](
    "Jobs, with the RMS of their errors",
    Column("name", "job"),
    Column("verdict", "verdict", tone=lambda r: _TONE[r.verdict]),
    _rms("rms_before"),
    _rms("rms_after"),
    Column("unit"),
    Column("data", "of"),
    Column("count"),
    Column("estimated", "estimated", form="d"),
    Column("unidentified"),
    Column("seconds", "s", form=".2f"),
    Column("resumed"),
    Column("", "why", lambda r: r.reason, optional=True),
    Column("sentence"),
    Column("error"),
    Column("job"),
    Column("folder"),
)
_IN_JSON: Final = Listing[JobResult]("", *RESULTS.columns, *written("notes", "warnings"))


def fleet_document(fleet: FleetSummary) -> Document:
    """One table of all jobs, the worst first; ``summary.csv`` and ``summary.json`` as given."""
    worst_first = sorted(fleet.results, key=lambda result: VERDICTS.index(result.verdict))
    warned = [f"{r.name}: {warning}" for r in fleet.results for warning in r.warnings]
    parts: list[Part] = [RESULTS.of(worst_first)]
    parts += [Text(f"Warnings: {listed(warned, 3)}")] if warned else []
    parts += [File("summary.csv", lambda: csv_text(RESULTS, fleet.results))]
    return Document(
        "summary",
        "Many jobs",
        fleet.assessment,
        parts,
        {
            "jobs": _IN_JSON.records(fleet.results),
            "counts": fleet.counts,
            "seconds": fleet.seconds,
        },
        written="record",
        incomplete=fleet.exit_code == 2,
    )
