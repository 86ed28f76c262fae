"""The intrinsics of a camera as unknowns, with their prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.lens import CENTRE, FOCAL, PLUMB_BOB
from suta_calib.measurements import Camera, Corners
from suta_calib.model.parameters import Parameter

# What is known of a camera at least as badly as this, px or 1: a prior of zero width is none. A
# decentring of 1e-4 shows as no corner's error, but bends a picture as a principal point a pixel
# off does, and would take its place.
HELD: Final = 1e-6


@dataclass(frozen=True)
class IntrinsicsPrior:
    """Prior of a camera's intrinsics: standard deviations about the known values.

    Attributes:
        focal: of the focal lengths, part of them.
        centre: of the principal point, part of the picture's width.
        radial: of the coefficients that bend along rays: k1, k2, ….
        tangential: of those that bend across them: p1 and p2.
        unbent: whether coefficients that are exactly zero are no part of the camera's model, as in
            rectified pictures.
    """

    focal: float
    centre: float
    radial: float
    tangential: float
    unbent: bool

    def stds(self, camera: Camera) -> FloatArray:
        """(n,) in the order of `Lens.names`, px and 1."""
        focal, centre = self.focal * camera.intrinsics[:2], self.centre * camera.width
        bent = np.where(camera.lens.tangential, self.tangential, self.radial)
        if self.unbent:
            bent[camera.intrinsics[4:] == 0.0] = 0.0
        return np.concatenate([focal, [centre, centre], bent])


# Of a camera that somebody calibrated without saying how well, such as by twenty pictures; pixels
# may be counted from 0, 1 or corners. Where pictures contradict it, `solver.weights` widens it.
CALIBRATED: Final = IntrinsicsPrior(
    focal=1e-3, centre=1e-3, radial=0.02, tangential=5e-4, unbent=True
)
# Of a camera that nobody has calibrated.
UNCALIBRATED: Final = IntrinsicsPrior(
    focal=0.3, centre=0.1, radial=0.3, tangential=0.02, unbent=False
)


def ideal(camera: Camera) -> bool:
    """Whether it is a camera as a renderer has it, to the last digit, and no ± is stated.

    Square pixels, the axis through the picture's middle, and no distortion: no lens is so.
    """
    (fx, fy), centre = camera.intrinsics[:2], camera.intrinsics[2:4]
    middle = np.array([camera.width - 1, camera.height - 1]) / 2.0
    straight = camera.lens is PLUMB_BOB and not camera.intrinsics[4:].any()
    return bool(fx == fy and straight and (centre == middle).all()) and camera.covariance is None


def prior_beside(camera: Camera, corners: Corners) -> FloatArray | None:
    """Prior (n,) of a camera whose corners are seen, px and 1; None where its file says it.

    Of one that was calibrated from these very corners they say everything, and once.
    """
    return UNCALIBRATED.stds(camera) if camera.corners == corners.digest else None


def intrinsic_parameters(
    owner: str, camera: Camera, prior: FloatArray | None
) -> tuple[Parameter, ...]:
    """The unknowns ``owner.fx … owner.k3``, nominally as the camera has them.

    A prior (n,), standard deviations in px and 1, is one that the data do not change; without it
    they are those that the camera's file says, or those of any camera that somebody calibrated.
    """
    stated = camera.stds if prior is None else prior
    stds = CALIBRATED.stds(camera) if stated is None else stated
    values = zip(camera.lens.names, camera.intrinsics.tolist(), stds.tolist(), strict=True)
    return tuple(
        Parameter(
            owner,
            key,
            "px" if key in (*FOCAL, *CENTRE) else "1",
            value,
            prior=max(std, HELD),
            prior_fixed=prior is not None,
            prior_assumed=stated is None,
        )
        for key, value, std in values
    )


def camera_at(camera: Camera, owner: str, values: Mapping[str, float]) -> Camera:
    """The camera with the intrinsics that these values have, or with its own."""
    intrinsics = [values.get(f"{owner}.{key}", value) for key, value in camera.values.items()]
    return replace(camera, intrinsics=np.array(intrinsics))
