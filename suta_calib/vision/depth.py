"""Corners of a board in 3-D, from pictures of depth that belong pixel by pixel to the pictures.

Depth at a single pixel is no depth of a corner: between black and white, and at an edge, a depth
camera errs most. On a plane the inverse depth is linear in the direction of the ray, so a plane is
fitted robustly to the inverse depths about the corner, and its depth is taken at the corner's ray.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import register_points, rms_length
from suta_calib.measurements import Board, Camera
from suta_calib.measurements.files import read_bytes
from suta_calib.measurements.seen_points import SeenPoints, seen_size, unit_hint
from suta_calib.units import mm
from suta_calib.vision.detection import Detection
from suta_calib.vision.opencv import opencv
from suta_calib.vision.pictures import PictureFile
from suta_calib.words import listed

# Only these are read from a folder of depth.
SUFFIXES: Final = frozenset({".png", ".tif", ".tiff", ".pgm", ".npy"})
# Words of a file's name that tell a picture from its depth, not one picture from another.
_SORT: Final = re.compile(r"aligned|colou?r|rgb|depth|image|img|raw")
# Radius of what is about a corner, pixels of depth: fewer tell no plane, more only take time.
_RADII: Final = (2, 12)
# RMS against the board, part of its distance, that no depth camera errs by.
_MISFIT: Final = 0.02


@dataclass(frozen=True, eq=False)
class BoardDepth(Displayable):
    """A board's corners in 3-D.

    Attributes:
        points: what was seen.
        lost: by the reason, how many corners have no depth.
        rms: by picture, of the distances of its corners from those of the board, m.
        size: how many times as large as its file says the board is seen, and its standard
            deviation; None where too few corners have a depth.
        notes: what must be known of it.
    """

    points: SeenPoints
    lost: Mapping[str, int]
    rms: Mapping[str, float]
    size: tuple[float, float] | None
    notes: tuple[str, ...]

    @property
    def middle_rms(self) -> float | None:
        """That of the middle picture, m."""
        return float(np.median([*self.rms.values()])) if self.rms else None


def find_depth(pictures: Sequence[PictureFile], folder: Path) -> dict[str, Path]:
    """The file of depth that belongs to each picture, by the picture's name.

    Files belong together by their names, apart from words such as color, rgb and depth.

    Raises:
        InputError: no folder, no files in it, none that belongs to a picture, or several to one.
    """
    try:
        files = sorted(f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES)
    except OSError as problem:
        raise InputError(
            f"no folder of depth ({problem.strerror})", "a folder of pictures of depth", file=folder
        ) from None
    kinds = ", ".join(sorted(SUFFIXES))
    if not files:
        raise InputError("a folder without depth", f"files such as {kinds}", file=folder)
    by_key: dict[str, list[Path]] = {}
    for file in files:
        by_key.setdefault(_key(file.stem), []).append(file)
    depths = {p.name: by_key.get(_key(p.path.stem), []) for p in pictures}
    for name, mine in depths.items():
        if len(mine) > 1:
            raise InputError(
                f"several files of depth for {name}: {listed([f.name for f in mine], 3)}",
                "one for each picture, with its name",
                file=folder,
            )
    paired = {name: mine[0] for name, mine in depths.items() if mine}
    if not paired:
        raise InputError(
            f"depth called {files[0].name} and pictures called {pictures[0].name}",
            "the same names, such as 07.png and 07.png, or color_07.png and depth_07.png",
            file=folder,
        )
    return paired


def _key(stem: str) -> str:
    return re.sub(r"[\W_]+", " ", _SORT.sub(" ", stem.lower())).strip()


def read_depth(path: Path, step: float | None = None) -> FloatArray:
    """Depths (height, width), m, along the camera's axis; NaN where there is none.

    Args:
        path: of a picture with 16 bits or floating-point numbers, or of an array (.npy).
        step: m for each unit of the file; by default whole numbers are mm, and others m.

    Raises:
        InputError: not readable, no such picture, or one that is made to be looked at.
    """
    data = read_bytes(path)
    try:
        raw: Any = (
            np.load(io.BytesIO(data), allow_pickle=False)
            if path.suffix.lower() == ".npy"
            else _decoded(data)
        )
    except (ValueError, EOFError, opencv().error) as problem:
        raise InputError(f"a file that cannot be read ({problem})", file=path) from None
    if raw is None:
        raise InputError("not a picture, or an incomplete one", "a picture of depth", file=path)
    found = f"{raw.dtype} numbers of shape {raw.shape}"
    if raw.ndim == 3 and raw.shape[2] == 1:
        raw = raw[..., 0]
    if raw.ndim != 2 or raw.dtype.kind not in "uif" or raw.dtype.itemsize < 2:
        raise InputError(
            found,
            "one number of 16 bits or more for each pixel",
            file=path,
            hint="it looks like depth that was coloured to be looked at: save the depth itself",
        )
    integers = raw.dtype.kind in "ui"
    depth = raw.astype(float)
    # The largest number stands for what is too far.
    none = ~np.isfinite(depth) | (depth <= 0)
    if integers:
        none |= raw == np.iinfo(raw.dtype).max
    depth[none] = np.nan
    return np.asarray(depth * ((1e-3 if integers else 1.0) if step is None else step))


def _decoded(data: bytes) -> Any:
    cv2 = opencv()
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None


def board_depth(
    detection: Detection,
    files: Mapping[str, Path],
    step: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> BoardDepth:
    """Where the corners that were found in pictures are in 3-D.

    Args:
        detection: of the corners, with a camera.
        files: of depth, by the picture's name.
        step: as of `read_depth`.
        progress: is told how many pictures are done, and of how many.

    Raises:
        InputError: depth of other pictures, in another unit, or mirrored; or none at any corner.
    """
    camera, corners = detection.camera, detection.corners
    if camera is None:
        raise InputError(
            "no camera", "the camera of the pictures: its rays", hint="give its file with --camera"
        )
    lost, seen, rows = Counter[str](), list[FloatArray](), list[int]()
    images = [name for name in corners.images if name in files]
    for done, name in enumerate(images, 1):
        depth, mine = read_depth(files[name], step), np.flatnonzero(corners.image == name)
        check_shape(depth, camera, files[name])
        located, reasons = corners_in_depth(depth, corners.pixel[mine], camera)
        lost.update(reason for reason in reasons if reason)
        there = np.isfinite(located[:, 2])
        seen.append(located[there])
        rows += mine[there].tolist()
        if progress is not None:
            progress(done, len(images))
    if unpaired := len(corners.images) - len(images):
        lost["their picture has no file of depth"] += int(np.sum(~np.isin(corners.image, images)))
    if not rows:
        (reason, _), *_ = lost.most_common() or [("no corners", 0)]
        raise InputError(f"no depth at any corner: {reason}", "depth where the board is")
    index = np.array(rows)
    points = SeenPoints(
        corners.image[index], corners.point[index].astype(np.str_), np.concatenate(seen)
    )
    pairs = _pairs(points, detection.board)
    size = seen_size([*pairs.values()])
    if size is not None and unit_hint(size[0]):
        raise InputError(
            f"a board that is seen {size[0]:.3g} times as large as board.yaml has it",
            "depth in the unit that was given",
            file=next(iter(files.values())),
            hint=f"the depth seems to be in {unit_hint(size[0])}: give --depth-unit",
        )
    rms = {name: _rms(*pair) for name, pair in pairs.items()}
    notes = [*_notes(size, rms, points, unpaired, len(corners.images))]
    middle = float(np.median([*rms.values()])) if rms else 0.0
    if middle > _MISFIT * float(np.median(points.position[:, 2])):
        _check_mirrored(detection, files, step, middle)
    return BoardDepth(points, dict(lost), rms, size, tuple(notes))


def check_shape(depth: FloatArray, camera: Camera, path: Path) -> None:
    """Refuse depth that is not of the same picture, smaller or larger."""
    height, width = depth.shape
    # Rounding of a size that was halved and halved again.
    same = abs(width * camera.height - height * camera.width) <= max(camera.width, camera.height)
    if not same:
        raise InputError(
            f"depth of {width}x{height} px where the camera has {camera.width}x{camera.height}",
            "depth that belongs to the picture pixel by pixel, or a smaller copy of that",
            file=path,
            hint="align the depth with the colour first: ROS has depth/aligned_depth_to_color and "
            "depth_image_proc/register, camera libraries an align filter",
        )


def corners_in_depth(
    depth: FloatArray, pixels: FloatArray, camera: Camera
) -> tuple[FloatArray, list[str]]:
    """Points (n, 3), m, in the camera, at pixels (n, 2) of the picture; and why some are NaN.

    The depth (height, width), m, may be a smaller or larger copy of the picture's.
    """
    count, scale = len(pixels), depth.shape[1] / camera.width
    points, reasons = np.full((count, 3), np.nan), [""] * count
    # Where a pixel's centre is in the copy.
    at = (pixels + 0.5) * scale - 0.5
    # Part of the way to the next corner that counts as about a corner: a square is flat, and
    # farther off the paper may end.
    radius = int(np.clip(0.4 * scale * _spacing(pixels), *_RADII))
    side = np.arange(-radius, radius + 1)
    window = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    window = window[np.sum(window**2, axis=1) <= (radius + 0.5) ** 2]
    grid = np.round(at).astype(np.intp)[:, None] + window
    inside = np.all((grid >= 0) & (grid < depth.shape[::-1]), axis=2)
    u, v = np.moveaxis(np.where(inside[..., None], grid, 0), -1, 0)
    at_pixel = np.where(inside, depth[v, u], np.nan)
    there = np.isfinite(at_pixel)
    rays = camera.undistort((grid + 0.5) / scale - 0.5)
    corner_rays = camera.undistort(pixels)
    for k in range(count):
        # Of the pixels about a corner, the part that must have a depth.
        if there[k].mean() < 0.5:
            reasons[k] = "most pixels about them have no depth"
            continue
        rows = there[k] & np.isfinite(rays[k]).all(axis=1)
        about = rays[k][rows] - corner_rays[k]
        inverse, used = _plane_at_zero(about, 1.0 / at_pixel[k][rows])
        if not (inverse > 0 and _surrounded(about[used])):
            reasons[k] = "the depth about them is no plane around the corner"
            continue
        points[k] = np.array([*corner_rays[k], 1.0]) / inverse
    return points, reasons


def _spacing(pixels: FloatArray) -> float:
    """Way from a corner to the next one, px: of the middle corner."""
    if len(pixels) < 2:
        return 2.0 * _RADII[1]
    distances = np.linalg.norm(pixels[:, None] - pixels, axis=2)
    np.fill_diagonal(distances, np.inf)
    return float(np.median(distances.min(axis=1)))


def _plane_at_zero(about: FloatArray, inverse: FloatArray) -> tuple[float, BoolArray]:
    """Inverse depth of a plane in the middle, robustly, and which pixels (n,) are on it.

    Least absolute differences first, then Tukey's weights by the scatter about those.
    """
    columns = np.column_stack([about, np.ones(len(about))])
    weight, plane = np.ones(len(about)), np.zeros(3)
    # Of Tukey's biweight, with an efficiency of 95 %.
    tukey = 4.685
    spread = 0.0
    for step in range(8):
        root = np.sqrt(weight)
        plane = np.linalg.lstsq(columns * root[:, None], inverse * root, rcond=None)[0]
        off = np.abs(inverse - columns @ plane)
        # Whole millimetres scatter by less than nothing about some planes.
        spread = max(float(np.median(off)) / 0.6745, 1e-6 * float(np.median(inverse)))
        if step < 3:
            weight = 1.0 / np.maximum(off, 0.1 * spread)
        else:
            weight = np.maximum(1.0 - (off / (tukey * spread)) ** 2, 0.0) ** 2
    return float(plane[2]), np.asarray(weight > 0)


def _surrounded(about: FloatArray) -> bool:
    """Whether points (n, 2) are on all sides of the origin: beside them a plane is a guess."""
    sides = [np.mean(sign * about[:, axis] >= 0) for axis in (0, 1) for sign in (-1, 1)]
    # Of those on each side of it, the part that must have a depth.
    return bool(len(about) >= 9 and min(sides) > 0.15)


def _pairs(points: SeenPoints, board: Board) -> dict[str, tuple[FloatArray, FloatArray]]:
    """By picture, points on the board and in the camera, of pictures with four or more."""
    on_board = board.positions(points.point.astype(np.intp))
    rows = {n: np.flatnonzero(points.image == n) for n in dict.fromkeys(points.image.tolist())}
    return {n: (on_board[k], points.position[k]) for n, k in rows.items() if len(k) >= 4}


def _rms(on_board: FloatArray, seen: FloatArray) -> float:
    R, p = register_points(on_board, seen)
    return rms_length(seen - on_board @ R.T - p)


def _check_mirrored(
    detection: Detection, files: Mapping[str, Path], step: float | None, middle: float
) -> None:
    """Refuse depth that fits the board far better once it is mirrored, or turned."""
    corners, camera = detection.corners, detection.camera
    assert camera is not None
    turned: dict[str, Callable[[FloatArray], FloatArray]] = {
        "mirrored left to right": lambda depth: depth[:, ::-1],
        "mirrored top to bottom": lambda depth: depth[::-1],
        "turned by 180°": lambda depth: depth[::-1, ::-1],
    }
    # Pictures that are asked: what is wrong is wrong with all.
    names = [name for name in corners.images if name in files][:5]
    for what, other in turned.items():
        errors = list[float]()
        for name in names:
            mine = corners.image == name
            points, _ = corners_in_depth(
                other(read_depth(files[name], step)), corners.pixel[mine], camera
            )
            there = np.isfinite(points[:, 2])
            if there.sum() >= 4:
                on_board = detection.board.positions(corners.point[mine][there])
                errors.append(_rms(on_board, points[there]))
        if errors and 3.0 * float(np.median(errors)) < middle:
            raise InputError(
                f"depth that fits the board to {mm(middle):.3g} mm, and to "
                f"{mm(float(np.median(errors))):.3g} mm if it is {what}",
                "depth that belongs to the picture pixel by pixel",
                file=files[names[0]],
                hint=f"the depth seems to be {what}, other than the pictures: save both alike",
            )


def _notes(
    size: tuple[float, float] | None,
    rms: Mapping[str, float],
    points: SeenPoints,
    unpaired: int,
    pictures: int,
) -> list[str]:
    """What must be known of it."""
    notes, away = list[str](), float(np.median(points.position[:, 2]))
    if unpaired:
        notes.append(f"{unpaired} of {pictures} pictures with the board have no file of depth.")
    middle = float(np.median([*rms.values()])) if rms else 0.0
    if middle > _MISFIT * away:
        notes.append(
            f"The corners in 3-D differ from the board by {mm(middle):.3g} mm (RMS) at "
            f"{mm(away):.0f} mm. No depth camera is so bad: check that the depth is aligned with "
            "the pictures, and that the camera's file is that of the pictures."
        )
    # One part in a thousand is 1 mm at a metre: less is no matter with a depth camera.
    if size is not None and abs(size[0] - 1.0) > max(1e-3, 4.0 * size[1]):
        notes.append(
            f"The board is seen {abs(size[0] - 1):.2%} ± {size[1]:.2%} too "
            f"{'large' if size[0] > 1 else 'small'}: {mm(abs(size[0] - 1) * away):.2g} mm at "
            f"{mm(away):.0f} mm. Either the depth has another scale, or the squares of the board "
            "have another size: measure the board."
        )
    return notes
