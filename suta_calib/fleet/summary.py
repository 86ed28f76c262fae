"""What came of many jobs: a row for each, and one verdict."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
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
        faults: of the notes, those that name what is wrong with the data or lacks in the model.
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
    faults: tuple[str, ...] = ()
    error: str = ""
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    resumed: bool = False

    def of_record(self, record: Mapping[str, Any], *, resumed: bool) -> Self:
        """The same with what the JSON of its answer says."""
        return replace(self.of_assessment(read_assessment(record)), resumed=resumed)

    def of_assessment(self, assessment: Assessment) -> Self:
        """The same with a verdict."""
        return replace(
            self,
            verdict=assessment.level,
            sentence=assessment.sentence,
            notes=assessment.notes,
            faults=assessment.faults,
        )

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
        """Why it has no answer, or one that must not be used; what must be known, in short.

        What names a fault comes first.
        """
        if self.verdict == "good":
            return ""
        return self.error or next(iter((*self.faults, *self.notes)), self.sentence)

    @property
    def told(self) -> str:
        """The reason, and how many notes there are beside it."""
        more = 0 if self.error or self.verdict == "good" else len(self.notes) - 1
        if more < 1:
            return self.reason
        return f"{self.reason} (and {more} more note{'s' * (more > 1)})"

    def beside(self, folder: Path) -> Self:
        """The same with paths relative to the summary's folder."""
        return replace(self, job=_relative(self.job, folder), folder=_relative(self.folder, folder))


def _relative(path: str, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        # On another drive.
        return os.path.abspath(path)  # noqa: PTH100


@dataclass(frozen=True, repr=False)
class FleetAssessment(Assessment):
    """The verdict on many: which of them somebody has to look at.

    Attributes:
        look_at: which, as the first words.
    """

    look_at: str = ""

    @property
    def word(self) -> str:
        """Which to look at; of a fleet that is all well, the level."""
        return self.look_at or super().word


@dataclass(frozen=True)
class FleetSummary(Displayable):
    """What came of many jobs.

    Attributes:
        results: of each, in the order in which they were given.
        seconds: all together.
        repeated: how often a job was named once more.
        unfinished: how many are not done, for somebody interrupted it.
        name: of the files that it is written to, without their suffix.
        noun: what each is: a job, a robot.
    """

    results: tuple[JobResult, ...]
    seconds: float
    repeated: int = 0
    unfinished: int = 0
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
        counts, count = self.counts, len(self.results)
        good, care = f"{counts['good']:,} good", f"{counts['care']:,} with care"
        jobs = f"{count:,} {self.noun}{'s' * (count != 1)}"
        wrong = [f"{counts['failed']:,} of {jobs} gave no answer"] * bool(counts["failed"])
        rest = "" if wrong else f" of {jobs}"
        wrong += [f"{counts['bad']:,}{rest} must not be used"] * bool(counts["bad"])
        usable = counts["good"] + counts["care"]
        how = ", ".join([good] * bool(counts["good"]) + [care] * bool(counts["care"]))
        if wrong:
            used = f"{usable:,} may be used: {how}" if usable else "none may be used"
            sentence = f"{', '.join(wrong)}; {used}"
        else:
            sentence = f"{jobs}: {how}"
        return self.judged_by(sentence, {"failed": "No answer", "bad": "Bad"}, [*self._facts()])

    def judged_by(
        self, sentence: str, words: Mapping[Verdict, str], facts: Sequence[str]
    ) -> FleetAssessment:
        """The verdict of the worst, with the names of those that are not good.

        Args:
            sentence: what was found.
            words: for those that failed, and those that are bad.
            facts: what else is to be known.
        """
        # About as many names as two lines have.
        most, to_see = 12, [*self.of("failed"), *self.of("bad")]
        named = [f"{word}: {listed(self.of(v), most)}." for v, word in words.items() if self.of(v)]
        careful = [f"Care: {listed(self.of('care'), most)}."] if self.of("care") else []
        if self.unfinished:
            each = f"{self.noun}{'s are' if self.unfinished > 1 else ' is'}"
            careful.append(f"Interrupted: {self.unfinished:,} {each} not done, and not listed.")
        judgement = FleetAssessment.of(sentence, bad=named, care=careful, facts=facts)
        if not to_see:
            return judgement
        count = len(self.results)
        look_at = f"Look at {len(to_see):,} of {count:,} {self.noun}{'s' * (count != 1)}"
        return replace(judgement, look_at=look_at)

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
        Column("reason"),
        Column("note_count", value=lambda r: len(r.notes)),
        Column("sentence"),
        Column("error"),
        Column("job"),
        Column("folder"),
        *more,
    )


def _reasons(results: Sequence[JobResult]) -> Iterator[str]:
    """Why each is not good, those with the same reason together."""
    alike, most, names = dict[str, list[str]](), 20, 12
    for result in results:
        if result.told:
            alike.setdefault(result.told, []).append(result.name)
    for told in [*alike][:most]:
        yield f"{listed(alike[told], names)}: {told}"
    if (more := len(alike) - most) > 0:
        yield f"{more:,} more reasons are in the column reason of the CSV file"


def fleet_document(fleet: FleetSummary, folder: Path | None = None) -> Document:
    """One table of all jobs, the worst first; ``NAME.csv`` and ``NAME.json`` in the order given.

    Args:
        fleet: what came of them.
        folder: that the files are written to: paths in them are relative to it.
    """
    if folder is not None:
        fleet = replace(fleet, results=tuple(r.beside(folder) for r in fleet.results))
    worst_first = sorted(
        fleet.results, key=lambda r: (VERDICTS.index(r.verdict), not r.faults, -r.concern)
    )
    listing = _listing(type(fleet.results[0]), fleet.noun)
    warned = [f"{r.name}: {warning}" for r in fleet.results for warning in r.warnings]
    parts: list[Part] = [listing.of(worst_first)]
    parts += [Text(reason, bullet=True) for reason in _reasons(worst_first)]
    parts += [Text(f"Warnings: {listed(warned, 3)}")] if warned else []
    parts += [File(f"{fleet.name}.csv", lambda: csv_text(listing, fleet.results))]
    in_json = _listing(type(fleet.results[0]), fleet.noun, *written("notes", "faults", "warnings"))
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
