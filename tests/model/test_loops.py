"""Closed loops that hang on the tree: a four-bar moves joints without an encoder."""

import numpy as np
import pinocchio as pin
import pytest

from suta_calib import (
    ArmModel,
    CalibrationJob,
    FixedPoint,
    InputError,
    Loop,
    Robot,
    TrackedPoint,
    calibrate,
)
from suta_calib.errors import UrdfError
from tests.support.palletizer import LOOP, palletizer, palletizer_urdf

# Readings for which the four-bar stays on its side.
REACH = 0.6


def readings(arm, rng, n):
    return rng.uniform(-REACH, REACH, (n, len(arm.joints)))


def built(arm, rng, size=1.0):
    """Values of all its geometry, off nominal by a millimetre and a third of a degree."""
    scale = {"m": 1e-3 * size, "rad": 6e-3 * size}
    return {
        name: p.nominal + scale[p.unit] * float(rng.standard_normal())
        for name, p in arm.parameters.items()
    }


def test_readings_are_those_of_the_joints_that_have_an_encoder():
    arm = palletizer()
    assert arm.joints == ("yaw", "shoulder", "wrist", "flange", "crank")
    assert "elbow.offset" not in arm.parameters
    assert "coupler.x" in arm.geometric
    assert "crank.offset" in arm.parameters


def test_a_parallelogram_keeps_the_forearm_at_the_angle_of_the_crank():
    arm, rng = palletizer(), np.random.default_rng(0)
    for q in readings(arm, rng, 10):
        angles = arm.passive_angles(q)
        assert angles["elbow"] == pytest.approx(q[4] - q[1], abs=1e-12)


def test_the_loop_is_closed_in_the_pose_that_pinocchio_gives():
    """Whatever the lengths are: the two frames coincide across the axis."""
    urdf = palletizer_urdf(coupler=0.4)
    arm = ArmModel.from_urdf(urdf, "tool", loops=[LOOP])
    model, data = arm.model, arm.model.createData()
    for q in readings(arm, np.random.default_rng(1), 10):
        pin.framesForwardKinematics(model, data, arm.configuration(q))
        ends = [data.oMf[model.getFrameId(name)].translation for name in LOOP.frames]
        np.testing.assert_allclose(*ends, atol=1e-12)
        tool = data.oMf[model.getFrameId("tool")]
        rotation, position = arm.forward(q)
        np.testing.assert_allclose(position, tool.translation, atol=1e-12)
        np.testing.assert_allclose(rotation, tool.rotation, atol=1e-12)


def test_a_loop_with_tilted_axes_closes_across_its_axis():
    arm, rng = palletizer(), np.random.default_rng(2)
    true = arm.at(built(arm, rng))
    model = pin.buildModelFromXML(true.calibrated_urdf({}).decode())
    data, neutral = model.createData(), pin.neutral(model)
    for q in readings(arm, rng, 5):
        angles = dict(zip(true.joints, q, strict=True)) | true.passive_angles(q)
        at = neutral.copy()
        for name, angle in angles.items():
            at[model.joints[model.getJointId(name)].idx_q] = angle
        # Offsets are in the URDF's origins.
        pin.framesForwardKinematics(model, data, at)
        first, second = (data.oMf[model.getFrameId(name)].translation for name in LOOP.frames)
        # Along the elbow's axis, about which they turn, they may be apart.
        elbow = data.oMi[model.getJointId("elbow")].rotation[:, 1]
        np.testing.assert_allclose(np.cross(elbow, first - second), 0.0, atol=1e-9)


def test_the_jacobian_by_all_parameters_is_that_of_central_differences():
    arm, rng = palletizer(), np.random.default_rng(3)
    values = built(arm, rng)
    q = readings(arm, rng, 1)[0]
    function = arm.function([*values])
    x = np.array([*values.values()])
    rotation, _, jacobian = (np.array(part) for part in function(x, q))
    turned = rotation.reshape(3, 3).T
    step = 1e-6
    for k, name in enumerate(values):
        moved = np.eye(len(x))[k] * step
        (r1, p1, _), (r0, p0, _) = function(x + moved, q), function(x - moved, q)
        linear = (np.array(p1) - np.array(p0)).reshape(3) / (2 * step)
        change = (np.array(r1) - np.array(r0)).reshape(3, 3).T @ turned.T / (2 * step)
        angular = np.array([change[2, 1], change[0, 2], change[1, 0]])
        numeric = np.concatenate([linear, angular])
        np.testing.assert_allclose(jacobian[k], numeric, atol=2e-8, err_msg=name)


def test_a_calibration_finds_the_crank_through_the_loop():
    arm, rng = palletizer(), np.random.default_rng(4)
    truth = {"crank.offset": 0.02, "shoulder.offset": -0.01, "coupler.x": -0.1215, "wrist.x": 0.352}
    terms = []
    for _ in range(2):
        q = readings(arm, rng, 60)
        p = arm.forward(q, truth)[1]
        seen = p + np.array([1.0, 2.0, 0.5]) + rng.normal(0, 1e-4, p.shape)
        terms.append(TrackedPoint.from_arrays(arm, q, position=seen))
    result = calibrate(arm, terms[0], validation=terms[1], free=[*truth])
    for name, value in truth.items():
        estimate = result.estimates[name]
        assert abs(estimate.value - value) < 4 * estimate.std
        assert estimate.std < 1e-3
    assert result.metrics["validation"]["after"].rms < 3e-4


