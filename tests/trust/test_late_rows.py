"""Readings a part of a row late on a moving arm are said first, whatever they look like."""

from __future__ import annotations

import numpy as np
import pytest
from judging import assessed, watched
from simulated import arm_named
from studies import first_of

from suta_calib import Problem, Selection, SolverOptions, Term, solve
from suta_calib.arrays import FloatArray

ROW = 0.1  # s from row to row


def notes(seed: int, late: float) -> tuple[str, ...]:
    """Of a calibration of an arm that swings while an instrument watches it.

    Args:
        seed: of the arm and its motion.
        late: by which readings were taken before what the instrument saw, s.
    """
    arm, rng = arm_named("ur5"), np.random.default_rng(seed)
    unknown = arm.select(
        Selection(("geometric",), prior_m=1e-3, prior_rad=2e-3),
        Selection(("*.offset",), prior_rad=1e-2),
    )
    truth = {p.name: p.nominal + (p.prior or 0.0) * rng.standard_normal() for p in unknown.values()}
    speed, width = rng.uniform(0.1, 0.6, 6), rng.uniform(0.5, 1.2, 6)
    phase, middle = rng.uniform(0.0, 6.28, 6), rng.uniform(-0.8, 0.8, 6)

    def readings(time: FloatArray) -> FloatArray:
        return np.asarray(middle + width * np.sin(np.outer(time, speed) + phase))

    def seen(time: FloatArray) -> Term:
        scatter = 1e-4 * rng.standard_normal((len(time), 3))
        return watched(arm, readings(time), truth, scatter, read=readings(time - late))

    times = ROW * np.arange(200)
    fitted, held_out = seen(times[:150]), seen(times[150:])
    solution = solve(Problem([fitted], unknown), SolverOptions(confirm=False))
    return assessed(solution, [held_out]).notes


# It passes for a moved reflector, for a creeping base, for a moved instrument, for a coupling.
@pytest.mark.parametrize(
    ("seed", "late"), first_of([(51, 0.05), (52, 0.02), (53, 0.05), (57, 0.05)], 2)
)
def test_what_looks_like_other_faults_is_said_first(seed: int, late: float) -> None:
    first, *_ = notes(seed, late)
    assert "The arm moved while the rows of tracked point were measured" in first
    assert "readings were taken before" in first
    assert "the key time_offset_ms: {bound: 100}" in first


def test_a_moving_arm_with_one_clock_is_told_nothing_of_time() -> None:
    assert "readings were taken" not in " ".join(notes(54, 0.0))
