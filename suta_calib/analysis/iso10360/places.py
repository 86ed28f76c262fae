"""One place found again and again: from other articulations, by probing a sphere, or repeatedly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suta_calib.analysis.iso10360.spheres import best_sphere, smallest_sphere
from suta_calib.analysis.repeatability import PositionScatter
from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.terms.block import grouped


@dataclass(frozen=True, eq=False)
class Articulation:
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
    found = []
    for name in grouped(point)[0]:
        rows = np.flatnonzero(point == name)
        labels = None if articulation is None else articulation[rows]
        found.append(_articulation(name, position[rows], labels, sphere=sphere))
    return tuple(found)


def _articulation(
    point: str, position: FloatArray, labels: NDArray[np.str_] | None, *, sphere: bool
) -> Articulation:
    names, index = [str(k + 1) for k in range(len(position))], np.arange(len(position))
    if labels is not None:
        names, index = grouped(labels)
    if len(names) < 2:
        raise SamplesError(
            f"point {point!r} from {len(names)} articulation",
            "every point from several",
            where="articulation",
        )
    places = [position[index == k] for k in range(len(names))]
    where = [f"point {point!r}, articulation {name!r}" for name in names]
    centres, amplification = np.array([each.mean(axis=0) for each in places]), 0.0
    if sphere:
        fitted = [best_sphere(*each) for each in zip(places, where, strict=True)]
        centres = np.array([each.centre for each in fitted])
        amplification = max(each.amplification for each in fitted)
    away = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    return Articulation(
        point,
        tuple(names),
        centres,
        2 * smallest_sphere(centres).radius,
        away,
        2 * float(np.sqrt(np.sum(away**2) / (len(away) - 1))),
        np.ptp(centres, axis=0),
        len(position),
        amplification,
    )


@dataclass(frozen=True, eq=False)
class SphereProbing:
    """One sphere probed in one place; lengths in m.

    Attributes:
        sphere: its label.
        radial: (n,) distance of every touch to the fitted centre, less the fitted radius.
        size: diameter of the sphere with the least squares, less the calibrated one: P_Size.
        form: largest less smallest radial distance: P_Form.
    """

    sphere: str
    radial: FloatArray
    size: float
    form: float


def probings(
    position: FloatArray, sphere: NDArray[np.str_], diameter: float
) -> tuple[SphereProbing, ...]:
    """Size and form errors of probing.

    Args:
        position: (n, 3) of the tip's centre at every touch, m.
        sphere: (n,) labels of the places it stood in.
        diameter: of the sphere on which the tip's centre lies: calibrated, plus the stylus', m.
    """
    found = []
    for name in grouped(sphere)[0]:
        points = position[sphere == name]
        fitted = best_sphere(points, f"sphere {name!r}")
        radial = np.linalg.norm(points - fitted.centre, axis=1) - fitted.radius
        size = 2 * fitted.radius - diameter
        found.append(SphereProbing(name, radial, float(size), float(np.ptp(radial))))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Repeats:
    """Repeated visits to one point; lengths in m.

    Attributes:
        point: its label.
        scatter: position repeatability.
        diameter: of the smallest sphere that holds the visits.
    """

    point: str
    scatter: PositionScatter
    diameter: float


def repeats(position: FloatArray, point: NDArray[np.str_]) -> tuple[Repeats, ...]:
    """Repeatability of probing every point (labels (n,)) of positions (n, 3).

    Raises:
        SamplesError: a point visited fewer than three times.
    """
    return tuple(_repeats(name, position[point == name]) for name in _names(point))


def _repeats(name: str, visits: FloatArray) -> Repeats:
    if len(visits) < 3:
        raise SamplesError(
            f"{len(visits)} visits to point {name!r}", "at least 3", where="repeatability"
        )
    return Repeats(name, PositionScatter.of(visits), 2 * smallest_sphere(visits).radius)


def _names(labels: NDArray[np.str_]) -> Sequence[str]:
    return grouped(labels)[0]
