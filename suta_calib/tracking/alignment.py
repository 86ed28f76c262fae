"""How late a recorded motion is against a reference, and where the one's frame is in the other's.

    T_ref_rec · (recorded(t) - Σ c_k error_k(t)) = reference(t - latency)

in the least-squares sense, over the latency, the transform where asked for, and the sizes ``c`` of
errors whose shape is known, such as those of a joint with play.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicSpline

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points, rms_length, rotation_from_vector, skew
from suta_calib.pose_calibration.registration import register
from suta_calib.tracking.trajectory import LEAST_ROWS, Trajectory

# Blocks of consecutive rows.
_BLOCKS: Final = 100
# m; what is left of a distance of which nothing is left.
_NEXT_TO_NOTHING: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Alignment:
    """The answer, and the rows it is about.

    Attributes:
        latency: s; positive where the recording comes later than the reference.
        latency_std: its standard uncertainty, s, from blocks of rows that vary together.
        rotation, position: ``T_ref_rec``; identity where none was asked for.
        registered: whether it was.
        sizes, sizes_std: (k,) of the known errors, and their standard uncertainties.
        rows: (m,) rows of the recording that the reference covers at any latency looked at.
        shifts, rms: latencies looked at (k,), s, and what distance they leave (k,), m.
        as_good: other latencies, s, that these motions do not tell from this one, because they
            repeat themselves; it is the smallest of them all.
        motion: how far the recording strays from its mean, RMS, m.
        left: how far what is left strays from its own, RMS, m.
        other_axes: of the recording, such as ``y, x, -z``, with which it would follow the
            reference far better; empty where there are none.
    """

    latency: float
    latency_std: float
    rotation: FloatArray
    position: FloatArray
    registered: bool
    sizes: FloatArray
    sizes_std: FloatArray
    rows: np.typing.NDArray[np.intp]
    shifts: FloatArray
    rms: FloatArray
    as_good: tuple[float, ...]
    motion: float
    left: float
    other_axes: str

    @property
    def at_the_end(self) -> bool:
        """Whether the best latency is the largest looked at: the true one may be larger."""
        return bool(abs(self.latency) >= 0.98 * abs(self.shifts[-1]))

    def act(self, points: FloatArray) -> FloatArray:
        """Points (n, 3) of the recording in the reference's frame."""
        return np.asarray(points @ self.rotation.T + self.position)


