"""Finds pictures that contradict the files of board and camera, and the likely reason.

Another board, another camera or a camera of pictures of another size, pixels that are counted in
another way, corners that are no corners, pictures or boards upside down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.assessment import Level
from suta_calib.errors import InputError, SamplesError
from suta_calib.geometry.lens import LENSES, Lens
from suta_calib.measurements import Board, Camera, corners_of
from suta_calib.terms.board_pictures import QUOTED, ROUNDING, TURNED, BoardPictures
from suta_calib.terms.camera_start import PLANAR, board_poses, columns_exchanged
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.lens_choice import best_lens
from suta_calib.words import listed

# Corners that are off by this part of the board's extent in a picture are of no such board.
NO_BOARD: Final = 0.1
# Pictures of which it is asked: what is wrong with the files is wrong with all.
ENOUGH: Final = 8
# Another board or camera is the cause where it leaves so many times less.
_FAR_LESS: Final = 2.0


def check_files(pictures: BoardPictures) -> None:
    """Refuse corners that contradict the files of board and camera."""
    if (cause := contradiction(pictures)) is not None:
        raise cause


def contradiction(pictures: BoardPictures) -> SamplesError | None:
    """That another board or camera explains the corners far better, or that none does.

    None where nothing speaks against the files.
    """
    if len(pictures.pixels) > ENOUGH:
        chosen = np.linspace(0, len(pictures.pixels) - 1, ENOUGH).astype(np.intp)
        return contradiction(replace(pictures, pixels=pictures.pixels[chosen]))
    # Misfit, part of the board's extent, that any camera leaves: nothing is asked below it.
    if pictures.misfit <= 1e-3:
        return None
    candidates = list(_others(pictures))
    _pose_together(
        [
            other
            for other, _ in candidates
            if other.board is pictures.board and not other.camera.lens.sees_behind
        ]
    )
    misfits = [(other.misfit, error) for other, error in candidates]
    least, cause = min(misfits, key=lambda other: other[0], default=(np.inf, None))
    if _FAR_LESS * least >= pictures.misfit:
        least, cause = pictures.misfit, None
    if (other := _other_camera(pictures, least)) is not None:
        return other
    if cause is not None:
        return cause
    if pictures.misfit <= NO_BOARD:
        return None
    return SamplesError(
        f"corners that differ from the board in any pose by more than {NO_BOARD:.0%} of its size",
        f"corners of this board ({pictures.board.type}), by their numbers",
        hint="are corners, board.yaml and camera.yaml of the same board and camera?",
    )


def _pose_together(candidates: Sequence[BoardPictures]) -> None:
    """Find the poses of one board's pictures by several cameras at once, a tenth of the work."""
    if not candidates:
        return
    rays = [pictures.camera.undistort(pictures.pixels) for pictures in candidates]
    rotation, position = board_poses(candidates[0].points, np.concatenate(rays))
    ends = np.cumsum([len(pictures) for pictures in rays])[:-1]
    for pictures, R, p in zip(
        candidates, np.split(rotation, ends), np.split(position, ends), strict=True
    ):
        vars(pictures)["poses"] = R, p


def _last_row(board: Board) -> BoolArray:
    """(points,) which have the largest y."""
    y = np.array(list(board.points.values()))[:, 1]
    return np.asarray(y > y.max() - ROUNDING)


def _others(pictures: BoardPictures) -> Iterator[tuple[BoardPictures, SamplesError]]:
    """The same corners of another board, or by a camera of another size, and what it means."""
    exchanged = pictures.board.exchanged
    found_corners = np.asarray(np.isfinite(pictures.pixels).all(axis=2))
    # A board of fewer rows has as many columns as this one exchanged, but never its last row.
    if exchanged is not None and found_corners[:, _last_row(exchanged)].any():
        yield replace(pictures, board=exchanged), columns_exchanged()
    if pictures.misfit > NO_BOARD:
        for other in pictures.board.recounted:
            more = len(other.points) - pictures.pixels.shape[1]
            pixels = np.pad(pictures.pixels, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
            yield (
                replace(pictures, board=other, pixels=pixels),
                SamplesError(
                    f"corners that are numbered along rows of {other.columns}",
                    "corners of the board as its file has it",
                    hint="is board.yaml of this board? It counts inner corners: "
                    "columns first, then rows",
                ),
            )
    if other_markers := _other_markers(pictures):
        yield other_markers
    yield from _other_lenses(pictures)
    corners = pictures.pixels[found_corners]
    # Sizes of a picture against the one that the camera's file is of.
    resized = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 3.0, 4.0)
    for factor in resized:
        camera = pictures.camera.resized(factor)
        if not camera.inside(corners).all():
            continue
        yield (
            replace(pictures, camera=camera),
            SamplesError(
                f"corners of pictures of about {camera.width} x {camera.height} px",
                f"of {pictures.camera.width} x {pictures.camera.height} px, as the camera's file "
                "says",
                hint="calibrate the camera on pictures of the same size, or multiply camera_matrix "
                f"in its file by {factor:.3g}",
            ),
        )


