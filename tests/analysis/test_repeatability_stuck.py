"""A joint whose encoder hangs, and one that was locked."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import arm_named
from visits import visits

from suta_calib.analysis.repeatability import Repeatability, repeatability
from suta_calib.arrays import FloatArray
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel

TILT = np.radians(1.0)


def run(arm: ArmModel, q: FloatArray) -> Repeatability:
    return repeatability(arm, Samples.from_arrays(arm.joints, q))


@pytest.mark.parametrize("joint", range(5))
@pytest.mark.parametrize("n", [30, 120])
@pytest.mark.parametrize("seed", range(2))
def test_an_encoder_that_hangs_is_named(joint: int, n: int, seed: int) -> None:
    arm, q = arm_named("suta"), visits(n, 3e-4, seed, tilt=TILT).q.copy()
    sound = run(arm, q)
    q[:, joint] = q[0, joint] + 1e-6 * np.random.default_rng(seed).integers(-1, 2, n)
    found = run(arm, q)
    (named,) = found.stuck
    assert named.joint == arm.joints[joint]
    # What scatters along the joint's own way is lost with it.
    truth = sound.position.rms.value
    assert 0.6 * truth < named.without < 1.05 * truth
    assert named.scatter == pytest.approx(found.position.rms.value)
    assert found.assessment.level == "care"
    assert any(note.startswith(f"{named.joint} reads ") for note in found.assessment.notes)


def test_what_is_not_named_does_no_harm() -> None:
    """In this posture the last joint hardly moves the tip; and where the arm hardly turns, none."""
    arm = arm_named("suta")
    for seed in range(4):
        for joint, tilt in ((5, TILT), *((k, np.radians(0.2)) for k in range(6))):
            q = visits(30, 3e-4, seed, tilt=tilt).q.copy()
            truth = run(arm, q).position.rms.value
            q[:, joint] = q[0, joint]
            found = run(arm, q)
            assert found.stuck or found.position.rms.value < 1.4 * truth


@pytest.mark.parametrize("seed", range(2))
def test_an_encoder_that_knows_few_places_is_named(seed: int) -> None:
    arm, q = arm_named("suta"), visits(30, 3e-4, seed, tilt=TILT).q.copy()
    q[:, 3] = 0.02 * np.round(q[:, 3] / 0.02)
    (named,) = run(arm, q).stuck
    assert named.joint == "joint_4"
    assert f"only {named.readings} values" in named.sentence


def locked(arm: ArmModel, joint: int, n: int, seed: int, by: float, size: FloatArray) -> FloatArray:
    """Readings of visits that scatter by ``size`` along each axis, with one joint that is still."""
    random, step = np.random.default_rng(seed), 1e-6
    posture = {
        "suta": [0.28, 2.45, 2.74, 2.15, 1.63, 2.64],
        "ur5": [0.3, -1.2, 1.4, -1.6, -1.4, 0.5],
    }
    q = np.tile(posture["ur5" if "elbow_joint" in arm.joints else "suta"], (n, 1))
    target = arm.forward(q)[1] + size * random.standard_normal((n, 3))
    free = [k for k in range(6) if k != joint]
    q[:, free] += by * random.standard_normal((n, 5))
    for _ in range(20):
        here = arm.forward(q)[1]
        columns = [(arm.forward(q + step * np.eye(6)[k])[1] - here) / step for k in free]
        off = target - here
        for row, jacobian in enumerate(np.stack(columns, axis=2)):
            q[row, free] += np.linalg.lstsq(jacobian, off[row], rcond=None)[0]
    assert np.abs(off).max() < 1e-8
    return q


@pytest.mark.parametrize("name", ["suta", "ur5"])
@pytest.mark.parametrize("n", [8, 15, 30, 120])
def test_a_joint_that_was_locked_is_left_alone(name: str, n: int) -> None:
    arm = arm_named(name)
    for seed in range(12 if n < 100 else 4):
        for by, size in ((0.01, np.full(3, 3e-4)), (0.1, np.array([3e-4, 6e-5, 3e-5]))):
            assert not run(arm, locked(arm, seed % 5, n, seed, by, size)).stuck
