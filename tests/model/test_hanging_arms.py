"""Arms that hang on joints of other chains: how they are held bends what is shared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from torso_robot import torso_robot, torso_robot_urdf

from suta_calib import CalibrationJob, Robot, calibrate
from suta_calib.errors import SamplesError
from suta_calib.model.parameters import Selection
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import TrackedPoint
from suta_calib.trust.explanation import explain

ROBOT = torso_robot()
ONCE = SolverOptions(starts=1)
FULL = pin.buildModelFromXML(torso_robot_urdf())


def torques(q: np.ndarray) -> np.ndarray:
    """Of gravity about every joint of the whole robot, (n, joints) N·m, by Pinocchio."""
    data, found = FULL.createData(), np.empty_like(q)
    places = [FULL.joints[FULL.getJointId(name)].idx_v for name in ROBOT.joints]
    for row, readings in zip(found, q, strict=True):
        full = np.zeros(FULL.nv)
        full[places] = readings
        row[:] = -pin.computeGeneralizedGravity(FULL, data, full)[places]
    return found


@pytest.mark.parametrize("name", ["left", "right"])
def test_a_shared_joint_yields_to_the_weight_of_both_arms(name: str) -> None:
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (6, len(ROBOT.joints)))
    arm, torque = ROBOT.laid_out[name], torques(q)
    yielding = {f"{joint}.compliance": 1e-3 * (k + 1) for k, joint in enumerate(arm.own_joints)}
    moved = q.copy()
    for k, joint in enumerate(arm.joints):
        moved[:, k] += yielding.get(f"{joint}.compliance", 0.0) * torque[:, k]
    for there, here in zip(arm.forward(q, yielding), arm.forward(moved), strict=True):
        np.testing.assert_allclose(there, here, atol=1e-12)
    # The other arm's readings alone move this hand, by centimetres here.
    other = q.copy()
    other[:, [arm.joints.index(j) for j in set(arm.joints) - set(arm.own_joints)]] *= -1
    apart = arm.forward(q, yielding)[1] - arm.forward(other, yielding)[1]
    assert np.linalg.norm(apart, axis=1).max() > 1e-3
    np.testing.assert_array_equal(arm.forward(q)[1], arm.forward(other)[1])


def test_two_hands_on_one_wrist_are_weighed_once() -> None:
    """A third chain whose arm is that of another, up to the wrist."""
    text = torso_robot_urdf().replace(
        '<link name="right_hand">',
        '<joint name="thumb" type="revolute"><parent link="right_link_6"/><child link="thumb"/>'
        '<origin xyz="0 0.1 0"/><axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="1" '
        'velocity="1"/></joint><link name="thumb"><inertial><origin xyz="0 0 -0.1"/>'
        '<mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
        '</link><link name="right_hand">',
    )
    ends = {"left": ("left_hand", None), "right": ("right_hand", None), "thumb": ("thumb", None)}
    robot, model = Robot.from_urdf(text, ends), pin.buildModelFromXML(text)
    q = np.random.default_rng(1).uniform(-1, 1, len(robot.joints))
    full = np.zeros(model.nv)
    for joint, reading in zip(robot.joints, q, strict=True):
        full[model.joints[model.getJointId(joint)].idx_v] = reading
    torque = -pin.computeGeneralizedGravity(model, model.createData(), full)
    for arm in robot.laid_out.values():
        moved = q.copy()
        moved[1] += 1e-3 * torque[model.joints[model.getJointId("torso_2")].idx_v]
        there = arm.forward(q, {"torso_2.compliance": 1e-3})[1]
        np.testing.assert_allclose(there, arm.forward(moved)[1], atol=1e-12)


BENT = {"torso_1.compliance_x": 1e-4, "torso_2.compliance": 2e-4, "left_2.compliance_y": 1e-3}
JOB = """
arm: {urdf: robot.urdf, chains: {left: {tip: left_hand}, right: {tip: right_hand}}}
parameters:
  - {select: "*.offset", prior_deg: 1}
  - {select: [torso_1.compliance_x, torso_2.compliance, left_2.compliance_y], bound_deg_per_nm: 0.2}
observations:
  - {kind: tracked_point, chain: left, samples: left.csv}
  - {kind: tracked_point, chain: right, samples: right.csv}