class ReferencePath:
    """A reference trajectory at any time it covers."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.begin, self.end = float(trajectory.time[0]), float(trajectory.time[-1])
        self._spline: Any = CubicSpline(trajectory.time, trajectory.position)

    def position(self, time: FloatArray) -> FloatArray:
        """(n, 3) m."""
        return np.asarray(self._spline(time))

    def velocity(self, time: FloatArray) -> FloatArray:
        """(n, 3) m/s, mean over some milliseconds: over less, a measured reference is noise."""
        return self._rate(self.position, time, 5e-3)

    def acceleration(self, time: FloatArray) -> FloatArray:
        """(n, 3) m/s², mean over a time in which 0.02 mm of noise make some 0.05 m/s²."""
        return self._rate(self.velocity, time, 0.025)

    def _rate(
        self, of: Callable[[FloatArray], FloatArray], time: FloatArray, half_interval: float
    ) -> FloatArray:
        after = np.minimum(time + half_interval, self.end)
        before = np.maximum(time - half_interval, self.begin)
        return np.asarray((of(after) - of(before)) / (after - before)[:, None])


def align(
    recorded: Trajectory,
    reference: Trajectory,
    *,
    registered: bool = False,
    largest: float = 0.5,
    errors: FloatArray | None = None,
) -> Alignment:
    """Find the latency that minimises the distance, by search and then Gauss-Newton.

    Args:
        recorded: what is judged.
        reference: what is held to be true.
        registered: whether the frames differ: then the transform is found too, robustly.
        largest: latencies of either sign looked at, s.
        errors: (n, 3, k) along the recording's axes: known shapes of errors of unknown size.

    Raises:
        SamplesError: no common time, a reference that does not move, or points that leave the
            registration undetermined.
    """
    path = ReferencePath(reference)
    rows = _covered(recorded, path, largest)
    time, points = recorded.time[rows], recorded.position[rows]
    # m; a reference that moves less tells no time.
    if float(np.ptp(path.position(time), axis=0).max()) < 1e-4:
        raise SamplesError(
            "a reference that does not move",
            "a motion: without one the time offset cannot be found",
            file=reference.path,
        )
    few = np.unique(np.linspace(0, len(rows) - 1, 800).astype(int))  # enough rows to search in
    shifts = np.linspace(-largest, largest, 201)
    targets = [path.position(time[few] - shift) for shift in shifts]
    rms = np.array([_misfit(points[few], target, registered) for target in targets])
    shapes = np.zeros((len(rows), 3, 0)) if errors is None else errors[rows]
    fit = _AlignmentFit(path, time, points, shapes, registered)
    sketch = _AlignmentFit(path, time[few], points[few], shapes[few], registered)
    fit.latency, *as_good = sketch.minima(shifts, rms)
    if registered:
        start = register(points[few], path.position(time[few] - fit.latency))
        fit.R, fit.p = start.rotation, start.position
    fit.refine(largest)
    std, left = fit.std(), fit.residual()
    left -= left.mean(axis=0)
    if registered:
        # The known errors may have taken a share of the transform; what is told has none of them.
        fit.R, fit.p = register_points(points, path.position(time - fit.latency))
    return Alignment(
        latency=fit.latency,
        latency_std=float(std[0]),
        rotation=fit.R,
        position=fit.p,
        registered=registered,
        sizes=fit.sizes,
        sizes_std=std[len(std) - len(fit.sizes) :],
        rows=rows,
        shifts=shifts,
        rms=rms,
        as_good=tuple(as_good),
        motion=rms_length(points - points.mean(axis=0)),
        left=rms_length(left),
        other_axes="" if registered else _other_axes(points[few], targets, rms_length(left)),
    )


def _covered(
    recorded: Trajectory, path: ReferencePath, largest: float
) -> np.typing.NDArray[np.intp]:
    begin, end = path.begin + largest, path.end - largest
    rows = np.flatnonzero((recorded.time >= begin) & (recorded.time <= end))
    if len(rows) < LEAST_ROWS:
        raise SamplesError(
            f"{len(rows)} rows between {begin:.3f} s and {end:.3f} s, the time that the "
            f"reference covers for latencies of up to {largest:g} s",
            f"at least {LEAST_ROWS}; the recording itself is from {recorded.time[0]:.3f} s to "
            f"{recorded.time[-1]:.3f} s",
            file=recorded.path,
            where="column 'time'",
            hint="both files must use the same clock; --max-latency narrows the search",
        )
    return rows


def _misfit(points: FloatArray, target: FloatArray, registered: bool) -> float:
    """Root mean square distance, m, after the best transform where one is to be found."""
    if registered:
        R, p = register_points(points, target)
        points = points @ R.T + p
    return rms_length(points - target)


def _other_axes(points: FloatArray, targets: Sequence[FloatArray], left: float) -> str:
    """Axes of the points (n, 3), in order and with signs, with which they fit a target far better.

    Far better, that is, than the fit that left so much, m: they leave less than a third of it, and
    less than half of the motion. The power that is left is that of both less twice what they share.
    """
    signed = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    away = points - points.mean(axis=0)
    centred = [target - target.mean(axis=0) for target in targets]
    power = np.array([np.sum(away**2) + np.sum(target**2) for target in centred]) / len(away)
    shared = np.array([target.T @ away for target in centred]) / len(away)
    squares = (power - 2 * np.einsum("pij,sij->ps", signed, shared)).min(axis=1)
    best = int(np.argmin(squares))
    fits = best == 0 or left < _NEXT_TO_NOTHING
    if fits or squares[best] > min(left / 3, rms_length(away) / 2) ** 2:
        return ""
    axes = ((row.min() < 0, int(np.argmax(np.abs(row)))) for row in signed[best])
    return ", ".join("-" * bool(negative) + "xyz"[axis] for negative, axis in axes)


class _AlignmentFit:
    """Gauss-Newton over everything at once: apart, latency and transform chase each other."""

    def __init__(
        self,
        path: ReferencePath,
        time: FloatArray,
        points: FloatArray,
        errors: FloatArray,
        registered: bool,
    ) -> None:
        self.path, self.time, self.points, self.errors = path, time, points, errors
        self.latency, self.registered = 0.0, registered
        self.R, self.p = np.eye(3), np.zeros(3)
        self.sizes = np.zeros(errors.shape[2])

    def minima(self, shifts: FloatArray, rms: FloatArray) -> list[float]:
        """Latencies that leave the least distance, s: the smallest that does, then as good ones.

        They are looked for from latencies (k,), s, at even steps, each of which leaves so much, m.
        """
        padded = np.concatenate([[np.inf], rms, [np.inf]])
        low = np.flatnonzero((rms <= padded[:-2]) & (rms <= padded[2:]))
        minima: list[tuple[float, FloatArray]] = []
        for k in low[np.argsort(rms[low])][:24]:
            self.latency, self.sizes = float(shifts[k]), np.zeros_like(self.sizes)
            if self.registered:
                target = self.path.position(self.time - self.latency)
                self.R, self.p = register_points(self.points, target)
            self.refine(float(shifts[-1]))
            minima.append((self.latency, (self.residual() ** 2).sum(axis=1)))
        _, least = min(minima, key=lambda minimum: float(minimum[1].mean()))

        def as_good(squares: FloatArray) -> bool:
            """Whether chance explains that these squares of distances are larger than the least.

            They are not if they leave 1.5 times the distance, or three standard errors more.
            """
            worth = max(1.5**2 * float(least.mean()), _NEXT_TO_NOTHING**2)
            parts = np.array_split(squares - least, _BLOCKS // 5)
            blocks = np.array([part.mean() for part in parts])
            error = float(blocks.std(ddof=1)) / np.sqrt(len(blocks))
            near = squares.mean() < _NEXT_TO_NOTHING**2
            return bool(squares.mean() <= worth and (near or blocks.mean() <= 3.0 * error))

        separate: list[float] = []
        good = (latency for latency, squares in minima if as_good(squares))
        for latency in sorted(good, key=abs):
            if all(abs(latency - other) > shifts[1] - shifts[0] for other in separate):
                separate.append(latency)
        return separate

    def refine(self, largest: float) -> None:
        """Until the latency does not change, or is as large as it may be."""
        for _ in range(20):
            residual, jacobian = self._linearised()
            inverse = _inverse(jacobian)
            step = -inverse @ np.einsum("nki,nk->i", jacobian, residual)
            self.latency = float(np.clip(self.latency + step[0], -largest, largest))
            self.sizes = self.sizes + step[len(step) - len(self.sizes) :]
            if self.registered:
                turn, centre = rotation_from_vector(step[4:7]), self._moved().mean(axis=0)
                self.R, self.p = turn @ self.R, turn @ (self.p - centre) + centre + step[1:4]
            # s; latencies that differ by less are the same.
            if abs(step[0]) < 1e-9:
                break

    def std(self) -> FloatArray:
        """Standard uncertainties: sandwich over blocks of rows that depend on their neighbours.

        Newey, West (1987, doi:10.2307/1913610), with sums over blocks for single rows.
        """
        neighbours = 4  # blocks that one of them may depend on
        residual, jacobian = self._linearised()
        inverse = _inverse(jacobian)
        score = np.einsum("nki,nk->ni", jacobian, residual)
        blocks = np.array([part.sum(axis=0) for part in np.array_split(score, _BLOCKS)])
        variance = blocks.T @ blocks
        for lag in range(1, neighbours + 1):
            product = blocks[lag:].T @ blocks[:-lag]
            variance += (1 - lag / (neighbours + 1)) * (product + product.T)
        free = max(_BLOCKS - score.shape[1], 1)
        covariance = _BLOCKS / free * inverse @ variance @ inverse
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))

    def residual(self) -> FloatArray:
        """(n, 3) m."""
        return self._moved() - self.path.position(self.time - self.latency)

    def _moved(self) -> FloatArray:
        return np.asarray((self.points - self.errors @ self.sizes) @ self.R.T + self.p)

    def _linearised(self) -> tuple[FloatArray, FloatArray]:
        """Residuals (n, 3); derivatives (n, 3, …) by latency, shift, turn and sizes."""
        moved, time = self._moved(), self.time - self.latency
        columns = [self.path.velocity(time)[:, :, None]]
        if self.registered:
            columns.append(rigid_motions(moved))
        columns.append(-self.R @ self.errors)
        return self.residual(), np.concatenate(columns, axis=2)


def rigid_motions(points: FloatArray) -> FloatArray:
    """(n, 3, 6) velocity of points (n, 3) that shift, and turn about their mean."""
    shift = np.tile(np.eye(3), (len(points), 1, 1))
    return np.concatenate([shift, -skew(points - points.mean(axis=0))], axis=2)


def _inverse(jacobian: FloatArray) -> FloatArray:
    """Pseudo-inverse of the normal matrix: what cannot be told apart shares the change."""
    matrix = np.einsum("nki,nkj->ij", jacobian, jacobian, optimize=True)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    outer = np.outer(scale, scale)
    # Eigenvalue of the scaled normal matrix below which two causes look alike.
    return np.asarray(np.linalg.pinv(matrix / outer, 1e-9, True) / outer)
