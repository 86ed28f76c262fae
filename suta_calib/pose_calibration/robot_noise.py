"""Splits the rotation noise of hand-eye calibration between hand and camera.

Turns of the hand make X's position known: between two poses that are turned alike, X may slide, and
nothing changes. Noise turns every pose a little, too, and seems to tell what it does not (errors in
variables). How much of the information about a direction noise made up is asked of the pairs: the
turns of the hand can be no noisier than their residuals, nor noisier than the places where the
target was seen allow, which a turn of the hand moves by its lever. What the eye saw enters no
derivative: its noise makes up nothing, however large.

All of this is the same whatever frames were chosen on base, hand, eye and target.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rotation_from_vector, skew, tangent_of_poses
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements.samples import Samples
from suta_calib.model.parameters import Parameter
from suta_calib.pose_calibration.consensus import DIMENSION, Consensus, some_rows
from suta_calib.pose_calibration.robust_fit import (
    ROUNDING,
    RobustFit,
    parts_of,
    robust_fit,
    scatter,
)
from suta_calib.solver.compiled_residual import term_residuals
from suta_calib.solver.information import scaled_inverse, whitened_rows
from suta_calib.terms.block import Block, Noise, Pose
from suta_calib.terms.external_frame import pose_parameters
from suta_calib.terms.hand_eye import HandEye, Owners, target_position, target_rotation
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.poses import MeasuredPoses, PoseSource
from suta_calib.terms.term import Term

# Before the data are asked: anything from none to all.
EXPECTED: Final = 0.5
SPREAD: Final = 0.29
UNKNOWNS: Final = 12
# What the poses of the eye in the hand and of the target are called among the unknowns.
EYE, TARGET = (frame.owner for frame in HandEye.frames)


@dataclass(frozen=True, eq=False)
class LeverModel:
    """How the turn in a pair's residual moves the target's position: ``turn x lever``.

    The lever is ``fraction (p_seen - hand) + in_eye + R_seen in_target``, all in the eye. It stays
    the same family whatever frames are chosen on hand, eye and target.

    Attributes:
        fraction: part of the rotational noise, as a variance, that is the hand's; between 0 and 1.
        std: its standard deviation.
        in_eye, in_target: (3,) in the axes of the eye and of the target, in the problem's unit.
        at_most: the largest fraction that the residuals allow.
    """

    fraction: float = EXPECTED
    std: float = SPREAD
    in_eye: tuple[float, float, float] = (0.0, 0.0, 0.0)
    in_target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    at_most: float = 1.0


def estimate_lever(
    position: FloatArray,
    turn: FloatArray,
    lever: FloatArray,
    target: FloatArray,
    sight: FloatArray | None = None,
    *,
    points: bool = True,
) -> LeverModel:
    """The lever by which the turns in the residuals of pairs move the target.

    A turn of the hand moves the target by turn x lever, seen from the eye; a turn of what the eye
    sees does not. The regression of one on the other is the fraction, shrunk towards one half where
    few poses tell little. Where noise of places and turns is correlated because frames lie
    elsewhere than what makes it, two points follow; the size of their prior is the one of most
    likelihood (empirical Bayes).

    Args:
        position: (n, 3) residuals of the target's position in the eye.
        turn: (n, 3) turn in each residual, rad, in the eye's axes.
        lever: (n, 3) from the hand's origin to the target, in the eye's axes, and in the unit of
            ``position``.
        target: (n, 3, 3) orientation of the target in the eye.
        sight: (n, 3) from the eye to the target. A camera knows the distance worse than the
            direction, and turns move the target sideways: both are weighed by their scatter.
        points: whether the two points are looked for: those of several eyes and targets differ.
    """
    # How far the noise's centres may be from the frames' origins, in units of the extent: a
    # standard deviation before the data are asked. Zero unless they speak for another by this much
    # (log- likelihood): six numbers more follow noise, too.
    centres = (0.0, 0.05, 0.2, 1.0) if points else (0.0,)
    cross = skew(turn)
    columns = np.concatenate([(cross @ lever[..., None]), cross, cross @ target], axis=2)
    if not columns[..., 0].any():
        return LeverModel()
    if sight is not None:
        along = _less_along(position, sight)
        position, columns = (along @ position[..., None])[..., 0], along @ columns
    weight = _believed(position)[:, None, None]
    position, columns = (weight * position[..., None]).ravel(), (weight * columns).reshape(-1, 7)
    y = position - EXPECTED * columns[:, 0]
    ridges = [_ridge(columns, y, size) for size in centres]
    best = max(range(len(ridges)), key=lambda k: ridges[k][0] - 2.0 * (k > 0))
    _, beta, std = ridges[best]
    fraction = EXPECTED + float(beta[0])
    if not 0.0 <= fraction <= 1.0:
        fraction = float(np.clip(fraction, 0.0, 1.0))
        if best:
            rest = position - fraction * columns[:, 0]
            beta = np.concatenate([[0.0], _ridge(columns[:, 1:], rest, centres[best])[1]])
    at = tuple(map(float, beta[1:])) if best else (0.0,) * 6
    # Two standard deviations more.
    at_most = min(1.0, fraction + 2.0 * std)
    return LeverModel(fraction, std, at[:3], at[3:], at_most)  # type: ignore[arg-type]


def _believed(position: FloatArray) -> FloatArray:
    """(n,) roots of Huber's weights: six numbers must not explain one pair that is wrong."""
    size = np.linalg.norm(position, axis=1)
    # From twice the middle residual on a pair counts less: noise exceeds it in one of 50.
    limit = max(2.0 * float(np.median(size)), 1e-300)
    return np.asarray(np.sqrt(np.minimum(1.0, limit / np.maximum(size, 1e-300))))


