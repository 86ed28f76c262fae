"""Pictures of a board as a camera would take them, with known truth: for tests and examples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.lens import Lens
from suta_calib.measurements.board import Board, Charuco, Chessboard, Markers
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.depth_noise import DepthNoise
from suta_calib.vision.markers import marker_bits, marker_cells
from suta_calib.vision.opencv import opencv
from suta_calib.vision.pictures import Grey


@dataclass(frozen=True)
class RenderOptions:
    """How a picture is taken.

    Attributes:
        black, white: greys of the print.
        background: grey of what lies behind the paper.
        margin: white paper around the board, squares or, around markers, halves of their size.
        blur: standard deviation of the lens' blur, px.
        noise: standard deviation of a pixel, grey levels.
        samples: rays through a pixel, in each direction.
    """

    black: float = 30.0
    white: float = 210.0
    background: float = 90.0
    margin: float = 0.7
    blur: float = 0.7
    noise: float = 2.0
    samples: int = 4


def rendered(
    board: Board,
    camera: Camera,
    T_camera_board: FloatArray,
    random: np.random.Generator,
    options: RenderOptions | None = None,
    *,
    scene: FloatArray | None = None,
) -> Grey:
    """A picture of a plane board.

    Args:
        board: in its plane z = 0.
        camera: with its distortion.
        T_camera_board: (4, 4) the board's pose in the camera, m.
        random: noise is drawn from.
        options: how it is taken.
        scene: (height, width) greys behind the paper; `RenderOptions.background` everywhere
            without.

    Returns:
        (height, width) greys, 8 bits.
    """
    how = options or RenderOptions()
    behind = how.background if scene is None else scene
    picture = np.full((camera.height, camera.width), behind, dtype=float)
    rays = _rays(camera.width, camera.height, camera.lens, tuple(camera.intrinsics.tolist()))
    plane = np.asarray(np.linalg.inv(T_camera_board[:3][:, [0, 1, 3]]), dtype=np.float64)
    paper, _ = _taken(board, rays, plane, how)
    rows, columns = np.flatnonzero(paper.any(axis=1)), np.flatnonzero(paper.any(axis=0))
    if len(rows):
        # Many rays to a pixel are worth their time only where the board is.
        at = tuple(slice(max(pixels[0] - 1, 0), pixels[-1] + 2) for pixels in (rows, columns))
        fine = _finer(rays[at], how.samples)
        paper, grey = _taken(board, fine, plane, how)
        there = np.repeat(np.repeat(picture[at], how.samples, axis=0), how.samples, axis=1)
        mixed = np.where(paper, grey, there)
        height, width = picture[at].shape
        picture[at] = mixed.reshape(height, how.samples, width, how.samples).mean(axis=(1, 3))
    if how.blur > 0:
        picture = opencv().GaussianBlur(picture, (0, 0), how.blur)
    noisy = picture + how.noise * random.standard_normal(picture.shape)
    return np.asarray(np.clip(np.round(noisy), 0, 255), dtype=np.uint8)


def rendered_depth(
    board: Board,
    camera: Camera,
    T_camera_board: FloatArray,
    random: np.random.Generator,
    noise: DepthNoise,
    behind: float = 3.0,
) -> FloatArray:
    """Depths (height, width), m, of a plane board as an aligned depth camera would see it.

    Args:
        board: in its plane z = 0.
        camera: of the pictures.
        T_camera_board: (4, 4) the board's pose in the camera, m.
        random: noise is drawn from, for each pixel by itself.
        noise: along the ray.
        behind: depth of a wall, m.
    """
    rays = _rays(camera.width, camera.height, camera.lens, tuple(camera.intrinsics.tolist()))
    plane = np.asarray(np.linalg.inv(T_camera_board[:3][:, [0, 1, 3]]), dtype=np.float64)
    paper, _ = _taken(board, rays, plane, RenderOptions())
    normal, origin = T_camera_board[:3, 2], T_camera_board[:3, 3]
    ahead = rays / rays[..., 2:]
    slope = ahead @ normal
    depth = np.where(paper, (normal @ origin) / np.where(paper, slope, 1.0), behind)
    sigma = noise.sigmas(depth.reshape(-1))[:, 2].reshape(depth.shape)
    return np.asarray(depth + sigma * random.standard_normal(depth.shape))


@lru_cache(maxsize=4)
def _rays(width: int, height: int, lens: Lens, intrinsics: tuple[float, ...]) -> FloatArray:
    """Directions (height, width, 3) of what is seen at each pixel's centre."""
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return lens.directions(pixels, intrinsics)


