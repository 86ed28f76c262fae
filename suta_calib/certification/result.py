"""What a certification found, how far to trust it, and the file a calibration reads of it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.certification.comparison import DrawingComparison, OverGround
from suta_calib.certification.frame import Source
from suta_calib.certification.noise import ProbingNoise
from suta_calib.certification.scatter import deviates
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import Artefact, Landmark, write_text
from suta_calib.measurements.artefact import artefact_text
from suta_calib.units import deg, from_deg, mm, um

# The tip points down when seated.
DOWN: Final = np.pi


@dataclass(frozen=True)
class Fault:
    """Why a landmark is called damaged: a quantity is off by ``size``, more than ``limit``, m."""

    landmark: str
    what: str
    size: float
    limit: float


@dataclass(frozen=True, eq=False)
class CertifiedLandmark(Displayable):
    """One landmark in the artefact's frame.

    Attributes:
        name: of the landmark.
        position: (3,) centre of the pillar's top, m; z is its height over the ground.
        std: (3,) standard deviation of each coordinate in the artefact's frame, m.
        shape_std: (3,) the same after best superposition: what distances suffer from, m.
        yaw: turn of the seated tip about z, rad; None where no flats were touched.
        yaw_std: its standard deviation, rad.
        tilt: of the top from the ground, rad.
        tilt_std: standard deviation of one component of it, rad.
        flatness: largest distance of a touch in use from the top's plane, m.
        symmetry: distance between the middles of the diagonals, m.
        diagonals: (2,) lengths 0-2 and 1-3, m.
        flats: distance between the flats, m; None without.
        touches: on the top, those in use.
        wrong_touches: lines of touches on the top that are not used.
    """

    name: str
    position: FloatArray
    std: FloatArray
    shape_std: FloatArray
    yaw: float | None
    yaw_std: float | None
    tilt: float
    tilt_std: float
    flatness: float
    symmetry: float
    diagonals: FloatArray
    flats: float | None
    touches: int
    wrong_touches: tuple[int, ...] = ()

    @property
    def sigma(self) -> float:
        """Standard deviation for a file that has one for all coordinates: the largest of them."""
        return float(self.std.max())

    @property
    def rotation(self) -> FloatArray | None:
        """(3, 3) of the seated tip: z down, x from the back flat to the front one."""
        return None if self.rotation_rpy is None else rotation_from_rpy(self.rotation_rpy)

    @property
    def rotation_rpy(self) -> FloatArray | None:
        """(3,) the same as roll, pitch, yaw, rad."""
        return None if self.yaw is None else np.array([DOWN, 0.0, self.yaw])


@dataclass(frozen=True, eq=False)
class PlaneQuality:
    """How well touches make a plane."""

    count: int  # touches in use
    rms: float  # scatter of a touch about the plane, m
    flatness: float  # of those in use from the lowest to the highest, m
    tilt_std: float  # standard deviation of its direction, rad: its largest component
    wrong_touches: tuple[int, ...]  # lines of touches that are not used


@dataclass(frozen=True, eq=False)
class SpacerLength:
    """Distance between a spacer's ends, m; ``nominal`` where the user gave it."""

    name: str
    length: float
    std: float
    nominal: float | None = None

    @property
    def deviation(self) -> float | None:
        """Measured less nominal, m."""
        return None if self.nominal is None else self.length - self.nominal


