"""An arm that is measured: it moves as it is read, among the places that it is brought to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics
from suta_calib.view.access import Site
from suta_calib.view.drawing import ShownArm, camera_view, draw_floor, spheres
from suta_calib.view.drawn_arm import DrawnArm
from suta_calib.view.meshes import link_meshes
from suta_calib.view.scene import ArmScene, Colour
from suta_calib.view.server import Viewer

MarkStatus = Literal["taken", "doubted", "next", "open", "planned", "worst"]
# Of Okabe and Ito, as on the page.
_COLOURS: Final[dict[MarkStatus, Colour]] = {
    "taken": (0, 158, 115),
    "doubted": (213, 94, 0),
    "next": (0, 114, 178),
    "open": (140, 140, 140),
    "planned": (204, 121, 167),
    "worst": (230, 159, 0),
}


@dataclass(frozen=True, eq=False)
class Mark:
    """A place (3,), m, with its name and what it is."""

    name: str
    position: FloatArray
    status: MarkStatus


class MeasuredArm:
    """The arm in the browser; a context manager.

    Args:
        title: what is measured.
        arm: at nominal.
        port, host, site: as of `Viewer`.

    Attributes:
        seen: whether the arm was moved to where it is.
    """

    def __init__(self, title: str, arm: ArmModel, port: int, host: str, site: Site) -> None:
        drawn = DrawnArm("arm", arm, {}, link_meshes(*arm.urdf))
        scene = ArmScene(title, (drawn,), InverseKinematics(arm, {}).middle)
        self._viewer = Viewer(scene, port, host, site)
        self._arm, self._drawn = arm, list[Any]()
        self._ghost: ShownArm | None = None
        self.seen = False
        # Of the arm's size: large enough to be found, small enough to be told apart.
        self._size = 0.011 * float(np.linalg.norm(np.ptp(scene.extent, axis=0)))

    def __enter__(self) -> MeasuredArm:
        return self

    def __exit__(self, *_: object) -> None:
        self._viewer.close()

    @property
    def url(self) -> str:
        """Of the site; the scene itself is below it."""
        return self._viewer.url

    def move(self, q: FloatArray) -> None:
        """Show the arm at readings (joints,), rad or m; the first decide where to look from."""
        if not self.seen:
            scene = replace(self._viewer.scene, q=q)
            first = self._viewer.server.initial_camera
            position, middle = camera_view(scene)
            # What counts is at the tip, and the places around it are beyond the arm: a part of the
            # way there, and from a bit farther off.
            first.look_at = middle + 0.4 * (self._arm.forward(q)[1] - middle)
            first.position = first.look_at + 1.2 * (position - middle)
            draw_floor(self._viewer.server.scene, scene)
            self.seen = True
        self._viewer.move(q)

    def show_goal(self, q: FloatArray | None) -> None:
        """Show a second arm, seen through, at readings (joints,) to go to; None for nowhere."""
        if self._ghost is None and q is not None:
            drawn = replace(self._viewer.arms[0].drawn, name="goal")
            api = self._viewer.server.scene
            pink = _COLOURS["planned"]
            self._ghost = ShownArm(api, drawn, solid=False, colour=pink, opaque=0.6)
        if self._ghost is not None:
            with self._viewer.server.atomic():
                self._ghost.whole.visible = q is not None
                if q is not None:
                    self._ghost.move(q)

    def mark(self, marks: Sequence[Mark]) -> None:
        """Show these places, and no others."""
        api = self._viewer.server.scene
        with self._viewer.server.atomic():
            for handle in self._drawn:
                handle.remove()
            self._drawn = []
            if not marks:
                return
            at = np.array([mark.position for mark in marks])
            colours = np.array([_COLOURS[mark.status] for mark in marks])
            sizes = np.array([2.0 if m.status in ("next", "doubted") else 1.0 for m in marks])
            scales = self._size * np.repeat(sizes[:, None], 3, axis=1)
            self._drawn.append(spheres(api, "/places/marks", at, scales, colours))
            for k, mark in enumerate(marks):
                if mark.status not in ("next", "doubted", "planned") or not mark.name:
                    continue  # More names than these would hide each other.
                self._drawn.append(
                    api.add_label(
                        f"/places/name_{k}",
                        mark.name,
                        position=mark.position + np.array([0.0, 0.0, 3.0 * self._size]),
                        font_screen_scale=1.6,
                    )
                )
