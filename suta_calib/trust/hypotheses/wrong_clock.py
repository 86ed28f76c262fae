"""Observations by a clock that runs slow or fast, or that was set while a file was written."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.misreadings import Change, Misreading, files_of, out_of_step, with_partners

# Parts of a file, in one of which a clock may have been set anew; not in the last.
SET_IN: Final = ("first", "middle", "last")


class WrongClock(Misreading):
    """The partner of row i is ever later in the file, or is k rows later from some part on."""

    name = "clock of the instrument"
    about = "The instrument's clock runs slow or fast, or was set during the recording."
    precedence = 22

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One for each number of rows, direction and part of the files."""
        several = len(files_of(terms)) > 1
        clock = "the clock of the observations"
        # Rows by which the clock is late or early at the end of a file.
        for rows in range(1, 5 + 1):
            for sign, speed in ((1, "slow"), (-1, "fast")):
                late = f"{rows} row{'s' * (rows > 1)} {'late' if sign > 0 else 'early'}"
                description = f"{clock} runs {speed}: {late} at the end"
                yield description, partial(drifted, sign * rows)
                # Of one file it is known better where: `lost_rows`.
                for part, which in enumerate(SET_IN[:-1] if several else ()):
                    description = (
                        f"{clock} was set in the {which} part of a file: {late} from there on"
                    )
                    yield description, partial(out_of_step, sign * rows, "", part, len(SET_IN))

    def fault(self, term: Term) -> tuple[str, Samples]:
        """In time at first, two rows late at the end."""
        samples = term.poses.samples
        rows = np.arange(len(samples) - 2)
        observed = samples.take(rows)
        spoilt = replace(observed, q=samples.q[rows + 3 * rows // len(samples)])
        return "the clock of the observations runs slow: 2 rows late at the end", spoilt


def drifted(last: int, samples: Samples) -> Samples:
    """Readings paired with what was observed ever later in each file, by ``last`` rows at its end.

    Rows near which another row begins to be the partner are left out: nobody knows to a row where.
    """
    files, rows = samples.file_names, np.arange(len(samples))
    partner, sure = rows.copy(), np.zeros(len(rows), dtype=np.bool_)
    for file in np.unique(files):
        mine = np.flatnonzero(files == file)
        progress = (abs(last) + 1) * (np.arange(len(mine)) + 0.5) / len(mine)
        partner[mine] += int(np.sign(last)) * np.floor(progress).astype(np.intp)
        # Before the first change, and after the last, there is nothing to be unsure of.
        change = np.clip(np.round(progress), 1, abs(last))
        # Part of the rows that are a whole row late, beside which a clock has made it another row.
        sure[mine] = np.abs(progress - change) > 0.1
    return with_partners(samples, partner, sure)
