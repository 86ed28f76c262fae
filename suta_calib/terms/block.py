"""Blocks of a term: residuals of one unit, their noise, and the artefact's part in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.measurements import Artefact
from suta_calib.terms.sample_errors import SampleErrors
from suta_calib.units import Unit


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform in CasADi symbols: rotation (3, 3) and position (3), m."""

    R: Symbol
    p: Symbol

    def inverse_act(self, point: Symbol) -> Symbol:
        """Coordinates, in this frame, of a point given in the outer one."""
        return self.R.T @ (point - self.p)


def pose_of(unknowns: Symbol) -> Pose:
    """A pose from six own unknowns: x y z (m) and the rotation vector rx ry rz (rad)."""
    return Pose(symbolic_rotation(unknowns[3:6]), unknowns[0:3])


Residual = Callable[[Sequence[Pose], Symbol, Symbol], Symbol]


@dataclass(frozen=True)
class Noise:
    """Noise of a block's residuals, and the threshold of the robust loss.

    Attributes:
        sigma: standard deviation of one component, m or rad; None to learn it from the data.
        huber: residual norm, m or rad, beyond which the cost grows linearly; inf for plain least
            squares.
        fixed: whether the data have no say in sigma.
    """

    sigma: float | None = None
    huber: float = math.inf
    fixed: bool = False

    def __post_init__(self) -> None:
        # Metres or radians below which nothing is measured, and whose squares are lost in rounding.
        least_sigma = 1e-12
        for name, size in (("sigma", self.sigma), ("huber", self.huber)):
            if size is not None and not (isinstance(size, Real) and size >= least_sigma):
                expected = f"a number greater than {least_sigma:g}"
                raise ParameterError(repr(size), expected, where=f"Noise: {name}")


# Least squares, and a scatter that is learnt.
LEARNT: Final = Noise()


@dataclass(frozen=True, eq=False)
class Certified:
    """Certified coordinates, whose errors all touches of a landmark share.

    Attributes:
        keys: what identifies a landmark, also in another term over the same artefact.
        sigma: (marks,) standard deviation of each coordinate, m.
        marks: (n, k) which landmarks each row looks at.
        derivative: (n, d, k, 3) of the residual by their coordinates in the artefact.
    """

    keys: tuple[tuple[Any, ...], ...]
    sigma: FloatArray
    marks: IntArray
    derivative: FloatArray

    @classmethod
    def of(
        cls, artefact: Artefact, touched: NDArray[Any], rows: IntArray, derivative: FloatArray
    ) -> Certified:
        """The artefact's part in a block whose rows look at some samples (n, k).

        ``touched`` (samples,) names the landmarks; the derivative (n, d, k, 3) is of the residual
        by their coordinates.
        """
        names, number = grouped(touched)
        landmarks = [artefact.landmark(name) for name in names]
        keys = tuple((artefact.name, mark.name, *mark.position.tolist()) for mark in landmarks)
        sigma = np.array([mark.sigma for mark in landmarks])
        return cls(keys, sigma, number[rows], derivative)


@dataclass(frozen=True, eq=False)
class Block(Displayable):
    """Residuals of one unit and dimension, one row an observation.

    Attributes:
        name: ``distance``, ``position`` or ``rotation``.
        unit: m or rad.
        size: numbers in one residual, d.
        residual: the residual of one row in CasADi symbols.
        samples: (n, k) which k samples' poses each row looks at.
        own_columns: (n, m) which of the term's own parameters each row looks at, in the residual's
            order.
        data: (n, c) what was measured or certified.
        noise: scatter and robustness.
        known_sigma: (n,) standard deviation per row that is known beforehand, added in quadrature.
        labels: (n,) what a person calls the row.
        certified: the artefact's part in the residuals, where there is an artefact.
        pixel: length that a pixel covers, m, where residuals are what was seen in a picture.
        relative: (n, d) standard deviations that the rows state, over `typical`, by which the
            residual has been divided; (1, 1) of one where they state none.
        lag: (n,) how much later than its sample each row was seen, in units of an own unknown of
            the term's clock, such as rows of a picture; None where all rows are of one moment.
        typical: what rows of the whole set typically state, m or rad; one where they state none.
        assumed: standard deviation of a component where `noise` says none, m or rad; None for that
            of any block of its unit.
        sample_errors: what the rows of a sample err by together, beside their own errors; only of
            rows that look at one sample each, without a lag, and at the same own parameters.
    """

    name: str
    unit: Unit
    size: int
    residual: Residual
    samples: IntArray
    own_columns: IntArray
    data: FloatArray
    noise: Noise
    known_sigma: FloatArray
    labels: tuple[str, ...] = field(repr=False)
    certified: Certified | None = None
    pixel: float | None = None
    relative: FloatArray = field(default_factory=lambda: np.ones((1, 1)))
    typical: float = 1.0
    lag: FloatArray | None = None
    assumed: float | None = None
    sample_errors: SampleErrors | None = None

    @classmethod
    def per_sample(
        cls,
        name: str,
        unit: Unit,
        size: int,
        residual: Residual,
        own_columns: IntArray,
        data: FloatArray,
        noise: Noise,
        labels: Iterable[str],
    ) -> Block:
        """One row for each sample, of which nothing is certified."""
        n = len(data)
        rows, certain = np.arange(n)[:, None], np.zeros(n)
        names = labels.tolist() if isinstance(labels, np.ndarray) else map(str, labels)
        return cls(
            name, unit, size, residual, rows, own_columns, data, noise, certain, tuple(names)
        )

    def __len__(self) -> int:
        return len(self.samples)


