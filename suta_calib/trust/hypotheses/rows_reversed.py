"""Observations that are in the opposite order of the readings."""

from collections.abc import Iterator, Sequence

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.misreadings import Change, Misreading, paired

DESCRIPTION = "the observations are in the opposite order"


class RowsReversed(Misreading):
    """Readings of the first row of a file belong to the observation of its last, and so on."""

    name = "rows reversed"
    about = "Observations are in the opposite order of the readings."
    precedence = 21

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One."""
        yield DESCRIPTION, backwards


def backwards(samples: Samples) -> Samples:
    """Readings with the observations of their file in the opposite order."""
    files, rows = samples.file_names, np.arange(len(samples))
    order = rows.copy()
    for file in np.unique(files):
        order[files == file] = rows[files == file][::-1]
    return paired(samples, rows, order)
