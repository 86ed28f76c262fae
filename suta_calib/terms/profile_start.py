"""Where a line scanner is on the tip, from a ball or a plane: where the solver of `profile` starts.

A profile of a ball is an arc. Its centre is the ball's, but for the distance y of the ball from the
scanner's plane: ``y² = R² - r²``, of either sign. So the scanner's pose X and the ball's place s
satisfy, for every scan, ``q = X⁻¹ (A_i⁻¹ s)`` with ``q_x, q_z`` the centre of the arc and
``√(R² - q_y²)`` its radius. No sign appears in that; signs make its minima many. A profile of a
plane is a piece of a line, both ends of which are on the plane.

Both are descended from rotations all over SO(3) at once, by Levenberg and Marquardt with Cauchy's
loss, so that a scan that is wrong decides nothing; translations of each start are linear.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, Final, Self

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector, skew
from suta_calib.geometry.planar import fitted_circle, piece_of_line
from suta_calib.terms.hand_eye_start import Poses, some_poses

# Of the radius of a ball: a smaller section is not told from none.
_SLIVER: Final = 0.1


@dataclass
class Answers:
    """Many answers at once: X's rotation (m, 3, 3), and all else (m, k)."""

    rotation: FloatArray
    rest: FloatArray
    cost: FloatArray = field(default_factory=lambda: np.zeros(0))

    def take(self, rows: IntArray) -> Answers:
        """Some of the answers."""
        return Answers(self.rotation[rows], self.rest[rows], self.cost[rows])


class ScanModel(ABC):
    """Residuals of many answers, and their derivatives by a turn of X and by all else.

    Scans are what profiles show, and the poses of the hand that they were taken at.
    """

    hand: Poses
    scale: float
    # (n, d, d) covariance of what a profile shows, by the scatter of its points, m².
    scatter: FloatArray
    # The two sources of noise, in words.
    sources: ClassVar[tuple[str, str]]

    @abstractmethod
    def take(self, rows: IntArray) -> Self:
        """The same of some of the scans."""

    @abstractmethod
    def reversed(self, rows: BoolArray) -> Self:
        """The same with some profiles turned by 180° about the beam."""

    @abstractmethod
    def exchanged(self, order: IntArray) -> Self:
        """The same with the profiles in another order, the hand as it is."""

    @abstractmethod
    def noise(self, state: Answers) -> FloatArray:
        """(2, n, d, d) covariances of the residuals for a unit of each of two sources of noise."""

    def free(self, state: Answers) -> FloatArray:
        """(3 + k, p) the directions in which the answer can change."""
        return np.eye(3 + state.rest.shape[1])

    @abstractmethod
    def residuals(self, state: Answers) -> tuple[FloatArray, FloatArray]:
        """(m, n, d) and (m, n, d, 3 + k)."""

    @abstractmethod
    def begun(self, rotation: FloatArray) -> Answers:
        """States with these rotations (m, 3, 3) of X."""

    def moved(self, state: Answers, step: FloatArray) -> Answers:
        """The states after steps (m, 3 + k)."""
        turned = state.rotation @ rotation_from_vector(step[:, :3])
        return Answers(turned, state.rest + step[:, 3:])

    def _cost(self, residual: FloatArray, scale: float) -> FloatArray:
        """(m,) by Cauchy's loss of each scan."""
        square = np.sum(residual**2, axis=2) / scale**2
        return np.asarray(np.sum(np.log1p(square), axis=1))

    def typical(self, state: Answers) -> float:
        """How far a scan is off in the first answer, counted so that a third may be wrong."""
        residual, _ = self.residuals(state)
        _, n, per_scan = residual.shape
        spare = max(n - (3 + state.rest.shape[1]) / per_scan, 1.0)
        middle = float(np.median(np.linalg.norm(residual[0], axis=1)))
        # A hand is never so exact that one scan should decide alone.
        return float(np.clip(2.0 * middle * np.sqrt(n / spare), 1e-3 * self.scale, self.scale))

    def descended(self, state: Answers, scale: float, iterations: int) -> Answers:
        """The minima below some states."""
        damping = np.full(len(state.rest), 1e-3)
        residual, slope = self.residuals(state)
        state.cost = self._cost(residual, scale)
        for _ in range(iterations):
            weight = 1.0 / (1.0 + np.sum(residual**2, axis=2) / scale**2)
            m = len(residual)
            rows = (slope * np.sqrt(weight)[..., None, None]).reshape(m, -1, slope.shape[-1])
            whitened = (residual * np.sqrt(weight)[..., None]).reshape(m, -1)
            normal = np.swapaxes(rows, 1, 2) @ rows
            pull = np.einsum("mij,mi->mj", rows, whitened)
            size = np.einsum("mii->mi", normal)
            floor = 1e-9 * size.max(axis=1, keepdims=True) + 1e-300
            held = normal + np.eye(slope.shape[-1]) * (
                damping[:, None, None] * size[:, None, :] + floor[:, None]
            )
            step = -np.linalg.solve(held, pull[..., None])[..., 0]
            # A turn of more than a radian is no small one.
            longest = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
            step *= np.minimum(1.0, 0.7 / np.maximum(longest, 1e-12))
            tried = self.moved(state, step)
            r, J = self.residuals(tried)
            cost = self._cost(r, scale)
            better, gain = cost < state.cost, state.cost - cost
            state.rotation = np.where(better[:, None, None], tried.rotation, state.rotation)
            state.rest = np.where(better[:, None], tried.rest, state.rest)
            state.cost = np.where(better, cost, state.cost)
            residual = np.where(better[:, None, None], r, residual)
            slope = np.where(better[:, None, None, None], J, slope)
            damping = np.clip(np.where(better, damping / 5.0, damping * 5.0), 1e-9, 1e6)
            # Where steps are as short as that, what is left is rounding.
            if np.all(np.where(better, gain < 1e-10 * cost, damping > 1e3)):
                break
        return state

    def with_twins(self, state: Answers) -> Answers:
        """The states, and what may fit as well as the first of them."""
        return state

    def impossible(self, state: Answers) -> BoolArray:
        """(m,) answers that cannot be, however well they fit."""
        return np.zeros(len(state.rest), dtype=np.bool_)


