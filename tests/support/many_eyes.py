"""Several eyes on a hand, several targets beside it: poses with known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.terms.hand_eye_start import (
    EYE_TO_HAND,
    EyeSetup,
    Poses,
    after,
    inverse_poses,
    some_poses,
)
from suta_calib.terms.many_eyes_start import SeenTogether
from suta_calib.terms.synthetic import PoseNoise

EYES = np.array(["left", "right", "top", "back"])
TARGETS = np.array(["A", "B", "C"])
FINE = PoseNoise(3e-4, float(np.radians(0.1)))


@dataclass(frozen=True, eq=False)
class Scene:
    """What was measured, and what is true.

    Attributes:
        hand, seen: ``T_base_hand`` and ``T_eye_target`` of every row.
        together: which eye saw which target.
        X, Z: true poses of every eye and of every target.
        outliers: (n,) rows that are grossly wrong.
    """

    hand: Poses
    seen: Poses
    together: SeenTogether
    X: Poses
    Z: Poses
    outliers: BoolArray

    @property
    def eye(self) -> NDArray[np.str_]:
        return EYES[self.together.eye]

    @property
    def target(self) -> NDArray[np.str_]:
        return TARGETS[self.together.target]

    @property
    def numbers(self) -> FloatArray:
        """(n, 14) as the columns of a file of pairs."""
        from scipy.spatial.transform import Rotation

        parts = [
            part
            for R, p in (self.hand, self.seen)
            for part in (p, Rotation.from_matrix(R).as_quat())
        ]
        return np.hstack(parts)


def scene(
    eyes: int = 3,
    targets: int = 2,
    instants: int = 40,
    *,
    seed: int = 0,
    hand: PoseNoise = FINE,
    eye: PoseNoise | Sequence[PoseNoise] = FINE,
    gross: float = 0.0,
    setup: EyeSetup = "eye-in-hand",
    axes: FloatArray | None = None,
    sees: BoolArray | None = None,
    turn: float = 1.0,
) -> Scene:
    """At every instant each eye sees one of its targets; they share what is wrong with the hand.

    Args:
        eye: noise of what all eyes see, or of each.
        axes: (eyes, 3) about which the hand turns where an eye looks: each then has instants of
            its own.
        sees: (eyes, targets) which are ever seen; all by default.
    """
    random, noise, errors = np.random.default_rng(seed).spawn(3)
    X = random_rotations(random, eyes), random.normal(0.0, 0.06, (eyes, 3))
    Z = random_rotations(random, targets), random.normal(0.0, 0.4, (targets, 3))
    every = np.ones((eyes, targets), dtype=bool) if sees is None else sees
    instant = np.repeat(np.arange(instants), eyes)
    which = np.tile(np.arange(eyes), instants)
    seen_target = np.array([random.choice(np.flatnonzero(every[e])) for e in which])
    if axes is None:
        turns = random.uniform(-turn, turn, (instants, 3))[instant]
    else:
        instant = np.arange(len(which))
        turns = random.uniform(-turn, turn, (len(which), 1)) * axes[which]
    places = random.uniform(-0.3, 0.3, (instant.max() + 1, 3))[instant]
    A = rotation_from_vector(turns), places
    sight = inverse_poses(after(A, some_poses(X, which)))
    B = after(sight, some_poses(Z, seen_target))
    if isinstance(eye, PoseNoise):
        B = eye.scattered(noise, B)
    else:
        for k, of_one in enumerate(eye):
            rows = which == k
            B[0][rows], B[1][rows] = of_one.scattered(noise, some_poses(B, rows))
    _, first, again = np.unique(instant, return_index=True, return_inverse=True)
    measured = some_poses(hand.scattered(noise, some_poses(A, first)), again)
    outliers = errors.random(len(which)) < gross
    bad = np.flatnonzero(outliers)
    if len(bad):
        B[0][bad] = random_rotations(errors, len(bad))
        B[1][bad] += errors.normal(0.0, 0.2, (len(bad), 3))
    if setup == EYE_TO_HAND:
        measured = inverse_poses(measured)
    together = SeenTogether(which, seen_target, eyes, targets)
    return Scene(measured, B, together, X, Z, outliers)


def pose_errors(found: FloatArray, truth: Poses) -> FloatArray:
    """(k, 6) displacement, m, outer axes, and turn, rad, own axes, of poses (k, 4, 4)."""
    from suta_calib.geometry.numbers import vector_from_rotation

    turn = vector_from_rotation(np.swapaxes(truth[0], 1, 2) @ found[:, :3, :3])
    return np.hstack([found[:, :3, 3] - truth[1], turn])


def rows(data: Scene, chosen: IntArray | BoolArray) -> tuple[Poses, Poses]:
    return some_poses(data.hand, chosen), some_poses(data.seen, chosen)
