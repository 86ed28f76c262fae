"""What a calibration says of its arm, as a scene: what was touched or seen, errors, uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.plotting.look import round_down
from suta_calib.plotting.scene import largest_of_regions
from suta_calib.terms import ArmPoses, Term
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.tip import tip_displacements
from suta_calib.units import mm
from suta_calib.view.calibrated import Calibrated
from suta_calib.view.drawn_arm import DrawnArm, LinkMesh
from suta_calib.view.meshes import link_meshes
from suta_calib.view.scene import (
    OUTLYING,
    ArmScene,
    Colour,
    Ellipsoids,
    ErrorVectors,
    SampleRows,
    Thing,
)
from suta_calib.view.server import Viewer
from suta_calib.view.surroundings import surroundings

if TYPE_CHECKING:
    from suta_calib.view.server import Viewer

# Of Okabe and Ito, told apart by the colour-blind too; blue and green darker, for the scene's light
# pales them.
UNSURE: Final[Colour] = (170, 50, 120)
COLOURS: Final[dict[str, Colour]] = {"calibration": (0, 68, 130), "validation": (0, 100, 72)}


@dataclass(frozen=True, eq=False)
class TipErrors:
    """How far off the tip is in the samples of one term.

    Attributes:
        group: ``calibration`` or ``validation``.
        term: whose samples they are.
        values: at which it is looked at.
        at: (n, 3) where the tip should have been, m.
        vector: (n, 3) from there to where the calibrated arm has it, m.
    """

    group: str
    term: Term
    values: Mapping[str, float]
    at: FloatArray
    vector: FloatArray

    @property
    def norm(self) -> FloatArray:
        """(n,) m."""
        return np.asarray(np.linalg.norm(self.vector, axis=1))

    @property
    def outlying(self) -> BoolArray:
        """(n,) which errors are larger than chance makes them, by the median of all."""
        size = self.term.blocks[0].size
        # Chance that the error of a sample with nothing wrong is called outlying.
        chance = 1e-4
        limit = math.sqrt(chdtri(size, chance) / chdtri(size, 0.5))
        return np.asarray(self.norm > limit * np.median(self.norm))

    @property
    def names(self) -> Iterator[str]:
        """Of every sample: its group, its labels, where it was read, and how far off it is."""
        samples = self.term.poses.samples
        for k, origin in enumerate(samples.origin):
            labels = " ".join(str(column[k]) for column in samples.labels.values())
            # Angles alone do not tell where the tip was.
            size = f"{mm(self.norm[k]):.3f} mm" if self.norm.any() else ""
            parts = (self.group, labels, origin, size)
            yield ", ".join(filter(None, parts))

    @property
    def arrows(self) -> ErrorVectors:
        """Blue or green, red where they are outlying; of many the largest of each region."""
        colours = np.tile(np.array(COLOURS[self.group]), (len(self.at), 1))
        colours[self.outlying] = OUTLYING
        name = f"errors/{self.group} {self.term.kind.replace('_', ' ')}"
        rows = largest_of_regions(self.at, self.norm)
        count = len(self.at) if len(rows) < len(self.at) else 0
        return ErrorVectors(name, self.at[rows], self.vector[rows], colours[rows], count)


def show(examined: CalibrationExamination, port: int = 0) -> Viewer:
    """Show in the browser what was just calibrated; in a notebook below the cell.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
        OutputError: the port cannot be had.
    """
    return view_calibration(Calibrated.of(examined, assess_calibration(examined)), port)


def calibration_page(calibrated: Calibrated) -> bytes:
    """A calibration as one HTML file, which needs no network and plays the samples.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
    """
    from suta_calib.view.page import page

    return page(calibration_scene(calibrated, link_meshes(*calibrated.arm.urdf)))


def view_calibration(calibrated: Calibrated, port: int = 0, host: str = "127.0.0.1") -> Viewer:
    """Show a calibration in the browser, with the shapes of the arm that are found.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
        OutputError: the port cannot be had.
    """
    viewer = Viewer(calibration_scene(calibrated, link_meshes(*calibrated.arm.urdf)), port, host)
    viewer.add_panel()
    return viewer


def calibration_scene(calibrated: Calibrated, meshes: tuple[LinkMesh, ...] = ()) -> ArmScene:
    """The arm before and after, its shapes, what was touched or seen, errors and uncertainty."""
    # Of the scene's size: how large frames are drawn, and at first how long large errors and how
    # wide usual uncertainties.
    axes = 0.05
    long = 0.08
    wide = 0.03
    arm = calibrated.arm
    arms = (
        DrawnArm("calibrated", arm, calibrated.values, meshes),
        DrawnArm("nominal", arm, {}, meshes),
    )
    errors = [
        TipErrors(name, term, values, *tip_displacements(term, values))
        for name, terms in calibrated.terms.items()
        for term, values in terms
    ]
    errors = [_in_base(error, arms[0]) for error in errors]
    rows = _rows(errors)
    _, links = arms[0].poses(rows.q[0])
    reach = max(float(np.linalg.norm(np.ptp(places, axis=0))) for places in (links, rows.at))
    size = axes * reach
    things = list[Thing]()
    for error in errors:
        if _stands(error, arms[0]):
            things += surroundings(error.term, error.values, size, labelled=not things)
        things.append(error.arrows)
    ellipsoids = _uncertainty(calibrated, [e for e in errors if _stands(e, arms[0])])
    if ellipsoids.std.max() > 0:
        things.append(ellipsoids)
    large = float(np.quantile(np.concatenate([error.norm for error in errors]), 0.9))
    usual = float(np.median(ellipsoids.std.max(axis=1)))
    return ArmScene(
        calibrated.title,
        arms,
        rows.q[0],
        _once(things),
        rows,
        _factor(long * reach, large),
        _factor(wide * reach, usual),
        calibrated.assessment,
        calibrated.summary,
    )


def _stands(error: TipErrors, drawn: DrawnArm) -> bool:
    """Whether a term's chain begins where the drawing does; else what it is about moves."""
    poses = error.term.poses
    return not isinstance(poses, ArmPoses) or poses.arm.chain.base == drawn.base