def joined(*groupings: IntArray) -> IntArray:
    """(n,) the groups that are left, from 0, where rows of one group of any grouping are together.

    Args:
        groupings: (n,) each, group of every row, from 0.
    """
    first = np.arange(len(groupings[0]))
    while True:
        before = first
        for groups in groupings:
            least = np.full(groups.max(initial=-1) + 1, len(first))
            np.minimum.at(least, groups, first)
            first = least[groups]
        # Whoever has been led on takes along the row that it followed, and all who follow that.
        np.minimum.at(first, before, first)
        first = first[first]
        if np.array_equal(first, before):
            return np.asarray(np.unique(first, return_inverse=True)[1], dtype=np.intp)


def grouped(labels: NDArray[Any]) -> tuple[list[str], IntArray]:
    """Distinct labels in order of first appearance, and which of them each row has."""
    names, number = numbered(labels)
    return [str(name) for name in names], number


def numbered(values: NDArray[Any]) -> tuple[NDArray[Any], IntArray]:
    """Distinct values (k,) in order of first appearance, and which of them each row (n,) has."""
    distinct, first, inverse = np.unique(values, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return distinct[order], rank[inverse].astype(np.intp)


def same_touches(placement: NDArray[Any], landmark: NDArray[Any], repeat: NDArray[Any]) -> IntArray:
    """(n,) one number for all rows, by these labels (n,), that are repeats of the same touch.

    The k-th touch of a landmark in one repeat pairs with the k-th in another.
    """
    places, marks, repeats = (numbered(column)[1] for column in (placement, landmark, repeat))
    mark = places * (marks.max(initial=0) + 1) + marks
    # Rows of one mark and repeat one after the other, each with its place among them.
    order = np.lexsort((repeats, mark))
    same = (np.diff(mark[order]) == 0) & (np.diff(repeats[order]) == 0)
    began = np.flatnonzero(np.concatenate([[True], ~same]))
    place = np.empty_like(order)
    place[order] = np.arange(len(order)) - np.repeat(began, np.diff([*began, len(order)]))
    return numbered(mark * (place.max(initial=0) + 1) + place)[1]


def grouped_rows(members: IntArray) -> tuple[IntArray, IntArray]:
    """Which of the different sets of members (n, k) each row has, (n,), and how often each is."""
    numbers = _numbered(np.sort(members, axis=1))
    _, group, count = np.unique(numbers, axis=0, return_inverse=True, return_counts=True)
    return group.reshape(-1).astype(np.intp), count.astype(np.intp)


def first_of_each(rows: IntArray) -> IntArray:
    """(k,) where each of the different rows (n, w) of numbers from 0 on is met first."""
    return np.unique(_numbered(rows), axis=0, return_index=True)[1].astype(np.intp)


def _numbered(rows: IntArray) -> IntArray:
    """Rows (n, w) of numbers from 0 on as one number (n,) each, in the order of the rows.

    Sorting numbers takes a tenth of sorting rows; these are left where no number is so large.
    """
    sizes = [int(most) + 1 for most in rows.max(axis=0, initial=0)]
    if math.prod(sizes) >= np.iinfo(np.intp).max:
        return rows
    places = np.cumprod([1, *sizes[:0:-1]], dtype=np.intp)[::-1]
    return np.asarray(rows @ places[: rows.shape[1]])


def summed(rows: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Sums (count, w) of rows (n, w) over each of ``count`` groups (n,)."""
    if len(rows) == count and np.array_equal(group, np.arange(count)):
        return rows.copy()  # each a group of its own
    ones, pointer = np.ones(len(rows)), np.arange(len(rows) + 1)
    return np.asarray(csc_array((ones, group, pointer), (count, len(rows))) @ rows)


def flat(matrices: FloatArray) -> FloatArray:
    """Matrices (n, r, c) as rows (n, r·c), column by column, as CasADi reshapes."""
    n, r, c = matrices.shape
    return np.swapaxes(matrices, 1, 2).reshape(n, r * c)


def norm(vector: Symbol) -> Symbol:
    """Euclidean norm of a CasADi vector."""
    return ca.sqrt(ca.dot(vector, vector))
