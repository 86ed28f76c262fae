"""Two robots in one cell, each with a URDF of its own: one job, and the pose between them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from suta_calib import (
    ArmModel,
    CalibrationJob,
    Contact,
    InputError,
    Noise,
    Problem,
    Robot,
    SolverOptions,
    calibrate,
)
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector
from suta_calib.model.parameters import PLACEMENT
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.held_geometry import drawing_covariance
from suta_calib.solver.robot_bases import with_bases_found
from suta_calib.solver.solve import solve
from tests.support.cli_job import answer, cli
from tests.support.palletizer import palletizer, palletizer_urdf
from tests.support.simulated import SUTA_URDF
from tests.support.studies import of_size

# Where the base of robot b stands in that of robot a.
STANDS = rotation_from_vector([0.1, -0.2, 2.5]), np.array([0.7, 0.1, 0.05])
BASE = tuple(f"robot[b].{key}" for key in PLACEMENT)
TWO = {"a": SUTA_URDF, "b": SUTA_URDF}
SUTA = SUTA_URDF, "tip"
# What a contact between the two tells of each.
TOLD = tuple(f"{robot}/joint_{k}.offset" for robot in "ab" for k in (2, 3, 4, 5))


def cell(*, given: bool = False) -> tuple[Robot, ArmModel]:
    """The two, and the chain from the tip of a to that of b."""
    robot = Robot.of_cell(TWO, poses={"b": STANDS} if given else None)
    return robot, robot.chain(tip="b/tip", base="a/tip", name="between")


def touches(n: int, rng: np.random.Generator, truth: dict[str, float], sigma: float) -> FloatArray:
    """Readings (n, joints) at which the tips touch."""
    kinematics, found = InverseKinematics(cell(given=True)[1], truth), list[FloatArray]()
    while len(found) < n:
        start = kinematics.random_readings(rng, n)
        apart = Targets(rng.normal(0, sigma, (n, 3)), np.tile(np.eye(3), (n, 1, 1)), "position")
        reached = kinematics.solve(apart, start, rng, starts=1)
        found += [*reached.q[reached.reached]]
    return np.array(found[:n])


def off(rng: np.random.Generator) -> dict[str, float]:
    return {name: 5e-3 * float(rng.standard_normal()) for name in TOLD}


def test_two_robots_that_touch_tell_where_they_stand():
    """Nobody says where the base of b stands: half a turn and a metre away it is found."""
    rng, (robot, arm) = np.random.default_rng(0), cell()
    truth = off(rng)
    q = touches(65, rng, truth, 2e-4)
    terms = [Contact.from_arrays(arm, part) for part in (q[:45], q[45:])]
    assert robot.unplaced == BASE
    result = calibrate(robot, terms[:1], validation=terms[1:], free=TOLD)
    assert result.assessment.usable, str(result.assessment)
    assert result.metrics["validation"]["after"].rms < 5e-4
    errors = [(result.estimates[n].value - truth[n]) / result.estimates[n].std for n in TOLD]
    assert np.abs(errors).max() < 4
    (stands,) = result.examined.external_poses
    assert (stands.name, stands.words) == ("robot[b]", "robot in base")
    assert np.abs((stands.position - STANDS[1]) / stands.std[:3]).max() < 4
    assert stands.std[:3].max() < 3e-4
    turn = rotation_from_vector(np.zeros(3)) if stands.rotation is None else stands.rotation
    np.testing.assert_allclose(turn, STANDS[0], atol=2e-3)


@pytest.mark.parametrize("seeds", of_size(5, 12))
def test_the_stated_error_of_a_base_is_the_true_one(seeds: int):
    """Monte-Carlo: errors over ± scatter by one."""
    _, arm = cell(given=True)
    _, unknown = cell()
    scatter = []
    for seed in range(seeds):
        q = touches(50, np.random.default_rng(seed), {}, 2e-4)
        term = Contact.from_arrays(unknown, q, noise=Noise(2e-4, fixed=True))
        found = with_bases_found([term], unknown.select(*BASE))
        solution = solve(Problem([term], found), SolverOptions(confirm=False))
        scatter += [
            (solution.values[n] - STANDS[1][k]) / solution.estimates[n].std
            for k, n in enumerate(BASE[:3])
        ]
    # Of 36 values the root mean square scatters by an eighth.
    assert 0.65 < np.sqrt(np.mean(np.square(scatter))) < 1.4
    assert arm.parameters[BASE[0]].nominal == pytest.approx(0.7)


def test_the_gradient_is_that_of_central_differences():
    rng, (robot, arm) = np.random.default_rng(3), cell(given=True)
    term = Contact.from_arrays(arm, touches(6, rng, {}, 1e-3))
    problem = Problem([term], robot.select(*BASE, *TOLD, "b/joint_2.z"))
    x = problem.start() + 1e-3 * rng.standard_normal(len(problem.names))
    sigmas = problem.assumed_sigmas()
    _, gradient, _ = problem.evaluation.cost_gradient_hessian(x, sigmas)
    for k, name in enumerate(problem.names):
        step = 1e-6 * np.eye(len(x))[k]
        ahead, behind = (problem.evaluation.cost(x + s, sigmas) for s in (step, -step))
        near = pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-6 * abs(gradient).max())
        assert gradient[k] == near, name


def test_each_robot_of_a_cell_moves_as_it_does_alone():
    robot, alone = cell(given=True)[0], ArmModel.from_urdf(SUTA_URDF, "tip")
    q = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    R, p = alone.forward(q)
    for name, (turn, at) in {"a": (np.eye(3), np.zeros(3)), "b": STANDS}.items():
        rotation, position = robot.chain(tip=f"{name}/tip").forward(q)
        np.testing.assert_allclose(position, p @ turn.T + at, atol=1e-12)
        np.testing.assert_allclose(rotation, turn @ R, atol=1e-12)


SIMULATED = """\
robots:
  a: {urdf: a.urdf, tip: tip}
  b: {urdf: b.urdf, tip: tip, pose: {position_mm: [700, 100, 50], rotation_rpy_deg: [3, -4, 150]}}
