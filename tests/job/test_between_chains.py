"""What two chains do to each other: tips that touch, hold one thing, or see one another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from suta_calib import (
    ArmModel,
    CalibrationJob,
    Contact,
    GivenPose,
    InputError,
    LoopClosure,
    Noise,
    Problem,
    Robot,
    SolverOptions,
    calibrate,
)
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.solver.solve import solve
from tests.support.cli_job import cli
from tests.support.torso_robot import built, torso_robot, torso_robot_urdf, tracked

FREE = ["geometric", "*.offset"]
# Pose of the right tip in the left one while both hold one thing, m.
HELD = rotation_from_vector([0.3, 2.0, -0.4]), np.array([0.1, 0.05, -0.2])


def between(robot: Robot) -> ArmModel:
    """The right hand from the left one."""
    return robot.chain(tip="right_hand", base="left_hand", name="between")


def postures(
    arm: ArmModel,
    truth: dict[str, float],
    position: FloatArray,
    rotation: FloatArray | None,
    rng: np.random.Generator,
    sigma: float = 0.0,
) -> FloatArray:
    """Readings (n, joints) at which the true arms are there, with noise of each coordinate, m."""
    kinematics, found = InverseKinematics(arm, truth), list[FloatArray]()
    n = len(position)
    for _ in range(8):
        tries = kinematics.random_readings(rng, n)
        turned = np.tile(np.eye(3), (n, 1, 1)) if rotation is None else rotation
        off = position + rng.normal(0, sigma, (n, 3)) if sigma else position
        if sigma:
            turned = turned @ rotation_from_vector(rng.normal(0, 5 * sigma, (n, 3)))
        matching = "position" if rotation is None else "pose"
        answer = kinematics.solve(Targets(off, turned, matching), tries, rng, starts=2)
        found += [*answer.q[answer.reached]]
    assert len(found) >= n
    return np.array(found[:n])


def touching(
    arm: ArmModel, truth: dict[str, float], n: int, rng: np.random.Generator, sigma: float = 2e-4
) -> Contact:
    """The two tips touch."""
    q = postures(arm, truth, np.zeros((n, 3)), None, rng, sigma)
    return Contact.from_arrays(arm, q, noise=Noise(2e-4))


def test_tips_that_touch_join_two_arms_that_were_measured_apart():
    """What each arm leaves open of the other is told by contacts, to what is stated."""
    rng, robot = np.random.default_rng(2), torso_robot()
    truth = built(robot, rng)
    arm = between(robot)
    terms = [
        *(tracked(robot.chains[name], truth, 50, rng) for name in ("left", "right")),
        touching(arm, truth, 60, rng),
    ]
    held = touching(arm, truth, 25, rng)
    result = calibrate(robot, terms, validation=[held], free=FREE)
    assert result.assessment.usable, str(result.assessment)
    # The tips touch where the readings were not fitted.
    _, apart = arm.forward(held.poses.samples.q, result.solution.values)
    assert np.sqrt(np.mean(apart**2)) < 4e-4
    _, before = arm.forward(held.poses.samples.q)
    assert np.sqrt(np.mean(before**2)) > 3e-3
    assert not [n for n in result.estimates if n.startswith("spot")]


def scatter(arm: ArmModel, truth: dict[str, float], make, names: list[str]) -> FloatArray:
    """Errors over their stated ± of some parameters, in seeded repetitions."""
    off = []
    for seed in range(6):
        term = make(np.random.default_rng(100 + seed))
        solution = solve(Problem([term], arm.select(*names)), SolverOptions(confirm=False))
        off += [
            (solution.estimates[n].value - truth[n]) / solution.estimates[n].std
            for n in names
            if solution.estimates[n].std
        ]
    return np.array(off)


def test_the_stated_error_of_contacts_and_loops_is_the_true_one():
    """Monte-Carlo: errors over ± scatter by one."""
    robot = torso_robot()
    arm = between(robot)
    names = ["left_2.offset", "left_4.offset", "right_2.offset", "right_4.offset", "right_5.z"]
    rng = np.random.default_rng(3)
    truth = {n: arm.parameters[n].nominal + 2e-3 * float(rng.standard_normal()) for n in names}
    sigma = 2e-4

    def contact(rng: np.random.Generator) -> Contact:
        q = postures(arm, truth, np.zeros((50, 3)), None, rng, sigma)
        return Contact.from_arrays(arm, q, noise=Noise(sigma, fixed=True))

    def loop(rng: np.random.Generator) -> LoopClosure:
        at, turned = np.tile(HELD[1], (50, 1)), np.tile(HELD[0], (50, 1, 1))
        q = postures(arm, truth, at, turned, rng, sigma)
        noise, angular = Noise(sigma, fixed=True), Noise(5 * sigma, fixed=True)
        return LoopClosure.from_arrays(arm, q, grip="bar", noise=noise, angular_noise=angular)

    for make in (contact, loop):
        off = scatter(arm, truth, make, names)
        assert len(off) == 30
        # Of 30 values the root mean square scatters by an eighth.
        assert 0.6 < np.sqrt(np.mean(off**2)) < 1.4, make.__name__


@pytest.mark.parametrize("given", [False, True])
def test_the_jacobian_of_tips_that_touch_is_that_of_central_differences(given: bool):
    robot, rng = torso_robot(), np.random.default_rng(4)
    arm = between(robot)
    truth = built(robot, rng)
    q = postures(arm, truth, np.array([[0.0, 0, 0.2], [0, 0.2, 0]]), None, rng)
    for term in (
        Contact.from_arrays(arm, q),
        Contact.from_arrays(arm, q, distance=0.2),
        Contact.from_arrays(arm, np.tile(q, (4, 1)), spot="S", surface="plane", distance=0.01),
        LoopClosure.from_arrays(arm, q, grip="G"),
    ):
        if given and term.own_parameters:
            pose = GivenPose(HELD[1], HELD[0], np.full(3, 1e-3), 1e-2)
            term = replace(term, given={term.places[0][0]: pose})
        problem = Problem([term], arm.select(*FREE))
        x = problem.start(truth)
        x = x + 1e-3 * rng.standard_normal(len(x))
        sigmas = problem.assumed_sigmas()
        _, gradient, _ = problem.evaluation.cost_gradient_hessian(x, sigmas)
        for k in range(len(x)):
            step = 1e-6 * np.eye(len(x))[k]
            ahead, behind = (problem.evaluation.cost(x + s, sigmas) for s in (step, -step))
            near = pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-5 * abs(gradient).max())
            assert gradient[k] == near, problem.names[k]


def test_what_cannot_be_a_contact_is_refused():
    robot = torso_robot()
    arm = between(robot)
    q = np.zeros((6, len(arm.joints)))
    with pytest.raises(InputError, match="mm apart"):
        Contact.from_arrays(arm, q).check_enough()
    with pytest.raises(InputError, match="0 for a touch"):
        Contact.from_arrays(arm, q, distance=-0.01)
    with pytest.raises(InputError, match="column spot"):
        Contact.from_arrays(arm, q, surface="plane")
    with pytest.raises(InputError, match="sphere or plane"):
        Contact.from_arrays(arm, q, surface="cube")
    with pytest.raises(InputError, match="spot A touched 1 times"):
        Contact.from_arrays(arm, q[:1], spot="A").check_enough()
    with pytest.raises(InputError, match="one posture"):
        LoopClosure.from_arrays(arm, q, grip="bar").check_enough()
    pose = {"A": GivenPose(np.zeros(3))}
    with pytest.raises(InputError, match="without an orientation"):
        Contact.from_arrays(arm, q, spot="A", surface="plane", given=pose)


HEAD = """\
arm:
  urdf: robot.urdf
  chains: {left: {tip: left_hand}, head: {tip: eye}, right: {tip: right_hand}}