def _other_camera(pictures: BoardPictures, least: float) -> SamplesError | None:
    """That the pictures show another camera, which leaves far less than ``least`` by any other.

    None where they do not, or where the difference can be estimated.
    """
    # Misfit, part of the board's extent, of a focal length that is a tenth off, and of a lens that
    # is bent otherwise.
    off, bent = 0.004, 0.01
    if pictures.misfit < off or (shown := shown_camera(pictures)) is None:
        return None
    if _FAR_LESS * replace(pictures, camera=shown).misfit > least:
        return None
    given, stds = pictures.camera, shown.stds
    assert stds is not None
    refocused = np.abs(np.log(shown.intrinsics[:2] / given.intrinsics[:2]))
    sure = 3.0 * stds[:2] / shown.intrinsics[:2]
    # Of two focal lengths of one camera, another focus.
    if pictures.misfit < bent and not (refocused > np.maximum(np.log(1.1), sure)).any():
        return None
    if not pictures.from_file and shown.lens is not given.lens:
        return SamplesError(
            f"corners as {_in_words(shown, bent=False)} shows them",
            f"those of the lens that was taken for it, {given.lens.called}",
            hint=f"use {shown.lens.name} (--lens, or the key lens)",
        )
    same_lens = shown.lens is given.lens and (refocused < np.log(1.02)).all()
    return SamplesError(
        f"corners as {_in_words(shown, bent=same_lens)} shows them",
        f"those of {_in_words(given, bent=same_lens)}, as the camera's file says",
        hint="the file must be for this camera, this lens, this focus and this size of picture: "
        "calibrate the camera (suta-calib detect --camera-out)",
    )


def _in_words(camera: Camera, *, bent: bool) -> str:
    """A camera by what tells it from others; by how its lens is bent where nothing else does."""
    fx, fy, cx, cy, *distortion = camera.intrinsics.tolist()
    words = f"a camera with the lens {camera.lens.called}, fx {fx:.0f}, fy {fy:.0f}, cx {cx:.0f}"
    words += f", cy {cy:.0f} px"
    if bent:
        named = zip(camera.lens.distortion, distortion, strict=True)
        words += "".join(f", {name} {value:.3g}" for name, value in named)
    return words


def shown_camera(pictures: BoardPictures, lens: Lens | None = None) -> Camera | None:
    """The camera that the pictures show by themselves; None where they do not determine one.

    With this lens; without one, with that which predicts left-out pictures best.
    """
    picture, point = np.nonzero(np.isfinite(pictures.pixels).all(axis=2))
    numbers = np.array([*pictures.board.points])[point]
    names = np.array([f"{k:06d}" for k in range(len(pictures.pixels))])[picture]
    corners = corners_of(names, numbers, pictures.pixels[picture, point])
    size = pictures.camera.width, pictures.camera.height
    try:
        return best_lens(corners, corners.images, pictures.board, size, lens).camera
    except InputError:
        return None


def _other_lenses(pictures: BoardPictures) -> Iterator[tuple[BoardPictures, SamplesError]]:
    """The same numbers as those of another model, where it can have them."""
    camera = pictures.camera
    for lens in LENSES.values():
        count = len(lens.distortion)
        bent = np.zeros(max(count, len(camera.intrinsics) - 4))
        bent[: len(camera.intrinsics) - 4] = camera.intrinsics[4:]
        if lens is camera.lens or bent[count:].any():
            continue
        intrinsics = np.concatenate([camera.intrinsics[:4], bent[:count]])
        other = replace(camera, lens=lens, intrinsics=intrinsics, covariance=None)
        yield (
            replace(pictures, camera=other),
            SamplesError(
                f"corners as a lens of the model {lens.called} shows them, with these numbers",
                f"those of {camera.lens.called}, as the camera's file says",
                hint="correct distortion_model in the camera's file",
            ),
        )


def _other_markers(pictures: BoardPictures) -> tuple[BoardPictures, SamplesError] | None:
    """The same corners of markers of the size that agrees best with the ways between them."""
    if pictures.board.with_markers(1.0) is None:
        return None

    def resized(factor: float) -> BoardPictures:
        board = pictures.board.with_markers(factor)
        assert board is not None
        return replace(pictures, board=board)

    # Sizes of markers against those that a board's file has.
    markers = (0.6, 1.6)
    best = minimize_scalar(
        lambda log: resized(np.exp(log)).misfit, bounds=np.log(markers), method="bounded"
    )
    factor = float(np.exp(best.x))
    return resized(factor), SamplesError(
        f"corners of markers that are {factor:.3f} times as large, compared with the distances "
        "between them, as the board's file states",
        "the printed size of the markers, and their places",
        hint="measure the markers and the distances between them; correct size_mm, or all "
        "position_mm",
    )