def _less_along(position: FloatArray, sight: FloatArray) -> FloatArray:
    """(n, 3, 3) what makes residuals (n, 3) scatter along the sight (n, 3) as across it."""
    unit = sight / np.maximum(np.linalg.norm(sight, axis=1), 1e-300)[:, None]
    depth = np.einsum("ni,ni->n", unit, position)
    across = float(np.sum(position**2) - depth @ depth) / 2.0
    weight = min(np.sqrt(max(across, 0.0) / max(float(depth @ depth), 1e-300)), 1.0)
    return np.asarray(np.eye(3) - (1.0 - weight) * unit[:, :, None] * unit[:, None, :])


def _ridge(columns: FloatArray, y: FloatArray, size: float) -> tuple[float, FloatArray, float]:
    """Logarithm of the marginal likelihood, the estimate, and the first one's std.

    Columns (n, k) are the fraction's, if there are seven, and those of two points, whose
    coordinates have the standard deviation ``size`` before the data.
    """
    points = np.full(6, size)
    prior = np.concatenate([[SPREAD], points]) if columns.shape[1] == 7 else points
    used = np.flatnonzero(prior)
    C, root = columns[:, used], prior[used]
    freedom = max(len(y) - UNKNOWNS / 2, 1.0)
    scaled = C * root
    information, pull = scaled.T @ scaled, scaled.T @ y
    # What exact poses leave is rounding.
    least = ROUNDING**2 * max(float(information.max()), 1.0)
    variance = max(float(y @ y) / freedom, least)
    for _ in range(20):
        step = np.linalg.solve(information + variance * np.eye(len(used)), pull)
        left = y - scaled @ step
        bayes = float(y @ left)
        again = max(bayes / freedom, least)
        if abs(again / variance - 1.0) < 1e-6:
            break
        variance = again
    logarithm = np.linalg.slogdet(np.eye(len(used)) + information / variance)[1]
    likelihood = -0.5 * (freedom * np.log(variance) + logarithm + bayes / variance)
    beta = np.zeros(columns.shape[1])
    beta[used] = root * step
    spread = variance * np.linalg.inv(information + variance * np.eye(len(used)))
    return float(likelihood), beta, float(root[0] * np.sqrt(spread[0, 0]))


def _position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return target_position(poses, unknowns, data[:-1]) / data[-1]


