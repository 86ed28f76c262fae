"""Which visits were pushed which way, and within which of them labels may change places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.terms.block import grouped


@dataclass(frozen=True, eq=False)
class DirectionGroups:
    """Visits by direction.

    Attributes:
        names: of the k directions, in order of first appearance.
        member: (n, k) one where a visit has the direction, else zero.
        strata: rows of each protocol: labels change places within one only.
    """

    names: Sequence[str]
    member: FloatArray
    strata: Sequence[IntArray]

    @classmethod
    def of(
        cls, direction: NDArray[np.str_], protocol: NDArray[np.str_] | None = None
    ) -> DirectionGroups:
        """From labels (n,) of direction and protocol."""
        names, index = grouped(direction)
        strata = [np.arange(len(direction))]
        if protocol is not None:
            strata = [np.flatnonzero(protocol == each) for each in np.unique(protocol)]
        return cls(names, np.eye(len(names))[index], strata)

    @property
    def counts(self) -> FloatArray:
        """(k,) visits of each direction."""
        return np.asarray(self.member.sum(axis=0))

    def centred(self, values: FloatArray) -> FloatArray:
        """Values (n, c) with each protocol's mean taken out."""
        centred = values.copy()
        for rows in self.strata:
            centred[rows] -= centred[rows].mean(axis=0)
        return centred

    def means(self, values: FloatArray, order: IntArray | None = None) -> FloatArray:
        """(k, c) means of values (n, c), with the labels in another order if one is given."""
        member = self.member if order is None else self.member[order]
        return np.asarray(member.T @ values / self.counts[:, None])

    def between(self, values: FloatArray, order: IntArray | None = None) -> float:
        """Sum of squares of values (n, c) that directions explain."""
        return float(self.counts @ (self.means(values, order) ** 2).sum(axis=1))

    def shuffled(self, random: np.random.Generator) -> IntArray:
        """(n,) an order in which labels have changed places within their protocols."""
        order = np.arange(len(self.member))
        for rows in self.strata:
            order[rows] = random.permutation(rows)
        return order