class BallModel(ScanModel):
    """A ball of which arcs (n, 3) were seen: centre x and z, and radius; rest t, s (and R)."""

    sources = "position errors of the hand", "form errors of the ball and of the scanner"

    def __init__(
        self, hand: Poses, arcs: FloatArray, radius: float | None, scatter: FloatArray | None = None
    ) -> None:
        self.hand, self.arcs, self.radius = hand, arcs, radius
        largest = float(arcs[:, 2].max(initial=1e-3))
        # Radii that are tried where nobody says one, over the largest of an arc.
        tried = [largest * f for f in (1.01, 1.1, 1.3)]
        self.radii = np.array(tried if radius is None else [radius])
        self.scale = 0.05 * self.radii[0]
        self.scatter = np.zeros((len(arcs), 3, 3)) if scatter is None else scatter

    def take(self, rows: IntArray) -> Self:
        """The same of some of the scans."""
        hand, arcs, scatter = some_poses(self.hand, rows), self.arcs[rows], self.scatter[rows]
        return type(self)(hand, arcs, self.radius, scatter)

    def reversed(self, rows: BoolArray) -> Self:
        """The same with some profiles turned by 180° about the beam."""
        return type(self)(
            self.hand,
            np.where(rows[:, None], [-1.0, 1.0, 1.0], 1.0) * self.arcs,
            self.radius,
            self.scatter,
        )

    def exchanged(self, order: IntArray) -> Self:
        """The same with the profiles in another order, the hand as it is."""
        return type(self)(self.hand, self.arcs[order], self.radius, self.scatter[order])

    def size(self, state: Answers) -> FloatArray:
        """(m,) radius of the ball, m."""
        if self.radius is not None:
            return np.full(len(state.rest), self.radius)
        return np.abs(state.rest[:, 6])

    def centres(self, state: Answers) -> FloatArray:
        """(n, 3) of the ball in the scanner, as the first answer has it, m."""
        (R, p), rest = self.hand, state.rest[0]
        return np.asarray(
            (np.einsum("nji,nj->ni", R, rest[3:6] - p) - rest[:3]) @ state.rotation[0]
        )

    def seen_centres(self, state: Answers) -> FloatArray:
        """(n, 3) of the ball in the base, as every arc has it, m."""
        (R, p), rest, arcs = self.hand, state.rest[0], self.arcs
        aside = np.sqrt(np.maximum(self.size(state)[0] ** 2 - arcs[:, 2] ** 2, 0.0))
        aside *= np.sign(self.centres(state)[:, 1])
        centre = np.column_stack([arcs[:, 0], aside, arcs[:, 1]])
        in_hand = centre @ state.rotation[0].T + rest[:3]
        return np.asarray(np.einsum("nij,nj->ni", R, in_hand) + p)

    def noise(self, state: Answers) -> FloatArray:
        """Of the hand's place, and of the radius of an arc: the form of ball and scanner."""
        aside, size = self.centres(state)[:, 1], float(self.size(state)[0])
        section = np.sqrt(np.maximum(size**2 - aside**2, (_SLIVER * size) ** 2))
        by_hand = np.zeros_like(self.scatter)
        by_hand[:, 0, 0] = by_hand[:, 1, 1] = 1.0
        by_hand[:, 2, 2] = (aside / section) ** 2
        of_radius = np.zeros_like(self.scatter)
        of_radius[:, 2, 2] = 1.0
        return np.stack([by_hand, of_radius])

    def residuals(self, state: Answers) -> tuple[FloatArray, FloatArray]:
        """What the profiles show, less what the answers have; and derivatives."""
        R, p = self.hand
        t, s = state.rest[:, :3], state.rest[:, 3:6]
        radius = self.size(state)
        back = np.swapaxes(R, 1, 2)
        from_hand = np.einsum("nij,mnj->mni", back, s[:, None] - p) - t[:, None]
        q = np.einsum("mji,mnj->mni", state.rotation, from_hand)
        m, n = q.shape[:2]
        slope = np.zeros((m, n, 3, 3 + state.rest.shape[1]))
        by = np.empty((m, n, 3, 9))
        by[..., :3] = skew(q)
        by[..., 3:6] = -np.swapaxes(state.rotation, 1, 2)[:, None]
        by[..., 6:9] = np.swapaxes(state.rotation, 1, 2)[:, None] @ back
        # A ball beyond the plane shows no arc at all; a small one leads back.
        least = (_SLIVER * radius[:, None]) ** 2
        section = np.sqrt(np.maximum(radius[:, None] ** 2 - q[..., 1] ** 2, least))
        residual = np.stack(
            [self.arcs[:, 0] - q[..., 0], self.arcs[:, 1] - q[..., 2], self.arcs[:, 2] - section],
            axis=2,
        )
        slope[:, :, 0, :9], slope[:, :, 1, :9] = -by[:, :, 0], -by[:, :, 2]
        slope[:, :, 2, :9] = (q[..., 1] / section)[..., None] * by[:, :, 1]
        if self.radius is None:
            slope[:, :, 2, 9] = -radius[:, None] / section
        return residual, slope

    def begun(self, rotation: FloatArray) -> Answers:
        """Signs of y as the arcs ask for, translations by linear least squares."""
        (R, p), n = self.hand, len(self.arcs)
        radius = np.resize(self.radii, (len(rotation), 1))
        solve = np.linalg.pinv(
            np.concatenate([R, -np.tile(np.eye(3), (n, 1, 1))], axis=2).reshape(-1, 6), 1e-6
        )
        y = np.sqrt(np.maximum(radius**2 - self.arcs[:, 2] ** 2, 0.0))
        sign = np.zeros((len(rotation), n))
        for _ in range(4):
            centre = np.stack(
                [
                    np.broadcast_to(self.arcs[:, 0], sign.shape),
                    sign * y,
                    np.broadcast_to(self.arcs[:, 1], sign.shape),
                ],
                axis=2,
            )
            in_hand = np.einsum("mij,mnj->mni", rotation, centre)
            there = np.einsum("nij,mnj->mni", R, in_hand) + p
            rest = -there.reshape(len(rotation), -1) @ solve.T
            off = np.einsum("nji,mnj->mni", R, rest[:, None, 3:] - p) - rest[:, None, :3]
            sign = np.sign(np.einsum("mj,mnj->mn", rotation[:, :, 1], off))
        more = [radius] if self.radius is None else []
        return Answers(rotation, np.hstack([rest, *more]))


