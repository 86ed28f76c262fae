"""An instrument's clock as an unknown: readings between rows, residuals, refusals, the estimate."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from moving_arm import MovingArm
from simulated import arm_named
from torso_robot import REFLECTOR, torso_robot

from suta_calib import (
    ArmModel,
    Gravity,
    HandEye,
    InputError,
    Samples,
    SolverOptions,
    Term,
    TimeOffset,
    TrackedPoint,
    solve,
)
from suta_calib.arrays import FloatArray
from suta_calib.errors import SutaCalibWarning
from suta_calib.measurements.motion import JointMotion
from suta_calib.solver import Ipopt
from suta_calib.solver.compiled_residual import TermErrors, term_residuals
from suta_calib.solver.problem import Problem

ONCE = SolverOptions(starts=1)
OFFSET = TimeOffset(bound=0.1)
CLOCK = "time_offset[default]"


def motion_in(time: Any, q: Any, origin: Any = None, turning: Any = (False, False)) -> JointMotion:
    q = np.asarray(q, dtype=float)
    joints = [f"j{k}" for k in range(q.shape[1])]
    samples = Samples.from_arrays(joints, q, time=time, origin=origin)
    motion = samples.in_motion(np.array(turning)).motion
    assert motion is not None
    return motion


def swing(time: Any, rate: float = 0.3) -> FloatArray:
    time = np.asarray(time, dtype=np.float64)
    return np.column_stack([np.sin(2 * np.pi * rate * time), np.cos(2 * np.pi * rate * time)])


# ── readings between the rows ────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("offset", [-0.1, -0.037, 0.0, 0.02, 0.1])
def test_readings_between_rows_are_those_of_the_motion(offset: float) -> None:
    time = 0.1 * np.arange(60)
    motion = motion_in(time, swing(time))
    rows = motion.recording.told(motion.moment, 0.1)
    assert rows.tolist() == [False, *[True] * 58, False]
    there = motion.take(np.flatnonzero(rows)).beyond(offset)
    exact = swing(time + offset)[rows]
    error = np.abs(swing(time)[rows] + there[0] - exact)
    assert error.max() < 2e-5
    # What it may be wrong by is known from the rows alone, and is not much more.
    told = motion.error[rows].mean()
    assert error.mean() < told < 2e-5
    rate = (swing(time + offset + 1e-6) - swing(time + offset - 1e-6))[rows] / 2e-6
    np.testing.assert_allclose(there[1], rate, atol=5e-3)


def test_a_slower_recording_says_that_it_knows_less() -> None:
    errors = []
    for step in (0.1, 0.2, 0.4):
        time = step * np.arange(60)
        errors.append(motion_in(time, swing(time)).error.mean())
    ratios = np.array(errors[1:]) / errors[:-1]
    np.testing.assert_allclose(ratios, 16.0, rtol=0.4)


def test_a_joint_that_turns_over_goes_on() -> None:
    time = 0.1 * np.arange(40)
    turns = np.column_stack([2.0 * time, np.sin(time)])
    wrapped = np.column_stack([(turns[:, 0] + np.pi) % (2 * np.pi) - np.pi, turns[:, 1]])
    motion = motion_in(time, wrapped, turning=np.array([True, False]))
    np.testing.assert_allclose(motion.beyond(0.03)[0][:-1, 0], 0.06, atol=1e-9)


def test_readings_are_not_taken_across_gaps_or_from_another_file() -> None:
    time = np.concatenate([0.1 * np.arange(20), 10 + 0.1 * np.arange(20)])
    files = [f"a.csv:{k}" for k in range(20)] + [f"a.csv:{k}" for k in range(20, 40)]
    two = [f"a.csv:{k}" for k in range(20)] + [f"b.csv:{k}" for k in range(20)]
    again = np.tile(0.1 * np.arange(20), 2)
    for times, origin in ((time, files), (again, two)):
        motion = motion_in(times, swing(times), origin)
        told = motion.recording.told(motion.moment, 0.1)
        assert np.flatnonzero(~told).tolist() == [0, 19, 20, 39]


def test_rows_of_one_moment_are_one_posture() -> None:
    time = np.repeat(0.1 * np.arange(30), 2)
    motion = motion_in(time, swing(time))
    once = motion_in(time[::2], swing(time[::2]))
    np.testing.assert_array_equal(motion.beyond(0.04)[0][::2], once.beyond(0.04)[0])


def refused(time: Any, q: Any) -> str:
    with pytest.raises(InputError) as problem:
        motion_in(time, q)
    return str(problem.value)


def test_times_that_cannot_be_used_are_told_in_words() -> None:
    time = 0.1 * np.arange(50)
    q = swing(time)
    for factor, unit in ((1e3, "ms"), (1e6, "µs"), (1e9, "ns")):
        said = refused(factor * time, q)
        assert f"they look like {unit}: divide by {factor:.0e}".replace("e+0", "e") in said
    back = time.copy()
    back[[20, 21]] = back[[21, 20]]
    assert "row 21, time: found a time of 2 s after 2.1 s" in refused(back, q)
    assert "sort the rows by time" in refused(back, q)
    twice = time.copy()
    twice[21] = twice[20]
    assert "row 21, time: found the time 2 s twice, with other readings" in refused(twice, q)
    assert "found an arm that does not move" in refused(time, np.tile(q[:1], (50, 1)))
    anywhere = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    assert "tell nothing of the motion between them" in refused(time, anywhere)
    assert "found 3 rows; expected at least 5 rows of a moving arm" in refused(time[:3], q[:3])
    assert "convert them to s" in refused(1e-5 * time, q)


# ── residuals at other times ─────────────────────────────────────────────────────────────────
@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return arm_named("suta")


@pytest.mark.parametrize("kind", [TrackedPoint, HandEye, Gravity])
@pytest.mark.parametrize("offset", [0.0, -0.02, 0.073])
def test_derivatives_by_the_offset_are_right(kind: type[Term], offset: float) -> None:
    moving = MovingArm(-0.02, rows=40)
    term = moving.term(kind, time_offset=OFFSET)
    problem = Problem([term], moving.arm.select("*.offset"))
    place = problem.names.index(CLOCK)
    x = problem.start()
    x[place], step = offset, 1e-6
    sigmas = problem.assumed_sigmas()
    by_offset = [
        np.asarray(line.pattern.by_own(line.by_own))[:, place - problem.arm_count].copy()
        for line in problem.linearise(x, sigmas)
    ]
    around = []
    for change in (step, -step):
        moved = x.copy()
        moved[place] += change
        around.append([line.residual.copy() for line in problem.linearise(moved, sigmas)])
    for derivative, later, earlier in zip(by_offset, *around, strict=True):
        np.testing.assert_allclose(
            derivative, ((later - earlier) / (2 * step)).reshape(-1), atol=1e-7
        )


def test_every_way_to_evaluate_a_term_takes_the_offset() -> None:
    moving = MovingArm(-0.02, rows=40)
    term = moving.term(time_offset=OFFSET)
    problem = Problem([term], moving.arm.select("*.offset"))
    x = problem.start()
    x[problem.names.index(CLOCK)] = 0.03
    values = problem.values(x)
    (line,) = problem.linearise(x, problem.assumed_sigmas())
    names = problem.names[: problem.arm_count]
    np.testing.assert_allclose(term_residuals(term, values)[0], line.residual, atol=1e-14)
    np.testing.assert_allclose(TermErrors(term, names)(values)[0], line.residual, atol=1e-14)
    some = term.take([3, 7, 20])
    np.testing.assert_allclose(
        term_residuals(some, values)[0], line.residual[[3, 7, 20]], atol=1e-14
    )


def test_noise_of_readings_moves_nothing_for_good() -> None:
    moving = MovingArm(-0.02, rows=40)
    term = moving.term(time_offset=OFFSET)
    problem = Problem([term], moving.arm.select("*.offset"))
    x, sigmas = problem.start(), problem.assumed_sigmas()
    x[-1] = 0.02
    (before,) = problem.linearise(x, sigmas)
    residual, by_own = before.residual.copy(), np.array(before.by_own)
    with problem.evaluation.table.shifted([np.full(term.poses.samples.q.shape, 0.01)]):
        (moved,) = problem.linearise(x, sigmas)
        assert np.abs(moved.residual - residual).max() > 1e-4
    (after,) = problem.linearise(x, sigmas)
    np.testing.assert_array_equal(after.residual, residual)
    np.testing.assert_array_equal(after.by_own, by_own)


def test_what_is_uncertain_between_rows_is_part_of_the_noise() -> None:
    spreads = []
    for step in (0.1, 0.5):
        moving = MovingArm(rows=60, step=step)
        offset = TimeOffset(bound=step)
        term = moving.term(time_offset=offset)
        problem = Problem([term], moving.arm.select("*.offset"))
        (line,) = problem.linearise(problem.start(), [1e-4])
        np.testing.assert_allclose(line.sigma, np.hypot(1e-4, line.known_sigma))
        spreads.append(line.known_sigma.mean())
    assert spreads[0] < 3e-6
    assert spreads[1] > 1e-5


# ── the estimate ─────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("kind", [TrackedPoint, HandEye, Gravity])
@pytest.mark.parametrize("late", [-0.02, 0.08])
def test_a_clock_that_is_off_is_found(kind: type[Term], late: float) -> None:
    moving = MovingArm(late)
    term = moving.term(kind, time_offset=OFFSET)
    solution = solve(Problem([term], moving.arm.select("*.offset")), ONCE)
    found = solution.estimates[CLOCK]
    assert found.std is not None
    assert solution.converged
    assert abs(found.value - late) < 1e-3
    assert abs(found.value - late) < 3.0 * found.std


def test_ipopt_with_exact_second_derivatives_agrees() -> None:
    moving = MovingArm(-0.02, rows=80)
    term = moving.term(time_offset=OFFSET)
    problem = Problem([term], moving.arm.select("*.offset"))
    found = [
        solve(problem, SolverOptions(starts=1, solver=solver))
        for solver in (Ipopt(), Ipopt(exact=True))
    ]
    np.testing.assert_allclose(found[0].x, found[1].x, atol=1e-9)


def test_the_spread_of_the_offset_is_its_standard_deviation() -> None:
    off = []
    for seed in range(40):
        moving = MovingArm(-0.02, rows=60, seed=seed)
        term = moving.term(time_offset=OFFSET)
        solution = solve(Problem([term], moving.arm.select("*.offset")), ONCE)
        found = solution.estimates[CLOCK]
        assert found.std is not None
        off.append((found.value + 0.02) / found.std)
    spread = float(np.sqrt(np.mean(np.square(off))))
    # Of forty numbers 0.78 to 1.24 in 19 of 20 cases.
    assert 0.75 < spread < 1.3


def test_a_prior_pulls_the_offset_to_zero() -> None:
    moving = MovingArm(-0.02, rows=60)
    term = moving.term(time_offset=TimeOffset(bound=0.1, prior=1e-6))
    solution = solve(Problem([term], moving.arm.select("*.offset")), ONCE)
    assert abs(solution.values[CLOCK]) < 1e-3


def test_rows_at_the_ends_are_left_out_once() -> None:
    moving = MovingArm(rows=40)
    term = moving.term(time_offset=OFFSET)
    assert len(term.poses) == 38
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        some = term.take(np.arange(5, 20))
        turned = term.poses.samples
        again = term.over_poses(term.poses.with_samples(replace(turned, q=-turned.q)))
    assert (len(some.poses), len(again.poses)) == (15, 38)
    assert [p.name for p in again.unknowns][-1] == CLOCK
    with pytest.warns(SutaCalibWarning, match="10 of 40 rows are nearer than 500 ms to a gap"):
        moving.term(time_offset=TimeOffset(bound=0.5))


def test_what_touches_has_no_clock_and_who_sees_needs_times(arm: ArmModel) -> None:
    moving = MovingArm(rows=40)
    with pytest.raises(InputError, match="found no time; expected when each row was taken, in s"):
        TrackedPoint.from_arrays(arm, moving.q, **moving.seen(), time_offset=OFFSET)
    with pytest.raises(InputError, match="no row that is not nearer than 5000 ms"):
        moving.term(time_offset=TimeOffset(bound=5.0))
    with pytest.raises(InputError, match="TimeOffset: bound: found -1"):
        TimeOffset(bound=-1)


def test_two_chains_that_one_instrument_sees_share_its_clock() -> None:
    robot, time, offset = torso_robot(), 0.1 * np.arange(120), TimeOffset(0.1)
    rng, terms = np.random.default_rng(3), []
    rate, phase = rng.uniform(0.4, 1.2, 14), rng.uniform(0, 6, 14)
    for first, arm in zip((0, 6), robot.chains.values(), strict=True):

        def readings(time: Any, arm: ArmModel = arm, first: int = first) -> FloatArray:
            mine = slice(first, first + len(arm.joints))
            return np.asarray(0.5 * np.sin(np.outer(time, rate[mine]) + phase[mine]))

        rotation, position = arm.forward(readings(time - 0.02))
        seen = position + rotation @ REFLECTOR + rng.normal(0, 1e-4, (120, 3))
        given: dict[str, Any] = {"time": time, "time_offset": offset, "target": "A"}
        terms.append(TrackedPoint.from_arrays(arm, readings(time), position=seen, **given))
    problem = Problem(terms, robot.select("*.offset"))
    assert [name for name in problem.names if name.startswith("time_offset")] == [CLOCK]
    found = solve(problem, ONCE).estimates[CLOCK]
    assert found.std is not None
    assert abs(found.value + 0.02) < min(1e-3, 3.5 * found.std)
