"""A map of the tip's uncertainty over the workspace: a vertical and a horizontal section.

In navigation it is called the map of the target registration error (TRE), of the part of it that
the arm's calibration causes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.spatial import KDTree

from suta_calib import analysis, plotting
from suta_calib.analysis.planning import Region, Situation
from suta_calib.analysis.planning.candidates import DOWN
from suta_calib.analysis.tip_sections import Knowledge, Slice, Walker, slices
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.solver.solution import Solution
from suta_calib.threads import single_threaded
from suta_calib.trust.tip import taken_as_cool
from suta_calib.units import Unit, mm, shown, text, unit_name
from suta_calib.words import listed

# 3-D RMS that laboratories require of a navigation system, m.
THRESHOLDS: Final = (0.3e-3, 0.5e-3)
_GRID: Final = 61
FEWEST_FIDUCIALS: Final = 3


@dataclass(frozen=True, eq=False)
class TipMapOptions(Displayable):
    """Options of a tip map.

    Attributes:
        box: (2, 3) corners of the region in the base, m; by default around what was touched.
        place: (3,) point around which the registration is done, m; by default amid what was
            touched, or in the box.
        tolerance: the RMS over the region that is good enough, m; None where any is.
        grid: points along each side of a section.
        seed: of the searches for postures.
        chain: which is mapped, of a robot with several.
    """

    box: FloatArray | None = None
    place: FloatArray | None = None
    tolerance: float | None = None
    grid: int = _GRID
    seed: int = 0
    chain: str = ""


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
    """A held parameter, its possible error (m, rad), and the RMS error of the tip that follows, m.

    The tip is registered, and its error is that over the region.
    """

    fixed: str
    plausible: float
    effect: float
    unit: Unit


@dataclass(frozen=True, eq=False, repr=False)
class TipMap(Displayable):
    """The uncertainty of the tip in a region and over the workspace.

    Attributes:
        knowledge: what was known.
        region: the figures are for.
        place, registration: (3,) where it was registered, m, at how many points.
        registered, absolute: figures over the region.
        sections: the maps.
        drawn: (joints + 2, 3) the arm in one posture, m.
        open_directions: what was held and moves the registered tip.
        axis: (3,) direction of the tip's z axis in the sections.
        tolerance: as in `TipMapOptions`.
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
    tolerance: float | None = None

    @property
    def in_a_line(self) -> str:
        """How sure the tip is."""
        return self.assessment.sentence

    def plot(self, figure: Any = None, *, absolute: bool = False) -> Any:
        """Draw the map over the arm, from the side and from above, mm.

        Args:
            figure: an empty `Figure` or `SubFigure`; a new one by default.
            absolute: the uncertainty in the base frame instead of that after registration.

        Returns:
            The figure.
        """
        figure = plotting.figure_or_new(figure, (9.7, 5.4))
        analysis.draw_tip_map(figure, self, absolute=absolute)
        return figure

    @property
    @judged
    def assessment(self) -> Assessment:
        """The uncertainty of the tip, whether it is small enough, and what it does not include."""
        rms, p95 = (text(size, "m") for size in (self.registered.rms, self.registered.p95))
        sentence = (
            f"Uncertainty of the tip from the calibration: {rms} mm (3-D RMS in the region, "
            f"after registration; 95 % within {p95} mm)"
        )
        bad = []
        if self.tolerance is not None and self.registered.rms > self.tolerance:
            bad.append(f"This exceeds the allowed {mm(self.tolerance):.3g} mm.")
        # What moves the registered tip by less than a twentieth of what is estimated is nothing.
        care = [
            f"{open_one.fixed} is held at an assumed value, not measured, and its error is not "
            "included in these figures. If it is wrong by "
            f"{shown(open_one.plausible, open_one.unit):.3g} {unit_name(open_one.unit)}, the tip "
            f"is wrong by {mm(open_one.effect):.3g} mm. The command 'plan' shows how to measure "
            "it."
            for open_one in self.open_directions
            if open_one.effect > 0.05 * self.registered.rms
        ]
        if (held := self.knowledge.fixed) and not self.knowledge.open_directions:
            care.append(
                "Held at assumed values, not measured, and not included in these figures: "
                f"{listed(held)}. The result does not contain their effect on the tip: calibrate "
                "again, or give the job instead of the result."
            )
        if self.registered.rms > THRESHOLDS[-1]:
            limits = " to ".join(f"{mm(limit):g}" for limit in THRESHOLDS)
            care.append(f"Laboratories require {limits} mm of the whole navigation system.")
        if sensors := self.knowledge.arm.tilt_sensors:
            links = listed([sensor.link for sensor in sensors])
            care.append(
                f"These figures are without the tilt sensors of {links}: "
                "with their readings, what leans these links in the model does not move the tip."
            )
        if cool := taken_as_cool(self.knowledge.arm.offered, self.knowledge.values):
            care.append(cool)
        return Assessment.of(sentence, bad=bad, care=care)


