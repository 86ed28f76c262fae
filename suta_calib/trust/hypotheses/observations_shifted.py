"""Rows whose observation is some rows too late or too early."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.misreadings import Change, Misreading, PairReading, Pairs, slid


class RowsLate(Misreading):
    """Readings of row i belong to the observation of row i + k, in all files.

    Pairs may also stand in the opposite order.
    """

    name = "rows late"
    about = "All observations are some rows too late or too early, by the same number of rows."
    precedence = 20

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """Two for each number of rows."""
        # Rows by which observations may be late: beyond a few the usual cause is a file in another
        # order, which is a hypothesis of its own.
        for rows in range(1, 20 + 1):
            count = "one row" if rows == 1 else f"{rows} rows"
            for description, offset in ((f"{count} late", rows), (f"{count} early", -rows)):
                yield f"the observations are {description}", partial(slid, offset, "")

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Observations two rows late."""
        samples = term.poses.samples
        return "the observations are 2 rows late", slid(-2, "", samples)

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """Two for each number of rows, and one for the opposite order."""
        # Rows by which pairs may be shifted; and pairs that must be left then, for of a few some
        # shift may always seem to fit.
        most_shift = 5
        least_pairs = 8
        count = len(pairs.hand[1])
        for rows in range(1, min(most_shift, count - least_pairs) + 1):
            sentence = f"if the target poses are {'a row' if rows == 1 else f'{rows} rows'}"
            yield f"{sentence} late", shifted(pairs, rows)
            yield f"{sentence} early", shifted(pairs, -rows)
        every = np.arange(count)
        yield ("if the target poses are in the opposite order", pairs.rows(every, every[::-1]))

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """The targets two rows late; those of the last rows stand in the first."""
        every = np.arange(len(pairs.hand[1]))
        return pairs.rows(every, np.roll(every, 2))


def shifted(pairs: Pairs, rows: int) -> Pairs:
    """The hand of each row with what was seen some rows later."""
    every = np.arange(len(pairs.hand[1]))
    first, last = every[: len(every) - abs(rows)], every[abs(rows) :]
    return pairs.rows(first, last) if rows > 0 else pairs.rows(last, first)
