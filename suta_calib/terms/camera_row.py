"""The row of a job for a camera that sees a board: its keys, files, noise and corners."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.lens import LENSES, Lens, lens_called
from suta_calib.measurements import Board, Corners, YamlSection, read_board, read_camera
from suta_calib.measurements.fields import FILE, Field, Fields, Value, choice, quantity
from suta_calib.terms.block import Noise
from suta_calib.terms.eye_term import TARGET_KEY, setup_key
from suta_calib.terms.hand_eye_start import EYE_IN_HAND
from suta_calib.terms.poses import PoseSource
from suta_calib.words import listed


def lens_named(row: YamlSection, key: str) -> Lens:
    """The model of a lens, by one of its names.

    Raises:
        InputError: none has this name.
    """
    lens = lens_called(name := row.text(key))
    if lens is None or not name:
        raise row.refuse(
            repr(name), f"one of {listed([*LENSES])} (fisheye: equidistant)", at=(key,)
        )
    return lens


CAMERA_KEYS: Final = (
    Field("corners", FILE, "Corners in the pictures: corners.csv.", True),
    Field(
        "board",
        Value("file", lambda row, key: read_board(row.existing_file(key))),
        "The board.yaml.",
        required=True,
    ),
    Field(
        "camera",
        Value("file", lambda row, key: read_camera(row.existing_file(key))),
        "The camera.yaml; without it the camera is estimated from the pictures alone.",
    ),
    Field(
        "lens",
        Value("text", lens_named),
        "Model of the lens, without camera: "
        + ", ".join(" or ".join(filter(None, (n.name, *n.also[:1]))) for n in LENSES.values())
        + "; by default the one that predicts left-out pictures best.",
    ),
    setup_key("board"),
    Field(
        "intrinsics",
        choice(("fixed", "free")),
        "fixed (the default beside a camera), or free: the camera is estimated too.",
    ),
    TARGET_KEY,
    Field("sigma_px", quantity("px", "positive"), "Standard deviation of a corner's coordinate."),
    Field(
        "huber_px",
        quantity("px", "positive"),
        "Robust threshold: corners with larger errors get less weight.",
    ),
)
# What such a row may name, as they look.
CAMERA_FILES: Final[Mapping[str, str]] = {
    "corners.csv": "image,point,u,v\n",
    "board.yaml": "# Inner corners: columns, rows. Other types: charuco, markers.\n"
    "type: chessboard\ncorners: [7, 5]\nsquare_mm: 30\n",
    "camera.yaml": "# As written by ROS or OpenCV.\nimage_width: 1280\nimage_height: 960\n"
    "camera_matrix: {rows: 3, cols: 3, data: [1000, 0, 639.5, 0, 1000, 479.5, 0, 0, 1]}\n"
    "distortion_model: plumb_bob\n"
    "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n",
}


def read_camera_row(row: YamlSection) -> dict[str, Any]:
    """Board, camera, where it is, and the noise in pixels; the corners' file as it is named.

    Raises:
        InputError: a file or a value that cannot be used.
    """
    settings = {"setup": EYE_IN_HAND, "target": "default", **Fields(*CAMERA_KEYS).values(row)}
    intrinsics = settings.pop("intrinsics", "fixed" if "camera" in row else "free")
    settings["free"] = intrinsics == "free"
    if not settings["free"] and "camera" not in row:
        hint = "name the camera's file, or set intrinsics: free"
        raise row.refuse("no camera for intrinsics: fixed", at=("camera",), hint=hint)
    if "lens" in settings and "camera" in row:
        raise row.refuse(
            "lens beside camera", "one of them: the file of the camera names its lens", at=("lens",)
        )
    sigma, huber = settings.pop("sigma", None), settings.pop("huber", np.inf)
    fixed = sigma is not None and row.flag("fixed")
    settings["noise"] = Noise(sigma, huber, fixed)
    return settings


def with_corners(poses: PoseSource, corners: Corners, board: Board) -> PoseSource:
    """Poses with the label ``image`` of pictures that have corners, with these in their samples.

    Corners of other pictures are left out; of pictures without any it is warned. That no picture
    has any, or that one was taken at two postures, is a SamplesError.
    """
    images: NDArray[np.str_] = poses.samples.labels["image"]
    names = list(dict.fromkeys(images.tolist()))
    number = {name: k for k, name in enumerate(names)}
    # Of every corner which of the pictures it is in; one look at each of what may be a million.
    row = np.array([number.get(name, -1) for name in corners.image.tolist()], dtype=np.intp)
    there = np.isin([number[name] for name in images.tolist()], row)
    if not there.any():
        raise SamplesError(
            f"images {_quoted(images)} in the samples and {_quoted(corners.image)} in the corners",
            "the same names in both",
            file=corners.path,
            where="column 'image'",
        )
    if not there.all():
        lost = images[~there]
        warnings.warn(
            f"{corners.path or 'corners'}: no corners of {len(lost)} of {len(images)} images "
            f"({_quoted(lost)}): they are left out",
            SutaCalibWarning,
            stacklevel=2,
        )
        poses, images = poses.take(there), images[there]
    _check_postures(poses)
    points = np.array(list(board.points), dtype=np.intp)
    order = np.argsort(points)
    column = order[np.searchsorted(points[order], corners.point)]
    table = np.full((len(names), len(points), 2), np.nan)
    table[row[row >= 0], column[row >= 0]] = corners.pixel[row >= 0]
    pixels = table[[number[name] for name in images.tolist()]]
    return poses.with_samples(replace(poses.samples, pixels=pixels))


def _check_postures(poses: PoseSource) -> None:
    """Refuse a picture that is named at two postures; one of them is not its own."""
    images: NDArray[np.str_] = poses.samples.labels["image"]
    if len(np.unique(images)) == len(images):
        return
    first: dict[str, int] = {}
    for row, name in enumerate(images.tolist()):
        before = first.setdefault(name, row)
        if poses.postures[row] != poses.postures[before]:
            origin = poses.samples.origin
            raise SamplesError(
                f"picture {name} at another posture than in {origin[before]}",
                "each picture where it was taken",
                where=origin[row],
            )


def _quoted(names: NDArray[np.str_]) -> str:
    """The first few different ones."""
    different = list(dict.fromkeys(names.tolist()))
    # Names of images that an error quotes.
    quoted = different[:3]
    return listed(quoted) if len(different) == len(quoted) else ", ".join([*quoted, "…"])
