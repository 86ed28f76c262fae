"""Readings or positions that were rounded when they were written."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth, sensitivity
from suta_calib.trust.held_out import robust_level
from suta_calib.trust.patterns import readings_of
from suta_calib.trust.simulated_faults import arm_of, with_columns
from suta_calib.units import from_deg, text
from suta_calib.words import listed

# Steps that somebody who rounds would choose, rad; encoders divide a turn by powers of two.
STEPS: Final = tuple(unit * 10.0**k for k in (0, -1, -2, -3) for unit in (from_deg(1.0), 1.0))
# Residuals over what rounding alone would make of them: less, and the readings were exact.
LEAST, MOST = 0.5, 3.0


class Rounded(Pattern):
    """All values are multiples of one step, and the step alone makes such residuals."""

    name = "rounded"
    about = "Readings or positions were rounded when they were written."
    precedence = 20

    def matches(self, answer: Solution) -> Iterator[str]:
        """One for the joints, and one for the positions of each term."""
        problem = answer.problem
        levels = [
            robust_level(line.residual)
            for line in problem.linearise(answer.x, problem.assumed_sigmas())
            if line.view.block.unit == "m"
        ]
        if problem.arm is None or not levels:
            return
        for what, step, scatter in (*_of_joints(answer), *_of_positions(problem.terms)):
            if LEAST * scatter < levels[0] < MOST * scatter:
                yield (
                    f"{what} are in steps of {step}. This rounding moves the tip by "
                    f"{text(scatter, 'm', with_unit=True)} per axis; the residuals are "
                    f"{text(levels[0], 'm', with_unit=True)}. Write every digit."
                )

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Positions in whole millimetres."""
        position = data.poses.samples.position
        assert position is not None
        coarse = with_columns(data, position=np.round(position, 3))
        return SpoiltData(coarse, effect="are in steps of 1.000 mm")


def _of_joints(answer: Solution) -> Iterator[tuple[str, str, float]]:
    """The joints whose readings have steps, the largest step, and what steps do to the tip, m."""
    assert answer.problem.arm is not None
    for arm in answer.problem.arm.arms:
        terms = [term for term in answer.problem.terms if arm_of(term) is arm]
        if terms:
            yield from _of_chain(answer, arm, readings_of(terms, arm.own_joints), terms)


def _of_chain(
    answer: Solution, arm: ArmModel, q: FloatArray, terms: Sequence[Term]
) -> Iterator[tuple[str, str, float]]:
    turning = [joint.type != "prismatic" for joint in arm.readings if joint.name in arm.own_joints]
    steps = np.array([_step(c, STEPS) if t else 0.0 for c, t in zip(q.T, turning, strict=True)])
    if not steps.any():
        return
    names = [f"{joint}.offset" for joint in arm.own_joints]
    # Rows whose postures show how the tip depends on the joints.
    shown = np.vstack([term.poses.samples.q for term in terms])[:: math.ceil(len(q) / 200)]
    jacobian = sensitivity(arm, answer.values, names, shown).jacobian
    # Anywhere within a step is as likely; of one axis of three.
    variance = np.sum((jacobian * steps) ** 2, axis=(1, 2)) / 12.0 / 3.0
    coarse = listed([joint for joint, step in zip(arm.own_joints, steps, strict=True) if step])
    yield (
        f"The readings of {coarse}",
        f"{np.degrees(steps.max()):.3g} deg",
        math.sqrt(float(variance.mean())),
    )


def _of_positions(terms: Sequence[Term]) -> Iterator[tuple[str, str, float]]:
    """The same of the positions that were measured."""
    for term in terms:
        position = term.poses.samples.position
        if position is not None and (step := _step(position.reshape(-1), (0.1, 0.01, 1e-3, 1e-4))):
            what = f"The positions of {term.called}"
            yield what, text(step, "m", with_unit=True), step / math.sqrt(12.0)


def _step(readings: FloatArray, steps: Sequence[float]) -> float:
    """The largest of ``steps`` whose multiples all readings (n,) are; zero where there is none.

    Nor is there one to speak of where nothing moved, or hardly.
    """
    values = np.unique(readings)
    for step in sorted(steps, reverse=True):
        times = values / step
        # Part of a step that is no rounding of the digits that are left.
        if np.abs(times - np.round(times)).max() < 1e-3:
            return step if len(np.unique(np.round(times))) > 2 else 0.0
    return 0.0