seed: 3
errors: [{select: ['*.offset'], std_deg: 0.5}]
noise: {instrument_mm: 0.1, corner_px: 0.2}
sets:
  seen: {kind: camera_view, chain: left, base_chain: head, samples: 40, SEEN}
  held: {kind: camera_view, chain: left, base_chain: head, samples: 15, SEEN}
  eye: {kind: hand_eye, chain: head, base_chain: right, samples: 30,
        eye_in_tip: {position_mm: [20, 10, 30]}, target_in_base: {position_mm: [20, 10, -50]}}
"""
SEEN = (
    "setup: eye-to-hand, board: board.yaml, camera: camera.yaml, "
    "camera_pose: {position_mm: [20, 10, 30], rotation_rpy_deg: [-90, 0, -90]}, "
    "board_pose: {position_mm: [20, 10, -50], rotation_rpy_deg: [0, 90, 0]}"
)
SEES = """\
arm:
  urdf: robot.urdf
  chains: {left: {tip: left_hand}, head: {tip: eye}, right: {tip: right_hand}}
parameters:
  - {select: ['left_*.offset', 'right_*.offset', 'neck_*.offset'], prior_deg: 1}
observations:
  - {kind: camera_view, chain: left, base_chain: head, samples: seen/samples.csv, FILES/seen.csv}
  - {kind: hand_eye, label: second, chain: head, base_chain: right, samples: eye/samples.csv}
validation:
  - {kind: camera_view, chain: left, base_chain: head, samples: held/samples.csv, FILES/held.csv}
"""
FILES = "setup: eye-to-hand, board: board.yaml, camera: camera.yaml, corners: corners"


def test_a_camera_on_the_head_sees_a_board_in_the_hand(
    tmp_path: Path, repository: Path, recwarn: pytest.WarningsRecorder
):
    """The board is somewhere in the hand and the camera somewhere on the head."""
    for name in ("board.yaml", "camera.yaml"):
        (tmp_path / name).write_bytes((repository / "data" / "workcell" / name).read_bytes())
    (tmp_path / "robot.urdf").write_text(torso_robot_urdf(head=True))
    (tmp_path / "simulation.yaml").write_text(HEAD.replace("SEEN", SEEN))
    (tmp_path / "job.yaml").write_text(SEES.replace("FILES", FILES))
    assert cli("simulate", tmp_path / "simulation.yaml", "--out", tmp_path) == 0
    result = CalibrationJob.load(tmp_path / "job.yaml").run()
    # Nobody has moved the torso, and no chain here hangs on it: it is no dead joint.
    assert result.assessment.level == "good", str(result.assessment)
    after = result.metrics["validation"]["after"].rms
    assert after < 4e-4 < result.metrics["validation"]["before"].rms
    found = {pose.name: pose for pose in result.examined.external_poses}
    at = found["hand_eye[head]"].position, found["target[left]"].position
    # Each joint's zero beside the camera or the board turns with it: its place is told.
    for position, true, name in zip(
        at, ([0.02, 0.01, 0.03], [0.02, 0.01, -0.05]), found, strict=False
    ):
        assert np.abs(position - true).max() < 6e-3, name
    truth = yaml.safe_load((tmp_path / "truth.yaml").read_text())["parameters"]
    for name in ("left_3.offset", "left_4.offset", "right_3.offset", "neck_2.offset"):
        error = result.estimates[name].value - np.radians(truth[name]["value_deg"])
        assert abs(error) < 4 * result.estimates[name].std, name
    # It can be drawn.
    assert result.scene() is not None
