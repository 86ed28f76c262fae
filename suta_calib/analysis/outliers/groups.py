"""Which samples belong together: landmarks, placements, sets, points, or every row by itself."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import IntArray
from suta_calib.terms.term import Term, grouped

# With fewer, "unlike the others" means nothing.
FEWEST: Final = 3


@dataclass(frozen=True, eq=False)
class Grouping:
    """A partition of a term's samples.

    Attributes:
        name: ``landmarks``, ``placements``, ``sets``, ``points`` or ``rows``.
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
    """Every partition that makes sense for a term, at least three groups each.

    Touches of an artefact: by landmark, by placement, by set (a placement gone through once).
    Touches of fixed points: by point, and row by row. What was seen from afar: row by row.
    """
    labels = term.poses.samples.labels
    found = []
    if "landmark" in labels:
        sets = np.char.add(np.char.add(labels["placement"], "/"), labels["repeat"])
        found = [
            _by("landmarks", labels["landmark"]),
            _by("placements", labels["placement"]),
            _by("sets", sets),
        ]
        if len(found[2]) == len(found[1]):
            found.pop()
    else:
        if "point" in labels:
            found.append(_by("points", labels["point"]))
        found.append(_by("rows", row_names(term)))
    return tuple(g for g in found if len(g) >= FEWEST)


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
    if "landmark" in labels:
        return "{} at {}/{}".format(*(labels[k][row] for k in ("landmark", "placement", "repeat")))
    return str(labels["point"][row]) if "point" in labels else f"row {row}"


def _by(name: str, labels: NDArray[np.str_]) -> Grouping:
    names, member = grouped(labels)
    return Grouping(name, tuple(names), member)
