"""One of several files whose observations are one row too late or too early."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.misreadings import MOST_FILES, Change, Misreading, files_of, slid


class FileLate(Misreading):
    """`RowsLate` in one of several files, by one row."""

    name = "rows of a file late"
    about = "All observations of one file are one row too late or too early."
    precedence = 24

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """Two for each file."""
        files = files_of(terms)
        for file in files if 1 < len(files) <= MOST_FILES else ():
            for direction, offset in (("late", 1), ("early", -1)):
                description = f"the observations are one row {direction} in {file}"
                yield description, partial(slid, offset, file)

    def fault(self, term: Term) -> tuple[str, Samples]:
        """The first of two files one row late."""
        samples = term.poses.samples
        half = len(samples) // 2
        rows = (f"{'ab'[row >= half]}.csv:{row + 2}" for row in range(len(samples)))
        split = replace(samples, origin=tuple(rows))
        return "the observations are one row late in a.csv", slid(-1, "a.csv", split)
