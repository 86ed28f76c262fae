"""Joints that the readings of others move too, against Pinocchio and known truth.

On random trees `test_trees` holds couplings and their derivatives against Pinocchio's too.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, random_readings, tracked_scene
from simulation_scenes import EXACT, Folder
from two_arms import ROBOT

from suta_calib.errors import ParameterError
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.noise import full_circle
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import TrackedPoint

ARM = arm_named("suta")
NAME = "joint_3.coupling[joint_2]"
# The second motor drags the third joint back by as much as it turns, and a little less.
TRUTH = {NAME: -0.98}


def prepared(q: np.ndarray, ratio: float) -> np.ndarray:
    """Angles of the joints behind a parallelogram."""
    angles = q.copy()
    angles[:, 2] += ratio * q[:, 1]
    return angles


def test_an_arm_that_is_coupled_draws_itself_so() -> None:
    q = random_readings(ARM, np.random.default_rng(0), 6)
    drawn = [ARM.at(TRUTH).configuration(row) for row in q]
    straight = [ARM.configuration(row) for row in prepared(q, -0.98)]
    np.testing.assert_allclose(drawn, straight, atol=1e-15)


def test_the_tips_velocity_per_reading_counts_what_is_dragged() -> None:
    arm = ARM.at(TRUTH)
    assert arm.gearing[2, 1] == -0.98
    q = random_readings(arm, np.random.default_rng(2), 1)[0]
    _, _, by_offset = (np.array(each) for each in arm.function(arm.offsets)(np.zeros(6), q))
    by_reading = by_offset.T @ arm.gearing
    for k, step in enumerate(1e-6 * np.eye(6)):
        slope = (arm.forward(q + step)[1] - arm.forward(q - step)[1]) / 2e-6
        np.testing.assert_allclose(by_reading[:3, k], slope, atol=1e-8)
    # At nominal nothing is dragged, whatever was asked of the arm that has it.
    np.testing.assert_array_equal(ARM.gearing, np.eye(6))


def test_a_full_turn_leaves_the_arm_as_it_was_only_if_it_drags_full_turns() -> None:
    free = arm_named("kinova")
    turning = np.flatnonzero(full_circle(free))
    k, other = (free.joints[j] for j in turning[:2])
    name = f"{other}.coupling[{k}]"
    for ratio, same in ((-1.0, True), (0.5, False)):
        arm = free.at({name: ratio})
        assert full_circle(arm)[turning[0]] == same
        assert full_circle(arm)[turning[1]]
        q = random_readings(arm, np.random.default_rng(0), 3)
        turned = q.copy()
        turned[:, turning[0]] += 2 * np.pi
        assert np.allclose(arm.forward(q)[1], arm.forward(turned)[1], atol=1e-10) == same


def scene(seed: int) -> TrackedPoint:
    """A tip seen to 0.1 mm."""
    found = tracked_scene(ARM.at({NAME: -1.0}), TRUTH | {"joint_4.z": 0.5713}, 60)
    noise = np.random.default_rng(seed).normal(0, 1e-4, found.position.shape)
    seen = replace(found.exact().poses.samples, position=found.position + noise)
    return found.term(seen)


def test_it_errs_as_it_says() -> None:
    """Over twelve sets of noise, in units of the standard deviations (chi-squared, 12, 0.1 %)."""
    unknown = ARM.at({NAME: -1.0}).select("joint_*.offset", "joint_4.z", NAME)
    pulls = []
    for seed in range(12):
        problem = Problem([scene(seed)], unknown)
        estimate = solve(problem, SolverOptions(starts=1)).estimates[NAME]
        assert (estimate.unit, estimate.state) == ("1", "identified")
        pulls.append((estimate.value - TRUTH[NAME]) / (estimate.std or 0.0))
    assert 2.2 < np.sum(np.square(pulls)) < 32.9


def test_names_are_of_two_joints_that_move_alike() -> None:
    assert len(ARM.select("*.coupling*")) == 30
    assert ARM.select(NAME)[NAME].geometric is False
    assert NAME not in ARM.select("*")
    tiago = arm_named("tiago")
    slides, turns = tiago.joints[0], tiago.joints[3]
    assert not any(slides in each for each in tiago.couplings)
    for pattern in (f"{turns}.coupling[{slides}]", f"{slides}.coupling[{turns}]"):
        with pytest.raises(ParameterError, match=r"matches no parameter .*\.coupling\[joint\]"):
            tiago.select(pattern)


def test_a_mimic_is_dragged_by_all_but_its_master(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(ROBOT)
    arm = ArmModel.from_urdf(tmp_path / "robot.urdf", "f3", "left")
    for segment in arm.movers:
        assert arm.read_from[segment.owner] not in segment.others


def test_a_true_arm_that_is_coupled_reaches_what_it_touches(
    tmp_path: Path, suta_urdf: Path
) -> None:
    row = f'  - {{select: ["{NAME}"], value: -0.98}}\nsets:'
    made = Folder(tmp_path, suta_urdf).simulate(EXACT.replace("sets:", row))
    assert made.values[NAME] == -0.98
    (file,) = (f for f in made.files if f.path.startswith("fixed_point"))
    _, tip = made.arm.forward(file.samples.q, made.values)
    np.testing.assert_allclose(tip, np.tile([0.4, 0.0, 0.1], (len(tip), 1)), atol=1e-9)