@dataclass(frozen=True, eq=False)
class Certification(Displayable):
    """The artefact as it was measured.

    Attributes:
        path: the raw points.
        name: of the artefact.
        points: rows in the file.
        landmarks: in the file's order.
        covariance: (3 n, 3 n) of all coordinates in the artefact's frame, m².
        origin: landmark where x and y are zero.
        heading: what the x axis follows.
        turned: quarter turns from the side to x, where a drawing says so.
        heading_std: standard deviation of that direction against the origin, rad.
        ground, side: quality of these planes; no side where none was touched.
        probing: what a touch is worth on each kind of feature.
        stated_noise: the standard deviation of a touched coordinate that was given, m.
        spacers: their lengths.
        faults: why landmarks are called damaged.
        comparison: with a drawing, if there is one.
        over_ground: how all landmarks stand over the ground against that drawing.
        tolerance: largest acceptable departure, m, if one was given.
        unjudged: what of judging it failed, one sentence each.
    """

    path: Path
    name: str
    points: int
    landmarks: tuple[CertifiedLandmark, ...]
    covariance: FloatArray = field(repr=False)
    origin: str
    heading: Source
    turned: int
    heading_std: float
    ground: PlaneQuality
    side: PlaneQuality | None
    probing: ProbingNoise
    stated_noise: float | None
    spacers: tuple[SpacerLength, ...]
    faults: tuple[Fault, ...]
    comparison: DrawingComparison | None
    over_ground: OverGround | None
    tolerance: float | None
    unjudged: tuple[str, ...] = ()

    @property
    def damaged(self) -> tuple[str, ...]:
        """Names of the landmarks with a fault, in order."""
        return tuple(dict.fromkeys(fault.landmark for fault in self.faults))

    @property
    def noise(self) -> float:
        """Standard deviation of one coordinate touched on a plane, m."""
        return self.probing.touch

    @property
    def freedom(self) -> float:
        """Degrees of freedom of `noise`; inf where it is the one that was given."""
        return self.probing.freedom

    @property
    def coverage_factor(self) -> float:
        """Standard deviations on either side that cover 95 %."""
        return deviates(0.025, self.probing.freedom_of("hole", "side"))

    @cached_property
    def wrong_touches(self) -> tuple[int, ...]:
        """Lines of all touches that were not used."""
        lines = [*self.ground.wrong_touches, *(self.side.wrong_touches if self.side else ())]
        return tuple(sorted([*lines, *(w for m in self.landmarks for w in m.wrong_touches)]))

    @property
    @judged
    def assessment(self) -> Assessment:
        """Bad where a landmark is damaged; care where something must be known."""
        largest = max(mark.sigma for mark in self.landmarks)
        sentence = (
            f"{len(self.landmarks)} landmarks certified from {self.points} points; largest "
            f"standard deviation of a coordinate {mm(largest):.4f} mm"
        )
        if self.damaged:
            sentence = f"Damaged or touched wrongly: {', '.join(self.damaged)}"
        too_much = "from the scatter of the touches and of the other pillars"
        if self.tolerance is not None:
            too_much = "the tolerance plus the uncertainty of the measurement"
        bad = [
            f"{fault.landmark}: the {fault.what} deviates by {mm(fault.size):.4f} mm. The limit "
            f"is {mm(fault.limit):.4f} mm ({too_much})."
            for fault in self.faults
        ]
        if self.comparison is not None:
            bad += self.comparison.registration.deformed("bad")
        if self.over_ground is not None:
            bad += self.over_ground.notes("bad")
        care = [*_touches(self), *_drawing(self)]
        if self.heading == "farthest landmark":
            care.append("No side plane was touched, so the direction of x is a convention.")
        if without := [m.name for m in self.landmarks if m.yaw is None]:
            which = "any landmark" if len(without) == len(self.landmarks) else ", ".join(without)
            care.append(
                f"No flats were touched on {which}, so the rotation of a tip seated "
                "there is unknown."
            )
        for spacer in self.spacers:
            limit = self.coverage_factor * spacer.std + (self.tolerance or 0.0)
            if spacer.deviation is not None and abs(spacer.deviation) > limit:
                part = 1e6 * spacer.deviation / (spacer.nominal or 1.0)
                care.append(
                    f"Spacer {spacer.name} differs by {mm(spacer.deviation):+.4f} mm from its "
                    f"nominal length ({part:+.0f} µm/m). Check the scale of the instrument and "
                    "the temperature."
                )
        return Assessment.of(sentence, bad=bad, care=care)

    def artefact(self) -> Artefact:
        """What a calibration reads: positions, seated rotations, one sigma for each landmark."""
        marks = {m.name: Landmark(m.name, m.position, m.rotation, m.sigma) for m in self.landmarks}
        return Artefact(self.name, marks)


