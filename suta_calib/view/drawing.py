"""How each thing of a scene is drawn with viser; nothing but this and `server` knows viser."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.view.drawn_arm import DrawnArm
from suta_calib.view.scene import (
    ArmScene,
    Colour,
    Ellipsoids,
    ErrorVectors,
    Frame,
    Frustum,
    Patch,
    PointCloud,
    Stroke,
    Thing,
)

if TYPE_CHECKING:
    import viser

# These stand out on white and on dark.
NOMINAL: Final[Colour] = (128, 128, 128)
CALIBRATED: Final[Colour] = (50, 105, 190)


def wxyz(rotation: FloatArray) -> FloatArray:
    """Quaternions (…, 4) w x y z, viser's order, of rotations (…, 3, 3)."""
    return np.roll(quaternion_from_rotation(rotation), 1, axis=-1)


class ShownArm:
    """An arm in viser's scene: a node for each link, shapes below it, and lines between.

    Args:
        api: of the server.
        drawn: the arm.
        solid: whether it is the one that is looked at; the other is seen through.
        colour, opaque: of the other: how it looks, and how little is seen through it.

    Attributes:
        root, chain: names of its node, and of the lines'.
        whole: its node.
    """

    def __init__(
        self,
        api: viser.SceneApi,
        drawn: DrawnArm,
        *,
        solid: bool,
        colour: Colour = NOMINAL,
        opaque: float = 0.3,
    ) -> None:
        self.drawn, self.root = drawn, f"/{drawn.name}"
        self.whole = api.add_frame(self.root, show_axes=False)
        on_chain = {drawn.links[k] for k in drawn.bones.ravel()}
        self._links = [
            api.add_frame(
                self.node(link),
                show_axes=solid and link in on_chain and not drawn.meshes,
                axes_length=0.04,
                axes_radius=0.0015,
            )
            for link in drawn.links
        ]
        for k, mesh in enumerate(drawn.meshes):
            red, green, blue, alpha = mesh.colour
            opacity = alpha / 255 * (1.0 if solid else opaque)
            api.add_mesh_simple(
                f"{self.node(mesh.link)}/shape_{k}",
                mesh.vertices.astype(np.float32),
                mesh.faces.astype(np.uint32),
                color=(red, green, blue) if solid else colour,
                opacity=None if opacity == 1.0 else opacity,
                flat_shading=True,
            )
        self.chain = f"{self.root}/chain"
        self._bones = api.add_line_segments(
            self.chain,
            np.zeros((len(drawn.bones), 2, 3)),
            CALIBRATED if solid else colour,
            # That of the other arm lies within.
            thickness=4.0 if solid else 2.0,
            thickness_units="screen",
        )

    def node(self, link: str) -> str:
        """Name of a link's node."""
        return f"{self.root}/links/{link.replace('/', '_')}"

    def move(self, q: FloatArray) -> None:
        """Show it at readings (joints,), rad or m."""
        rotation, position = self.drawn.poses(q)
        for handle, turn, place in zip(self._links, wxyz(rotation), position, strict=True):
            handle.wxyz, handle.position = turn, place
        self._bones.points = position[self.drawn.bones].astype(np.float32)


def camera_view(scene: ArmScene) -> tuple[FloatArray, FloatArray]:
    """Where to look from, and at, (3,) each, m: from above, ahead and aside, all of it in sight."""
    low, high = scene.extent
    away = 0.47 * float(np.linalg.norm(high - low)) * np.array([1.0, -1.1, 0.8])
    return (low + high) / 2 + away, (low + high) / 2


def draw_floor(api: viser.SceneApi, scene: ArmScene) -> None:
    """A grid of decimetres below everything."""
    low, high = scene.extent
    middle, size = (low + high) / 2, 1.4 * float(np.ptp(scene.extent, axis=0).max())
    api.add_grid(
        "/floor",
        width=size,
        height=size,
        position=np.array([middle[0], middle[1], low[2] - 0.01 * size]),
        cell_size=0.1,
        section_size=0.5,
        cell_color=(190, 190, 190),
        section_color=(160, 160, 160),
        cell_thickness=0.4,
        section_thickness=0.7,
        plane="xy",
    )


