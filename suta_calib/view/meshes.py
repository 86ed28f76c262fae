"""Shapes of an arm's links, from the files that its URDF names, as far as they are found.

``package://NAME/…`` is looked for beside the URDF and above it, and where ROS has its packages
(``ROS_PACKAGE_PATH``, ``AMENT_PREFIX_PATH``). yourdfpy reads the URDF, trimesh the meshes.
"""

from __future__ import annotations

import io
import logging
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.errors import SutaCalibWarning
from suta_calib.optional_packages import load
from suta_calib.view.drawn_arm import LinkMesh

_PACKAGE: Final = "package://"


def link_meshes(urdf: Path, data: bytes) -> tuple[LinkMesh, ...]:
    """Visual shapes of all links of a URDF; those whose files are not found are left out.

    What cannot be read is left out too, with a `SutaCalibWarning`: a picture is no reason to fail.

    Args:
        urdf: the file, beside which meshes are looked for.
        data: its bytes.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
    """
    yourdfpy, trimesh = load("yourdfpy", "view"), load("trimesh", "view")

    def named(name: str) -> Path:
        return found_file(name, urdf)

    def readable(name: str) -> Path:
        file = named(name)
        try:
            if file.is_file():
                trimesh.load(file, force="scene")
        except Exception as error:  # noqa: BLE001 (readers of a dozen formats raise anything)
            _warn(f"{file}: found no mesh ({error}); it is left out")
            return Path()
        return file

    def shapes(file_of: Callable[[str], Path]) -> tuple[LinkMesh, ...]:
        robot = yourdfpy.URDF.load(
            io.BytesIO(data), filename_handler=lambda fname: str(file_of(fname))
        )
        return tuple(_meshes_of(robot.scene, set(robot.link_map)))

    with _without_log("yourdfpy"):  # It warns of every mesh that is not there.
        try:
            return shapes(named)
        except Exception:  # noqa: BLE001
            pass  # Which file it is, it does not say.
        try:
            return shapes(readable)
        except Exception as error:  # noqa: BLE001 (it checks little of what it reads)
            _warn(
                f"{urdf}: found shapes that cannot be drawn ({error}); only frames and lines "
                "are drawn"
            )
            return ()


@contextmanager
def _without_log(name: str) -> Iterator[None]:
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


def _warn(message: str) -> None:
    warnings.warn(message, SutaCalibWarning, stacklevel=3)


def _meshes_of(scene: Any, links: set[str]) -> Iterator[LinkMesh]:
    """Every mesh of a trimesh scene, in the frame of the link it hangs on."""
    for node in scene.graph.nodes_geometry:
        link = scene.graph.transforms.parents[node]
        matrix, name = scene.graph.get(node, link)
        mesh = scene.geometry[name]
        if link not in links or not len(getattr(mesh, "faces", ())):
            continue
        vertices = np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
        faces = np.asarray(mesh.faces, dtype=np.intp)
        # A mirrored mesh shows its inside.
        faces = faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces
        yield LinkMesh(link, vertices, faces, _colour(mesh))


def _colour(mesh: Any) -> tuple[int, int, int, int]:
    visual = mesh.visual
    if not visual.defined:
        return (160, 165, 172, 255)
    colour = visual.material.main_color if hasattr(visual, "material") else visual.main_color
    r, g, b, a = (int(c) for c in colour)
    return r, g, b, a


def found_file(name: str, urdf: Path) -> Path:
    """The file that a URDF calls so; where there is none, the path as it stands."""
    if not name.startswith(_PACKAGE):
        return urdf.parent / name.removeprefix("file://")
    inside = Path(name.removeprefix(_PACKAGE))
    for folder in (*urdf.resolve().parents, *_ros_folders()):
        # The folder holds the package, or is it.
        for path in (folder / inside, folder.joinpath(*inside.parts[1:])):
            if path.is_file() and (path == folder / inside or folder.name == inside.parts[0]):
                return path
    return inside


def _ros_folders() -> Iterator[Path]:
    for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(folder, below)
