"""Which landmarks the samples taken so far are of, where some may have been missed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement
from typing import Final

import numpy as np

from suta_calib.acquisition.seating_check import ANOTHER, SeatingCheck
from suta_calib.arrays import FloatArray

# As many landmarks can be told from others.
CERTAIN: Final = 4
# So many times better other names must fit.
_CLEARLY: Final = 3.0
_MOST_MISSED: Final = 3


def likelier(
    seating: SeatingCheck, names: Sequence[str], taken: Sequence[int], tips: Sequence[FloatArray]
) -> tuple[int, ...] | None:
    """Places in the sequence that samples belong to rather than to those they were taken for.

    Landmarks are touched in their order, and at most three are missed. The names that they were
    given stand unless they are impossible and others fit far better.

    Args:
        seating: gives the artefact.
        names: of the landmarks, in their order.
        taken: places in ``names`` the samples were taken for, increasing.
        tips: (3,) of each sample, m.

    Returns:
        Other places, increasing; None where those given stand, or where nothing can be said.
    """
    count = len(tips)
    if count < CERTAIN:
        return None

    def misfit(places: Sequence[int]) -> float:
        """How badly the samples are those landmarks, m."""
        return seating.disagreement([names[k] for k in places], tips)

    now = misfit(taken)
    if now <= ANOTHER:
        return None
    later = min(_shifted(count, len(names)), key=misfit)
    if _CLEARLY * misfit(later) < now:
        return later
    # Among so many some fit by chance: they must fit as an arm does that needs no calibration yet.
    best = min(_increasing(count, len(names)), key=misfit)
    return best if _CLEARLY * misfit(best) < now and misfit(best) < ANOTHER else None


def _shifted(count: int, of: int) -> Iterator[tuple[int, ...]]:
    """So many places one after the other, after the first few."""
    for missed in range(min(_MOST_MISSED, of - count) + 1):
        yield tuple(range(missed, missed + count))


def _increasing(count: int, of: int) -> Iterator[tuple[int, ...]]:
    """So many places with few left out before the last."""
    most = min(_MOST_MISSED, of - count)
    for missed in combinations_with_replacement(range(most + 1), count):
        yield tuple((np.arange(count) + missed).tolist())