def _rotation(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return target_rotation(poses, unknowns, data[:-1]) / data[-1]


@dataclass(frozen=True, eq=False, repr=False)
class PairedHandEye(HandEye):
    """`HandEye` of which nothing is held because it is known badly: only what is singular.

    Attributes:
        every: owners of all eyes and of all targets, which it has whatever its rows look at; those
            of the rows where they are left out.
        relative: (n, 2) noise of each pair's displacement and turn over what they typically have.
    """

    every: tuple[Sequence[str], Sequence[str]] | None = None
    relative: FloatArray | None = None

    @property
    def fractions(self) -> FloatArray:
        """Of each pair: where the eye's turns are noisier, the hand's are a smaller part of all."""
        fractions = super().fractions
        if self.relative is None:
            return fractions
        return np.asarray(np.minimum(fractions / self.relative[:, 1] ** 2, 1.0))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Positions and rotations of the target in the eye, over the noise of the eye."""
        if self.relative is None:
            return super().blocks
        return tuple(
            replace(
                block,
                residual=residual,
                data=np.column_stack([block.data, relative]),
                relative=np.repeat(relative[:, None], DIMENSION, axis=1),
            )
            for block, residual, relative in zip(
                super().blocks, (_position, _rotation), self.relative.T, strict=True
            )
        )

    def take(self, rows: ArrayLike) -> Self:
        """The term over some of its samples."""
        relative = None if self.relative is None else self.relative[np.asarray(rows)]
        return replace(self, poses=self.poses.take(rows), relative=relative)

    def owners(self, poses: PoseSource) -> tuple[Owners, Owners]:
        """Of every row, among all that there are."""
        by_owner = super().owners(poses)
        if self.every is None:
            return by_owner
        eyes, targets = (
            Owners([*names], np.array([names.index(n) for n in owners.names])[owners.which])
            for owners, names in zip(by_owner, self.every, strict=True)
        )
        return eyes, targets

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The poses of its frames."""
        # Times of a known unknown's plausible range: what the pairs tell badly gets a large
        # standard deviation. Only what is singular is held, and then refused.
        return tuple(
            replace(p, plausible=100.0 * p.plausible)
            for frame in self.frame_names
            for p in pose_parameters(frame)
        )


class RobotNoise:
    """Part of the rotational noise that comes from the hand, updated with the solution.

    Args:
        hand, seen: rotations (n, 3, 3) and positions (n, 3) of both, in units of the problem.
        finest_turn: noise of a turn, rad, that is assumed at least.
        labels: of the eye and the target of each row, where there are several.

    Attributes:
        lever: by which turns in the residuals move the target, as `make` takes it.
        whole: the term over all rows.
    """

    def __init__(
        self,
        hand: Poses,
        eye: Poses,
        finest_turn: float,
        labels: Mapping[str, NDArray[np.str_]] | None = None,
    ) -> None:
        self._seen, self._finest = eye, finest_turn
        nothing = np.zeros((len(hand[1]), 0))
        samples = Samples.from_arrays(
            [], nothing, labels=labels or {}, position=eye[1], rotation=eye[0]
        )
        # Information that noise causes is tested here: `noise_made_directions`.
        poses = MeasuredPoses(*hand, samples, judged=False)
        self._poses = parts_of(poses)
        self.lever, self.whole = LeverModel(), PairedHandEye(poses)
        eyes, targets = self.whole.owners(poses)
        self._every, self._eye = (eyes.names, targets.names), eyes.which
        self._relative = np.ones((len(eyes.names), 2))

    @property
    def moves_targets(self) -> bool:
        """Whether turns in the residuals are taken to move the target at all."""
        return bool(self.lever.fraction or any(self.lever.in_eye + self.lever.in_target))

    def plain(self, rows: IntArray) -> PairedHandEye:
        """The term over some rows whose noise is of one size, and independent at the target."""
        term = self._term(rows, (Noise(), Noise()), NO_LEVER)
        return replace(term, relative=None)

    def without_hand(
        self, rows: IntArray, hand: Poses, levels: FloatArray, like: Term
    ) -> PairedHandEye:
        """The term over some rows with other poses of a hand that has no errors.

        Args:
            rows: which (n,).
            hand: (n, 3, 3) and (n, 3).
            levels: (eyes, 2) noise of displacements and turns of each eye.
            like: a term as robust as this one.
        """
        of_rows = levels[self._eye[rows]]
        typical = np.exp(np.mean(np.log(of_rows), axis=0))
        noises = [
            Noise(s, s * block.noise.huber / block.noise.sigma)
            for s, block in zip(typical.tolist(), like.blocks, strict=True)
        ]
        samples = self._poses(rows).samples
        poses = MeasuredPoses(*hand, samples, judged=False)
        term = self._term(rows, noises, NO_LEVER)
        return replace(term, poses=poses, relative=of_rows / typical)

    @property
    def relative(self) -> FloatArray:
        """(n, 2) noise of each pair's displacement and turn over what they typically have."""
        return self._relative[self._eye]

    def make(self, rows: IntArray, noises: Sequence[Noise]) -> PairedHandEye:
        """The term over some rows."""
        return self._term(rows, noises, self.lever)

    def revise(self, values: Mapping[str, float], inliers: BoolArray) -> None:
        """Estimate the noise of each eye, and the lever, from the inliers' residuals."""
        rows = np.flatnonzero(inliers)
        term = self.plain(rows)
        slid, turned = term_residuals(term, values)
        several = len(self._every[0]) > 1
        if several:
            self._relative[:, 1] = self._by_eye(turned, rows)
        places, turns = self._relative[self._eye[rows]].T[..., None]
        R_X, p_X = term.owners(term.poses)[0].poses(values)
        R_seen, p_seen = self._seen[0][rows], self._seen[1][rows]
        # The hand turns alike whichever eye looks.
        in_eye = np.einsum("nij,nj->ni", R_seen, turned) / (places * turns**2)
        lever = p_seen + np.einsum("nji,nj->ni", R_X, p_X)
        one = sum(map(len, self._every)) == 2
        self.lever = estimate_lever(slid / places, in_eye, lever, R_seen, p_seen, points=one)
        if several:
            term = self._term(rows, (Noise(), Noise()), self.lever)
            left = term_residuals(term, values)[0] * places
            self._relative[:, 0] = self._by_eye(left, rows)

    def _by_eye(self, residual: FloatArray, rows: IntArray) -> FloatArray:
        """(eyes,) scatter of each eye's residuals (n, 3) over what they typically have."""
        eye, eyes = self._eye[rows], len(self._every[0])
        numbers = np.bincount(eye, minlength=eyes)
        squares = np.zeros(eyes)
        for k in np.flatnonzero(numbers):
            # An X of its own follows the noise of one row.
            factor = numbers[k] / max(numbers[k] - 1, 1)
            squares[k] = factor * scatter(residual[eye == k], robust=True) ** 2
        squares += ROUNDING**2
        many = numbers > 1
        together = np.exp(np.mean(np.log(squares[many]))) if many.any() else 1.0
        # An eye is believed to err as the others do, as if that were one row more.
        variances = np.where(many, (numbers * squares + together) / (numbers + 1), together)
        typical = np.exp(numbers @ np.log(variances) / max(int(numbers.sum()), 1))
        return np.asarray(np.sqrt(variances / typical))

    def forget(self) -> None:
        """Take the noise of places and turns for independent at the target's origin."""
        self.lever = NO_LEVER

    def explains(self, fit: RobustFit) -> bool:
        """Whether the residuals at the target grew no more by it than by chance.

        Some of many pairs tell. Neighbours may err alike, so that a pair is one cluster of places
        and one of turns.
        """
        rows = np.flatnonzero(fit.inliers)
        rows = rows[some_rows(len(rows))]
        plain = robust_fit(
            lambda r, n: self._term(rows[r], n, NO_LEVER),
            Consensus.of_all(len(rows), *fit.sigmas),
            (0.0, self._finest),
            robust=False,
        )
        term = self._term(rows, (Noise(), Noise()), NO_LEVER)
        with_robot_noise = [float(np.sum(r**2)) for r in term_residuals(term, fit.solution.values)]
        without = [float(np.sum(r**2)) for r in plain.residuals]
        allowed = 1.0 + 2.5 * UNKNOWNS / max(2 * len(rows) - UNKNOWNS, 1)
        return all(w <= allowed * p for w, p in zip(with_robot_noise, without, strict=True))

    def _term(self, rows: IntArray, noises: Sequence[Noise], lever: LeverModel) -> PairedHandEye:
        return PairedHandEye(
            self._poses(rows),
            noises[0],
            noises[1],
            robot_noise_fraction=lever.fraction,
            lever_in_eye=lever.in_eye,
            lever_in_target=lever.in_target,
            every=self._every,
            relative=self.relative[rows] if len(self._every[0]) > 1 else None,
        )


NO_LEVER: Final = LeverModel(fraction=0.0, std=0.0)


def noise_made_directions(fit: RobustFit, noise: RobotNoise, eye: int = 0) -> list[FloatArray]:
    """Displacements and turns (6,) of an X that noise may tell as well as the pairs do.

    The largest generalised eigenvalues of what noise makes up, F, against the information A, on X
    with all else free to follow; first of X's displacements alone.
    """
    if len(fit.solution.identification.fixed):
        return []  # X is where it started: nothing can be said of its surroundings
    sigmas = np.maximum(fit.sigmas, ROUNDING)
    x, together = fit.solution.x, noise.whole.seen_together
    rows = whitened_rows(fit.solution.problem, x, sigmas.tolist())
    jacobian = np.vstack([r.jacobian for r in rows]) @ np.linalg.inv(tangent_of_poses(x))
    information = jacobian.T @ jacobian
    of_this = np.arange(6 * eye, 6 * eye + 6)
    of_rest = np.setdiff1d(np.arange(len(x)), of_this)
    follow = np.zeros((len(x), 6))
    follow[of_this] = np.eye(6)
    follow[of_rest] = (
        -scaled_inverse(information[np.ix_(of_rest, of_rest)])
        @ (information[np.ix_(of_rest, of_this)])
    )
    of_eye = follow.T @ information @ follow
    place, turned = (sigmas * noise.relative[fit.inliers]).T
    of_hand = noise.lever.at_most * float(turned.min()) ** 2
    made = np.zeros((6, 6))
    of_target = np.bincount(
        together.target[fit.inliers], of_hand / place**2, minlength=together.targets
    )
    for amount, first in zip(of_target, range(6 * together.eyes, len(x), 6), strict=True):
        # What the point on a target moves by at which noise of places and of turns is independent.
        R = rotation_from_vector(x[first + 3 : first + 6])
        lever = -R @ noise.lever.in_target
        moves = np.hstack([np.eye(3), -skew(lever) @ R]) @ follow[first : first + 6]
        made += 2.0 * amount * moves.T @ moves
    of_eyes = np.bincount(
        together.eye[fit.inliers], 1.0 + of_hand / turned**2, minlength=together.eyes
    )
    for amount, first in zip(of_eyes, range(0, 6 * together.eyes, 6), strict=True):
        turns = follow[first + 3 : first + 6]
        made += 2.0 * amount * turns.T @ turns
    slides = _made(of_eye[:3, :3], made[:3, :3])
    every = _made(of_eye, made)
    return [
        *(np.concatenate([v / np.linalg.norm(v), np.zeros(3)]) for v in slides),
        *_turns(every, len(every) - len(slides)),
    ]


def _made(information: FloatArray, made: FloatArray) -> list[FloatArray]:
    """Directions of which noise may have made a tenth, by which it biases them; most made first."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, axes = np.linalg.eigh(information * np.outer(scale, scale))
    root = scale[:, None] * axes / np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    share, directions = np.linalg.eigh(root.T @ made @ root)
    return [root @ directions[:, k] for k in range(len(share))[::-1] if share[k] > 0.1]


def _turns(directions: list[FloatArray], count: int) -> list[FloatArray]:
    """The turns (count, 6) that some directions have most of."""
    if count < 1:
        return []
    unit = np.array([v[3:] for v in directions]).T
    axes = np.linalg.svd(unit / max(float(np.linalg.norm(unit)), 1e-300))[0]
    return [np.concatenate([np.zeros(3), axes[:, k]]) for k in range(min(count, 3))]
