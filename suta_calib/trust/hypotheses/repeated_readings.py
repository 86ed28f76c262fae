"""Rows in which all joints read as in another row, to the last digit, at another posture."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.measurements.samples import hashed, joined
from suta_calib.terms import Term
from suta_calib.terms.block import grouped, grouped_rows, numbered
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import may_read_alike
from suta_calib.trust.simulated_faults import with_columns


class RepeatedReadings(Pattern):
    """A bus repeats its last answer, or readings that never came are written as zeros.

    What is seen of one posture may be wrong in some of its rows, but agrees in most; and a tip that
    touches one place is not at another.
    """

    name = "repeated readings"
    about = "All joints read the same in rows that were measured in different postures."
    precedence = 12
    role = "cause"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for each term."""
        for term in terms:
            rows = _repeated(term)
            if rows.any():
                yield (
                    f"{np.sum(rows)} rows of {term.called} "
                    f"({term.poses.samples.origin[int(np.argmax(rows))]} is the first) read the "
                    "same in all joints, to the last digit, as rows of other postures. Did the bus "
                    "repeat its last answer, or do zeros stand for missing readings? Leave these "
                    "rows out."
                )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Five rows repeat the readings of the one before."""
        q = data.poses.samples.q.copy()
        q[11:16] = q[10]
        return SpoiltData(with_columns(data, q=q), effect="read the same in all joints")


def _repeated(term: Term) -> BoolArray:
    """(n,) which rows of a term read as others that were elsewhere."""
    samples = term.poses.samples
    posture = hashed(samples.q)
    none = np.zeros(len(samples), dtype=np.bool_)
    if len(np.unique(posture)) == len(samples):
        return none
    group = numbered(posture)[1]
    columns = [name for name in samples.labels if name != "repeat"]
    place = grouped(joined(samples.labels, columns))[1] if columns else np.zeros_like(group)
    # Distances, pixels and m, of what is seen from one posture that no instrument's noise makes.
    if samples.pixels is not None:
        return _scattered(group, np.nanmean(samples.pixels, axis=1), 20.0)
    if samples.position is not None:
        # What has another label may be another target, or seen from elsewhere.
        readings = term.readings(term.blocks[0])
        group = grouped_rows(np.column_stack([group, place, readings]))[0]
        return _scattered(group, samples.position, 0.01)
    if term.medium == "touch" and not samples.numbers and not may_read_alike(samples):
        return np.asarray(_extent(group, place[:, None].astype(float)) > 0)
    return none


def _scattered(group: IntArray, where: FloatArray, reach: float) -> BoolArray:
    """(n,) rows of groups (n,) most of which are farther than that from their middle, (n, d)."""
    scattered = _extent(group, where) > reach
    order = np.argsort(group, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        if not scattered[rows[0]]:
            continue
        away = np.linalg.norm(where[rows] - np.median(where[rows], axis=0), axis=1) > reach
        # Rows that read the same from which on it is their readings that are wrong, not what was
        # observed.
        scattered[rows] = len(rows) >= 3 and 2 * int(np.sum(away)) > len(rows)
    return scattered


def _extent(group: IntArray, where: FloatArray) -> FloatArray:
    """(n,) how far apart (n, d) the rows of each one's group (n,) are."""
    low, high = (np.full((group.max() + 1, where.shape[1]), end) for end in (np.inf, -np.inf))
    np.minimum.at(low, group, where)
    np.maximum.at(high, group, where)
    return np.asarray(np.linalg.norm(high - low, axis=1)[group])
