"""What the answers on loops ``A_i X B_i = Z`` share, of one eye and of several."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rms_length, tangent_of_poses
from suta_calib.measurements.scale import PPM, LengthScale
from suta_calib.pose_calibration.eye_poses import ENOUGH
from suta_calib.pose_calibration.robust_answer import RobustAnswer
from suta_calib.solver.covariance import observed_parts
from suta_calib.solver.problem import Problem
from suta_calib.terms.hand_eye_start import EyeSetup
from suta_calib.trust.hypotheses.depth_scale import DepthScale
from suta_calib.trust.hypothesis import Finding
from suta_calib.trust.uncertainty_budget import UncertaintyBudget, pose_budgets
from suta_calib.units import text


class DistanceTrend(NamedTuple):
    """Relative error of the distance to a target, and its standard deviation."""

    share: float
    std: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LoopAnswer(Displayable, RobustAnswer):
    """Poses of eyes and of targets; `solution` is in units of `length`.

    Residuals are ``A_i X B_i - Z`` in Z's outer frame.

    Attributes:
        setup: ``eye-in-hand`` or ``eye-to-hand``.
        rotation_residuals: (n, 3), the turn between ``A_i X B_i`` and Z, rad.
        axes: (n - 1, 3) rotation vectors of the hand's consecutive motions, rad.
        robot_noise_fraction: part of the rotational noise that seems to be the hand's, 0 to 1.
        copies: how many of the pairs that were fitted repeat another: no measurements.
        length: m per unit of `solution`.
        by_scale: (6, 6) or larger, part of the covariance for the scale of all seen lengths; None
            where nothing was added for it.
    """

    setup: EyeSetup
    rotation_residuals: FloatArray
    axes: FloatArray
    robot_noise_fraction: float
    copies: int
    length: float
    by_scale: FloatArray | None = None

    @property
    def budgets(self) -> tuple[UncertaintyBudget, ...]:
        """What the uncertainty of X is made of: its place, and its turn; of every X and Z by name.

        The poses are those of `covariance`, in its order.
        """
        added = np.zeros_like(self.covariance) if self.by_scale is None else self.by_scale
        return tuple(
            budget
            for k, name in enumerate(self.posed)
            for at in [slice(6 * k, 6 * k + 6)]
            for budget in pose_budgets(
                *(name, self.covariance[at, at], self.scatter),
                {"scale of what is seen": added[at, at]},
            )
        )

    @property
    def posed(self) -> tuple[str, ...]:
        """Poses that have a budget, by name."""
        return ("X",)

    @property
    def rms_angle(self) -> float:
        """Root mean square turn of the inliers' ``A_i X B_i`` against Z, rad."""
        return rms_length(self.rotation_residuals[self.inliers])

    @property
    def far_sight(self) -> Finding | None:
        """That the eyes see too far or too near; the covariance allows for it."""
        return self.finding(DepthScale.name)

    @property
    def trend(self) -> DistanceTrend:
        """By what share the eyes seem to see too far, supported or not."""
        evidence = self.evidence(DepthScale.name)
        if evidence is None:
            return DistanceTrend(0.0, 0.0)
        return DistanceTrend(float(evidence.size[0]), float(evidence.std[0]))

    @property
    def _std_without_far_sight(self) -> float:
        """Standard deviation of the first X's position but for `far_sight`, m, 3-D."""
        evidence = self.evidence(DepthScale.name)
        assert evidence is not None
        moves = self.length * evidence.moves[:3]
        by_it = (1.0 + 1.0 / evidence.significance**2) * float(moves @ moves)
        return math.sqrt(max(float(np.trace(self.covariance[:3, :3])) - by_it, 0.0))

    @property
    def _cautions_on_pairs(self) -> list[str]:
        """What must be known of the pairs, one sentence each."""
        caution = list[str]()
        count = int(self.inliers.sum()) - self.copies
        if self.copies:
            rows = "1 pair repeats" if self.copies == 1 else f"{self.copies} pairs repeat"
            caution.append(f"{rows} another exactly, hand and target. Measure new poses instead.")
        if count < ENOUGH:
            caution.append(
                f"Only {count} pairs: the standard deviations are uncertain, and a wrong pair may "
                "stay unnoticed. Take a dozen or more."
            )
        if self.far_sight:
            caution.append(
                f"{self.far_sight.sentence} Without it, ± would be "
                f"{text(self._std_without_far_sight, 'm')} mm, and a part of the pairs without "
                "this error gives the same."
            )
        if self.moved:
            caution.append(self.moved.sentence)
        return caution


A = TypeVar("A", bound=LoopAnswer)


def with_scale(answer: A, scale_ppm: float) -> A:
    """The same, with the effect of a scale error of all seen lengths in the covariance.

    A target of another size than its file says puts all that is seen nearer or farther. X follows,
    and where distances hardly differ no residual shows it. Where the residuals show that distances
    are off, the covariance allows for that already.

    Args:
        answer: from pairs of poses.
        scale_ppm: standard deviation of the factor on what was seen, against what the hand moved,
            1e-6.
    """
    if answer.far_sight or scale_ppm == 0.0:
        return answer
    solution, scale = answer.solution, LengthScale(scale_ppm * PPM)
    problem = Problem([replace(term, scale=scale) for term in solution.problem.terms])
    part = observed_parts(replace(solution.spread.fit, problem=problem)).of_scale
    size = len(answer.covariance)
    jacobian = tangent_of_poses(solution.x[:size], answer.length)
    by_scale = jacobian @ part @ jacobian.T
    return replace(answer, covariance=answer.covariance + by_scale, by_scale=by_scale)
