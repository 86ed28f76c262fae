"""Observations that stand in the opposite order of the readings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.sample_readings import Change, MisreadSamples, paired

DESCRIPTION = "what was seen or touched is in the opposite order"


class RowsReversed(MisreadSamples):
    """Readings of the first row of a file belong to the observation of its last, and so on."""

    name: ClassVar[str] = "rows reversed"
    about: ClassVar[str] = "Observations stand in the opposite order of the readings."
    precedence: ClassVar[int] = 21

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One."""
        del terms
        yield DESCRIPTION, backwards


def backwards(samples: Samples) -> Samples:
    """Readings with the observations of their file in the opposite order."""
    files, rows = samples.file_names, np.arange(len(samples))
    order = rows.copy()
    for file in np.unique(files):
        order[files == file] = rows[files == file][::-1]
    return paired(samples, rows, order)
