"""Simulated measurements over poses, with known truth: what every `simulate` is made of.

The scene, its noise and its gross errors come from separate random numbers: the same seed with more
noise, or with outliers, is the same scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.terms.external_frame import point_named, pose_named
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.term import Term

# How a row is grossly wrong: its pose is anything; it is displaced, as where a tip slipped off its
# point; it is another row's, as where two streams are out of step.
OutlierKind = Literal["wrong", "slipped", "swapped"]
# Shortest and longest slip, m: far outside the noise of a tracker, and small enough to be missed.
SLIP: Final = (5e-3, 30e-3)
SimulatedTerm = TypeVar("SimulatedTerm", bound=Term)


@dataclass(frozen=True)
class PoseNoise:
    """How measured poses scatter: standard deviations per axis, normal.

    Attributes:
        position: m.
        rotation: of a turn about the body's own origin, in its own axes, rad.
    """

    position: float = 0.0
    rotation: float = 0.0

    def scattered(self, random: np.random.Generator, poses: Poses) -> Poses:
        """Noisy copies of poses (n, 3, 3), (n, 3)."""
        R, p = poses
        turn = rotation_from_vector(self.rotation * random.standard_normal(p.shape))
        return R @ turn, p + self.position * random.standard_normal(p.shape)


@dataclass(frozen=True)
class OutlierModel(Displayable):
    """Gross errors.

    Attributes:
        share: of the rows, 0 to 1; rounded to whole rows.
        nature: ``wrong``: orientation and place uniform over all there are; ``slipped``: displaced
            by 5 to 30 mm in any direction; ``swapped``: the measurement of another row.

    Raises:
        SamplesError: a share that is none.
    """

    share: float = 0.0
    nature: OutlierKind = "wrong"

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise SamplesError(f"{self.share}", "a share from 0 to 1", where="share")

    def rows(self, random: np.random.Generator, count: int) -> tuple[int, ...]:
        """Which of ``count`` rows are grossly wrong, in order."""
        rows = np.sort(random.permutation(count)[: round(self.share * count)])
        if self.nature == "swapped" and len(rows) == 1:
            raise SamplesError(
                f"one row of {count} to swap", "a share that makes two rows at least", where="share"
            )
        return tuple(int(row) for row in rows)


EXACT: Final = PoseNoise()
NO_OUTLIERS: Final = OutlierModel()


@dataclass(frozen=True, eq=False)
class Simulated(Displayable, Generic[SimulatedTerm]):
    """Measurements that were simulated, and what is true.

    Attributes:
        term: over the measured poses.
        truth: values of the term's own parameters by name, m and rad.
        outliers: rows that are grossly wrong, from 0.
    """

    term: SimulatedTerm
    truth: dict[str, float]
    outliers: tuple[int, ...]

    @property
    def poses(self) -> Poses:
        """Measured ``T_base_tool``: rotations (n, 3, 3) and positions (n, 3), m."""
        return self.term.poses.at(self.truth)

    @property
    def seen(self) -> Poses:
        """What was seen beside them: rotations (n, 3, 3), positions (n, 3); upright at 0 if not."""
        samples, n = self.term.poses.samples, len(self.term.poses)
        R = np.tile(np.eye(3), (n, 1, 1)) if samples.rotation is None else samples.rotation
        return R, np.zeros((n, 3)) if samples.position is None else samples.position

    @property
    def inliers(self) -> IntArray:
        """Rows that are not grossly wrong, from 0, in order."""
        return np.setdiff1d(np.arange(len(self.term.poses)), self.outliers)

    def true_point(self, prefix: str) -> FloatArray:
        """The true position (3,), m, of the own parameters ``prefix.x|y|z``."""
        return point_named(self.truth, prefix)

    def true_pose(self, prefix: str) -> Poses:
        """The true rotation (3, 3) and position (3,), m, of ``prefix.x … prefix.rz``."""
        return pose_named(self.truth, prefix)


def named(term: Term, truths: Sequence[FloatArray]) -> dict[str, float]:
    """True values by name, given in the order of the term's own parameters."""
    names = (parameter.name for parameter in term.own_parameters)
    return {name: float(v) for name, v in zip(names, np.concatenate(truths), strict=True)}


def random_directions(random: np.random.Generator, count: int) -> FloatArray:
    """Unit vectors (count, 3), uniform over the sphere."""
    vectors = random.standard_normal((count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def random_turns(
    random: np.random.Generator, count: int, largest: float, axes: ArrayLike | None = None
) -> FloatArray:
    """Orientations (count, 3, 3) of a body: somehow, then turned about its own axes.

    Turns are uniform up to ``largest``, rad, about any axis, or about those of ``axes`` (k, 3).
    """
    first = random_rotations(random, 1)[0]
    if axes is None:
        about = random_directions(random, count)
    else:
        given = np.atleast_2d(np.asarray(axes, dtype=float))
        given = given / np.linalg.norm(given, axis=1, keepdims=True)
        about = given[random.integers(len(given), size=count)]
    turn = random.uniform(-largest, largest, (count, 1))
    return np.asarray(first @ rotation_from_vector(about * turn))


def contaminated(
    random: np.random.Generator, poses: Poses, gross: OutlierModel, *, swap_orientation: bool = True
) -> tuple[Poses, tuple[int, ...]]:
    """Copies of poses (n, 3, 3), (n, 3) of which some are grossly wrong, and which.

    Rows that are swapped take the other's orientation too, unless told not to.
    """
    R, p = poses[0].copy(), poses[1].copy()
    outliers = gross.rows(random, len(p))
    rows = np.array(outliers, dtype=np.intp)
    if gross.nature == "slipped":
        p[rows] += random_directions(random, len(rows)) * random.uniform(*SLIP, (len(rows), 1))
    elif gross.nature == "swapped":
        other = np.roll(rows, 1)
        p[rows] = poses[1][other]
        R[rows] = poses[0][other] if swap_orientation else R[rows]
    elif len(rows):
        R[rows] = random_rotations(random, len(rows))
        p[rows] = random.uniform(p.min(axis=0), p.max(axis=0), (len(rows), 3))
    return (R, p), outliers