seed: 3
errors: [{select: ['*.offset'], std_deg: 0.5}]
noise: {seating_mm: 0.05, instrument_mm: 0.05}
sets:
  touch: {kind: contact, chain: b, base_chain: a, spots: {tip: {position_mm: [0, 0, 0]}},
          directions: 40}
  held: {kind: contact, chain: b, base_chain: a, spots: {tip: {position_mm: [0, 0, 0]}},
         directions: 15, cone_deg: 100}
  seen_a: {kind: tracked_point, chain: a, samples: 30}
  seen_b: {kind: tracked_point, chain: b, samples: 30}
"""
JOB = """\
robots:
  a: {urdf: a.urdf, tip: tip}
  b: {urdf: b.urdf, tip: tip}
parameters:
  - {select: '*.offset', prior_deg: 1}
observations:
  - {kind: tracked_point, chain: a, samples: seen_a/samples.csv}
  - {kind: tracked_point, chain: b, samples: seen_b/samples.csv}
  - {kind: contact, chain: b, base_chain: a, samples: touch/tip.csv,
     pose: {tip: {position_mm: [0, 0, 0]}}}
validation:
  - {kind: contact, chain: b, base_chain: a, samples: held/tip.csv,
     pose: {tip: {position_mm: [0, 0, 0]}}}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated job of two robots."""
    folder = tmp_path_factory.mktemp("cell")
    for name in "ab":
        (folder / f"{name}.urdf").write_bytes(SUTA_URDF.read_bytes())
    (folder / "simulation.yaml").write_text(SIMULATED)
    (folder / "calibration.yaml").write_text(JOB)
    assert cli("simulate", folder / "simulation.yaml", "--out", folder) == 0
    return folder


def test_a_job_writes_a_urdf_for_each_robot(made: Path):
    out = made / "results"
    found = answer("calibrate", made / "calibration.yaml", "--out", out)
    assert found["verdict"]["usable"]
    after = found["metrics"]["validation"]["after"]["rms_mm"]
    assert after < 0.2 < found["metrics"]["validation"]["before"]["rms_mm"]
    assert set(found["metrics"]["by_chain"]) == {"a", "b", "b seen from a"}
    # The base of b in that of a, apart from the zeros of the first joints, with its ±.
    stands = json.loads((out / "result.json").read_text())["external_poses"]["robot[b]"]
    assert stands["matrix"][2][3] == pytest.approx(0.05, abs=3e-4)
    assert found["parameters"]["robot[b].z"]["std"] < 2e-4
    # One URDF of each robot, as its own calls its joints, and one of all.
    values = CalibrationJob.load(made / "calibration.yaml").run().solution.values
    robot = CalibrationJob.load(made / "calibration.yaml").arm
    q = np.random.default_rng(0).uniform(-1, 1, (4, 6))
    alone = [ArmModel.from_urdf(out / f"calibrated_{name}.urdf", "tip") for name in "ab"]
    np.testing.assert_allclose(
        alone[0].forward(q)[1], robot.chains["a"].forward(q, values)[1], atol=1e-9
    )
    whole = Robot.from_urdf(out / "calibrated.urdf")
    for name in "ab":
        np.testing.assert_allclose(
            whole.chain(tip=f"{name}/tip").forward(q)[1],
            robot.chains[name].forward(q, values)[1],
            atol=1e-9,
        )
    before = ArmModel.from_urdf(made / "b.urdf", "tip").forward(q)[1]
    assert np.abs(alone[1].forward(q)[1] - before).max() > 1e-3
    again = answer("validate", out / "calibrated.urdf", made / "calibration.yaml")
    assert again["metrics"]["validation"]["after"]["rms_mm"] == pytest.approx(after, rel=0.02)


def test_a_pose_that_is_given_is_held_or_has_a_prior(made: Path, tmp_path: Path):
    for name in ("a.urdf", "b.urdf"):
        (tmp_path / name).write_bytes((made / name).read_bytes())
    for folder in ("seen_a", "seen_b", "touch", "held"):
        (tmp_path / folder).symlink_to(made / folder)
    job = tmp_path / "calibration.yaml"
    pose = "position_mm: [700, 100, 50], rotation_rpy_deg: [3, -4, 150]"
    unknown = "b: {urdf: b.urdf, tip: tip}"
    job.write_text(JOB.replace(unknown, f"b: {{urdf: b.urdf, tip: tip, pose: {{{pose}}}}}"))
    loaded = CalibrationJob.load(job)
    assert not any(loaded.parameters[name].free for name in BASE)
    np.testing.assert_allclose(
        loaded.arm.chains["b"].forward(np.zeros(6))[1],
        rotation_from_rpy(np.radians([3, -4, 150])) @ loaded.arm.chains["a"].forward(np.zeros(6))[1]
        + [0.7, 0.1, 0.05],
        atol=1e-12,
    )
    rough = f"{pose}, prior_mm: 5, prior_deg: 1"
    job.write_text(JOB.replace(unknown, f"b: {{urdf: b.urdf, tip: tip, pose: {{{rough}}}}}"))
    parameters = CalibrationJob.load(job).parameters
    assert parameters["robot[b].x"].prior == pytest.approx(5e-3)
    assert parameters["robot[b].rz"].prior == pytest.approx(np.radians(1))


def test_a_file_of_one_robot_may_call_its_joints_as_its_urdf_does(made: Path):
    file = made / "seen_b" / "samples.csv"
    text = file.read_text()
    before = CalibrationJob.load(made / "calibration.yaml").observations[1].poses.samples.q
    file.write_text(text.replace("b/joint", "joint"))
    after = CalibrationJob.load(made / "calibration.yaml").observations[1].poses.samples.q
    file.write_text(text)
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  b: {urdf: b.urdf, tip: tip}\n", "", "1 robot; expected two robots"),
        ("robots:\n", "arm: {urdf: a.urdf, tip: tip}\nrobots:\n", "arm beside robots"),
        ("b.urdf, tip: tip", "b.urdf", "neither tip nor chains"),
        ("b.urdf, tip: tip", "b.urdf, tip: tap", "b/tap"),
        ("b.urdf, tip: tip", "b.urdf, tip: tip, colour: red", "colour"),
        ("a.urdf, tip: tip", "a.urdf, tip: tip, pose: {position_mm: [0, 0, 1]}", "first robot"),
        ("  b: {urdf", "  b/c: {urdf", "letters, digits"),
        ("chain: b, samples", "chain: c, samples", "one of a, b"),
        ("chain: b, base_chain: a", "chain: b, base_chain: b", "two chains"),
        ("samples: touch/tip.csv", "samples: seen_b/samples.csv", "a/joint"),
        ("urdf: b.urdf", "urdf: c.urdf", "c.urdf"),
    ],
)
def test_what_is_wrong_with_a_cell_is_said(made: Path, old: str, new: str, message: str):
    text = JOB.replace(old, new)
    if new.startswith("  b/c"):
        text = text.replace("chain: b", "chain: b/c")
    assert text != JOB
    job = made / "wrong.yaml"
    job.write_text(text)
    with pytest.raises(InputError, match=message):
        CalibrationJob.load(job)


def test_chains_that_nothing_joins_are_refused(made: Path):
    own = JOB.replace("b.urdf, tip: tip", "b.urdf, tip: tip, base: base_link")
    job = made / "apart.yaml"
    job.write_text(own[: own.index("  - {kind: contact")])
    with pytest.raises(InputError, match="begin at a link of its own"):
        CalibrationJob.load(job)


def test_robots_are_named_so_that_joints_can_be_called_after_them():
    with pytest.raises(InputError, match="two robots at least"):
        Robot.of_cell({"a": SUTA_URDF})
    with pytest.raises(InputError, match="a pose of the base of 'a'"):
        Robot.of_cell(TWO, poses={"a": STANDS})
    with pytest.raises(InputError, match="letters, digits"):
        Robot.of_cell({"a": SUTA_URDF, "b/c": SUTA_URDF})


ROBOTS = """\
robots:
  p:
    {urdf: p.urdf, tip: tool, gravity: [0, -1, 0], grade: printed,
     loops: [{frames: [tail_link, pin_link], passive: [elbow, coupler]}]}
  b: {urdf: b.urdf, tip: tip, grade: certified, couplings: {joint_3: {joint_2: -1}}}