class PlaneModel(ScanModel):
    """A plane of which pieces of lines (n, 2, 3) were seen; rest t, the normal, and z."""

    sources = "position errors of the hand", "turn errors of the hand"

    def __init__(self, hand: Poses, ends: FloatArray, scatter: FloatArray | None = None) -> None:
        self.hand, self.ends = hand, ends
        self.lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self.scale = 0.2 * float(np.median(self.lengths))
        self.scatter = np.zeros((len(ends), 2, 2)) if scatter is None else scatter

    def take(self, rows: IntArray) -> Self:
        """The same of some of the scans."""
        return type(self)(some_poses(self.hand, rows), self.ends[rows], self.scatter[rows])

    def reversed(self, rows: BoolArray) -> Self:
        """The same with some profiles turned by 180° about the beam."""
        return type(self)(
            self.hand,
            np.where(rows[:, None, None], [-1.0, 1.0, 1.0], 1.0) * self.ends,
            self.scatter,
        )

    def exchanged(self, order: IntArray) -> Self:
        """The same with the profiles in another order, the hand as it is."""
        return type(self)(self.hand, self.ends[order], self.scatter[order])

    def noise(self, state: Answers) -> FloatArray:
        """Of the hand's height over the plane, and of its turn, rad."""
        del state
        turned = (0.5 * self.lengths) ** 2
        height = np.ones_like(self.scatter)
        return np.stack([height, turned[:, None, None] * np.array([[1.0, -1.0], [-1.0, 1.0]])])

    def free(self, state: Answers) -> FloatArray:
        """The normal keeps its length."""
        across = np.linalg.svd(state.rest[:1, 3:6])[2][1:].T
        free = np.zeros((10, 9))
        free[:6, :6] = np.eye(6)
        free[6:9, 6:8], free[9, 8] = across, 1.0
        return free

    def residuals(self, state: Answers) -> tuple[FloatArray, FloatArray]:
        """What the profiles show, less what the answers have; and derivatives."""
        R, p = self.hand
        t, normal, z = state.rest[:, :3], state.rest[:, 3:6], state.rest[:, 6]
        in_hand = np.einsum("nji,mj->mni", R, normal)
        at = np.einsum("mij,nkj->mnki", state.rotation, self.ends) + t[:, None, None]
        residual = np.einsum("mni,mnki->mnk", in_hand, at) + (normal @ p.T - z[:, None])[..., None]
        in_eye = np.einsum("mji,mnj->mni", state.rotation, in_hand)
        slope = np.zeros((*residual.shape, 10))
        slope[..., :3] = np.cross(self.ends[None], in_eye[:, :, None])
        slope[..., 3:6] = in_hand[:, :, None]
        there = np.einsum("nij,mnkj->mnki", R, at) + p[:, None]
        # Along the normal nothing changes: its length is one.
        along = np.einsum("mi,mnki->mnk", normal, there)
        slope[..., 6:9] = there - along[..., None] * normal[:, None, None]
        slope[..., 9] = -1.0
        return residual, slope

    def with_twins(self, state: Answers) -> Answers:
        """Beyond the plane, turned about its y axis, a scanner sees the same.

        But for what its distance from the plane varies.
        """
        beyond = 2.0 * float(np.median(self.ends[..., 2])) * state.rotation[:, :, 2]
        rest = state.rest.copy()
        rest[:, :3] += beyond
        turned = state.rotation * [-1.0, 1.0, -1.0]
        return Answers(np.vstack([state.rotation, turned]), np.vstack([state.rest, rest]))

    def impossible(self, state: Answers) -> BoolArray:
        """With the plane between the hand and the scanner."""
        (R, p), normal = self.hand, state.rest[:, 3:6]
        height = normal @ p.T - state.rest[:, 6:]
        of_scanner = height + np.einsum("nij,mj,mi->mn", R, state.rest[:, :3], normal)
        return np.asarray(np.median(height, axis=1) * np.median(of_scanner, axis=1) < 0.0)

    def moved(self, state: Answers, step: FloatArray) -> Answers:
        """The states after steps (m, 3 + k); a normal keeps its length."""
        moved = super().moved(state, step)
        moved.rest[:, 3:6] /= np.linalg.norm(moved.rest[:, 3:6], axis=1, keepdims=True)
        return moved

    def begun(self, rotation: FloatArray) -> Answers:
        """The normal that the lines are most square to, and translations by least squares."""
        R, p = self.hand
        along = np.einsum("nij,mjk,nk->mni", R, rotation, self.ends[:, 1] - self.ends[:, 0])
        normal = np.linalg.eigh(np.swapaxes(along, 1, 2) @ along)[1][..., 0]
        in_hand = np.einsum("nji,mj->mni", R, normal)
        middle = np.einsum("mij,nj->mni", rotation, self.ends.mean(axis=1))
        right = -np.einsum("mni,mni->mn", in_hand, middle) - normal @ p.T
        rows = np.concatenate([in_hand, -np.ones((*in_hand.shape[:2], 1))], axis=2)
        solved = np.einsum("mij,mj->mi", np.linalg.pinv(rows, 1e-4), right)
        return Answers(rotation, np.hstack([solved[:, :3], normal, solved[:, 3:]]))


