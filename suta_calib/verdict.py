"""How far to trust an answer: in one word, a sentence, and what must be known to use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

Level = Literal["good", "caution", "bad"]
WORD: Final[dict[Level, str]] = {"good": "Good", "caution": "Take care", "bad": "Do not use"}


@dataclass(frozen=True)
class Verdict:
    """The first thing a reader needs.

    Attributes:
        level: ``good``; ``caution`` (usable, but something must be known); ``bad`` (not usable).
        notes: what must be known, one sentence each; none where all is well.
        sentence: what was found, where a verdict says more than how far to trust it.
    """

    level: Level
    notes: tuple[str, ...] = ()
    sentence: str = ""

    @property
    def usable(self) -> bool:
        """Whether the answer may be used at all."""
        return self.level != "bad"

    @property
    def word(self) -> str:
        """The level for a reader."""
        return WORD[self.level]


def verdict_of(bad: Sequence[str], caution: Sequence[str], sentence: str = "") -> Verdict:
    """The worst of what was found."""
    level: Level = "bad" if bad else "caution" if caution else "good"
    return Verdict(level, (*bad, *caution), sentence)
