"""The bundle adjustment of cameras on one body that see a board at the same instants.

Camera c sees the point k of the board at instant i at ``π_c(T_c T_i p_k)``: ``T_c`` is the pose of
the first camera in camera c, ``T_i`` the board's in the first camera, of which each instant has its
own (`bundle`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.lens import Lens
from suta_calib.geometry.lens_slopes import pixel_slopes
from suta_calib.geometry.numbers import rotation_from_vector, skew
from suta_calib.terms.bundle import Bundle, PictureEquations, corner_weights

# Instants that tell by themselves how much they scatter.
ENOUGH: Final = 8


@dataclass(frozen=True, eq=False)
class RigState:
    """Unknowns.

    Attributes:
        intrinsics: of each camera.
        turn, shift: ``T_camera_first`` of each camera (c, 3, 3) and (c, 3), m.
        rotation, position: ``T_first_board`` at each instant (n, 3, 3) and (n, 3), m.
    """

    intrinsics: tuple[FloatArray, ...]
    turn: FloatArray
    shift: FloatArray
    rotation: FloatArray
    position: FloatArray


@dataclass(frozen=True, eq=False)
class RigProblem(Bundle[RigState]):
    """What was seen.

    Attributes:
        points: (k, 3) of the board, m.
        pixels: (c, n, k, 2) px by camera and instant; NaN where a corner was not found.
        lenses: of the cameras.
        start: where it begins; priors of the intrinsics are about these.
        priors: information of the intrinsics of each camera; None where they are held.
        robust: whether corners that are far off pull no harder than others.
    """

    points: FloatArray
    pixels: FloatArray
    lenses: Sequence[Lens]
    start: RigState
    priors: Sequence[FloatArray | None]
    robust: bool = True

    @cached_property
    def there(self) -> BoolArray:
        """(c, n, k) which corners were found."""
        return np.asarray(np.isfinite(self.pixels).all(axis=-1))

    @cached_property
    def columns(self) -> tuple[list[slice], list[slice]]:
        """Columns of the shared unknowns: intrinsics and pose of each camera; the first has none.

        Displacement and turn of a pose are about the axes of that camera.
        """
        intrinsics, poses, count = list[slice](), list[slice](), 0
        for prior in self.priors:
            intrinsics.append(slice(count, count + (0 if prior is None else len(prior))))
            count = intrinsics[-1].stop
        for camera in range(len(self.lenses)):
            poses.append(slice(count, count + (6 if camera else 0)))
            count = poses[-1].stop
        return intrinsics, poses

    @property
    def shared(self) -> int:
        """Number of the shared unknowns."""
        return int(self.columns[1][-1].stop)

    def in_camera(self, at: RigState, camera: int) -> tuple[FloatArray, FloatArray]:
        """(n, k, 3) points from the board's origin and in a camera, both about its axes, m."""
        turned = np.einsum("ij,njl,kl->nki", at.turn[camera], at.rotation, self.points)
        middle = at.position @ at.turn[camera].T + at.shift[camera]
        return turned, turned + middle[:, None]

    def errors(self, at: RigState) -> FloatArray | None:
        """(c, n, k, 2) px, zero of what was not found; None where a corner is behind a camera."""
        off = np.zeros(self.pixels.shape)
        for camera, lens in enumerate(self.lenses):
            points = self.in_camera(at, camera)[1]
            points = np.where(self.there[camera][..., None], points, [0.0, 0.0, 1.0])
            if not lens.ahead(points).all():
                return None
            projected = lens.projected(points, at.intrinsics[camera]) - self.pixels[camera]
            off[camera] = np.where(self.there[camera][..., None], projected, 0.0)
        return off

    def weights(self, errors: FloatArray) -> FloatArray:
        """(c, n, k) of the corners, 1/px², by their own scatter in each camera."""
        cameras = zip(errors, self.there, strict=True)
        return np.stack([corner_weights(off, seen, robust=self.robust) for off, seen in cameras])

    def away(self, at: RigState) -> tuple[FloatArray, FloatArray]:
        """Information on the intrinsics, and how far they are from what it says."""
        information, away = np.zeros((self.shared, self.shared)), np.zeros(self.shared)
        for prior, columns, values, first in zip(
            self.priors, self.columns[0], at.intrinsics, self.start.intrinsics, strict=True
        ):
            if prior is not None:
                information[columns, columns], away[columns] = prior, values - first
        return information, away

    def equations(self, at: RigState, errors: FloatArray, weight: FloatArray) -> PictureEquations:
        """The equations of a step from here."""
        of_intrinsics, of_poses = self.columns
        count, instants = self.shared, len(at.position)
        AA, a = np.zeros((instants, count, count)), np.zeros((instants, count))
        AB, BB = np.zeros((instants, count, 6)), np.zeros((instants, 6, 6))
        b = np.zeros((instants, 6))
        for camera, lens in enumerate(self.lenses):
            instants_seen = np.flatnonzero(self.there[camera].any(axis=1))
            turned, points = (part[instants_seen] for part in self.in_camera(at, camera))
            visible = self.there[camera][instants_seen]
            points = np.where(visible[..., None], points, [0.0, 0.0, 1.0])
            by_place, by_values = pixel_slopes(lens, points, at.intrinsics[camera])
            root = np.sqrt(weight[camera][instants_seen])[..., None, None]
            by_place, by_values = root * by_place, root * by_values
            r = (root[..., 0] * errors[camera][instants_seen]).reshape(len(instants_seen), -1)
            parts = list[tuple[slice, FloatArray]]()
            if self.priors[camera] is not None:
                parts.append((of_intrinsics[camera], by_values))
            if camera:
                by_pose = np.concatenate([by_place, -by_place @ skew(points)], axis=-1)
                parts.append((of_poses[camera], by_pose))
            # The board's pose is moved about the axes of the first camera.
            moved = by_place @ at.turn[camera]
            by_board = np.concatenate(
                [moved, -by_place @ skew(turned) @ at.turn[camera]], axis=-1
            ).reshape(len(instants_seen), -1, 6)
            rows = [
                (at_, part.reshape(len(instants_seen), -1, part.shape[-1])) for at_, part in parts
            ]
            BB[instants_seen] += np.swapaxes(by_board, 1, 2) @ by_board
            b[instants_seen] += np.einsum("nri,nr->ni", by_board, r)
            for one, J in rows:
                a[instants_seen, one] += np.einsum("nri,nr->ni", J, r)
                AB[instants_seen, one] += np.swapaxes(J, 1, 2) @ by_board
                for other, K in rows:
                    AA[instants_seen, one, other] += np.swapaxes(J, 1, 2) @ K
        return PictureEquations(AA, AB, BB, a, b, *self.away(at))

    def moved(self, at: RigState, shared: FloatArray, boards: FloatArray) -> RigState:
        """After a step of the shared unknowns (g,) and of the boards' poses (n, 6)."""
        of_intrinsics, of_poses = self.columns
        intrinsics = tuple(
            values if prior is None else values + shared[columns]
            for values, prior, columns in zip(
                at.intrinsics, self.priors, of_intrinsics, strict=True
            )
        )
        steps = np.array([shared[one] if one.stop > one.start else np.zeros(6) for one in of_poses])
        turns = rotation_from_vector(steps[:, 3:])
        return RigState(
            intrinsics,
            turns @ at.turn,
            np.einsum("cij,cj->ci", turns, at.shift) + steps[:, :3],
            rotation_from_vector(boards[:, 3:]) @ at.rotation,
            at.position + boards[:, :3],
        )

    def solved(self) -> RigState:
        """The state of least reprojection error."""
        return self.minimised(self.start, settled=1e-9)

    def without(self, pictures: BoolArray) -> RigProblem:
        """The same without pictures (c, n)."""
        return replace(self, pixels=np.where(pictures[..., None, None], np.nan, self.pixels))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the scatter behind the `covariance`."""
        instants = self.there.shape[1]
        if instants >= ENOUGH:
            return float(instants - 1)
        return float(max(2 * int(self.there.sum()) - self.shared - 6 * instants, 1))

    def covariance(self, at: RigState) -> FloatArray:
        """(g, g) of the shared unknowns, by what they change if an instant is left out (jackknife).

        Errors of one instant, such as of a board that bends, may be alike; no two instants share
        them. Of few instants it is that of corners that err independently.
        """
        errors = self.errors(at)
        assert errors is not None
        weight = self.weights(errors)
        equations = self.equations(at, errors, weight).eliminated()
        curvature, (by_instant, slopes) = equations.curvature, equations.of_picture
        instants = len(at.position)
        if instants < ENOUGH:
            scatter = float(np.sum(weight[..., None] * errors**2)) / self.freedom
            return np.asarray(scatter * np.linalg.pinv(curvature, hermitian=True))
        changes = np.stack(
            [
                np.linalg.lstsq(curvature - part, slope, rcond=None)[0]
                for part, slope in zip(by_instant, slopes, strict=True)
            ]
        )
        # What the files say of the cameras is independent of all instants.
        prior_information, _ = self.away(at)
        inverse = np.linalg.pinv(curvature, hermitian=True)
        scatter_of_changes = (instants - 1) / instants * changes.T @ changes
        return np.asarray(scatter_of_changes + inverse @ prior_information @ inverse)
