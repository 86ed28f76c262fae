"""Several chains of one robot in one job: shared joints are one unknown."""

from pathlib import Path

import numpy as np
import pytest

from suta_calib import (
    ArmModel,
    CalibrationJob,
    InputError,
    Problem,
    Robot,
    TrackedPoint,
    calibrate,
)
from suta_calib.errors import SutaCalibWarning
from suta_calib.terms.external_frame import point_named, pose_named
from tests.support.torso_robot import (
    REFLECTOR,
    SEEN,
    built,
    torso_robot,
    torso_robot_urdf,
    tracked,
    write_torso_job,
)

FREE = ["geometric", "*.offset"]


def test_two_arms_on_a_torso_are_found_together_to_what_is_stated():
    rng = np.random.default_rng(1)
    robot = torso_robot()
    left, right = robot.chains.values()
    truth = built(robot, rng)
    fitted = [tracked(arm, truth, 60, rng) for arm in (left, right)]
    held = [tracked(arm, truth, 30, rng) for arm in (left, right)]
    result = calibrate(robot, fitted, validation=held, free=FREE)
    assert result.assessment.usable
    # What a torso joint is off, both hands see: it is one unknown.
    assert len([n for n in result.estimates if n == "torso_1.offset"]) == 1
    off = [
        (e.value - truth[name]) / e.std
        for name, e in result.solution.arm_estimates.items()
        if name in truth and e.std
    ]
    assert len(off) > 80
    assert 0.6 < np.std(off) < 1.3
    # The reflector of each hand in postures that were not fitted, where the instrument sees it.
    values = result.solution.values
    instrument = pose_named(values, "base")
    for name, arm, term in zip(robot.chains, (left, right), held, strict=True):
        q = term.poses.samples.q
        (R, p), (true_R, true_p) = arm.forward(q, values), arm.forward(q, truth)
        reflector = p + R @ point_named(values, f"target[{name}/A]")
        at = reflector @ instrument[0].T + instrument[1]
        true = (true_p + true_R @ REFLECTOR) @ SEEN[0].T + SEEN[1]
        assert np.sqrt(np.mean(np.sum((at - true) ** 2, axis=1))) < 5e-4


def test_a_chain_with_the_columns_of_a_robot_moves_as_it_does_alone():
    robot, rng = torso_robot(), np.random.default_rng(0)
    for name, arm in robot.chains.items():
        laid = robot.laid_out[name]
        assert laid.joints == robot.joints
        assert laid.own_joints == arm.joints
        q = rng.uniform(-2, 2, (5, len(robot.joints)))
        own = q[:, [robot.joints.index(joint) for joint in arm.joints]]
        for wide, narrow in zip(laid.forward(q), arm.forward(own), strict=True):
            np.testing.assert_allclose(wide, narrow, atol=1e-14)
        np.testing.assert_allclose(laid.configuration(q[0]), arm.configuration(own[0]))


def test_the_jacobian_of_several_chains_is_that_of_central_differences():
    robot, rng = torso_robot(), np.random.default_rng(3)
    truth = built(robot, rng)
    terms = [tracked(arm, truth, 4, rng) for arm in robot.chains.values()]
    problem = Problem(terms, robot.select(*FREE))
    x = problem.start(truth)
    sigmas = problem.assumed_sigmas()

    def residuals(at):
        return np.concatenate([line.residual.ravel() for line in problem.linearise(at, sigmas)])

    lines = problem.linearise(x, sigmas)
    evaluation = problem.evaluation
    jacobian = np.vstack(
        [
            np.hstack([arm, np.asarray(own)])
            for line in lines
            for arm, own in [evaluation.columns(line, line.by_pose, line.by_own)]
        ]
    ).copy()
    step = 1e-6
    for k in range(len(x)):
        moved = np.eye(len(x))[k] * step
        numeric = (residuals(x + moved) - residuals(x - moved)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], numeric, atol=1e-7, err_msg=problem.names[k])


