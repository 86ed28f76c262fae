"""Which way the markers of a board lie on it, by pictures: files are often written with y up.

A file whose places have y up, and whose markers have no rotation, describes markers that are
mirrored about their middles, and no pose of the board explains a picture of it. A picture of two
markers tells which of the eight ways (four turns, from the face or mirrored) is the true one: only
there is the map from the board to the picture projective (the direct linear transformation, Hartley
and Zisserman, Multiple View Geometry, 2004, algorithm 4.1).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements.board import CORNERS, Board, Markers
from suta_calib.measurements.corners import Corners
from suta_calib.units import deg

BACKWARDS: Final = (
    "The corners of the markers are listed counter-clockwise, and expected clockwise from the top "
    "left. They are used as they are listed, with the positions in the file, so the frame of the "
    "board does not change. To correct it, list them clockwise."
)
# Singular value of centred points, relative to the first, of which a plane has none.
FLAT: Final = 1e-6


def markers_as_seen(board: Board, corners: Corners) -> tuple[Board, str]:
    """The board with its markers turned as the pictures show them, and what was changed.

    Places are kept, so that the board's frame is that of its file. The board itself and an empty
    sentence where it fits, or where nothing tells.
    """
    if not isinstance(board, Markers):
        return board, ""
    ways = [board, *(_turned(board, way) for way in _other_ways())]
    misfits = []
    placed = np.isin(corners.point // CORNERS, board.unplaced, invert=True)
    for name in corners.images:
        rows = np.flatnonzero((corners.image == name) & placed)
        rows = rows[np.argsort(corners.point[rows])]
        point = corners.point[rows]
        if len(point) < 2 * CORNERS or len(np.unique(point // CORNERS)) < 2:
            continue
        misfits.append([_misfit(way.positions(point), corners.pixel[rows], point) for way in ways])
        # What is wrong with the file is wrong in all pictures.
        if len(misfits) == 8:
            break
    if not misfits:
        return board, ""
    misfit = np.median(misfits, axis=0)
    best = int(np.argmin(misfit))
    # Misfit, in edges of a marker, up to which the file is right: a lens bends straight lines by a
    # few hundredths, and another way round leaves 0.3 and more. Another way must leave so many
    # times less: the true one leaves ten times less and better.
    if misfit[0] < 0.1 or 4.0 * misfit[best] > misfit[0]:
        return board, ""
    backwards = counter_clockwise(corners.table(board.points).reshape(-1, CORNERS, 2))
    return ways[best], BACKWARDS if backwards else _sentence(board, ways[best])


def counter_clockwise(quads: FloatArray) -> bool:
    """Whether most of the corners (n, 4, 2), px, of markers run counter-clockwise in pictures.

    Those of a marker that is printed as it should be, on what one cannot look through, run so only
    if they are listed so.
    """
    across, along = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    area = across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]
    area = area[np.isfinite(area)]
    return bool(len(area) and np.median(area) < 0.0)


def _other_ways() -> list[FloatArray]:
    """Rotations (3, 3) of a marker onto its square, but for the one that leaves it as it is."""
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    upside_down = np.diag([1.0, -1.0, -1.0])
    turns = [np.linalg.matrix_power(quarter, k) for k in range(4)]
    return [upside_down, *turns[1:], *(upside_down @ turn for turn in turns[1:])]


def _turned(board: Markers, turn: FloatArray) -> Markers:
    """A board whose markers are turned about their middles, by a rotation in their own axes."""
    markers = {n: replace(m, rotation=m.rotation @ turn) for n, m in board.markers.items()}
    return replace(board, markers=markers)


def _misfit(points: FloatArray, pixels: FloatArray, numbers: IntArray) -> float:
    """RMS, in edges of a marker, that the best projective map of points (n, 3) leaves."""
    centred = points - points.mean(axis=0)
    _, size, axes = np.linalg.svd(centred, full_matrices=False)
    flat = centred @ axes[size > FLAT * size[0]].T
    plane = np.column_stack([flat / np.abs(flat).max(), np.ones(len(flat))])
    if 2 * len(points) < 3 * plane.shape[1]:
        return 0.0
    middle, scale = pixels.mean(axis=0), pixels.std()
    image_points = (pixels - middle) / scale
    nothing = np.zeros_like(plane)
    u, v = (image_points[:, k : k + 1] * plane for k in (0, 1))
    rows = np.vstack([np.hstack([plane, nothing, -u]), np.hstack([nothing, plane, -v])])
    P = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, -1)
    image = plane @ P.T
    depth = np.where(np.abs(image[:, 2]) > FLAT, image[:, 2], FLAT)
    off = image[:, :2] / depth[:, None] - image_points
    follows = np.flatnonzero((np.diff(numbers) == 1) & (numbers[:-1] % CORNERS < CORNERS - 1))
    edge = np.median(np.linalg.norm(image_points[follows + 1] - image_points[follows], axis=1))
    return float(np.sqrt(np.mean(np.sum(np.minimum(off**2, 1.0), axis=1))) / edge)


def _sentence(board: Markers, turned: Markers) -> str:
    """What the file says of the markers, what pictures show, and what to write."""
    every = [np.round(deg(rpy_from_rotation(m.rotation)), 6) for m in turned.markers.values()]
    # Half a turn is written as 180, and nothing without a sign.
    angles = {tuple(np.where(turn == -180.0, 180.0, turn + 0.0).tolist()) for turn in every}
    number = next(iter(board.markers))
    right, down = (turned.markers[number].rotation.T @ board.markers[number].rotation)[:2]
    y_up = np.allclose(right, [1, 0, 0]) and np.allclose(down, [0, -1, 0])
    sentence = (
        "The file of the board places the markers with y up, but y of the markers points down"
        if y_up
        else "The markers are rotated on the board against its file"
    )
    first = ", ".join(f"{angle:g}" for angle in next(iter(angles)))
    remedy = (
        f"give every marker rotation_rpy_deg: [{first}]"
        if len(angles) == 1
        else "correct every marker's rotation_rpy_deg"
    )
    return (
        f"{sentence}. The orientation in the pictures is used with the positions in the file, so "
        f"the frame of the board does not change. To correct the file, {remedy}."
    )
