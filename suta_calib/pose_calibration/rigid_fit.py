"""The rigid transform between points that are each one measurement: closed form, consensus, fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import (
    extent,
    register_points,
    rotation_from_vector,
    tangent_of_vector,
)
from suta_calib.measurements.samples import Samples
from suta_calib.pose_calibration.consensus import Consensus, find_consensus, minimal_samples
from suta_calib.pose_calibration.robust_fit import ROUNDING, RobustFit, parts_of, robust_fit
from suta_calib.pose_calibration.stated_noise import StatedSpread, WeighedPoint
from suta_calib.terms.block import Noise
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.tracked_point import TrackedPoint
from suta_calib.units import mm

LEAST_POINTS: Final = 3
# Second singular value of centred points, relative to the first, of points on a line.
ON_A_LINE: Final = 1e-6
# A reflection that fits so many times better than any rotation is what the data are.
MIRRORED: Final = 3.0
_NOT_ON_A_LINE: Final = "at least three points that are not on one line"
# Smallest number of points from which an outlier among them can be found.
ENOUGH_TO_JUDGE: Final = 5


@dataclass(frozen=True, eq=False)
class RigidFit:
    """A rigid transform between points.

    Attributes:
        fit: the lengths in it in units of the points' extent.
        rotation, position: of the transform, m.
        middle: (3,) middle of the fitted points in frame b, m.
        length: m per unit of the lengths in `fit`.
        jacobian: (6, 6) derivative of a displacement of the middle, m, and a small turn by the
            fit's parameters.
        relative: (n,) how much each row scatters in units of a typical one.
    """

    fit: RobustFit
    rotation: FloatArray
    position: FloatArray
    middle: FloatArray
    length: float
    jacobian: FloatArray
    relative: FloatArray

    @property
    def sigma(self) -> float:
        """Scatter of one component, m."""
        return self.fit.sigmas[0] * self.length

    def off(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Residuals (n, 3) of points, m."""
        return np.asarray(a @ self.rotation.T + self.position - b)


def rigid_fit(
    a: FloatArray, b: FloatArray, spread: StatedSpread | None, seed: int | None
) -> RigidFit:
    """The transform of points (n, 3), m; all are believed without a seed.

    Raises:
        SamplesError: they are the mirror image of each other, unrelated, or hardly off a line.
    """
    judged = seed if len(a) >= ENOUGH_TO_JUDGE else None
    relative = np.ones(len(a)) if spread is None else spread.per_point / spread.typical
    start, mirrored = _start(a, b, judged, relative), _start(-a, b, judged, relative)
    # Mirror images are Arun's third case, unless noise may be what turned the sign.
    scatter = float(start.sigmas[0])
    if scatter > MIRRORED * float(mirrored.sigmas[0]) and scatter > ROUNDING * float(np.ptp(b)):
        raise SamplesError(
            "points that are the mirror image of each other",
            "two right-handed frames",
            hint="swap two axes or turn the sign of one in one of the files",
        )
    from_centre, to_centre = a[start.inliers].mean(axis=0), b[start.inliers].mean(axis=0)
    length = extent(b) or 1.0
    placed, fixed = (a - from_centre) / length, (b - to_centre) / length
    # In which directions of b the points of a are uncertain.
    turned = register_points(a[start.inliers], b[start.inliers])[0]
    samples = Samples.from_arrays([], np.zeros((len(a), 0)), position=fixed)
    upright = np.tile(np.eye(3), (len(a), 1, 1))
    some_poses = parts_of(MeasuredPoses(upright, placed, samples, exact=True))

    def make(rows: IntArray, noises: Sequence[Noise]) -> TrackedPoint:
        poses = some_poses(rows)
        if spread is None:
            return TrackedPoint(poses, noises[0])
        return WeighedPoint(poses, noises[0], whitening=spread.take(rows).whitening(turned))

    def revise(values: Mapping[str, float], inliers: BoolArray) -> None:
        del inliers
        nonlocal turned
        turned = pose_named(values, TrackedPoint.frames[0].owner)[0]

    fit = robust_fit(
        make,
        Consensus(start.inliers, start.sigmas / length),
        robust=seed is not None,
        revise=None if spread is None else revise,
        stated=None if spread is None else spread.typical / length,
    )
    x = fit.solution.x
    R, middle = rotation_from_vector(x[3:6]), to_centre + length * x[:3]
    jacobian = length * np.eye(6)
    jacobian[3:, 3:] = R @ tangent_of_vector(x[3:6])
    _check_fit(fit, placed[fit.inliers], length)
    return RigidFit(fit, R, middle - R @ from_centre, middle, length, jacobian, relative)


