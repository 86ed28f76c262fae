"""A map of the tip's uncertainty over the workspace: a vertical and a horizontal section.

In navigation it is called the map of the target registration error (TRE), of the part of it that
the arm's calibration causes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.analysis.planning.links import link_points
from suta_calib.analysis.planning.region import Region
from suta_calib.analysis.tip_sections import Knowledge, Slice, Walker, slices
from suta_calib.analysis.tip_uncertainty import sensitivity
from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.threads import single_threaded

# 3-D RMS that laboratories ask of a navigation system, m.
THRESHOLDS: Final = (0.3e-3, 0.5e-3)
_GRID: Final = 61


@dataclass(frozen=True)
class Figures:
    """3-D uncertainty of the tip over the region, m, and the share of it within `THRESHOLDS`."""

    rms: float
    median: float
    p95: float
    maximum: float
    within: tuple[float, ...]

    @classmethod
    def of(cls, std: FloatArray) -> Figures:
        """Summarise (n,) standard uncertainties."""
        return cls(
            float(np.sqrt(np.mean(std**2))),
            float(np.median(std)),
            float(np.percentile(std, 95)),
            float(std.max()),
            tuple(float(np.mean(std <= limit)) for limit in THRESHOLDS),
        )


@dataclass(frozen=True)
class OpenDirection:
    """What was held, and what it does to the registered tip if it is as far off as plausible, m."""

    fixed: str
    plausible: float
    effect: float


@dataclass(frozen=True, eq=False)
class TipMap:
    """The answer.

    Attributes:
        knowledge: what was known.
        region: the figures are for.
        place: (3,) where it was registered, the centre of the points, m.
        registration: how many points were registered.
        registered, absolute: figures over the region.
        sections: the maps.
        drawn: (joints + 2, 3) the arm in one posture, m.
        open_directions: what was held and moves the registered tip.
        axis: (3,) direction of the tip's z axis in the sections.
    """

    knowledge: Knowledge
    region: Region
    place: FloatArray
    registration: int
    registered: Figures
    absolute: Figures
    sections: tuple[Slice, ...]
    drawn: FloatArray
    open_directions: tuple[OpenDirection, ...]
    axis: FloatArray


@single_threaded
def tip_map(
    knowledge: Knowledge,
    region: Region,
    place: FloatArray,
    fiducials: FloatArray,
    postures: FloatArray,
    *,
    grid: int = _GRID,
    seed: int = 0,
) -> TipMap:
    """Predict how far the tip may be off, over the workspace and in a region of it.

    Args:
        knowledge: the calibrated arm.
        region: what the figures are for; its axis is the direction of the tool in the sections.
        place: (3,) where the registration's points are, m.
        fiducials: (k, 3) these points about their centre, m, three or more.
        postures: (n, joints) of the region.
        grid: points along each side of a section.
        seed: of the searches for postures.

    Raises:
        JobError: fewer than three registration points are within reach.
    """
    walker = Walker(knowledge, region.axis, seed)
    touched = walker.reach(place + fiducials)
    good = np.isfinite(touched).all(axis=1)
    if good.sum() < min(3, len(fiducials)) or good.sum() < 3:
        raise JobError(
            f"{int(good.sum())} of {len(fiducials)} registration points within reach about "
            "({:.0f}, {:.0f}, {:.0f}) mm".format(*(1e3 * place)),
            "at least 3",
            where="register-at",
            hint="register where the arm reaches with its tool as in the samples",
        )
    reference = knowledge.at(touched[good])
    inside = knowledge.at(postures)
    covariance = knowledge.covariance
    centre = (region.lower + region.upper) / 2
    posture = walker.reach(centre[None, :])[0]
    return TipMap(
        knowledge=knowledge,
        region=region,
        place=reference.position.mean(axis=0),
        registration=int(good.sum()),
        registered=Figures.of(inside.std(covariance, inside.registered(reference))),
        absolute=Figures.of(inside.std(covariance)),
        sections=slices(walker, region, reference, grid),
        drawn=link_points(knowledge.arm, posture if np.isfinite(posture).all() else postures[0]),
        open_directions=_open(knowledge, postures, reference.q),
        axis=region.axis,
    )


def _open(
    knowledge: Knowledge, postures: FloatArray, reference: FloatArray
) -> tuple[OpenDirection, ...]:
    """Effect of every undetermined direction on the registered tip, largest first."""
    found = []
    for fixed, direction, plausible in knowledge.open_directions:
        names = [name for name in direction if name in knowledge.arm.offered]
        step = np.array([direction[name] for name in names]) * plausible
        at, inside = (
            sensitivity(knowledge.arm, knowledge.values, names, q) for q in (reference, postures)
        )
        moved = inside.registered(at) @ step
        found.append(
            OpenDirection(fixed, plausible, float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))))
        )
    return tuple(sorted(found, key=lambda each: -each.effect))
