"""Which samples belong together, and touches of an artefact with each placement registered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import orth

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import register_points
from suta_calib.measurements.samples import joined
from suta_calib.terms.block import grouped
from suta_calib.terms.landmark import certified_positions
from suta_calib.terms.term import Term


@dataclass(frozen=True, eq=False)
class Grouping:
    """A partition of a term's samples into ``landmarks``, ``rows`` and so on.

    ``member`` (samples,) is the number of the group, in the order of ``labels``, of each sample.
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
    labels, by_columns = term.poses.samples.labels, dict[tuple[str, ...], Grouping]()
    for noun, columns in term.groupings.items():
        if not set(columns) <= set(labels):
            continue
        names, member = grouped(joined(labels, columns) if columns else row_names(term))
        grouping = Grouping(f"{noun}s", tuple(names), member)
        coarser = by_columns.get(columns[:-1])
        if coarser is None or len(coarser) < len(grouping):
            by_columns[columns] = grouping
    # With fewer, "unlike the others" means nothing.
    return tuple(g for g in by_columns.values() if len(g) >= 3)


def row_names(term: Term) -> NDArray[np.str_]:
    """``file.csv:12`` for every sample; with its folder where file names repeat."""
    origin = term.poses.samples.origin
    short = [PurePath(place).name for place in origin]
    if len(set(short)) == len(short):
        return np.array(short)
    counts = Counter(origin)
    return np.array([f"{o} ({k})" if counts[o] > 1 else o for k, o in enumerate(origin)])


def touch_name(term: Term, row: int) -> str:
    """What was touched, for a sentence."""
    labels = term.poses.samples.labels
    if term.touched is not None:
        return "{} at {}/{}".format(*(labels[k][row] for k in ("landmark", "placement", "repeat")))
    return str(labels[term.place][row]) if term.place else f"row {row}"


@dataclass(frozen=True, eq=False)
class Registered:
    """The touches of a term that knows an artefact, by placement."""

    term: Term  # the touches
    certified: FloatArray  # (n, 3) positions of the touched landmarks in the artefact, m
    # (n,) number of each touch's placement; of placement and landmark.
    placement: IntArray
    cell: IntArray
    used: BoolArray  # (n,) touches that decide the registration

    @classmethod
    def of(cls, term: Term, used: BoolArray) -> Registered | None:
        """None where the term knows no artefact."""
        if term.touched is None:
            return None
        certified, labels = certified_positions(term.poses, term.touched), term.poses.samples.labels
        placement = grouped(labels["placement"])[1]
        names, landmark = grouped(labels["landmark"])
        return cls(term, certified, placement, placement * len(names) + landmark, used)

    def residuals(self, values: Mapping[str, float]) -> FloatArray:
        """(n, 3) touched minus certified positions in the artefact's frame, m."""
        _, position = self.term.poses.at(values)
        residuals = np.zeros((len(position), 3))
        for rows, used in self._by_placement():
            r, p = register_points(position[used], self.certified[used])
            residuals[rows] = position[rows] @ r.T + p - self.certified[rows]
        return residuals

    def registered(self, displacements: FloatArray) -> FloatArray:
        """The same for small displacements (k, n, 3) of the touches, m, to first order."""
        found = np.zeros_like(displacements)
        for rows, used in self._by_placement():
            centre = self.certified[used].mean(axis=0)
            motion = np.linalg.pinv(rigid_columns(self.certified[used] - centre))
            there = displacements[:, used].reshape(len(found), -1)
            back = rigid_columns(self.certified[rows] - centre) @ (motion @ there.T)
            found[:, rows] = displacements[:, rows] - back.T.reshape(len(found), -1, 3)
        return found

    def _by_placement(self) -> list[tuple[IntArray, IntArray]]:
        found = []
        for k in range(int(self.placement.max()) + 1):
            rows = np.flatnonzero(self.placement == k)
            used = rows[self.used[rows]]
            found.append((rows, used if len(used) >= 3 else rows))
        return found


def rigid_columns(points: FloatArray) -> FloatArray:
    """(3 n, 6) displacements of points (n, 3) by unit translations and turns."""
    columns = np.zeros((len(points), 3, 6))
    columns[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        columns[:, :, 3 + k] = np.cross(axis, points)
    return columns.reshape(-1, 6)


def systematic(
    residual: FloatArray, rows: BoolArray, level: str, registered: Registered
) -> FloatArray:
    """(k,) the part of the residuals (k, n, 3), m, that repeating would not average away.

    Of a landmark: the length of its mean residual. Of a placement: the RMS over its landmarks of
    the mean over their repeats. Of a set: the RMS displacement of its touches by the rigid motion
    that fits them best, which is what a slip of the artefact between repeats looks like.
    """
    mine = residual[:, rows]
    if level == "landmarks":
        return np.asarray(np.linalg.norm(mine.mean(axis=1), axis=1))
    if level == "placements":
        cell = registered.cell[rows]
        means = [mine[:, cell == c].mean(axis=1) for c in np.unique(cell)]
        return np.asarray(np.sqrt(np.mean(np.sum(np.array(means) ** 2, axis=2), axis=0)))
    points = registered.certified[rows]
    basis = orth(rigid_columns(points - points.mean(axis=0)))
    along = mine.reshape(len(mine), -1) @ basis
    return np.asarray(np.sqrt(np.sum(along**2, axis=1) / rows.sum()))
