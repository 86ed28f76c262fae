"""The bundle adjustment of pictures of a board: a camera, and where it has the board in each.

From a start such as the closed form, which knows of no distortion, the reprojection errors of all
pictures are minimised, each with a pose of the board of its own (Zhang 2000,
doi:10.1109/34.888718, 3.2 and 3.3; `bundle`). A lens that bends much leaves poses that no hand
agrees with.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.lens import Lens
from suta_calib.geometry.lens_slopes import pixel_slopes
from suta_calib.geometry.numbers import rotation_from_vector, skew
from suta_calib.measurements import Board, Camera, Corners
from suta_calib.terms.bundle import Bundle, PictureEquations, corner_weights
from suta_calib.terms.camera_start import poses_in_camera


@dataclass(frozen=True, eq=False)
class CameraState:
    """A camera (c,), px and 1, and where the board is in each picture: (n, 3, 3) and (n, 3), m."""

    intrinsics: FloatArray
    rotation: FloatArray
    position: FloatArray

    def take(self, pictures: BoolArray) -> CameraState:
        """Of some of the pictures (n,)."""
        return CameraState(self.intrinsics, self.rotation[pictures], self.position[pictures])

    def moved(self, camera: FloatArray, poses: FloatArray) -> CameraState:
        """After a step (c,) of the camera and (n, 6) of the poses, about the camera's axes."""
        return CameraState(
            self.intrinsics + camera,
            rotation_from_vector(poses[:, 3:]) @ self.rotation,
            self.position + poses[:, :3],
        )


@dataclass(frozen=True, eq=False)
class PicturesSeen:
    """What was seen.

    Attributes:
        points: (k, 3) of the board, m.
        pixels: (n, k, 2) px.
        there: (n, k) which were found.
        lens: of the camera.
    """

    points: FloatArray
    pixels: FloatArray
    there: BoolArray
    lens: Lens

    def take(self, pictures: BoolArray) -> PicturesSeen:
        """Some of the pictures (n,)."""
        return replace(self, pixels=self.pixels[pictures], there=self.there[pictures])

    def in_camera(self, at: CameraState) -> tuple[FloatArray, FloatArray]:
        """(n, k, 3) from the board's origin, turned, and from the camera; z is 1 where not seen."""
        turned = np.einsum("nij,kj->nki", at.rotation, self.points)
        points = turned + at.position[:, None]
        return turned, np.where(self.there[..., None], points, [0.0, 0.0, 1.0])

    def errors(self, at: CameraState) -> FloatArray | None:
        """(n, k, 2) px, zero for what was not found; None where a point is behind the camera."""
        _, points = self.in_camera(at)
        if not self.lens.ahead(points).all():
            return None
        off = self.lens.projected(points, at.intrinsics) - self.pixels
        return np.where(self.there[..., None], off, 0.0)

    def slopes(self, at: CameraState) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the errors by the camera (n, k, 2, c) and by the poses (n, k, 2, 6)."""
        turned, points = self.in_camera(at)
        by_place, by_camera = pixel_slopes(self.lens, points, at.intrinsics)
        by_pose = np.concatenate([by_place, -by_place @ skew(turned)], axis=-1)
        shown = self.there[..., None, None]
        return np.where(shown, by_camera, 0.0), np.where(shown, by_pose, 0.0)


def seen_by(
    camera: Camera, corners: Corners, board: Board
) -> tuple[PicturesSeen, CameraState, BoolArray]:
    """What was seen, and where a camera has the board in each picture that tells it.

    The third is (pictures,) which do, in the order of `Corners.images`.
    """
    pixels = corners.table(board.points)
    points = np.array(list(board.points.values()))
    rotation, position = poses_in_camera(points, pixels, camera)
    located = np.asarray(np.isfinite(position[:, 0]))
    there = np.asarray(np.isfinite(pixels[located]).all(axis=2))
    shown = np.where(there[..., None], pixels[located], 0.0)
    pictures = PicturesSeen(points, shown, there, camera.lens)
    return pictures, CameraState(camera.intrinsics, rotation[located], position[located]), located


@dataclass(frozen=True, eq=False)
class _OneCamera(Bundle[CameraState]):
    """A camera, and the board at each picture.

    Attributes:
        pictures: what was seen.
        first: (c,) intrinsics about which the prior is.
        prior: (c,) standard deviations.
        robust: whether corners that are far off pull no harder than others.
    """

    pictures: PicturesSeen
    first: FloatArray
    prior: FloatArray
    robust: bool

    def errors(self, at: CameraState) -> FloatArray | None:
        return self.pictures.errors(at)

    def weights(self, errors: FloatArray) -> FloatArray:
        return corner_weights(errors, self.pictures.there, robust=self.robust)

    def away(self, at: CameraState) -> tuple[FloatArray, FloatArray]:
        return np.diag(self.prior**-2.0), at.intrinsics - self.first

    def equations(
        self, at: CameraState, errors: FloatArray, weight: FloatArray
    ) -> PictureEquations:
        A, B = (J.reshape(len(J), -1, J.shape[-1]) for J in self.pictures.slopes(at))
        w, r = np.repeat(weight, 2, axis=1), errors.reshape(len(A), -1)
        WA, WB = w[..., None] * A, w[..., None] * B
        return PictureEquations(
            np.swapaxes(A, 1, 2) @ WA,
            np.swapaxes(WA, 1, 2) @ B,
            np.swapaxes(B, 1, 2) @ WB,
            np.einsum("nri,nr->ni", WA, r),
            np.einsum("nri,nr->ni", WB, r),
            *self.away(at),
        )

    def moved(self, at: CameraState, shared: FloatArray, poses: FloatArray) -> CameraState:
        return at.moved(shared, poses)


def refined(
    pictures: PicturesSeen,
    state: CameraState,
    prior: FloatArray,
    *,
    robust: bool = True,
    settled: float = 1e-6,
) -> CameraState:
    """The camera and poses of least reprojection error; ``prior`` (c,) is about the first one.

    ``robust`` lets corners that are far off pull no harder than others; ``settled`` is the relative
    gain from where on it ends.
    """
    return _OneCamera(pictures, state.intrinsics, prior, robust).minimised(state, settled)
