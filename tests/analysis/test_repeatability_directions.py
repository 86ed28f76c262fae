"""Directional force: a joint with play is named, noise names none, whatever the clearance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulated import arm_named
from visits import visits

from suta_calib.analysis.repeatability import DirectionalForce, repeatability
from suta_calib.analysis.repeatability.directions import directional_force
from suta_calib.arrays import FloatArray
from suta_calib.measurements import Samples
from suta_calib.units import Unit

PUSHES = ["left", "right", "back", "front"] * 12
JOINTS: list[tuple[str, Unit, float]] = [(f"joint_{k + 1}", "rad", 0.3) for k in range(6)]
# The seat's clearance moves all joints together, far more than an encoder's noise.
TOGETHER = 1e-3 * np.random.default_rng(99).standard_normal((6, 3))


def seated(seed: int) -> FloatArray:
    """Simulated deviations (48, 6), rad: clearance, and noise of every encoder."""
    rng = np.random.default_rng(seed)
    clearance = rng.standard_normal((48, 3)) @ TOGETHER.T
    return clearance + 2e-5 * rng.standard_normal((48, 6))


def pushed(
    values: FloatArray, seed: int = 0, protocol: list[str] | None = None
) -> DirectionalForce:
    position = 1e-4 * np.random.default_rng(seed + 10**6).standard_normal((len(values), 3))
    labels = None if protocol is None else np.array(protocol)
    return directional_force(JOINTS, values, position, np.array(PUSHES), labels, seed)


def giving(found: DirectionalForce) -> list[str]:
    return [each.joint for each in found.joints if each.has_backlash]


def with_play(values: FloatArray, joint: int, play: float) -> FloatArray:
    sign = {"left": 0.5, "right": -0.5}
    values = values.copy()
    values[:, joint] += play * np.array([sign.get(each, 0.0) for each in PUSHES])
    return values


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_with_play_is_named_and_measured(joint: int) -> None:
    found = pushed(with_play(seated(joint), joint, 8e-4))
    assert giving(found) == [f"joint_{joint + 1}"]
    assert found.loosest.backlash == pytest.approx(8e-4, rel=0.3)
    assert found.loosest.tip == pytest.approx(0.3 * found.loosest.backlash)
    assert found.loosest.backlash > 3 * found.loosest.by_chance


def test_two_joints_with_play_are_both_named() -> None:
    found = pushed(with_play(with_play(seated(1), 1, 8e-4), 4, 2e-3))
    assert giving(found) == ["joint_2", "joint_5"]
    assert found.loosest.joint == "joint_5"


def test_noise_alone_names_no_joint() -> None:
    named = sum(pushed(seated(seed), seed).loosest is not None for seed in range(12))
    assert named <= 1


@pytest.mark.slow
def test_noise_alone_names_no_joint_in_a_large_study() -> None:
    named = sum(pushed(seated(seed), seed).loosest is not None for seed in range(300))
    assert named <= 12


def test_what_differs_between_protocols_is_no_direction() -> None:
    values = seated(5)
    half = ["before"] * 24 + ["after"] * 24
    values[24:, 2] += 5e-3
    # Directions are spread unevenly over the protocols.
    order = np.argsort([*(k % 4 for k in range(24)), *((k + k // 8) % 4 for k in range(24))])
    found = pushed(values[order], protocol=[half[k] for k in order])
    assert found.loosest is None


def test_the_same_seed_gives_the_same_answer() -> None:
    values = with_play(seated(2), 3, 3e-4)
    assert pushed(values, 7).joints == pushed(values, 7).joints


def test_a_joint_that_never_moves_gives_nothing() -> None:
    values = seated(3)
    values[:, 0] = 0.0
    first = pushed(values).joints[0]
    assert (first.backlash, first.peak_to_peak, first.has_backlash) == (0.0, 0.0, False)


def test_play_in_the_arms_own_joint_is_named_through_its_kinematics() -> None:
    arm, samples = arm_named("suta"), visits(48, 0.05e-3, 4, tilt=math.radians(0.05))
    q = samples.q.copy()
    q[:, 2] += np.where(np.array(PUSHES) == "left", math.radians(0.1), 0.0)
    found = repeatability(arm, Samples.from_arrays(arm.joints, q, labels={"direction": PUSHES}))
    assert giving(found.directions) == ["joint_3"]
    assert found.directions.tip_p_value < 0.01
    joint_3 = found.directions.joints[2]
    assert math.degrees(joint_3.backlash) == pytest.approx(0.1, rel=0.3)
    # Its play is what the tip seems to shift by.
    assert joint_3.tip == pytest.approx(found.directions.tip_shift, rel=0.3)
    assert any("joint_3 has play or bends" in note for note in found.assessment.notes)