def other_size(pictures: BoardPictures) -> str:
    """That the camera's file tells a size that its principal point and all corners deny.

    Empty where they do not: a principal point may be far from the middle of pictures that were
    cut out of larger ones, but then corners are beyond twice of it.
    """
    camera = pictures.camera
    size = np.array([camera.width, camera.height])
    # Pixels are counted from the centre of the first one.
    middle = camera.intrinsics[2:4]
    full_size = 2.0 * middle + 1.0
    # Part of a picture's size up to which twice its principal point comes near it in any camera.
    centred = 0.8
    small = full_size < centred * size
    pixels = pictures.pixels[np.isfinite(pictures.pixels).all(axis=2)]
    if not small.any() or (pixels + 0.5 > full_size)[:, small].any():
        return ""
    return (
        f"The camera's file states {camera.width} x {camera.height} px, but its principal point "
        f"({middle[0]:.1f}, {middle[1]:.1f}) px is the middle of about {full_size[0]:.0f} x "
        f"{full_size[1]:.0f} px, and no corner is outside that. Either image_width and "
        "image_height, or camera_matrix, are for pictures of another size."
    )


def otherwise_read(pictures: BoardPictures) -> Iterator[tuple[str, FloatArray]]:
    """The pixels as they are if they were counted or taken in another way; which.

    Each mirrors the pictures, which no pose of a board makes up for in all of them.
    """
    u, v = pictures.pixels[..., 0], pictures.pixels[..., 1]
    right, below = pictures.camera.width - 1.0, pictures.camera.height - 1.0
    for sentence, other in (
        ("v counts upwards, from the lowest row, or the pictures are mirrored", (u, below - v)),
        ("u and v are exchanged", (v, u)),
        ("left and right are exchanged in the pictures", (right - u, v)),
    ):
        yield sentence, np.stack(other, axis=-1)


def doubts(
    pictures: BoardPictures, names: Sequence[str], hand: Poses, *, robust: bool
) -> dict[str, Level]:
    """What is wrong with the pictures by themselves, and what an answer is worth for it.

    The hand is as `BoardPictures.upside_down` has it. Where corners that are far off pull no harder
    than others (``robust``), they spoil nothing.
    """
    levels: dict[str, Level] = {}
    sentence, level = pictures.numbered_otherwise
    if sentence:
        levels[sentence] = level
    if other := other_size(pictures):
        levels[other] = "care"
    level = "care" if robust else "bad"
    levels |= dict.fromkeys(_strange(pictures, names), level)
    for what, rows in pictures.upside_down(hand).items():
        if rows.any():
            turned = listed(np.array(names)[rows].tolist(), QUOTED)
            levels[f"In {turned} {TURNED[what]} Leave these pictures out (exclude)."] = "bad"
    return levels


def _strange(pictures: BoardPictures, names: Sequence[str]) -> list[str]:
    """Pictures whose corners are far from where they are in any pose of the board; which."""
    # Errors of a picture, in those of the middle one and in px, from which on corners are wrong.
    far_off = 10.0
    visible_px = 2.0
    off = pictures.rms
    limit = (
        max(far_off * float(np.nanmedian(off)), visible_px) if np.isfinite(off).any() else np.inf
    )
    nowhere = pictures.posed & np.isnan(off)
    sentences = []
    for k in np.flatnonzero(nowhere | (off > limit)).tolist():
        if nowhere[k]:
            wrong = "no pose of the board has its corners in front of the camera"
        else:
            what = _blunder(pictures, k, limit) or f"the corners are {off[k]:.0f} px"
            wrong = f"{what} from the places that the board has in any pose"
        sentences.append(f"In {names[k]} {wrong}. Leave this picture out (exclude).")
    return sentences


def _blunder(pictures: BoardPictures, picture: int, limit: float) -> str:
    """The corner without which all others are within ``limit`` px; empty if there is none."""
    corners = np.flatnonzero(np.isfinite(pictures.pixels[picture]).all(axis=1))
    if len(corners) <= PLANAR:
        return ""
    pixels = np.repeat(pictures.pixels[picture][None], len(corners), axis=0)
    pixels[np.arange(len(corners)), corners] = np.nan
    without = replace(pictures, pixels=pixels)
    off = without.rms
    if not np.isfinite(off).any() or np.nanmin(off) > limit:
        return ""
    best = int(np.nanargmin(off))
    rotation, position = (part[best] for part in without.poses)
    place = rotation @ pictures.points[corners[best]] + position
    pixel = pictures.pixels[picture, corners[best]]
    away = float(np.linalg.norm(pictures.camera.project(place) - pixel))
    return f"corner {list(pictures.board.points)[corners[best]]} is {away:.0f} px"
