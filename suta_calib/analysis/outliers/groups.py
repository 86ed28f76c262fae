"""Which samples belong together: landmarks, placements, sets, points, or every row by itself."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import IntArray
from suta_calib.terms.block import grouped
from suta_calib.terms.term import Term, joined

# With fewer, "unlike the others" means nothing.
FEWEST: Final = 3


@dataclass(frozen=True, eq=False)
class Grouping:
    """A partition of a term's samples.

    Attributes:
        name: what one group is called, in the plural: ``landmarks``, ``rows``.
        labels: of the groups.
        member: (samples,) number of the group each sample is in.
    """

    name: str
    labels: tuple[str, ...]
    member: IntArray

    def __len__(self) -> int:
        return len(self.labels)

    def rows(self, group: int) -> NDArray[np.bool_]:
        """(samples,) which samples are in a group."""
        return np.asarray(self.member == group)


def groupings(term: Term) -> tuple[Grouping, ...]:
    """Every partition that the term's kind knows, at least three groups each.

    Sets, where every placement was gone through once, are placements.
    """
    labels, found = term.poses.samples.labels, dict[tuple[str, ...], Grouping]()
    for noun, columns in term.groupings.items():
        names, member = grouped(joined(labels, columns) if columns else row_names(term))
        grouping = Grouping(f"{noun}s", tuple(names), member)
        coarser = found.get(columns[:-1])
        if coarser is None or len(coarser) < len(grouping):
            found[columns] = grouping
    return tuple(g for g in found.values() if len(g) >= FEWEST)


def row_names(term: Term) -> NDArray[np.str_]:
    """``file.csv:12`` for every sample; with its folder where file names repeat."""
    origin = term.poses.samples.origin
    short = [PurePath(place).name for place in origin]
    if len(set(short)) == len(short):
        return np.array(short)
    full = list(origin)
    seen = Counter(full)
    return np.array([f"{o} ({k})" if seen[o] > 1 else o for k, o in enumerate(full)])


def touch_name(term: Term, row: int) -> str:
    """What was touched, for a sentence."""
    labels = term.poses.samples.labels
    if term.touched is not None:
        return "{} at {}/{}".format(*(labels[k][row] for k in ("landmark", "placement", "repeat")))
    return str(labels[term.place][row]) if term.place else f"row {row}"
