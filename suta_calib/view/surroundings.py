"""What stands outside the arm: artefacts, points, planes, boards, cameras and instruments."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import register_points, right_singular
from suta_calib.terms import Term
from suta_calib.terms.external_frame import ExternalFrame
from suta_calib.view.scene import Colour, Frame, Frustum, Patch, PointCloud, Stroke, Thing

# Orange, of Okabe and Ito: told apart by the colour-blind too.
STANDING: Final[Colour] = (230, 159, 0)


def surroundings(
    term: Term, values: Mapping[str, float], size: float, *, labelled: bool
) -> Iterator[Thing]:
    """What a term's samples touched, or saw, or were seen by.

    Args:
        term: any kind.
        values: of the arm's parameters and the term's own unknowns, m or rad.
        size: of a frame's axes, m.
        labelled: whether landmarks are called by name where the artefact first stood.
    """
    for k, frame in enumerate(term.outside):
        yield _frame(term, frame, values, size, sees=k == 0 and term.medium == "camera")
    if (board := term.settings.get("board")) is not None:
        yield from _board(term, values, np.array(list(board.points.values())), size)
    if len(scanned := term.scanned_points(values)):
        # As many as a browser turns without effort.
        scanned = scanned[:: -(-len(scanned) // 5000)]
        label = getattr(term, "target", "default")
        yield PointCloud(f"profiles/{label}", scanned, STANDING, 0.02 * size)
    for k, (name, corners) in enumerate(term.seen_planes(values).items(), start=1):
        carrier = _tip_link(term, term.outside[k])
        yield from _span(f"{term.outside[k].what}s/{name} seen", corners, carrier)
    if term.medium != "touch":
        return
    ideal = term.observed(values, term.poses).place
    names, place = term.places
    for k, name in enumerate(names):
        touched = ideal[place == k]
        if term.touched is not None:
            rows, first = np.flatnonzero(place == k), labelled and k == 0
            yield _artefact(term, name, rows, touched, size, labelled=first)
        else:
            yield from _span(f"{term.place}s/{name} touched", touched)


def _frame(
    term: Term, frame: ExternalFrame, values: Mapping[str, float], size: float, *, sees: bool
) -> Thing:
    """A frame or a point that the term's own unknowns are; of what sees, what it sees."""
    R, p = frame.pose(values)
    what, carrier = frame.what, _tip_link(term, frame)
    if what == "base":  # Where the base is in the instrument tells where that is.
        assert R is not None
        what, R, p = frame.within, R.T, -R.T @ p
    name = f"{what}s/{_label(frame, what)}"
    if R is None:
        colour = STANDING
        return PointCloud(name, p[None], colour, 0.08 * size, (_label(frame, what),), carrier)
    if not sees:
        return Frame(name, R, p, 0.6 * size, carrier)
    frustum = Frustum(name, R, p, size, carrier)
    if (camera := term.settings.get("camera")) is None:
        return frustum
    angle = 2.0 * math.atan2(camera.height, 2.0 * camera.matrix[1, 1])
    return replace(frustum, field_of_view=angle, aspect=camera.width / camera.height)


def _tip_link(term: Term, frame: ExternalFrame) -> str:
    arm = getattr(term.poses, "arm", None)
    return arm.chain.tip_link if arm is not None and frame.within == "tip" else ""


def _label(frame: ExternalFrame, what: str) -> str:
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
    yield PointCloud(name, points @ R.T + p, STANDING, 0.05 * size, (), _tip_link(term, frame))


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
    return PointCloud(
        f"artefact/{name} landmarks", position, STANDING, 0.08 * size, marks if labelled else ()
    )


def _span(name: str, points: FloatArray, carrier: str = "") -> Iterator[Thing]:
    """The straight line, or the flat rectangle, that points of one place lie on, if they do."""
    middle = points.mean(axis=0)
    axes = right_singular(points - middle)[1]
    inside = (points - middle) @ axes.T
    low, high = inside.min(axis=0), inside.max(axis=0)
    # Points that extend less than this in a direction do not extend in it, m.
    dimensions = int(np.sum(high - low > 1e-6))
    if dimensions == 1:
        ends = np.array([[low[0], 0.0, 0.0], [high[0], 0.0, 0.0]])
        yield Stroke(name, ends @ axes + middle, STANDING)
    elif dimensions == 2:
        corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        flat = np.array([[u, v, 0.0] for u, v in corners])
        yield Patch(name, flat @ axes + middle, STANDING, carrier)
