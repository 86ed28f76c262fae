"""Rows that are missing among the readings of a file, or among its observations."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.misreadings import MOST_FILES, Change, Misreading, files_of, out_of_step

# Parts in one of which rows may be missing; files share them.
PARTS: Final = 6


class LostRows(Misreading):
    """A file is in step up to some row, and k rows out of step from there on."""

    name = "lost rows"
    about = "Rows are missing in a file's readings, or in its observations."
    precedence = 23

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One for each file, part and number of rows."""
        files, samples = files_of(terms), [term.poses.samples for term in terms]
        parts = max(PARTS // len(files), 2)
        for file in files if len(files) <= MOST_FILES else ():
            mine = next(s for s in samples if file in s.file_names)
            rows = np.flatnonzero(mine.file_names == file)
            if len(rows) < 2 * parts:
                continue
            for count in range(1, 5 + 1):
                are = "a row is" if count == 1 else f"{count} rows are"
                # Behind the last part nothing would be out of step.
                for part, within in enumerate(np.array_split(rows, parts)[:-1]):
                    where = f"between {mine.origin[within[0]]} and {mine.origin[within[-1]]}"
                    for what, offset in (
                        ("the joints' readings", count),
                        ("the observations", -count),
                    ):
                        change = partial(out_of_step, offset, file, part, parts)
                        yield f"{are} missing among {what}, {where}", change

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Three readings missing from the middle of the fourth part on."""
        samples = term.poses.samples
        rows = np.arange(len(samples) - 3)
        start = round(len(rows) * 3.5 / PARTS)
        spoilt = replace(samples.take(rows), q=samples.q[rows + 3 * (rows >= start)])
        return "3 rows are missing among the joints' readings, between ", spoilt
