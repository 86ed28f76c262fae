"""How far to trust the answer of a closed problem, in one word and a few sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["good", "caution", "bad"]


@dataclass(frozen=True)
class Verdict:
    """The first thing a reader needs.

    Attributes:
        level: ``good``; ``caution`` (usable, but something must be known); ``bad`` (not usable).
        notes: what must be known, one sentence each; none where all is well.
    """

    level: Level
    notes: tuple[str, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether the answer may be used at all."""
        return self.level != "bad"


def verdict_of(bad: list[str], caution: list[str]) -> Verdict:
    """The worst of what was found."""
    level: Level = "bad" if bad else "caution" if caution else "good"
    return Verdict(level, (*bad, *caution))
