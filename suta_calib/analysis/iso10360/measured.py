"""Measurements of an acceptance test: lengths, one point visited repeatedly, spheres."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from suta_calib.analysis.repeatability import PositionScatter
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.terms import Term
from suta_calib.terms.block import grouped

_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Sphere(Displayable):
    """A sphere.

    Attributes:
        centre: (3,) m.
        radius: m.
        amplification: standard uncertainty of a fitted centre (3-D) per that of a touch; 0 where
            the sphere was not fitted.
    """

    centre: FloatArray
    radius: float
    amplification: float = 0.0


def smallest_sphere(points: FloatArray) -> Sphere:
    """The smallest sphere that holds points (n, 3), m.

    Grows from the points it must pass through (Gärtner 1999, doi:10.1007/3-540-48481-7_29): the
    farthest point outside joins them, and the smallest sphere of at most five is found outright.
    """
    support = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while True:
        sphere, support = _of_few(points, support)
        away = np.linalg.norm(points - sphere.centre, axis=1)
        farthest = int(np.argmax(away))
        if away[farthest] <= sphere.radius * (1 + _ROUNDING) + 1e-15 or farthest in support:
            return sphere
        support = [*support, farthest]


def _of_few(points: FloatArray, chosen: list[int]) -> tuple[Sphere, list[int]]:
    """Smallest sphere of a few points, and which of them it passes through."""
    best: tuple[Sphere, list[int]] | None = None
    for size in range(1, min(len(chosen), 4) + 1):
        for subset in combinations(chosen, size):
            sphere = _through(points[list(subset)])
            away = np.linalg.norm(points[chosen] - sphere.centre, axis=1)
            holds = (away <= sphere.radius * (1 + _ROUNDING) + 1e-15).all()
            if holds and (best is None or sphere.radius < best[0].radius):
                best = sphere, list(subset)
    assert best is not None, "some sphere through at most four points holds them all"
    return best


def _through(points: FloatArray) -> Sphere:
    """The smallest sphere through points (n, 3), n at most four: its centre lies among them."""
    sides = points[1:] - points[0]
    share = np.linalg.lstsq(2 * sides @ sides.T, (sides**2).sum(axis=1), rcond=None)[0]
    offset = sides.T @ share
    return Sphere(points[0] + offset, float(np.linalg.norm(offset)))


def best_sphere(points: FloatArray, where: str = "") -> Sphere:
    """The sphere with the least squares of distances to points (n, 3), n at least four.

    Raises:
        SamplesError: too few points, or points that lie in a plane.
    """
    least_points = 4
    if len(points) < least_points:
        raise SamplesError(
            f"{len(points)} points on the sphere", f"at least {least_points}", where=where
        )
    middle = points.mean(axis=0)
    away = points - middle
    sizes = np.linalg.svd(away, compute_uv=False)
    # Points nearer to a plane than this share of their extent leave the sphere undetermined.
    if sizes[2] < 1e-3 * sizes[0]:
        raise SamplesError(
            "points in one plane", "points that are spread over the sphere", where=where
        )
    rows = np.column_stack([2 * away, np.ones(len(away))])
    start = np.linalg.lstsq(rows, (away**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(max(float(start[3] + start[:3] @ start[:3]), 0.0))
    scale = float(sizes[0])
    solution = least_squares(
        lambda x: (np.linalg.norm(away - x[:3] * scale, axis=1) - x[3] * scale) / scale,
        np.append(start[:3], radius) / scale,
        **dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15),
    ).x * scale  # fmt: skip
    centre = middle + solution[:3]
    # How much less sure a centre is than a touch; a pole and four places on the equator give 1.5.
    normals = (points - centre) / np.linalg.norm(points - centre, axis=1, keepdims=True)
    inverse = np.linalg.pinv(np.column_stack([normals, np.ones(len(normals))]))
    return Sphere(centre, float(solution[3]), float(np.linalg.norm(inverse[:3])))


@dataclass(frozen=True, eq=False)
class LengthErrors(Displayable):
    """Measured minus calibrated length of every pair of landmarks of one placement and repeat.

    Attributes:
        label: (n,) the pair, such as ``O-M1``.
        placement, repeat: (n,) labels.
        length: (n,) calibrated, m.
        error: (n,) measured minus calibrated, m.
        calibration_std: (n,) standard uncertainty of the calibrated length, m.
    """

    label: NDArray[np.str_]
    placement: NDArray[np.str_]
    repeat: NDArray[np.str_]
    length: FloatArray
    error: FloatArray
    calibration_std: FloatArray

    @classmethod
    def of(cls, term: Term) -> LengthErrors:
        """Over the poses of distances between landmarks, the arm held as it is."""
        block = term.blocks[0]
        _, position = term.poses.at({})
        first, second = block.samples.T
        measured = np.linalg.norm(position[first] - position[second], axis=1)
        labels, length = term.poses.samples.labels, block.data[:, 0]
        return cls(
            np.array(block.labels),
            labels["placement"][first],
            labels["repeat"][first],
            length,
            measured - length,
            block.known_sigma,
        )

    @classmethod
    def joined(cls, parts: Sequence[LengthErrors]) -> LengthErrors:
        """Those of several artefacts, one after the other."""
        columns = [[getattr(part, entry.name) for part in parts] for entry in fields(cls)]
        return cls(*map(np.concatenate, columns))

    def __len__(self) -> int:
        return len(self.error)

    @property
    def lines(self) -> int:
        """How many different lengths there are: each pair of landmarks at each placement."""
        return len(self._repeats())

    @property
    def repeat_range(self) -> float | None:
        """Largest range of a length's errors over the repeats of one placement, m."""
        return max((max(e) - min(e) for e in self._repeats().values() if len(e) > 1), default=None)

    def _repeats(self) -> dict[tuple[str, ...], list[float]]:
        """Errors of each pair at each placement, whichever of the two was touched first."""
        by_pair: dict[tuple[str, ...], list[float]] = {}
        for placement, label, error in zip(self.placement, self.label, self.error, strict=True):
            by_pair.setdefault((placement, *sorted(label.split("-"))), []).append(float(error))
        return by_pair

    def by_placement(self) -> Iterator[tuple[str, IntArray]]:
        """Rows of each placement."""
        for name in grouped(self.placement)[0]:
            yield name, np.flatnonzero(self.placement == name)