def test_the_calibrated_urdf_has_the_joints_beside_the_chain():
    arm, rng = palletizer(), np.random.default_rng(5)
    values = built(arm, rng)
    again = ArmModel.from_urdf(arm.calibrated_urdf(values).decode(), "tool", loops=[LOOP])
    q = readings(arm, rng, 5)
    for there, here in zip(again.forward(q), arm.forward(q, values), strict=True):
        np.testing.assert_allclose(there, here, atol=1e-9)


def test_a_chain_of_a_robot_has_its_loop_too():
    robot = Robot.from_urdf(
        palletizer_urdf(), {"tool": ("tool", None), "hand": ("hand", None)}, [LOOP]
    )
    lone, rng = palletizer(), np.random.default_rng(6)
    laid = robot.laid_out["hand"]
    q = readings(lone, rng, 3)
    order = [robot.joints.index(name) for name in lone.joints]
    wide = np.zeros((3, len(robot.joints)))
    wide[:, order] = q
    hand = ArmModel.from_urdf(palletizer_urdf(), "hand", loops=[LOOP])
    own = q[:, [lone.joints.index(name) for name in hand.joints]]
    np.testing.assert_allclose(laid.forward(wide)[1], hand.forward(own)[1], atol=1e-13)


@pytest.mark.parametrize(
    ("urdf", "loop", "message"),
    [
        (palletizer_urdf(coupler=0.45), LOOP, "50 mm apart"),
        (palletizer_urdf(), Loop(("tail_link", "no_link"), ("elbow", "coupler")), "no_link"),
        (palletizer_urdf(), Loop(("tail_link", "pin_link"), ("elbow", "wrist")), "'wrist'"),
        (palletizer_urdf(), Loop(("tail_link", "pin_link"), ("elbow", "elbow")), "two different"),
        (
            palletizer_urdf().replace('axis xyz="0 -1 0"', 'axis xyz="0 -1 0.1"'),
            LOOP,
            "not parallel",
        ),
        (palletizer_urdf(), Loop(("tool", "pin_link"), ("elbow", "coupler")), "not parallel"),
    ],
)
def test_what_is_no_planar_loop_is_refused(urdf, loop, message):
    with pytest.raises(UrdfError, match=message):
        ArmModel.from_urdf(urdf, "tool", loops=[loop])


def test_readings_at_which_the_loop_cannot_close_are_refused():
    arm = palletizer()
    assert (arm.open_loops(readings(arm, np.random.default_rng(0), 20)) < 1e-12).all()
    # A crank that is longer than the forearm's tail cannot point away from the elbow.
    long = ArmModel.from_urdf(palletizer_urdf(crank=0.139), "tool", loops=[LOOP])
    q = np.zeros((3, 5))
    q[2, [1, 4]] = np.pi / 4, -np.pi / 4
    with pytest.raises(InputError, match=r"row 2.*stays open by"):
        FixedPoint.from_arrays(long, q, point="post")


def test_a_compliance_in_a_loop_is_refused():
    with pytest.raises(UrdfError, match="closed loop"):
        palletizer().select("wrist.compliance")


def test_a_term_over_an_arm_with_a_loop_is_simulated_again():
    arm, rng = palletizer(), np.random.default_rng(7)
    q = readings(arm, rng, 12)
    term = FixedPoint.from_arrays(arm, q, point="post")
    assert np.isfinite(term.poses.at({})[1]).all()


def test_a_job_says_its_loops(tmp_path):
    arm, rng = palletizer(), np.random.default_rng(8)
    (tmp_path / "arm.urdf").write_text(palletizer_urdf())
    truth = {"crank.offset": 0.02, "wrist.offset": -0.01}
    q = readings(arm, rng, 40)
    position = arm.forward(q, truth)[1] + rng.normal(0, 1e-4, (40, 3))
    rows = [",".join(f"{x!r}" for x in map(float, row)) for row in np.hstack([q, position])]
    (tmp_path / "seen.csv").write_text("\n".join([",".join((*arm.joints, "x", "y", "z")), *rows]))
    job = tmp_path / "calibration.yaml"
    text = (
        "arm:\n  urdf: arm.urdf\n  tip: tool\n  loops:\n"
        "    - {frames: [tail_link, pin_link], passive: [elbow, coupler]}\n"
        "parameters:\n  - {select: [crank.offset, wrist.offset], prior_deg: 5}\n"
        "observations:\n  - {kind: tracked_point, samples: seen.csv}\n"
    )
    job.write_text(text)
    result = CalibrationJob.load(job).run()
    for name, value in truth.items():
        assert abs(result.estimates[name].value - value) < 4 * result.estimates[name].std
    job.write_text(text.replace("[elbow, coupler]", "[elbow]"))
    with pytest.raises(InputError, match=r"calibration\.yaml.*two names"):
        CalibrationJob.load(job)
    job.write_text(text.replace("pin_link]", "pin_lnk]"))
    says = r"calibration\.yaml:4: arm\.loops: found loop tail_link – pin_lnk: 'pin_lnk'.*'pin_link'"
    with pytest.raises(InputError, match=says):
        CalibrationJob.load(job).run()