def test_a_hand_seen_from_the_other_hand_is_a_chain_of_the_same_robot():
    """A chain through both arms shares every joint with the two that it passes."""
    robot = torso_robot()
    through = robot.chain(tip="right_hand", base="left_hand", name="through")
    assert set(through.joints) == {*robot.joints} - {"torso_1", "torso_2"}
    # The fixed joint of each hand is called as the tip of its chain is.
    assert set(through.parameters) <= set(robot.chains["left"].parameters) | set(
        robot.chains["right"].parameters
    )
    assert robot.laid_out["through"].bodies.base == "left"
    assert robot.laid_out["through"].bodies.tip == "right"


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A job of two chains, each with samples of its own columns."""
    return write_torso_job(tmp_path)


def test_a_job_names_the_chain_of_every_row(job: Path, tmp_path: Path):
    result = CalibrationJob.load(job).run()
    assert result.assessment.usable
    assert "target[left/A].x" in result.estimates
    assert "target[right/A].x" in result.estimates
    calibrated = tmp_path / "out.urdf"
    result.write_urdf(calibrated)
    # One URDF holds both arms.
    again = torso_robot(calibrated)
    q = np.random.default_rng(0).uniform(-1, 1, (6, 8))
    for name, arm in torso_robot(job.parent / "robot.urdf").chains.items():
        np.testing.assert_allclose(
            again.chains[name].forward(q)[1], arm.forward(q, result.solution.values)[1], atol=1e-9
        )


def test_a_chain_whose_base_moves_is_told(job: Path):
    """Its samples have the torso's readings too: what stands in the room is no base of the arm."""
    text = job.read_text()
    job.write_text(text.replace("left: {tip: left_hand}", "left: {tip: left_hand, base: torso_a}"))
    says = r"yaml:[69]: the base 'torso_a' of chain left moves with torso_1.*leave out base"
    with pytest.warns(SutaCalibWarning, match=says):
        CalibrationJob.load(job)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "chain: left, samples: left_fitted",
            "samples: left_fitted",
            "the chain that its samples are",
        ),
        (
            "chain: left, samples: left_fitted",
            "chain: lefd, samples: left_fitted",
            "left, right; did you mean 'left'",
        ),
        ("right: {tip: right_hand}", "right: {tip: left_hand}", "the tip of the chain left too"),
        ("right: {tip: right_hand}", "right: {tip: no_hand}", "no_hand"),
        ("urdf: robot.urdf, chains", "urdf: robot.urdf, tip: left_hand, chains", "beside chains"),
        (
            "samples: right_fitted.csv",
            "samples: left_fitted.csv",
            "right_1.*the file has the joints of left: write chain: left, or name another file",
        ),
        (
            "samples: left_fitted.csv",
            "samples: [left_fitted.csv, right_fitted.csv]",
            "in all of these files",
        ),
        (
            "chain: right, samples: right_f",
            "chain: right, base_chain: right, samples: right_f",
            "both",
        ),
    ],
)
def test_what_is_wrong_with_chains_is_said(job: Path, old: str, new: str, message: str):
    text = job.read_text()
    assert old in text
    job.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        CalibrationJob.load(job)


def test_rows_of_two_chains_in_one_file_are_refused(job: Path):
    """A file that has the columns of all joints, in each row those of one chain."""
    left, right = ((job.parent / f"{name}_fitted.csv").read_text() for name in ("left", "right"))
    (header, first, *_), (_, second, *_) = left.splitlines(), right.splitlines()
    others = header.replace("torso_1,torso_2,", "").replace("left", "right").partition(",x")[0]
    both = [f"{header},{others}", f"{first},,,,,,"]
    torso, own, seen_at = second.split(",")[:2], second.split(",")[2:8], second.split(",")[8:]
    both.append(",".join([*torso, *[""] * 6, *seen_at, *own]))
    (job.parent / "left_fitted.csv").write_text("\n".join(both) + "\n")
    with pytest.raises(InputError, match=r":3: column 'left_1': found ''.*each chain a file"):
        CalibrationJob.load(job)


def test_chains_of_two_urdfs_are_refused():
    robot, rng = torso_robot(), np.random.default_rng(0)
    other = ArmModel.from_urdf(torso_robot_urdf().replace("0 0 0.5", "0 0 0.6"), "left_hand")
    truth = built(robot, rng)
    terms = [tracked(robot.chains["left"], truth, 5, rng), tracked(other, {}, 5, rng)]
    with pytest.raises(InputError, match="chains of one robot"):
        Problem(terms, robot.select("*.offset"))
    with pytest.raises(InputError, match="another ArmModel"):
        calibrate(robot, terms)


@pytest.mark.parametrize("tip", ["lefft", "left"])
def test_the_name_of_a_chain_is_no_tip(tip: str):
    with pytest.raises(InputError, match=r"robot\.chains\['left'\] is the chain of that name"):
        torso_robot().chain(tip=tip)


def test_a_robot_shows_itself_in_a_line():
    assert "left: base_link → left_hand, 8 joints" in repr(torso_robot())
    assert "no chain yet" in repr(Robot.from_urdf(torso_robot_urdf()))


def test_a_term_of_one_chain_alone_needs_no_robot():
    robot, rng = torso_robot(), np.random.default_rng(2)
    left = robot.chains["left"]
    term = tracked(left, {}, 20, rng)
    assert Problem([term], left.select("*.offset")).arm is left
    assert isinstance(term, TrackedPoint)
