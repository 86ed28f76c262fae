"""The verdict on a result: one word, a sentence, and the notes to read before using it.

Every answer of this package has an ``assessment``, made where the answer is made. The exit code,
the JSON, the report and whoever reads an answer back ask it; nobody judges twice.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any, Final, Literal, Self, TypeVar

from suta_calib.errors import SutaCalibError, UnusableResultError, is_interrupt

Level = Literal["good", "care", "bad"]
WORD: Final[dict[Level, str]] = {"good": "Good", "care": "Take care", "bad": "Do not use"}
A = TypeVar("A")
T = TypeVar("T")


class NotExplainedWarning(UserWarning):
    """A check, explanation or picture failed; the result is complete without it."""


def attempt(what: str, compute: Callable[[], T], otherwise: T, notes: list[str] | None = None) -> T:
    """Compute a check, an explanation or a picture; if it fails, the result is kept.

    Args:
        what: is done with what, as the end of "not …": ``explained: joint_1.x``.
        compute: the part. An interrupt and a lack of memory end the program as always.
        otherwise: value of a part that fails.
        notes: where the sentence about a failure is added.

    Returns:
        The value of the part, or ``otherwise`` with a `NotExplainedWarning`. The tests of this
        package make errors of warnings, so that no failure goes unnoticed there.
    """
    try:
        return compute()
    except MemoryError:
        raise
    except Exception as error:
        if is_interrupt(error):
            raise
        own_error = isinstance(error, SutaCalibError)
        reason = " ".join((str(error) if own_error else f"{type(error).__name__}: {error}").split())
        note = f"Not {what} ({reason}). The answer stands without it."
        if not own_error:
            note += " This is a fault of suta_calib: please report it."
        warnings.warn(note, NotExplainedWarning, stacklevel=2)
        if notes is not None:
            notes.append(note)
        return otherwise


def judge(what: str, compute: Callable[[], Iterable[T]], notes: list[str] | None = None) -> list[T]:
    """The findings of one check; if it fails, none, with a note (`attempt`)."""
    return attempt(f"judged: {what}", lambda: list(compute()), [], notes)


def judged(assess: Callable[[A], Assessment]) -> Callable[[A], Assessment]:
    """The assessment of a result; if it fails, the verdict is "care" and the result is kept.

    An answer that was judged in part while it was made lists in ``unjudged`` what failed there.
    """

    @wraps(assess)
    def assessed(answer: A) -> Assessment:
        notes = list[str]()
        assessment = attempt(
            "judged: whether this answer may be used",
            lambda: assess(answer),
            Assessment("care"),
            notes,
        )
        return assessment.with_care([*notes, *getattr(answer, "unjudged", ())])

    return assessed


@dataclass(frozen=True, repr=False)
class Assessment:
    """The verdict on a result, with its reasons.

    Attributes:
        level: ``good``; ``care`` (usable, but something must be known); ``bad`` (not usable).
        sentence: what was found; empty where the level says it all.
        notes: what must be known, one sentence each; where all is well, what that rests on.
        faults: of the notes, those that name what is wrong with the data or lacks in the model.
    """

    level: Level
    sentence: str = ""
    notes: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def statement(self) -> str:
        """The sentence, as it begins behind a full stop."""
        return self.sentence[:1].upper() + self.sentence[1:]

    def __repr__(self) -> str:
        notes = f"{len(self.notes)} note{'s' * (len(self.notes) != 1)}" if self.notes else ""
        return f"<Assessment: {self.level}{'; '.join(['', *filter(None, [self.sentence, notes])])}>"

    @classmethod
    def of(
        cls,
        sentence: str = "",
        *,
        bad: Sequence[str] = (),
        care: Sequence[str] = (),
        facts: Sequence[str] = (),
    ) -> Self:
        """The verdict from all findings: the worst one counts.

        Args:
            sentence: what was found.
            bad: reasons not to use the answer.
            care: what must be known to use it.
            facts: what it rests on; no reason for care.
        """
        level: Level = "bad" if bad else "care" if care else "good"
        return cls(level, sentence, (*bad, *care, *facts))

    def with_care(self, notes: Sequence[str]) -> Assessment:
        """The same with more notes that are a reason for care."""
        level: Level = "care" if notes and self.level == "good" else self.level
        return replace(self, level=level, notes=(*self.notes, *notes))

    @property
    def usable(self) -> bool:
        """Whether the result can be used."""
        return self.level != "bad"

    @property
    def exit_code(self) -> int:
        """Exit code of the command: 0, or 1 if the result must not be used."""
        # What must not be used is exit code 1.
        return 0 if self.usable else 1

    @property
    def word(self) -> str:
        """The level for a reader."""
        return WORD[self.level]

    def as_dict(self) -> dict[str, Any]:
        """The key ``verdict`` that every result has in JSON."""
        return {
            "level": self.level,
            "usable": self.usable,
            "sentence": self.sentence,
            "notes": list(self.notes),
            **({"faults": list(self.faults)} if self.faults else {}),
        }


def read_assessment(answer: Mapping[str, Any]) -> Assessment:
    """The verdict of a result that was read from JSON; "care" if it has none."""
    verdict = _verdict(answer)
    level, lists = verdict.get("level"), (verdict.get("notes"), verdict.get("faults"))
    return Assessment(
        level if level in WORD else "care",
        str(verdict.get("sentence", "it has no verdict")),
        *(tuple(map(str, notes)) if isinstance(notes, list) else () for notes in lists),
    )


def says_usable(answer: Mapping[str, Any]) -> bool:
    """Whether a result that was read from JSON can be used."""
    # Written before answers carried their judgement: whether it converged is all there is.
    converged = answer.get("status", "converged") == "converged"
    return bool(_verdict(answer).get("usable", converged))


def _verdict(answer: Mapping[str, Any]) -> Mapping[str, Any]:
    verdict = answer.get("verdict")
    return verdict if isinstance(verdict, Mapping) else {}


def refuse_unusable(
    answer: Mapping[str, Any] | Assessment,
    file: Path,
    *,
    anyway: bool = False,
    insist: str = "--anyway",
) -> None:
    """Raise an error if a result must not be used.

    Args:
        answer: as read back from JSON, or the assessment of one that was just made.
        file: it came from.
        anyway: use it all the same (``--anyway``).
        insist: how a user says so.

    Raises:
        UnusableResultError: its ``verdict`` says that it is not usable.
    """
    written = {"verdict": answer.as_dict()} if isinstance(answer, Assessment) else answer
    if anyway or says_usable(written):
        return
    verdict = _verdict(written)
    notes = [str(note) for note in verdict.get("notes", ())]
    why = next(iter(notes), str(verdict.get("sentence", "")) or "it did not converge")
    raise UnusableResultError(
        f"a result that must not be used ({why.rstrip('.')})",
        "a usable result",
        file=file,
        where="" if isinstance(answer, Assessment) else "verdict",
        hint=f"correct the problem and run again, or use it with {insist}",
    )