def _finer(rays: FloatArray, samples: int) -> FloatArray:
    """Rays (height · s, width · s, 3) through every pixel, where a lens is as good as linear."""
    inside = (np.arange(samples) + 0.5) / samples - 0.5
    down, right = (np.gradient(rays, axis=k) for k in (0, 1))
    fine = (
        rays[:, None, :, None]
        + right[:, None, :, None] * inside[:, None]
        + down[:, None, :, None] * inside[:, None, None, None]
    )
    height, width = rays.shape[:2]
    return np.asarray(fine.reshape(height * samples, width * samples, 3))


def _taken(
    board: Board, rays: FloatArray, plane: FloatArray, how: RenderOptions
) -> tuple[BoolArray, FloatArray]:
    """Whether rays (h, w, 3) meet paper, and which grey."""
    homogeneous = rays @ plane.T
    ahead = homogeneous[..., 2] > 0
    depth = np.where(ahead, homogeneous[..., 2], 1.0)
    paper, white = _print(
        board, homogeneous[..., 0] / depth, homogeneous[..., 1] / depth, how.margin
    )
    return paper & ahead, how.black + (how.white - how.black) * white


def _print(
    board: Board, x: FloatArray, y: FloatArray, margin: float
) -> tuple[BoolArray, FloatArray]:
    """Whether there is paper at x, y, m, on the board, and how white: 0 to 1."""
    if isinstance(board, Markers):
        return _markers(board, x, y, margin)
    assert isinstance(board, Chessboard | Charuco)
    u, v = x / board.square, y / board.square
    if isinstance(board, Chessboard):
        # A board's origin is its first inner corner; the print begins a square before.
        u, v, columns, rows = u + 1, v + 1, board.columns + 1, board.rows + 1
    else:
        columns, rows = board.columns, board.rows
    paper = (u > -margin) & (u < columns + margin) & (v > -margin) & (v < rows + margin)
    i, j = np.floor(u).astype(np.intp), np.floor(v).astype(np.intp)
    squares = (u >= 0) & (i < columns) & (v >= 0) & (j < rows)
    white = np.where(squares & ((i + j) % 2 == 0), 0.0, 1.0)
    if isinstance(board, Charuco):
        numbers = np.full((rows, columns), -1)
        cells = marker_cells(board)
        numbers[cells[:, 1], cells[:, 0]] = np.arange(len(cells))
        number = np.where(squares, numbers[np.clip(j, 0, rows - 1), np.clip(i, 0, columns - 1)], -1)
        part = board.marker / board.square
        a, b = ((u - i) - 0.5) / part + 0.5, ((v - j) - 0.5) / part + 0.5
        bits = np.array([marker_bits(board.dictionary, k) for k in range(len(cells))])
        white = np.where(number >= 0, _cell(bits, number, a, b), white)
    return paper, white


def _markers(
    board: Markers, x: FloatArray, y: FloatArray, margin: float
) -> tuple[BoolArray, FloatArray]:
    paper, white = np.zeros(x.shape, dtype=np.bool_), np.ones(x.shape)
    for number, marker in board.markers.items():
        R = marker.rotation[:2, :2]
        du, dv = x - marker.position[0], y - marker.position[1]
        a = (R[0, 0] * du + R[1, 0] * dv) / marker.size + 0.5
        b = (R[0, 1] * du + R[1, 1] * dv) / marker.size + 0.5
        paper |= (np.abs(a - 0.5) < (1 + margin) / 2) & (np.abs(b - 0.5) < (1 + margin) / 2)
        bits = marker_bits(board.dictionary, number)[None]
        white = np.minimum(white, _cell(bits, np.zeros(x.shape, dtype=np.intp), a, b))
    return paper, white


def _cell(bits: FloatArray, number: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Of markers (m, k, k): how white the one of a number is at a, b from 0 to 1; white outside."""
    cells = bits.shape[-1]
    i, j = np.floor(a * cells).astype(np.intp), np.floor(b * cells).astype(np.intp)
    inside = (i >= 0) & (i < cells) & (j >= 0) & (j < cells)
    i, j = np.clip(i, 0, cells - 1), np.clip(j, 0, cells - 1)
    return np.where(inside, bits[np.maximum(number, 0), j, i], 1.0)