def _start(a: FloatArray, b: FloatArray, seed: int | None, relative: FloatArray) -> Consensus:
    """What most points agree on; all of them without a seed. ``relative`` as `agreeing_points`."""
    if seed is not None:
        return agreeing_points(a, b, seed, determining_rows(a, b), relative)
    R, p = register_points(a, b)
    off = (a @ R.T + p - b) / relative[:, None]
    return Consensus.of_all(len(a), float(np.sqrt(np.mean(off**2))))


def agreeing_points(
    a: FloatArray, b: FloatArray, seed: int, needed: int, relative: FloatArray | None = None
) -> Consensus:
    """The points (n, 3), m, that most agree on how ``a`` lies on ``b``; ``needed`` determine it.

    A point scatters ``relative`` (n,) times as much as a typical one.
    """
    scatter = np.ones(len(a)) if relative is None else relative

    def residuals(model: tuple[FloatArray, FloatArray], rows: IntArray) -> FloatArray:
        R, p = model
        error = a[rows] @ np.swapaxes(R, 1, 2) + p[:, None, :] - b[rows]
        return np.asarray((np.linalg.norm(error, axis=2) / scatter[rows])[..., None])

    samples = minimal_samples(np.zeros(len(a), dtype=np.intp), LEAST_POINTS, seed)
    return find_consensus(
        len(a), samples, lambda rows: register_points(a[rows], b[rows]), residuals, needed
    )


def check_points(a: FloatArray, b: FloatArray) -> None:
    """Refuse sets that no data could register: sizes, too few, one point, one line."""
    if a.shape != b.shape:
        raise SamplesError(
            f"{len(a)} points and {len(b)} points", "the same points in both, row for row"
        )
    if len(a) < LEAST_POINTS:
        raise SamplesError(f"{len(a)} points", f"at least {LEAST_POINTS}, not on one line")
    for points, which in ((a, "first"), (b, "second")):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[0] <= 1e-12 * np.abs(points).max():
            raise SamplesError(f"the same point in every row of the {which} set", _NOT_ON_A_LINE)
        if spread[1] < ON_A_LINE * spread[0]:
            raise SamplesError(f"points on a line in the {which} set", _NOT_ON_A_LINE)


def _check_fit(fit: RobustFit, moved: FloatArray, length: float) -> None:
    """Refuse points that do not lie on each other, or off a line by no more than noise."""
    sigma = fit.sigmas[0]
    # Scatter of the residuals, in units of the points' extent, that unrelated points have.
    if sigma > 0.25:
        raise SamplesError(
            f"points that stay {mm(length * sigma):.1f} mm per axis apart after the best "
            f"registration; the points scatter by {mm(length):.1f} mm about their middle",
            "the same points, row for row",
            hint="do both sets have the same order of rows, and the same unit?",
        )
    spread = np.linalg.svd(moved - moved.mean(axis=0), compute_uv=False)
    held = len(fit.solution.identification.fixed)
    # Extent across a line, in units of the scatter, up to which it is noise.
    if held or spread[1] / np.sqrt(len(moved)) < 2.5 * sigma:
        raise SamplesError(
            "points that nearly lie on a line, compared with their scatter: the turn about it is "
            "not determined",
            _NOT_ON_A_LINE,
        )


def distinct_rows(a: FloatArray, b: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of points (n, 3) without their exact copies.

    Returns:
        (k,) rows that are not copies of one before, in their order; and (n,) for every row the
        index of its like among them.
    """
    _, first, copies = np.unique(np.hstack([a, b]), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    return first[order], rank[copies.reshape(-1)]


def determining_rows(a: FloatArray, b: FloatArray) -> int:
    """Rows (n, 3) of which every choice has three different points, as long as some have.

    Two points fit any pair of their like: where the two that occur most are many rows, what most
    rows agree on says nothing of the turn about them. In the words of robust regression, the rows
    are not in general position (Rousseeuw and Leroy 1987, section 3.4). Three where no point
    occurs twice in either frame.
    """
    counts = [np.unique(points, axis=0, return_counts=True)[1] for points in (a, b)]
    return 1 + max(int(np.sort(c)[-2:].sum()) for c in counts)
