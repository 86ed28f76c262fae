"""Closed forms for a camera that sees a board: the board's pose, and the intrinsics.

What is found here is where a solver starts. Homographies and projections are found linearly from
points that are first centred and scaled (Hartley 1997, doi:10.1109/34.601246).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import BoardError, SamplesError
from suta_calib.geometry.lens import PLUMB_BOB
from suta_calib.geometry.numbers import (
    nearest_rotation,
    rotation_from_vector,
    skew,
    vector_turning_z_to,
)
from suta_calib.measurements import Board, Camera, Corners

# Points of a plane that determine a homography.
PLANAR: Final = 4


def board_poses(
    points: FloatArray, pixels: FloatArray, near: tuple[FloatArray, FloatArray] | None = None
) -> tuple[FloatArray, FloatArray]:
    """``T_eye_board`` of pictures, each by its own points; NaN where these do not determine it.

    Points in a plane give a homography, whose first columns are the plane's axes; others a
    projection. From the nearest rotation to what is found the reprojection error is minimised. The
    board's points (k, 3) are in m; an ideal camera of focal length one sees them at pixels (n, k,
    2), NaN where it does not.

    A few points of a plane look nearly the same from two sides (Schweighofer, Pinz 2006,
    doi:10.1109/TPAMI.2006.252). Where poses are known roughly, the minimum ``near`` them is found.
    """
    rotation, position = np.full((len(pixels), 3, 3), np.nan), np.full((len(pixels), 3), np.nan)
    there = np.asarray(np.isfinite(pixels).all(axis=2))
    rows = np.flatnonzero(there.sum(axis=1) >= PLANAR)
    if not len(rows):
        return rotation, position
    middle = _middle(np.broadcast_to(points, (len(rows), *points.shape)), there[rows])
    offsets = np.where(there[rows, :, None], points - middle[:, None], 0.0)
    _, size, axes = np.linalg.svd(np.linalg.qr(offsets, mode="r"))
    axes = axes * np.stack([np.ones(len(rows))] * 2 + [np.linalg.det(axes)], axis=1)[:, :, None]
    # Second over first singular value of points on a line, third over first of points in a plane.
    line, flat = size[:, 1] <= 1e-2 * size[:, 0], size[:, 2] <= 1e-3 * size[:, 0]
    for kind, dimension in ((flat & ~line, 2), (~flat & ~line, 3)):
        mine = np.flatnonzero(kind)
        which, local = rows[mine], (offsets[mine] @ np.swapaxes(axes[mine], 1, 2))[..., :dimension]
        matrix = _linear_of_each(local, pixels[which], there[which])
        columns, shift = matrix[..., :-1], matrix[..., -1]
        # A homography has no sign: what is seen is ahead.
        sign = np.where(shift[:, 2] < 0.0, -1.0, 1.0)
        columns = sign[:, None, None] * columns
        if dimension == 2:
            length = np.linalg.norm(columns, axis=1).mean(axis=1)
            across = np.cross(columns[..., 0], columns[..., 1]) / length[:, None]
            columns = np.concatenate([columns, across[..., None]], axis=2)
        located = np.isfinite(columns).all(axis=(1, 2)) & np.isfinite(shift).all(axis=1)
        mine, which, columns, shift = (
            mine[located],
            which[located],
            columns[located],
            shift[located],
        )
        if dimension == 3:
            length = np.linalg.svd(columns, compute_uv=False).mean(axis=1)
        else:
            length = length[located]
        start = sign[located, None] * shift / length[:, None]
        turn = nearest_rotation(columns) @ axes[mine]
        if near is not None:
            R, p = near[0][which], near[1][which]
            p = p + (R @ middle[mine, :, None])[..., 0]
            depth = (offsets[mine] @ np.swapaxes(R, 1, 2) + p[:, None])[..., 2]
            ahead = np.min(depth, axis=1) > 0.0
            turn = np.where(ahead[:, None, None], R, turn)
            start = np.where(ahead[:, None], p, start)
        R, p = _refined(offsets[mine], pixels[which], there[which], turn, start)
        rotation[which], position[which] = R, p - (R @ middle[mine, :, None])[..., 0]
    return rotation, position


def poses_in_camera(
    points: FloatArray,
    pixels: FloatArray,
    camera: Camera,
    near: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """`board_poses` of pictures (n, k, 2), px, by a camera with its lens.

    A lens may see a board beside itself, where no point has a place at unit depth: each picture is
    turned first, so that what is seen is ahead.
    """
    if not camera.lens.sees_behind:
        return board_poses(points, camera.undistort(pixels), near)
    turn, turned, _ = ahead_of(camera.directions(pixels))
    if near is not None:
        back = np.swapaxes(turn, 1, 2)
        near = back @ near[0], (back @ near[1][:, :, None])[:, :, 0]
    rotation, position = board_poses(points, turned, near)
    return turn @ rotation, (turn @ position[:, :, None])[:, :, 0]


def ahead_of(rays: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Directions (..., k, 3) in a frame (..., 3, 3) in whose z axis their middle is.

    They are at unit depth there (..., k, 2), and the last (..., k) says which are in front of it.
    """
    middle = np.nan_to_num(rays).sum(axis=-2)
    length = np.linalg.norm(middle, axis=-1, keepdims=True)
    middle = np.where(length > 0, middle / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
    turn = rotation_from_vector(vector_turning_z_to(middle))
    rays = rays @ turn
    ahead = rays[..., 2] > 1e-2
    return turn, rays[..., :2] / np.where(ahead, rays[..., 2], np.nan)[..., None], ahead


def _refined(
    points: FloatArray,
    pixels: FloatArray,
    there: BoolArray,
    rotation: FloatArray,
    position: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The poses of least reprojection error, by Gauss and Newton from one that is near.

    A step that does not help ends it: what is near is then the answer. Positions are of the middle
    about which the points (n, k, 3) are.
    """
    # Steps of a refinement, and the relative gain from where on it is settled.
    steps = 10
    settled = 1e-6
    best = rotation.copy(), position.copy()
    rows, error = np.arange(len(pixels)), np.full(len(pixels), np.inf)
    for _ in range(steps):
        turned = points[rows] @ np.swapaxes(rotation, 1, 2)
        x, y, z = np.moveaxis(turned + position[:, None], 2, 0)
        # What is not seen counts as seen where it belongs.
        z = np.where(there[rows], z, 1.0)
        residual = np.stack([x / z, y / z], axis=2) - pixels[rows]
        residual[~there[rows]] = 0.0
        squared = np.sum(residual**2, axis=(1, 2))
        better = (squared < error[rows]) & (z > 0).all(axis=1)
        best[0][rows[better]], best[1][rows[better]] = rotation[better], position[better]
        going = better & ~(error[rows] - squared <= settled * squared)
        error[rows] = squared
        rows, rotation, position = rows[going], rotation[going], position[going]
        if not len(rows):
            break
        x, y, z, turned, residual = (part[going] for part in (x, y, z, turned, residual))
        by_point = np.zeros((*z.shape, 2, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = 1.0 / z
        by_point[..., 0, 2], by_point[..., 1, 2] = -x / z**2, -y / z**2
        by_point[~there[rows]] = 0.0
        # The point moves with the position, and with a turn about the camera's axes.
        jacobian = np.concatenate([by_point, -by_point @ skew(turned)], axis=3)
        jacobian = jacobian.reshape(len(rows), -1, 6)
        transposed = np.swapaxes(jacobian, 1, 2)
        slope = transposed @ residual.reshape(len(rows), -1, 1)
        step = -(np.linalg.pinv(transposed @ jacobian, hermitian=True) @ slope)[..., 0]
        rotation = rotation_from_vector(step[:, 3:]) @ rotation
        position = position + step[:, :3]
    return best


def _linear(points: FloatArray, pixels: FloatArray) -> FloatArray | None:
    """(3, d + 1) that takes points (k, d) to homogeneous coordinates of what is seen (k, 2).

    Up to a factor; None where several do.
    """
    (matrix,) = _linear_of_each(
        points[None], pixels[None], np.ones((1, len(points)), dtype=np.bool_)
    )
    return matrix if np.isfinite(matrix).all() else None


def _linear_of_each(points: FloatArray, pixels: FloatArray, there: BoolArray) -> FloatArray:
    """(n, 3, d + 1) that take points (n, k, d) to homogeneous coordinates of pixels (n, k, 2).

    Up to a factor, by the points that are ``there`` (n, k); NaN where several do.
    """
    n, k, dimension = points.shape
    width = dimension + 1
    to_points, to_seen = _unit_size(points, there), _unit_size(pixels, there)
    counted = there[..., None].astype(float)
    source = np.concatenate([np.where(there[..., None], points, 0.0), counted], axis=2)
    target = np.concatenate([np.where(there[..., None], pixels, 0.0), counted], axis=2)
    source, target = (
        rows @ np.swapaxes(to, 1, 2) for rows, to in ((source, to_points), (target, to_seen))
    )
    # With as many rows as unknowns at least, all singular vectors are there.
    rows = np.zeros((n, max(k, -(-3 * width // 2)), 2, 3 * width))
    rows[:, :k, 0, :width] = rows[:, :k, 1, width : 2 * width] = source
    rows[:, :k, :, 2 * width :] = -target[:, :, :2, None] * source[:, :, None, :]
    rows = rows.reshape(n, 2 * rows.shape[1], 3 * width)
    matrices = np.full((n, 3, width), np.nan)
    # Six points of a body determine a projection.
    enough = there.sum(axis=1) >= (PLANAR if dimension == 2 else 6)
    enough &= np.isfinite(rows).all(axis=(1, 2))
    # Of the many rows nothing but their triangle is looked at.
    _, singular, vectors = np.linalg.svd(np.linalg.qr(rows[enough], mode="r"))
    # Second smallest over largest singular value below which a linear system has several solutions.
    several = singular[:, 3 * width - 2] <= 1e-9 * singular[:, 0]
    matrix = np.linalg.solve(
        to_seen[enough], vectors[:, -1].reshape(-1, 3, width) @ to_points[enough]
    )
    matrix[several] = np.nan
    matrices[enough] = matrix
    return matrices


def _middle(points: FloatArray, there: BoolArray) -> FloatArray:
    """(n, d) mean of those points (n, k, d) that are there."""
    total = np.where(there[..., None], points, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(there.sum(axis=1), 1)[:, None])


def _unit_size(points: FloatArray, there: BoolArray) -> FloatArray:
    """(n, d + 1, d + 1) homogeneous, that bring points (n, k, d) to their middle and unit size."""
    n, _, dimension = points.shape
    middle = _middle(points, there)
    squared = _middle((points - middle[:, None]) ** 2, there).mean(axis=1)
    scale = 1.0 / np.maximum(np.sqrt(squared), 1e-300)
    matrix = np.tile(np.eye(dimension + 1), (n, 1, 1))
    matrix[:, :dimension, :dimension] *= scale[:, None, None]
    matrix[:, :dimension, dimension] = -scale[:, None] * middle
    return matrix


def closed_form_camera(corners: Corners, board: Board) -> Camera:
    """A camera as its pictures of a flat board show it, without distortion.

    Its picture is taken to end where the corners do: its real size is in none of them.

    Raises:
        BoardError: one that is not flat.
        SamplesError: corners of another board, or pictures that do not tell the focal length.
    """
    if not board.flat:
        raise BoardError(
            "a board that is not flat",
            "a flat one, where no camera is given",
            hint="calibrate the camera first, and name its file",
        )
    by_image = [corners.take(corners.image == image) for image in corners.images]
    boards = [board.positions(mine.point) for mine in by_image]
    pictures = [mine.pixel for mine in by_image]
    _check_board(by_image, board)
    closed_form = closed_form_intrinsics(boards, pictures)
    if closed_form is None:
        raise SamplesError(
            "pictures that do not determine the focal length",
            "pictures of a board that is tilted in several directions",
            file=corners.path,
            hint="or give the camera's file",
        )
    width, height = (int(size) + 1 for size in corners.pixel.max(axis=0))
    intrinsics = np.concatenate([closed_form, np.zeros(len(PLUMB_BOB.distortion))])
    return Camera(width, height, intrinsics)


def columns_exchanged() -> SamplesError:
    """Corners of a board whose file exchanges two numbers, to be raised by the caller."""
    return SamplesError(
        "corners that fit the board if its columns and rows are exchanged",
        "corners of the board as its file has it",
        hint="exchange the two numbers in board.yaml: columns first, then rows",
    )


def _check_board(pictures: Sequence[Corners], board: Board) -> None:
    """Refuse corners that no plane with this board's points shows, whatever the camera."""
    off, other = _off_plane(pictures, board), board.exchanged
    # Part of a board's extent that no lens bends the picture of a plane by, and how many times less
    # another board must leave to be the cause.
    no_plane = 0.1
    if off <= no_plane:
        return
    if other is not None and _off_plane(pictures, other) <= no_plane:
        raise columns_exchanged()
    raise SamplesError(
        f"corners that differ from a flat board by {off:.0%} of its size",
        f"corners of this board ({board.type}), by their numbers",
        hint="does board.yaml have the right numbers of columns and rows?",
    )


def _off_plane(pictures: Sequence[Corners], board: Board) -> float:
    """How far corners are from the best homography of the board, part of its extent.

    Root mean squares; of the middle one of the pictures.
    """
    distances = [0.0]
    for mine in pictures:
        points, pixels = board.positions(mine.point), mine.pixel
        if len(points) <= PLANAR:  # These fit any board.
            continue
        centred = pixels - pixels.mean(axis=0)
        size = float(np.sqrt(np.mean(centred**2)))
        H = _linear(points[:, :2], centred / size)
        if H is not None:
            there = np.column_stack([points[:, :2], np.ones(len(points))]) @ H.T
            error = there[:, :2] / there[:, 2:] - centred / size
            distances.append(float(np.sqrt(np.mean(error**2))))
    return float(np.median(distances[1:] or distances))


def closed_form_intrinsics(
    boards: Sequence[FloatArray], pictures: Sequence[FloatArray]
) -> FloatArray | None:
    """fx, fy, cx, cy (4,), px, from pictures of a plane: Zhang (2000), doi:10.1109/34.888718.

    Without skew. Where the pictures do not tell the principal point, it is the middle of what was
    seen, and pixels are square. Of each picture there are points (k, 3) in the plane z = 0, m, and
    pixels (k, 2). None where not even the focal length is told: all look straight at the board.
    """
    every = np.concatenate(pictures)
    middle, size = (every.min(axis=0) + every.max(axis=0)) / 2.0, float(np.ptp(every, axis=0).max())
    homographies = (
        _linear(b[:, :2], (p - middle) / size) for b, p in zip(boards, pictures, strict=True)
    )
    rows = [
        row for H in homographies if H is not None for row in _conic_rows(H / np.linalg.norm(H))
    ]
    if not rows:
        return None
    for answer in (_free_centre(np.array(rows)), _given_centre(np.array(rows))):
        if answer is not None:
            focal, centre = answer[:2] * size, answer[2:] * size + middle
            return np.concatenate([focal, centre])
    return None


def _conic_rows(H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What one homography says of the image of the absolute conic: B11 B22 B13 B23 B33 (5,)."""

    def row(i: int, j: int) -> FloatArray:
        a, b = H[:, i], H[:, j]
        mixed = (a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1])
        return np.array([a[0] * b[0], a[1] * b[1], *mixed, a[2] * b[2]])

    return row(0, 1), row(0, 0) - row(1, 1)


def _free_centre(rows: FloatArray) -> FloatArray | None:
    """fx, fy, cx, cy in units of the picture, from three homographies or more."""
    if len(rows) < 6:
        return None
    b11, b22, b13, b23, b33 = np.linalg.svd(rows)[2][-1]
    if not (b11 * b22 > 0):
        return None
    cx, cy = -b13 / b11, -b23 / b22
    scale = b33 - b11 * cx**2 - b22 * cy**2
    squared = np.array([scale / b11, scale / b22])
    # How far the principal point may be from the middle of what was seen, in its extents.
    off_centre = 1.5
    if not (squared > 0).all() or np.hypot(cx, cy) > off_centre:
        return None
    return np.array([*np.sqrt(squared), cx, cy])


def _given_centre(rows: FloatArray) -> FloatArray | None:
    """One focal length, with the principal point in the middle."""
    of_focal, constant = rows[:, 0] + rows[:, 1], rows[:, 4]
    square = float(of_focal @ of_focal)
    inverse = -float(of_focal @ constant) / square if square > 0 else 0.0
    return np.array([inverse**-0.5, inverse**-0.5, 0.0, 0.0]) if inverse > 0 else None