@dataclass(frozen=True, eq=False)
class Articulation(Displayable):
    """One point found from several articulations of the arm; lengths in m.

    Attributes:
        point: its label.
        names: (k,) of the articulations; of the rows where there is no such column.
        centres: (k, 3) where each found it, in the base.
        diameter: of the smallest sphere that holds the centres: the location error L_Dia.
        deviations: (k,) distance of each centre to their mean.
        two_sigma: ``2 √(Σ d² / (k - 1))`` of these, as ASME B89.4.22 states single-point
            articulation.
        axis_range: (3,) range along the base's axes.
        touches: rows that went into it.
        amplification: largest of the fitted spheres', 0 for seats: how much less sure a centre is
            than a touch.
    """

    point: str
    names: tuple[str, ...]
    centres: FloatArray
    diameter: float
    deviations: FloatArray
    two_sigma: float
    axis_range: FloatArray
    touches: int
    amplification: float = 0.0

    @property
    def maximum(self) -> float:
        """Largest deviation from the mean, m."""
        return float(self.deviations.max())


def articulations(
    position: FloatArray,
    point: NDArray[np.str_],
    articulation: NDArray[np.str_] | None = None,
    *,
    sphere: bool = False,
) -> tuple[Articulation, ...]:
    """The points of a single-point articulation test.

    Args:
        position: (n, 3) of the tip, m.
        point: (n,) labels.
        articulation: (n,) labels; touches of one are averaged. Without it each row is one.
        sphere: the rows of an articulation are points on a sphere, whose centre counts.

    Raises:
        SamplesError: a point with fewer than two articulations, or a sphere that its rows do not
            determine.
    """
    points = []
    for name in grouped(point)[0]:
        rows = np.flatnonzero(point == name)
        names, index = [str(k + 1) for k in range(len(rows))], np.arange(len(rows))
        if articulation is not None:
            names, index = grouped(articulation[rows])
        if len(names) < 2:
            raise SamplesError(
                f"point {name!r} from {len(names)} articulation",
                "several articulations for every point",
                where="articulation",
            )
        places = [position[rows[index == k]] for k in range(len(names))]
        centres, amplification = np.array([touches.mean(axis=0) for touches in places]), 0.0
        if sphere:
            where = [f"point {name!r}, articulation {label!r}" for label in names]
            fitted = [best_sphere(*named) for named in zip(places, where, strict=True)]
            centres = np.array([sphere.centre for sphere in fitted])
            amplification = max(sphere.amplification for sphere in fitted)
        away = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
        points.append(
            Articulation(
                name,
                tuple(names),
                centres,
                2 * smallest_sphere(centres).radius,
                away,
                2 * float(np.sqrt(np.sum(away**2) / (len(away) - 1))),
                np.ptp(centres, axis=0),
                len(rows),
                amplification,
            )
        )
    return tuple(points)


@dataclass(frozen=True, eq=False)
class SphereProbing(Displayable):
    """One sphere probed in one place; lengths in m.

    Attributes:
        sphere: its label.
        radial: (n,) distance of every touch to the fitted centre, less the fitted radius.
        size: diameter of the sphere with the least squares, less the calibrated one: P_Size.
        form: largest less smallest radial distance: P_Form.
        amplification: how much less sure the fitted centre is than a touch.
    """

    sphere: str
    radial: FloatArray
    size: float
    form: float
    amplification: float


def probings(
    position: FloatArray, sphere: NDArray[np.str_], diameter: float
) -> tuple[SphereProbing, ...]:
    """Size and form errors of probing.

    Args:
        position: (n, 3) of the tip's centre at every touch, m.
        sphere: (n,) labels of the places it stood in.
        diameter: of the sphere on which the tip's centre lies: calibrated, plus the stylus', m.
    """
    spheres = []
    for name in grouped(sphere)[0]:
        points = position[sphere == name]
        fitted = best_sphere(points, f"sphere {name!r}")
        radial = np.linalg.norm(points - fitted.centre, axis=1) - fitted.radius
        size = 2 * fitted.radius - diameter
        form = float(np.ptp(radial))
        spheres.append(SphereProbing(name, radial, size, form, fitted.amplification))
    return tuple(spheres)


@dataclass(frozen=True, eq=False)
class RepeatedVisits(Displayable):
    """Repeated visits to one point; lengths in m.

    Attributes:
        point: its label.
        scatter: position repeatability.
        diameter: of the smallest sphere that holds the visits.
    """

    point: str
    scatter: PositionScatter
    diameter: float


def repeats(position: FloatArray, point: NDArray[np.str_]) -> tuple[RepeatedVisits, ...]:
    """Repeatability of probing every point (labels (n,)) of positions (n, 3).

    Raises:
        SamplesError: a point visited fewer than three times.
    """
    visited = []
    for name in grouped(point)[0]:
        visits = position[point == name]
        if len(visits) < 3:
            raise SamplesError(
                f"{len(visits)} visits to point {name!r}", "at least 3", where="repeatability"
            )
        diameter = 2 * smallest_sphere(visits).radius
        visited.append(RepeatedVisits(name, PositionScatter.of(visits), diameter))
    return tuple(visited)