def _in_base(error: TipErrors, drawn: DrawnArm) -> TipErrors:
    """The errors of a chain that begins elsewhere, such as in another hand, as they are drawn."""
    poses = error.term.poses
    if not isinstance(poses, ArmPoses) or _stands(error, drawn):
        return error
    link = drawn.links.index(poses.arm.chain.base)
    placed = [drawn.poses(q) for q in poses.samples.q]
    turn = np.array([rotations[link] for rotations, _ in placed])
    origin = np.array([positions[link] for _, positions in placed])
    at = np.einsum("nij,nj->ni", turn, error.at) + origin
    return replace(error, at=at, vector=np.einsum("nij,nj->ni", turn, error.vector))


def _uncertainty(calibrated: Calibrated, errors: list[TipErrors]) -> Ellipsoids:
    """Of the tip in some samples of each chain: more would hide what they are about."""
    by_arm: dict[ArmModel, list[FloatArray]] = {}
    for error in errors:
        if isinstance(error.term.poses, ArmPoses):
            by_arm.setdefault(error.term.poses.arm, []).append(error.term.poses.samples.q)
    at, covariance = list[FloatArray](), list[FloatArray]()
    for arm, parts in by_arm.items():
        q, most = np.vstack(parts), 30 // len(by_arm)
        chosen = np.unique(np.linspace(0, len(q) - 1, min(len(q), most)).astype(int))
        positions, covariances = calibrated.tip(arm, q[chosen])
        at.append(positions)
        covariance.append(covariances)
    return Ellipsoids.of("uncertainty", np.vstack(at), np.vstack(covariance), UNSURE)


def _factor(longest: float, length: float) -> float:
    return round_down(longest / length) if length > 0 else 1.0


def _once(things: list[Thing]) -> tuple[Thing, ...]:
    """The first of each name: what two terms look at stands there once."""
    by_name: dict[str, Thing] = {}
    for thing in things:
        by_name.setdefault(thing.name, thing)
    return tuple(by_name.values())


def _rows(errors: list[TipErrors]) -> SampleRows:
    return SampleRows(
        tuple(name for error in errors for name in error.names),
        np.vstack([error.term.poses.samples.q for error in errors]),
        np.vstack([error.at for error in errors]),
        np.concatenate([error.outlying for error in errors]),
    )