"""


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """A palletizer with a four-bar beside an arm whose second motor drags its third joint."""
    (tmp_path / "p.urdf").write_text(palletizer_urdf())
    (tmp_path / "b.urdf").write_bytes(SUTA_URDF.read_bytes())
    rng, robots = np.random.default_rng(0), {"p": palletizer(), "b": ArmModel.from_urdf(*SUTA)}
    rows = []
    for name, arm in robots.items():
        q = rng.uniform(-0.5, 0.5, (30, len(arm.joints)))
        header = ",".join(("x", "y", "z", *arm.joints))
        lines = [",".join(map(str, row)) for row in np.hstack([arm.forward(q)[1], q]).tolist()]
        (tmp_path / f"{name}.csv").write_text("\n".join([header, *lines]) + "\n")
        rows.append(f"  - {{kind: tracked_point, chain: {name}, samples: {name}.csv}}\n")
    text = f"{ROBOTS}parameters: [{{select: '*.offset', prior_deg: 1}}]\nobservations:\n"
    (tmp_path / "calibration.yaml").write_text(text + "".join(rows))
    return tmp_path / "calibration.yaml"


def test_what_is_said_of_one_robot_is_so_of_it_alone(mixed: Path):
    loaded = CalibrationJob.load(mixed)
    robot, rng = loaded.arm, np.random.default_rng(1)
    assert isinstance(robot, Robot)
    # The four-bar of the palletizer, and not of the other.
    q = rng.uniform(-0.5, 0.5, (4, 5))
    np.testing.assert_allclose(
        robot.chains["p"].forward(q)[1], palletizer().forward(q)[1], atol=1e-12
    )
    # The coupling of the other.
    held = loaded.parameters["b/joint_3.coupling[b/joint_2]"]
    assert (held.nominal, held.free) == (-1.0, False)
    q = rng.uniform(-0.5, 0.5, (4, 6))
    angles = q - np.outer(q[:, 1], np.eye(6)[2])
    alone = ArmModel.from_urdf(*SUTA)
    np.testing.assert_allclose(
        robot.chains["b"].forward(q)[1], alone.forward(angles)[1], atol=1e-12
    )
    # How each was made, and where gravity points for both.
    assert robot.grades == {"p": "printed", "b": "certified"}
    assert robot.chains["b"].grade == "certified"
    assert robot.grade == ""
    for arm in robot.chains.values():
        np.testing.assert_allclose(arm.gravity / np.linalg.norm(arm.gravity), [0, -1, 0])


def test_a_urdf_of_the_whole_cell_has_what_is_said_of_its_robots(mixed: Path, tmp_path: Path):
    loaded = CalibrationJob.load(mixed)
    urdf = tmp_path / "whole.urdf"
    urdf.write_bytes(loaded.arm.calibrated_urdf({}))
    whole = loaded.spec.arm.mechanism_of(urdf, loaded.arm, loaded.spec.pairs)
    q = np.random.default_rng(2).uniform(-0.5, 0.5, (4, 11))
    for one, other in zip(whole.arms, loaded.arm.arms, strict=True):
        np.testing.assert_allclose(one.forward(q)[1], other.forward(q)[1], atol=1e-9)
    assert whole.grades == loaded.arm.grades


def test_what_is_held_is_as_far_off_as_its_own_robot_allows(mixed: Path):
    """Lengths of a printed robot are off by 0.2 mm, those of a certified one by 0.005 mm."""
    problem = CalibrationJob.load(mixed).problem()
    names = ["p/shoulder.x", "b/joint_2.x", "p/shoulder.ry"]
    fit = Fitted(problem, problem.start(), problem.assumed_sigmas(), np.zeros(0, dtype=int))
    spread = drawing_covariance(fit, np.zeros((len(fit.x),) * 2), names, np.zeros(3))
    stds = np.sqrt(np.diag(spread)) * [1e3, 1e3, np.degrees(1)]
    np.testing.assert_allclose(stds, [0.2, 0.005, 0.2], rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[elbow, coupler]", "[elbow, kupler]", "kupler"),
        ("{joint_3: {joint_2", "{joint_3: {elbow", r"couplings\.joint_3\.elbow: .*joint_1"),
        ("grade: certified", "grade: best", "best"),
        ("tip: tip, grade", "tip: tip, gravity: [0, 0, -1], grade", "gravity in the entry of p"),
    ],
)
def test_what_is_wrong_with_one_robot_is_said(mixed: Path, old: str, new: str, message: str):
    text = mixed.read_text()
    assert old in text
    mixed.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        CalibrationJob.load(mixed)