"""


def written(folder: Path, joints: dict[str, tuple[str, ...]]) -> Path:
    """A job over postures of both arms at once, with the columns of these joints."""
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.5, 1.5, (60, len(ROBOT.joints)))
    for name, arm in ROBOT.laid_out.items():
        position = arm.forward(q, BENT)[1] + rng.normal(0, 1e-4, (60, 3))
        own = q[:, [arm.joints.index(joint) for joint in joints[name]]]
        np.savetxt(
            folder / f"{name}.csv",
            np.hstack([own, position]),
            delimiter=",",
            header=",".join([*joints[name], "x", "y", "z"]),
            comments="",
        )
    (folder / "robot.urdf").write_text(torso_robot_urdf())
    (folder / "calibration.yaml").write_text(JOB)
    return folder / "calibration.yaml"


@pytest.mark.parametrize("both", [True, False])
def test_a_job_takes_the_readings_of_the_other_arm_where_its_samples_have_them(
    tmp_path: Path, both: bool
) -> None:
    columns = {name: ROBOT.joints if both else arm.joints for name, arm in ROBOT.chains.items()}
    result = CalibrationJob.load(written(tmp_path, columns)).run()
    rms = result.metrics["calibration"]["after"].rms
    assert (rms < 2.5e-4) == both
    if both:
        for name, value in BENT.items():
            estimate = result.estimates[name]
            assert abs(estimate.value - value) < 4 * (estimate.std or 0)


def test_readings_of_the_other_arm_are_checked(tmp_path: Path) -> None:
    columns = dict.fromkeys(ROBOT.chains, ROBOT.joints)
    job = written(tmp_path, columns)
    rows = (tmp_path / "left.csv").read_text().splitlines()
    cells = rows[1].split(",")
    cells[ROBOT.joints.index("right_1")] = "90"
    (tmp_path / "left.csv").write_text("\n".join([rows[0], ",".join(cells), *rows[2:]]) + "\n")
    with pytest.raises(SamplesError, match=r"left\.csv:2: column 'right_1': found 90"):
        CalibrationJob.load(job)


def test_a_zero_that_the_other_arm_is_held_at_counts() -> None:
    q = np.random.default_rng(3).uniform(-1, 1, (3, len(ROBOT.joints)))
    moved = q.copy()
    moved[:, ROBOT.joints.index("right_2")] += 0.3
    yielding = {"torso_2.compliance": 1e-3}
    turned = ROBOT.at({"right_2.offset": 0.3}).laid_out["left"]
    np.testing.assert_allclose(
        turned.forward(q, yielding)[1],
        ROBOT.laid_out["left"].forward(moved, yielding)[1],
        atol=1e-12,
    )


def test_arrays_with_the_readings_of_both_arms() -> None:
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.5, 1.5, (40, len(ROBOT.joints)))
    terms = [
        TrackedPoint.from_arrays(arm, q, position=arm.forward(q, BENT)[1])
        for arm in ROBOT.laid_out.values()
    ]
    result = calibrate(ROBOT, terms, free=["*.offset", *BENT])
    assert result.metrics["calibration"]["after"].rms < 1e-4


def test_what_is_held_of_a_shared_joint_is_explained() -> None:
    problem = Problem(
        hands(0, BENT, 40, 1e-4), ROBOT.select("*.offset", *BENT, "torso_1.compliance")
    )
    found = solve(problem, ONCE)
    told = {e.fixed: e for e in explain(problem, found.x, found.identification)}
    assert not any(e.failed for e in told.values())
    assert "gravity has no torque about its axis" in told["torso_1.compliance"].sentence


UNKNOWN = (
    Selection("geometric", prior_m=1e-3, prior_rad=8e-3, fixed=True),
    Selection("*.offset", prior_rad=8e-3, fixed=True),
    Selection("*.compliance*", prior_rad_per_nm=3e-4, fixed=True),
)


def drawn(seed: int) -> dict[str, float]:
    """True values, as wide as the priors say."""
    rng, names = np.random.default_rng(seed), ROBOT.select(*UNKNOWN)
    return {n: p.nominal + float(rng.normal(0, p.prior or 0)) for n, p in names.items()}


def hands(seed: int, truth: dict[str, float], n: int, sigma: float) -> list[TrackedPoint]:
    """Both hands, seen in the same postures."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (n, len(ROBOT.joints)))
    return [
        TrackedPoint.from_arrays(
            arm, q, position=arm.forward(q, truth)[1] + rng.normal(0, sigma, (n, 3))
        )
        for arm in ROBOT.laid_out.values()
    ]


@pytest.mark.parametrize(
    ("seeds", "low", "high"), [(2, 0.6, 1.5), pytest.param(40, 0.9, 1.1, marks=pytest.mark.slow)]
)
def test_hands_err_as_is_stated(seeds: int, low: float, high: float) -> None:
    """In postures that were not fitted, and each compliance, in units of what is stated."""
    off, expected, pulls = [], [], []
    for seed in range(seeds):
        truth = drawn(seed)
        unknown = ROBOT.select(*UNKNOWN)
        found = solve(Problem(hands(seed, truth, 60, 3e-4), unknown), ONCE)
        assert found.converged
        probe = Problem(hands(seed + 1000, truth, 10, 0.0), unknown)
        x = np.array([found.values[name] for name in probe.names])
        order = [[*found.estimates].index(name) for name in probe.names]
        covariance = found.covariance[np.ix_(order, order)]
        for line in probe.linearise(x, probe.assumed_sigmas()):
            arm, own = probe.evaluation.columns(line, line.by_pose, line.by_own)
            jacobian = np.hstack([arm, own if isinstance(own, np.ndarray) else own.toarray()])
            off.append(np.mean(line.residual**2))
            expected.append(np.mean(np.einsum("ip,pq,iq->i", jacobian, covariance, jacobian)))
        pulls += [
            (found.values[n] - truth[n]) / e.std
            for n, e in found.estimates.items()
            if "compliance" in n and e.std
        ]
    assert low < np.sqrt(np.mean(off) / np.mean(expected)) < high
    assert low < np.sqrt(np.mean(np.square(pulls))) < high
