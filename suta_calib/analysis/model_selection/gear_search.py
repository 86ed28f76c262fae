"""The ratios of strain wave gears, by the ripple that they leave in the residuals.

The ripple of such a gear comes twice with each turn of its input: 2N times with a joint's turn. For
each joint and each ratio N from 20 to 200 the residuals are compared with cos 2Nq and sin 2Nq,
while all of the geometry may follow: a periodogram (Scargle 1982, doi:10.1086/160554). The best of
so many is lucky, so its chance is multiplied by their number. Only the whole numbers are looked at
that the readings tell apart from an offset.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray
from suta_calib.model.parameters import GEAR_RATIO, OFFSET, RIPPLE
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.linear_fit import LinearFit

RATIOS: Final = np.arange(20, 201)


@dataclass(frozen=True)
class FoundRatio:
    """A ripple in the residuals.

    Attributes:
        joint: whose gear.
        ratio: turns of its input with each turn of the joint.
        chance: p-value for all joints and ratios together.
        others: ratios that fit as well.
    """

    joint: str
    ratio: int
    chance: float
    others: tuple[int, ...]


def found_ratios(answer: CalibrationExamination) -> tuple[FoundRatio, ...]:
    """Ratios of gears that nobody stated, the most evident first; none of most arms."""
    joints, ratios = _joints(answer), list[FoundRatio]()
    fit = _geometry_follows(answer)
    columns = {joint: _columns(answer, joint) for joint in joints}
    while left := [joint for joint in joints if joint not in {f.joint for f in ratios}]:
        weighed = [_weigh(fit, joint, columns[joint], len(joints)) for joint in left]
        best = min(weighed, key=lambda ratio: ratio.chance)
        # Chance, for all joints and ratios together, below which the residuals show a ripple.
        if not best.chance < 0.01:
            break
        ratios.append(best)
        k = 2 * int(best.ratio - RATIOS[0])
        fit = fit.beside(columns[best.joint][:, k : k + 2])
    return tuple(ratios)


def _joints(answer: CalibrationExamination) -> list[str]:
    """Joints that turn, have readings of their own, and a gear of which nobody said the ratio."""
    arm = answer.solution.problem.arm
    if arm is None:
        return []
    given = answer.solution.values
    offered = {joint: arm.offered.get(f"{joint}.{GEAR_RATIO}") for joint in arm.joints}
    return [
        joint
        for joint, ratio in offered.items()
        if ratio is not None
        and not given.get(ratio.name, ratio.nominal)
        and f"{joint}.{OFFSET}" in arm.offsets
        and all(f"{joint}.{key}" in arm.offered for key in RIPPLE)
    ]


def _geometry_follows(answer: CalibrationExamination) -> LinearFit:
    """The fit with what was estimated, all of the geometry, and what belongs to terms."""
    problem, fitted = answer.problem, {*answer.solution.problem.parameters}
    arm = answer.solution.problem.arm
    assert arm is not None
    follows = [
        k
        for k, name in enumerate(problem.names)
        if k >= problem.arm_count or name in fitted or name in arm.geometric or name in arm.offsets
    ]
    return answer.everything.only(np.array(follows, dtype=np.intp))


def _columns(answer: CalibrationExamination, joint: str) -> FloatArray:
    """(m, 2R) how residuals change with cosine and sine of each ratio, in turn."""
    arm = answer.solution.problem.arm
    assert arm is not None
    mover = [*arm.offsets].index(f"{joint}.{OFFSET}")
    moved, q = answer.motion[:, :, mover, None], answer.q[:, arm.joints.index(joint)]

    def parts() -> Iterator[FloatArray]:
        # So many ratios at once that the velocities of thousands of rows fit into memory.
        for ratios in np.array_split(RATIOS, 10):
            phase = 2.0 * q[:, None] * ratios
            waves = np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(q), 1, -1)
            yield answer.by_motion(moved * waves)

    return np.hstack([*parts()])


def _weigh(fit: LinearFit, joint: str, columns: FloatArray, joints: int) -> FoundRatio:
    """The best ratio of a joint, and its chance."""
    left = fit.followed(columns).reshape(len(fit.residual), -1, 2)
    weighted = left * fit.weights[:, None, None]
    information = np.einsum("mri,mrj->rij", weighted, left)
    score = np.einsum("mri,m->ri", weighted, fit.settled)
    # A ripple that is the same at all readings is an offset, and tells nothing.
    least, most = np.moveaxis(np.linalg.eigvalsh(information), 1, 0)
    determined = least > 1e-3 * max(float(most.max()), 1e-300)
    gain = np.zeros(len(RATIOS))
    gain[determined] = np.einsum(
        "ri,rij,rj->r", score[determined], np.linalg.inv(information[determined]), score[determined]
    )
    k = int(np.argmax(gain))
    freedom = fit.rows - fit.spent - len(RIPPLE)
    if freedom < 1.0 or not determined[k]:
        return FoundRatio(joint, int(RATIOS[k]), 1.0, ())
    noise = max(fit.squares - gain[k], 1e-12 * fit.squares, 1e-300) / freedom
    # Squares, in units of the noise, by which a ratio may fit worse than the best and be the right
    # one: of one degree of freedom, once in twenty times.
    as_good = RATIOS[determined & (gain > gain[k] - 3.84 * noise)].tolist()
    # What is sold most: taken where they fit as well as the best.
    ratio = next(
        (usual for usual in (100, 50, 80, 120, 160, 30) if usual in as_good), int(RATIOS[k])
    )
    # Rows that share a touch err together: by squares and by the scatter from touch to touch.
    variance = fit.score_variance(left[:, k], fit.settled)
    by_touch = float(score[k] @ np.linalg.pinv(variance, hermitian=True) @ score[k])
    touches = max(fit.cluster_count - fit.spent, 1.0)
    chance = max(
        float(fdtrc(2, freedom, gain[k] / 2.0 / noise)), float(fdtrc(2, touches, by_touch / 2.0))
    )
    tried = joints * int(determined.sum())
    rivals = tuple(other for other in as_good if other != ratio)
    return FoundRatio(joint, ratio, min(1.0, tried * chance), rivals)
