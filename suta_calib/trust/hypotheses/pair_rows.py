"""What an eye saw stands in other rows than the hand's poses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading

# Rows by which they may be shifted; and pairs that must be left then, for of a few some shift may
# always seem to fit.
MOST_SHIFT: Final = 5
LEAST_PAIRS: Final = 8


class PairRows(MisreadPairs):
    """The target of row i was seen from the hand of row i ± k, or of the last row but i."""

    name: ClassVar[str] = "rows of pairs"
    about: ClassVar[str] = "What the eye saw is some rows late or early, or in the opposite order."

    def readings(self, data: Any) -> Iterator[Reading]:
        """Two for each number of rows, and one for the opposite order."""
        count = len(data.hand[1])
        for rows in range(1, min(MOST_SHIFT, count - LEAST_PAIRS) + 1):
            sentence = f"if what the eye saw is {'a row' if rows == 1 else f'{rows} rows'}"
            yield f"{sentence} late", shifted(data, rows)
            yield f"{sentence} early", shifted(data, -rows)
        every = np.arange(count)
        yield (
            "if what the eye saw is in the opposite order",
            data.rows(every, every[::-1]),
        )

    def fault(self, pairs: Pairs) -> Pairs:
        """The targets two rows late; those of the last rows stand in the first."""
        every = np.arange(len(pairs.hand[1]))
        return pairs.rows(every, np.roll(every, 2))


def shifted(pairs: Pairs, rows: int) -> Pairs:
    """The hand of each row with what was seen some rows later."""
    every = np.arange(len(pairs.hand[1]))
    first, last = every[: len(every) - abs(rows)], every[abs(rows) :]
    return pairs.rows(first, last) if rows > 0 else pairs.rows(last, first)