def draw(thing: Thing, api: Any, path: str, scene: ArmScene) -> Any:
    """Draw one thing of a scene through the server's ``api``, at the node ``path``.

    Returns:
        Its handle.
    """
    of_screen: dict[str, Any] = {"thickness_units": "screen"}
    match thing:
        case PointCloud():
            for k, (label, at) in enumerate(zip(thing.labels, thing.position, strict=False)):
                api.add_label(f"{path}/{k}", label, position=at, font_screen_scale=0.7)
            return spheres(api, path, thing.position, np.full(3, thing.size), thing.colour)
        case ErrorVectors():
            # Of the scene's size.
            shaft = 0.0012 * float(np.linalg.norm(np.ptp(scene.extent, axis=0)))
            ends = thing.ends(scene.magnification).astype(np.float32)
            head = {"head_radius": 2.5 * shaft, "head_length": 6.0 * shaft}
            return api.add_arrows(
                path, ends, thing.colours.astype(np.uint8), shaft_radius=shaft, **head
            )
        case Ellipsoids():
            scales = ellipsoid_scales(thing, scene.inflation)
            return spheres(api, path, thing.at, scales, thing.colour, thing.turn, 0.5)
        case Frame():
            api.add_label(f"{path}/label", thing.name.rpartition("/")[2], font_screen_scale=0.9)
            place = {"wxyz": wxyz(thing.rotation), "position": thing.position}
            if isinstance(thing, Frustum):
                of_screen |= {"scale": thing.size, "thickness": 2.0, "color": CALIBRATED}
                lens = thing.field_of_view, thing.aspect
                return api.add_camera_frustum(path, *lens, **of_screen, **place)
            axes = {"axes_length": thing.size, "axes_radius": 0.03 * thing.size}
            return api.add_frame(path, **place, **axes)
        case Patch():
            faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
            flat = {"color": thing.colour, "opacity": 0.4, "side": "double", "flat_shading": True}
            return api.add_mesh_simple(path, thing.corners.astype(np.float32), faces, **flat)
        case Stroke():
            ends = thing.ends[None].astype(np.float32)
            return api.add_line_segments(path, ends, thing.colour, thickness=3.0, **of_screen)


def ellipsoid_scales(thing: Ellipsoids, factor: float) -> FloatArray:
    """(n, 3) half-axes as they are drawn, ``factor`` times one standard deviation, m."""
    return np.maximum(factor * thing.std, 1e-6).astype(np.float32)


def spheres(
    api: Any,
    path: str,
    at: FloatArray,
    scales: FloatArray,
    colour: Colour | FloatArray,
    turn: FloatArray | None = None,
    opacity: float | None = None,
) -> Any:
    """Spheres, or ellipsoids, at (n, 3), m, with half-axes (3,) or (n, 3), m, turned (n, 3, 3)."""
    vertices, faces = _sphere()
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (len(at), 1)) if turn is None else wxyz(turn)
    return api.add_batched_meshes_simple(
        path,
        vertices,
        faces,
        batched_wxyzs=turned.astype(np.float32),
        batched_positions=at.astype(np.float32),
        batched_scales=np.broadcast_to(scales, at.shape).astype(np.float32),
        batched_colors=np.asarray(colour, dtype=np.uint8),
        opacity=opacity,
        lod="off",
        cast_shadow=False,
    )


def _sphere(rings: int = 8, around: int = 12) -> tuple[FloatArray, Any]:
    """Vertices (n, 3) and faces (m, 3) of a unit sphere."""
    polar = np.linspace(0, math.pi, rings + 1)[:, None]
    turn = np.linspace(0, 2 * math.pi, around, endpoint=False)[None]
    grid = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn], -1
    )
    k = np.arange(rings * around).reshape(rings, around)
    right = np.roll(k, -1, axis=1)
    below, below_right = k + around, right + around
    faces = np.concatenate(
        [np.stack([k, below, below_right], -1), np.stack([k, below_right, right], -1)]
    )
    return grid.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.uint32)
