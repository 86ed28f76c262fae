"""Rows whose observation stands some rows too late or too early."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import ClassVar, Final

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.sample_readings import Change, MisreadSamples, slid

# Rows by which observations may be late: beyond a few the usual cause is a file in another order,
# which is a hypothesis of its own.
SHIFTS: Final = 20


class RowsLate(MisreadSamples):
    """Readings of row i belong to the observation of row i + k, in all files or in one."""

    name: ClassVar[str] = "rows late"
    about: ClassVar[str] = "Observations stand some rows too late or too early, all by the same."
    precedence: ClassVar[int] = 20

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """Two for each number of rows."""
        del terms
        for rows in range(1, SHIFTS + 1):
            count = "one row" if rows == 1 else f"{rows} rows"
            for description, offset in ((f"{count} late", rows), (f"{count} early", -rows)):
                yield f"what was seen or touched is {description}", partial(slid, offset, "")

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Observations two rows late."""
        samples = term.poses.samples
        return "what was seen or touched is 2 rows late", slid(-2, "", samples)