def scanner(model: ScanModel) -> Answers:
    """The lowest minimum, searched with some of the scans and decided with all."""
    # Rotations from which is searched: about 30° apart.
    rotation = random_rotations(np.random.default_rng(0), 250)
    n = len(model.hand[1])
    # Scans that are searched with; all of them decide at last.
    subset = model.take(np.unique(np.linspace(0, n - 1, min(n, 24)).astype(np.intp)))
    state = subset.begun(rotation)
    # After how many steps how many of them are left: most are soon seen to lead nowhere.
    for steps, left in ((6, 60), (8, 20), (12, 6)):
        state = subset.descended(state, subset.scale, steps)
        state = state.take(np.argsort(state.cost)[:left])
    state = model.descended(state, model.scale, 40)
    state = model.with_twins(state.take(np.argsort(state.cost)[:1]))
    for _ in range(3):
        state = model.descended(state, model.typical(state), 20)
    # Of two answers that noise alone tells apart, that which can be.
    # In the cost of two answers, a difference that noise makes: of 2 log-likelihood ratios, p =
    # 1e-4.
    cost = state.cost + 15.0 * model.impossible(state)
    return state.take(np.array([int(np.argmin(cost))]))


def arcs_of(points: FloatArray) -> FloatArray:
    """(n, 3) centre x and z, and radius, of the arcs of points (n, points, 2), NaN for none; m."""
    circles = [fitted_circle(p[np.isfinite(p).all(axis=1)]) for p in points]
    return np.reshape([[*centre, radius] for centre, radius in circles], (-1, 3))


