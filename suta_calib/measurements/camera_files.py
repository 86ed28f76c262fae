"""Files of a camera as other programs write them, in the keys of ``camera.yaml``.

ROS's calibration file is the form that `camera` reads; OpenCV's ``FileStorage`` has the same keys.
A message ``CameraInfo``, as ``ros2 topic echo`` prints it, and a camchain of kalibr have others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from suta_calib.errors import CameraError
from suta_calib.geometry.lens import LENSES, PLUMB_BOB, RATIONAL, Lens, lens_called
from suta_calib.measurements.files import read_text
from suta_calib.measurements.yaml_file import KeyPath, YamlDocument, YamlSection
from suta_calib.measurements.yaml_nodes import plain_data

# Models of other programs that are not read, and what they are.
_OTHER_MODELS: Final = {
    "thin_prism": "OpenCV's model with a thin prism, k1 to s4",
    "fov": "the field-of-view model, one number",
}
# Between documents of YAML; each message that is echoed ends so.
_SEPARATOR: Final = re.compile(r"^---[ \t]*\r?$", re.MULTILINE)
# Keys of a message and those of a file; ROS 1 has the matrices in capitals.
_OF_MESSAGE: Final = {
    **{"width": "image_width", "height": "image_height"},
    **{"k": "camera_matrix", "d": "distortion_coefficients"},
    **{"K": "camera_matrix", "D": "distortion_coefficients"},
}
_CAMCHAIN: Final = ("intrinsics", "distortion_coeffs", "resolution")


def camera_document(path: Path) -> YamlDocument:
    """A camera's file with the keys of ``camera.yaml``, each with its line in the file."""
    text = read_text(path, CameraError)
    data, lines = plain_data(path, _first_document(text), CameraError)
    document = YamlDocument(path, data, lines)
    if {"width", "height"} <= {*data} and ({"k", "d"} <= {*data} or {"K", "D"} <= {*data}):
        return _of_message(document)
    chain = [key for key, part in data.items() if isinstance(part, dict) and _is_camera(part)]
    return _of_kalibr(document, chain) if chain else document


def _first_document(text: str) -> str:
    """The first of several messages, without what ends it."""
    begin = 0
    for mark in _SEPARATOR.finditer(text):
        lines = text[begin : mark.start()].splitlines()
        if any(line.strip() and not line.startswith(("%", "#")) for line in lines):
            return text[: mark.start()]
    return text


def _is_camera(section: Mapping[str, Any]) -> bool:
    return all(key in section for key in _CAMCHAIN)


def _of_message(document: YamlDocument) -> YamlDocument:
    """A ``CameraInfo``: of the whole picture, unless it says that it is of a part."""
    top = YamlSection(document, CameraError)
    for key in ("binning_x", "binning_y"):
        if document.data.get(key, 0) not in (0, 1):
            raise top.refuse(
                f"pictures binned by {document.data[key]}",
                "pictures that are not binned",
                at=(key,),
            )
    region = document.data.get("roi")
    offset = region if isinstance(region, dict) else {}
    if any(offset.get(key) for key in ("x_offset", "y_offset")):
        raise top.refuse("only a part of the picture", "whole pictures", at=("roi",))
    return _renamed(document, _OF_MESSAGE)


def _of_kalibr(document: YamlDocument, chain: list[str]) -> YamlDocument:
    """The one camera of a camchain."""
    top = YamlSection(document, CameraError)
    if len(chain) > 1:
        raise top.refuse(
            f"{len(chain)} cameras of kalibr: {', '.join(chain)}",
            "one",
            at=(chain[1],),
            hint="copy each camera into its own file",
        )
    section = top.section(chain[0])
    if (model := section.data.get("camera_model", "pinhole")) != "pinhole":
        raise section.refuse(
            f"{model!r}, a camera model of kalibr",
            "pinhole",
            at=("camera_model",),
            hint="calibrate it with --models pinhole-radtan or pinhole-equi",
        )
    fx, fy, cx, cy = section.numbers("intrinsics", 4)
    width, height = section.numbers("resolution", 2)
    model = section.text("distortion_model", "radtan")
    coefficients = section.data["distortion_coeffs"]
    if model == "none":
        model, coefficients = PLUMB_BOB.name, coefficients or [0.0]
    matrix = {"data": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]}
    keys: dict[str, tuple[str, Any]] = {
        "image_width": ("resolution", int(width)),
        "image_height": ("resolution", int(height)),
        "camera_matrix": ("intrinsics", matrix),
        "distortion_model": ("distortion_model", model),
        "distortion_coefficients": ("distortion_coeffs", {"data": coefficients}),
    }
    line_of = partial(section.document.line_of, chain[0])
    lines: dict[KeyPath, int] = {(key,): line_of(source) or 1 for key, (source, _) in keys.items()}
    return YamlDocument(document.path, {key: value for key, (_, value) in keys.items()}, lines)


def _renamed(document: YamlDocument, names: Mapping[str, str]) -> YamlDocument:
    """The same with other keys at the top; lists there are the ``data`` of a matrix."""
    data: dict[str, Any] = {}
    lines: dict[KeyPath, int] = {}
    for key, value in document.data.items():
        name = names.get(key, key)
        matrix = name in ("camera_matrix", "distortion_coefficients")
        data[name] = {"data": value} if matrix else value
        for at, line in document.lines.items():
            if at[0] == key:
                lines[(name, *(("data",) if matrix and at[1:] else ()), *at[1:])] = line
    return YamlDocument(document.path, data, lines)


def lens_of(top: YamlSection) -> Lens:
    """The lens that a camera's file names; without a name, the one that has so many coefficients.

    Raises:
        CameraError: a model that is not known.
    """
    model = top.data.get("distortion_model")
    if model is None:
        # OpenCV's FileStorage names none: eight numbers are those of its rational model.
        section = top.data.get("distortion_coefficients")
        listed = section.get("data") if isinstance(section, dict) else None
        if not isinstance(listed, list) or len(listed) != len(RATIONAL.distortion):
            return PLUMB_BOB
        return RATIONAL if any(listed[len(PLUMB_BOB.distortion) :]) else PLUMB_BOB
    lens = lens_called(str(model))
    if lens is not None:
        return lens
    model = top.text("distortion_model")
    what = f", {_OTHER_MODELS[model]}" if model in _OTHER_MODELS else ""
    raise top.refuse(
        f"{model!r}{what}",
        f"one of {', '.join(LENSES)}",
        at=("distortion_model",),
        hint="calibrate the camera with one of these models",
    )
