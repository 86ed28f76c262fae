"""What came of many jobs: a row for each, and one verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final, Literal, Self

from suta_calib.assessment import Assessment, judged, read_assessment
from suta_calib.display import Displayable
from suta_calib.report.document import Document, File, Part, Text
from suta_calib.report.listing import Column, Listing, Tone, csv_text, written
from suta_calib.words import listed

Verdict = Literal["good", "care", "bad", "failed"]
# The worst first: what somebody has to look at.
VERDICTS: Final[tuple[Verdict, ...]] = ("failed", "bad", "care", "good")
_TONE: Final[dict[Verdict, Tone]] = {"failed": "bad", "bad": "bad", "care": "care", "good": "good"}


@dataclass(frozen=True)
class JobResult(Displayable):
    """What came of one job of many; what a command has beside it is in a class of its own.

    Attributes:
        name: of the job in the fleet.
        job: path of its file.
        folder: where its results are.
        verdict: of its answer; ``failed`` where it has none.
        sentence: of the verdict.
        notes: of the verdict.
        error: why there is no answer.
        warnings: what was said beside it.
        seconds: from reading to the last file.
        resumed: whether the results were there, and nothing was computed.
    """

    title: ClassVar[str] = "Jobs"
    columns: ClassVar[tuple[Column[Any], ...]] = ()

    name: str
    job: str
    folder: str
    verdict: Verdict = "failed"
    sentence: str = ""
    notes: tuple[str, ...] = ()
    error: str = ""
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    resumed: bool = False

    def of_record(self, record: Mapping[str, Any], *, resumed: bool) -> Self:
        """The same with what the JSON of its answer says."""
        return replace(self.of_assessment(read_assessment(record)), resumed=resumed)

    def of_assessment(self, assessment: Assessment) -> Self:
        """The same with a verdict."""
        verdict, notes = assessment.level, assessment.notes
        return replace(self, verdict=verdict, sentence=assessment.sentence, notes=notes)

    @property
    def concern(self) -> float:
        """Of two with the same verdict, the larger one is looked at first."""
        return 0.0

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
        name: of the files that it is written to, without their suffix.
        noun: what each is: a job, a robot.
    """

    results: tuple[JobResult, ...]
    seconds: float
    repeated: int = 0
    name: str = "summary"
    noun: str = "job"

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
        jobs = f"{count:,} {self.noun}{'s' * (count != 1)}"
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
            yield f"A {self.noun} was named {times} more than once, and is computed once."

    @property
    def in_a_line(self) -> str:
        """How many have which verdict."""
        return self.assessment.sentence


def _listing(row: type[JobResult], noun: str, *more: Column[Any]) -> Listing[Any]:
    """The table of rows of a class."""
    return Listing[Any](
        row.title,
        Column("name", noun),
        Column("verdict", "verdict", tone=lambda r: _TONE[r.verdict]),
        *row.columns,
        Column("seconds", "s", form=".2f"),
        Column("resumed"),
        Column("", "why", lambda r: r.reason, optional=True),
        Column("sentence"),
        Column("error"),
        Column("job"),
        Column("folder"),
        *more,
    )


def fleet_document(fleet: FleetSummary) -> Document:
    """One table of all jobs, the worst first; ``NAME.csv`` and ``NAME.json`` in the order given."""
    worst_first = sorted(fleet.results, key=lambda r: (VERDICTS.index(r.verdict), -r.concern))
    listing = _listing(type(fleet.results[0]), fleet.noun)
    warned = [f"{r.name}: {warning}" for r in fleet.results for warning in r.warnings]
    parts: list[Part] = [listing.of(worst_first)]
    parts += [Text(f"Warnings: {listed(warned, 3)}")] if warned else []
    parts += [File(f"{fleet.name}.csv", lambda: csv_text(listing, fleet.results))]
    in_json = _listing(type(fleet.results[0]), fleet.noun, *written("notes", "warnings"))
    return Document(
        fleet.name,
        f"Many {fleet.noun}s",
        fleet.assessment,
        parts,
        {
            f"{fleet.noun}s": in_json.records(fleet.results),
            "counts": fleet.counts,
            "seconds": fleet.seconds,
        },
        written="record",
        incomplete=fleet.exit_code == 2,
    )