def _touches(result: Certification) -> Iterator[str]:
    # A ground so many times rougher than a touch deserves a word.
    rough = 3.0
    for name, plane in (("ground", result.ground), ("side", result.side)):
        if plane is not None and plane.wrong_touches:
            yield (
                f"Touches of the {name} that contradict the others: {_lines(plane.wrong_touches)}."
            )
    for mark in result.landmarks:
        if mark.wrong_touches:
            yield (
                f"A touch of the top of {mark.name} does not fit the others "
                f"({_lines(mark.wrong_touches)}): the probe slipped, or the top is dented there."
            )
    # Touches that the procedure asks for on every top.
    few = [m.name for m in result.landmarks if m.touches + len(m.wrong_touches) < 5]
    if few:
        yield (
            f"Fewer than five touches on the top of {', '.join(few)}: a wrong touch may stay "
            "undetected."
        )
    if result.stated_noise is not None and result.noise > result.stated_noise:
        yield (
            f"Touches scatter by {um(result.noise):.2f} µm, more than the given "
            f"{um(result.stated_noise):.2f} µm. The larger value is used."
        )
    if result.ground.rms > rough * result.noise:
        yield (
            f"The ground is rougher than the tops ({mm(result.ground.rms):.4f} mm RMS). Heights "
            "are counted from its mean plane, and their uncertainty includes the roughness."
        )
    if (side := result.probing.of("side")) > rough * result.noise:
        yield (
            f"The side is rougher than the tops ({mm(side):.4f} mm RMS). x follows its mean "
            "direction, and the uncertainty of this direction includes the roughness."
        )
    if (holes := result.probing.of("hole")) > rough * result.noise:
        yield (
            "The diagonals of the holes do not meet in their midpoints: this corresponds to "
            f"{um(holes):.1f} µm of scatter for touches of holes, but touches of planes scatter "
            f"by {um(result.noise):.1f} µm. Either the holes were touched less exactly, or they "
            "were drilled unevenly. The uncertainty of the centres includes this."
        )


def _lines(lines: tuple[int, ...]) -> str:
    most = 6
    shown = ", ".join(map(str, lines[:most]))
    return f"line{'s' * (len(lines) > 1)} {shown}{', …' * (len(lines) > most)}; not used"


def _drawing(result: Certification) -> Iterator[str]:
    comparison = result.comparison
    if comparison is None:
        return
    if comparison.not_drawn:
        yield f"Not in the drawing: {', '.join(comparison.not_drawn)}."
    if comparison.not_touched:
        yield f"In the drawing, but not touched: {', '.join(comparison.not_touched)}."
    turns = comparison.turn[np.isfinite(comparison.turn)]
    common = float(np.angle(np.mean(np.exp(1j * turns)))) if len(turns) else 0.0
    # A turn that all landmarks share is another way of counting, not a fault.
    if abs(common) > from_deg(1.0):
        yield (
            f"All seated tips are rotated by {deg(common):.1f}° against the drawing. Check which "
            "flat is the front one: --front-deg gives its direction in the frame of the tip."
        )
    # What else a registration has to say is about too few points to use it for.
    yield from comparison.registration.deformed("care")
    if result.over_ground is not None:
        yield from result.over_ground.notes("care")


def write_certified(path: Path, result: Certification) -> None:
    """Write ``artefact.yaml`` with a header that says how it came about.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    story = [
        f"Certified by suta-calib certify from {result.points} points of {result.path.name}. The "
        f"standard deviation of one touched coordinate is {um(result.noise):.2f} µm "
        f"({noise_source(result)}).",
        f"Frame: {frame_sentence(result)} A position is the centre of a pillar's top. "
        "rotation_rpy_deg is the rotation of the seated tip (z down, x from the back flat to the "
        "front flat).",
        "sigma_mm is the largest standard deviation of the three coordinates in this frame, by "
        "first-order propagation from every touch.",
    ]
    if result.wrong_touches:
        story.append(
            f"Lines of touches that were not used: {', '.join(map(str, result.wrong_touches))}."
        )
    if result.damaged:
        story.append(
            f"DAMAGED OR TOUCHED WRONGLY: {', '.join(result.damaged)}. Do not calibrate with "
            "this file before this is clarified."
        )
    comment = textwrap.TextWrapper(98, initial_indent="# ", subsequent_indent="# ")
    header = [line for paragraph in story for line in comment.wrap(paragraph)]
    write_text(path, "\n".join([*header, artefact_text(result.artefact())]))


def noise_source(result: Certification) -> str:
    """Where the noise of a touch was taken from."""
    if result.freedom == float("inf"):
        return "as given"
    return f"from the residuals of planes, {result.freedom:.0f} degrees of freedom"


def frame_sentence(result: Certification) -> str:
    """How the artefact's frame lies in the artefact."""
    towards = {
        "side plane": "x is along the side plane, which is on the -y side",
        "farthest landmark": f"x is by convention from {result.origin} to the farthest landmark",
    }[result.heading]
    if result.heading == "side plane" and result.turned:
        towards = (
            f"x is as in the drawing, rotated by {90 * result.turned}° from the direction "
            "of the side plane"
        )
    elif result.heading == "farthest landmark" and result.comparison is not None:
        towards = "x is as in the drawing, aligned with the landmark farthest from the origin"
    return (
        f"z is the normal of the ground, z = 0 is the ground, x = y = 0 is at {result.origin}, "
        f"and {towards}."
    )
