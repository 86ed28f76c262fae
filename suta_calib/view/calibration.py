"""What a calibration says of its arm, as a scene: what was touched or seen, errors, uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment
from suta_calib.diagnostics.displacements import tip_displacements
from suta_calib.diagnostics.tip_uncertainty import sensitivity
from suta_calib.distributions import chi2
from suta_calib.geometry.numbers import register_points
from suta_calib.model.arm import ArmModel
from suta_calib.plotting.factor import round_down
from suta_calib.terms import Term
from suta_calib.terms.outside import OutsideFrame
from suta_calib.units import mm
from suta_calib.view.drawn_arm import DrawnArm, LinkMesh
from suta_calib.view.meshes import link_meshes
from suta_calib.view.scene import (
    OUTLYING,
    Arrows,
    Colour,
    Ellipsoids,
    Frame,
    Frustum,
    Patch,
    Points,
    Rows,
    Scene,
    Stroke,
    Thing,
)

if TYPE_CHECKING:
    from suta_calib.view.server import Viewer

# Of Okabe and Ito: told apart by the colour-blind too.
_BLUE: Final[Colour] = (0, 114, 178)
_GREEN: Final[Colour] = (0, 158, 115)
_ORANGE: Final[Colour] = (230, 159, 0)
UNSURE: Final[Colour] = (204, 121, 167)
COLOURS: Final = {"calibration": _BLUE, "validation": _GREEN}
# Of the scene's size: how large frames are drawn, and at first how long large errors and how wide
# usual uncertainties.
_AXES: Final = 0.05
_LONG: Final = 0.08
_WIDE: Final = 0.03
# Ellipsoids that are drawn: more hide what they are about.
_ELLIPSOIDS: Final = 30
# Where nothing is known of a camera's lens, rad, and width over height of its picture.
_LENS: Final = (0.8, 4.0 / 3.0)
# Chance that the error of a sample with nothing wrong is called outlying.
_CHANCE: Final = 1e-4
# A group of touches that extends less than this in a direction does not extend in it, m.
_FLAT: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibration, whether it was just made or read back.

    Attributes:
        title: what was calibrated.
        arm: at nominal.
        values: of the calibrated arm's parameters by name, m or rad.
        names, covariance: p parameters that were estimated, and (p, p) how surely.
        terms: by set (``calibration``, ``validation``): each term with the values of its own
            unknowns and the arm's, m or rad.
        rms: by set, before and after, m.
        assessment: whether it may be used.
    """

    title: str
    arm: ArmModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: FloatArray
    terms: Mapping[str, tuple[tuple[Term, Mapping[str, float]], ...]]
    rms: Mapping[str, tuple[float, float]]
    assessment: Assessment

    @property
    def summary(self) -> str:
        """One line on the errors before and after."""
        shown = ((name, *(mm(each) for each in rms)) for name, rms in self.rms.items())
        return ", ".join(f"{name} {a:.3g} → {b:.3g} mm RMS" for name, a, b in shown)

    def tip(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the calibrated tip is at readings (n, joints), and how surely.

        Returns:
            Positions (n, 3), m, and their covariances (n, 3, 3), m².
        """
        at = sensitivity(self.arm, self.values, self.names, q)
        return at.position, at.jacobian @ self.covariance @ np.swapaxes(at.jacobian, 1, 2)


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
        limit = math.sqrt(chi2.isf(_CHANCE, size) / chi2.median(size))
        return np.asarray(self.norm > limit * np.median(self.norm))

    @property
    def names(self) -> Iterator[str]:
        """Of every sample: its group, its labels, where it was read, and how far off it is."""
        samples = self.term.poses.samples
        for k, origin in enumerate(samples.origin):
            labels = " ".join(str(column[k]) for column in samples.labels.values())
            said = (self.group, labels, origin, f"{mm(self.norm[k]):.3f} mm")
            yield ", ".join(filter(None, said))

    @property
    def arrows(self) -> Arrows:
        """Blue or green, red where they are outlying."""
        colours = np.tile(np.array(COLOURS[self.group]), (len(self.at), 1))
        colours[self.outlying] = OUTLYING
        name = f"errors/{self.group} {self.term.kind.replace('_', ' ')}"
        return Arrows(name, self.at, self.vector, colours)


def calibration_page(calibrated: Calibrated) -> bytes:
    """A calibration as one HTML file, which needs no network: it plays sample after sample.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
    """
    from suta_calib.view.server import page

    return page(calibration_scene(calibrated, link_meshes(calibrated.arm.chain.path)))


def view_calibration(calibrated: Calibrated, port: int = 0, host: str = "127.0.0.1") -> Viewer:
    """Show a calibration in the browser, with the shapes of the arm that are found.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
        OutputError: the port cannot be had.
    """
    from suta_calib.view.server import Viewer

    viewer = Viewer(
        calibration_scene(calibrated, link_meshes(calibrated.arm.chain.path)), port, host
    )
    viewer.add_panel()
    return viewer


def calibration_scene(calibrated: Calibrated, meshes: tuple[LinkMesh, ...] = ()) -> Scene:
    """The arm before and after, all that was touched or seen, errors and uncertainty.

    Args:
        calibrated: the calibration.
        meshes: shapes of the arm's links; none where no file of them was found.
    """
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
    rows = _rows(errors)
    _, links = arms[0].poses(rows.q[0])
    reach = max(float(np.linalg.norm(np.ptp(each, axis=0))) for each in (links, rows.at))
    size = _AXES * reach
    things = list[Thing]()
    for found in errors:
        things += _stands(found.term, found.values, size, labelled=not things)
        things.append(found.arrows)
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _ELLIPSOIDS)).astype(int))
    ellipsoids = Ellipsoids.of("uncertainty", *calibrated.tip(rows.q[chosen]), UNSURE)
    if ellipsoids.std.max() > 0:
        things.append(ellipsoids)
    large = float(np.quantile(np.concatenate([found.norm for found in errors]), 0.9))
    usual = float(np.median(ellipsoids.std.max(axis=1)))
    return Scene(
        calibrated.title,
        arms,
        rows.q[0],
        _once(things),
        rows,
        _factor(_LONG * reach, large),
        _factor(_WIDE * reach, usual),
        calibrated.assessment,
        calibrated.summary,
    )


def _factor(wanted: float, length: float) -> float:
    return round_down(wanted / length) if length > 0 else 1.0


def _once(things: list[Thing]) -> tuple[Thing, ...]:
    """The first of each name: what two terms look at stands there once."""
    found: dict[str, Thing] = {}
    for thing in things:
        found.setdefault(thing.name, thing)
    return tuple(found.values())


def _rows(errors: list[TipErrors]) -> Rows:
    return Rows(
        tuple(name for found in errors for name in found.names),
        np.vstack([found.term.poses.samples.q for found in errors]),
        np.vstack([found.at for found in errors]),
        np.concatenate([found.outlying for found in errors]),
    )


# ── what stands outside the arm ─────────────────────────────────────────────────────────────
def _stands(
    term: Term, values: Mapping[str, float], size: float, *, labelled: bool
) -> Iterator[Thing]:
    """What the term's samples touched, or saw, or were seen by."""
    for k, frame in enumerate(term.outside):
        yield _frame(term, frame, values, size, sees=k == 0 and term.medium == "camera")
    if (board := term.settings.get("board")) is not None:
        yield from _board(term, values, np.array(list(board.points.values())), size)
    if term.medium != "touch":
        return
    ideal = term.observed(values, term.poses).position
    names, place = term.places
    for k, name in enumerate(names):
        touched = ideal[place == k]
        if term.touched is not None:
            rows, first = np.flatnonzero(place == k), labelled and k == 0
            yield _artefact(term, name, rows, touched, size, labelled=first)
        else:
            yield from _span(f"{term.place}s/{name}", touched)


def _frame(
    term: Term, frame: OutsideFrame, values: Mapping[str, float], size: float, *, sees: bool
) -> Thing:
    """A frame or a point that the term's own unknowns are; of what sees, what it sees."""
    R, p = frame.pose(values)
    what, carrier = frame.what, _tip_link(term, frame)
    if what == "base":  # Where the base is in the instrument tells where that is.
        assert R is not None
        what, R, p = frame.within, R.T, -R.T @ p
    name = f"{what}s/{_label(frame, what)}"
    if R is None:
        colour = _ORANGE
        return Points(name, p[None], colour, 0.08 * size, (_label(frame, what),), carrier)
    if not sees:
        return Frame(name, R, p, 0.6 * size, carrier)
    camera = term.settings.get("camera")
    if camera is None:
        lens = _LENS
    else:
        angle = 2.0 * math.atan2(camera.height, 2.0 * camera.matrix[1, 1])
        lens = (angle, camera.width / camera.height)
    return Frustum(name, R, p, size, *lens, carrier)


def _tip_link(term: Term, frame: OutsideFrame) -> str:
    arm = getattr(term.poses, "arm", None)
    return arm.chain.tip_link if arm is not None and frame.within == "tip" else ""


def _label(frame: OutsideFrame, what: str) -> str:
    """What stands in the brackets of its unknowns' names, if anything does."""
    _, bracket, label = frame.owner.partition("[")
    return label.removesuffix("]") if bracket else what


def _board(
    term: Term, values: Mapping[str, float], points: FloatArray, size: float
) -> Iterator[Thing]:
    """The points of the board that the term's camera sees: the second of its frames."""
    frame = term.outside[1]
    R, p = frame.pose(values)
    assert R is not None
    name = f"{frame.what}s/{_label(frame, frame.what)} points"
    yield Points(name, points @ R.T + p, _ORANGE, 0.03 * size, (), _tip_link(term, frame))


def _artefact(
    term: Term, name: str, rows: IntArray, touched: FloatArray, size: float, *, labelled: bool
) -> Thing:
    """All landmarks of the artefact where it stood."""
    artefact = term.touched
    assert artefact is not None
    marks = tuple(artefact.landmarks)
    certified = artefact.position_of(term.poses.samples.labels["landmark"][rows])
    R, p = register_points(certified, touched)
    position = np.array([artefact.landmarks[mark].position for mark in marks]) @ R.T + p
    return Points(
        f"artefact/{name} landmarks", position, _ORANGE, 0.08 * size, marks if labelled else ()
    )


def _span(name: str, touched: FloatArray) -> Iterator[Thing]:
    """The straight line, or the flat rectangle, that touches of one place lie on, if they do."""
    middle = touched.mean(axis=0)
    axes = np.linalg.svd(touched - middle)[2]
    inside = (touched - middle) @ axes.T
    low, high = inside.min(axis=0), inside.max(axis=0)
    dimensions = int(np.sum(high - low > _FLAT))
    if dimensions == 1:
        ends = np.array([[low[0], 0.0, 0.0], [high[0], 0.0, 0.0]])
        yield Stroke(f"{name} touched", ends @ axes + middle, _ORANGE)
    elif dimensions == 2:
        corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        flat = np.array([[u, v, 0.0] for u, v in corners])
        yield Patch(f"{name} touched", flat @ axes + middle, _ORANGE)