def ends_of(points: FloatArray) -> FloatArray:
    """(n, 2, 2) pieces of the lines through points (n, points, 2), NaN for none; m."""
    pieces = [piece_of_line(p[np.isfinite(p).all(axis=1)]) for p in points]
    return np.reshape(pieces, (-1, 2, 2))


def scanner_by_ball(
    hand: Poses, arcs: FloatArray, radius: float | None
) -> tuple[Poses, FloatArray, float]:
    """X, the ball's place (3,) and its radius, from arcs (n, 3): x and z of the centre, radius; m.

    Args:
        hand: ``T_base_hand`` of every scan.
        arcs: of the ball, as each scan shows it.
        radius: of the ball, m; None where nobody says.
    """
    model = BallModel(hand, arcs, radius)
    state = scanner(model)
    rest = state.rest[0]
    return (state.rotation[0], rest[:3]), rest[3:6], float(model.size(state)[0])


def scanner_by_plane(hand: Poses, ends: FloatArray) -> tuple[Poses, FloatArray, float]:
    """X, the plane's normal (3,) and its distance from the base's origin along it, m.

    Args:
        hand: ``T_base_hand`` of every scan.
        ends: (n, 2, 2) of the piece of a line that each scan shows, x and z, m.
    """
    state = scanner(PlaneModel(hand, in_scanner(ends)))
    rest = state.rest[0]
    # Its normal points up in the base, as a plane that is estimated has it.
    sign = -1.0 if rest[5] < 0 else 1.0
    return (state.rotation[0], rest[:3]), sign * rest[3:6], sign * float(rest[6])


def in_scanner(points: FloatArray) -> FloatArray:
    """Points (..., 2), x and z, with their y of zero, (..., 3)."""
    return np.stack([points[..., 0], np.zeros(points.shape[:-1]), points[..., 1]], axis=-1)