@checked
def tip_map_of_solution(solution: Solution, options: TipMapOptions) -> TipMap:
    """The map of a calibration, with its tool directions, registered on its artefact.

    Args:
        solution: a converged one, over an arm.
        options: what is asked for.

    Raises:
        JobError: the region has no volume, the arm reaches next to nothing of it, or fewer than
            three registration points.
    """
    situation = Situation.of(solution.problem, solution, chain=options.chain)
    region = Region.around(situation)
    if options.box is not None:
        region = Region.box(options.box[0], options.box[1], situation)
    fiducials, artefact = _corners(), situation.artefact
    if artefact is not None and len(artefact.landmarks) >= len("xyz"):
        certified = np.array([mark.position for mark in artefact.landmarks.values()])
        fiducials = certified - certified.mean(axis=0)
    knowledge = Knowledge.of(solution, options.chain)
    walker = Walker(knowledge, region.axis, options.seed)
    place = _registrable(walker, situation.tips[1], fiducials)
    return _mapped(knowledge, region, place, fiducials, options)


@checked
def tip_map_of_result(knowledge: Knowledge, options: TipMapOptions) -> TipMap:
    """The map of an arm whose samples are not known; the tool points straight down.

    Args:
        knowledge: as a result has it.
        options: what is asked for, a box among it.

    Raises:
        JobError: the box is missing or has no volume, the arm reaches next to nothing of it, or
            fewer than three registration points.
    """
    if options.box is None:
        raise JobError(
            "a result, which contains no samples", "--region, the region of the tip", where="region"
        )
    region = Region(options.box[0], options.box[1], np.array(DOWN))
    return _mapped(knowledge, region, options.box.mean(axis=0), _corners(), options)


def _registrable(walker: Walker, tips: FloatArray, fiducials: FloatArray) -> FloatArray:
    """(3,) the middle of the tips (n, 3), or where most were, if the arm reaches no middle."""
    middle = tips.mean(axis=0)
    near = float(np.linalg.norm(fiducials, axis=1).max())
    company = KDTree(tips).query_ball_point(tips, near, return_length=True)
    # Places where an arm often was that are tried, where it does not reach the middle of them all.
    for place in (middle, *tips[np.argsort(-company, kind="stable")[:8]]):
        if np.isfinite(walker.reach(place + fiducials, near)).all(axis=1).sum() >= FEWEST_FIDUCIALS:
            return np.asarray(place)
    return np.asarray(middle)


def _corners() -> FloatArray:
    """Points to register where there is no artefact: corners of a box as large as one, m."""
    return np.asarray(0.08 * np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T)


def _mapped(
    knowledge: Knowledge,
    region: Region,
    middle: FloatArray,
    fiducials: FloatArray,
    options: TipMapOptions,
) -> TipMap:
    tips = knowledge.arm.forward(knowledge.visited, knowledge.values)[1]
    postures = region.postures(knowledge.kinematics, knowledge.visited, tips, options.seed)
    place = middle if options.place is None else options.place
    sizes = {"grid": options.grid, "seed": options.seed}
    result = tip_map(knowledge, region, place, fiducials, postures, **sizes)
    return replace(result, tolerance=options.tolerance)


@single_threaded
@checked
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
    """Predict the uncertainty of the tip over the workspace and in a region.

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
    # What an arm that gets only to a line or a surface has for a corner of the box.
    near = float(np.linalg.norm(fiducials, axis=1).max())
    touched = walker.reach(place + fiducials, near)
    good = np.isfinite(touched).all(axis=1)
    if good.sum() < FEWEST_FIDUCIALS:
        raise JobError(
            f"{int(good.sum())} of {len(fiducials)} registration points within reach about "
            "({:.0f}, {:.0f}, {:.0f}) mm".format(*mm(place)),
            f"at least {FEWEST_FIDUCIALS}",
            where="register-at",
            hint="choose a region that the arm reaches with the tool orientations of the samples",
        )
    reference = knowledge.at(touched[good])
    inside = knowledge.at(postures)
    covariance = knowledge.covariance
    centre = (region.lower + region.upper) / 2
    posture = walker.reach(centre[None, :], near=math.inf)[0]
    return TipMap(
        knowledge=knowledge,
        region=region,
        place=reference.position.mean(axis=0),
        registration=int(good.sum()),
        registered=Figures.of(inside.std(covariance, inside.registered(reference))),
        absolute=Figures.of(inside.std(covariance)),
        sections=slices(walker, region, reference, grid),
        drawn=knowledge.arm.skeleton(posture if np.isfinite(posture).all() else postures[0]).points,
        open_directions=_open(knowledge, postures, reference.q),
        axis=region.axis,
    )


def _open(
    knowledge: Knowledge, postures: FloatArray, reference: FloatArray
) -> tuple[OpenDirection, ...]:
    """Effect of every undetermined direction on the registered tip, largest first."""
    directions = []
    for fixed, direction, plausible in knowledge.open_directions:
        names = tuple(name for name in direction if name in knowledge.arm.offered)
        step = np.array([direction[name] for name in names]) * plausible
        at, inside = (replace(knowledge, names=names).at(q) for q in (reference, postures))
        moved = inside.registered(at) @ step
        effect = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        unit = knowledge.arm.offered[fixed].unit
        directions.append(OpenDirection(fixed, plausible, effect, unit))
    return tuple(sorted(directions, key=lambda direction: -direction.effect))
