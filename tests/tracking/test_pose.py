"""Poses and their uncertainty: against the plain kinematics, differences, and linear algebra."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated import arm_named, random_readings
from tracking_scene import TRUTH, Calibrated, calibrated, reading, suta_tracker

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.tracker import NO_TOOL, TipKinematics, Tool, Tracker, quaternion, read_tool
from suta_calib.tracking.uncertainty import read_uncertainty


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    return calibrated(tmp_path_factory.mktemp("calibrated"))


@pytest.mark.parametrize("name", ["suta", "panda", "kinova"])
def test_poses_are_those_of_the_arm(name: str):
    arm = arm_named(name)
    readings = random_readings(arm, np.random.default_rng(0), 20)
    kinematics = TipKinematics(arm, Tool(np.array([0.01, -0.02, 0.15])))
    rotation, position = arm.forward(readings)
    for q, R, p in zip(readings, rotation, position, strict=True):
        found_R, found_p, std = kinematics(q)
        np.testing.assert_allclose(found_R, R, atol=1e-14)
        np.testing.assert_allclose(found_p, p + R @ [0.01, -0.02, 0.15], atol=1e-14)
        assert std is None


def test_quaternions_are_scipys():
    for R in Rotation.random(50, random_state=1):
        np.testing.assert_allclose(quaternion(R.as_matrix()), R.as_quat(canonical=True), atol=1e-12)


def moved_by(
    arm: ArmModel,
    q: FloatArray,
    values: dict[str, float],
    direction: dict[str, float],
    step: float = 1e-6,
    lever: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """How the tip moves (3,) and turns (3,) per unit of parameters that change, by differences."""
    tips, frames = [], []
    for sign in (-1, 1):
        changed = {
            name: values.get(name, arm.offered[name].nominal) + sign * step * by
            for name, by in direction.items()
        }
        R, p = arm.forward(q, values | changed)
        tips.append(p if lever is None else p + R @ lever)
        frames.append(Rotation.from_matrix(R))
    turn = (frames[1] * frames[0].inv()).as_rotvec()
    return (tips[1] - tips[0]) / (2 * step), turn / (2 * step)


def test_uncertainty_is_that_of_the_nominal_arm_with_its_parameters(scene: Calibrated):
    """The file speaks of the nominal URDF; offsets and turns are folded into the calibrated one."""
    tool = Tool(np.array([0.01, 0.03, 0.12]), np.array([1e-4, 2e-4, 3e-4]))
    kinematics = TipKinematics(scene.arm, tool, read_uncertainty(scene.path, scene.arm))
    for q in random_readings(scene.nominal, np.random.default_rng(2), 10):
        by_name = [moved_by(scene.nominal, q, TRUTH, {n: 1.0}, lever=tool.tip) for n in TRUTH]
        J, T = (np.array(columns).T for columns in zip(*by_name, strict=True))
        R = scene.nominal.forward(q, TRUTH)[0]
        variance = J @ scene.covariance @ J.T + R @ np.diag(tool.std**2) @ R.T
        _, _, std, turn_std = kinematics.with_turns(q)
        np.testing.assert_allclose(std, np.sqrt(np.diag(variance)), rtol=1e-6)
        # A tool's tip turns nothing.
        turned = np.sqrt(np.diag(T @ scene.covariance @ T.T))
        np.testing.assert_allclose(turn_std, turned, rtol=1e-6)


def test_what_was_held_and_moves_the_tip_is_in_what_is_streamed(scene: Calibrated, tmp_path: Path):
    """Anywhere within 3 mm, and what the data tie to it goes along; the base is a convention."""
    held = {
        "joint_6.z": (3e-3, {"joint_6.z": 1.0, "joint_3.offset": -2.0, "joint_2.gain": 0.1}),
        "joint_1.offset": (0.2, {"joint_1.offset": 1.0}),
    }
    entries = {name: {"value": scene.nominal.offered[name].nominal, "std": None} for name in held}
    data = scene.result | {
        "parameters": scene.result["parameters"] | entries,
        "unidentified": [*held],
        "held": [
            {"parameter": name, "plausible": plausible, "direction": direction}
            for name, (plausible, direction) in held.items()
        ],
    }
    file = tmp_path / "result.json"
    file.write_text(json.dumps(data))
    alone = read_uncertainty(file, scene.arm)
    known = alone.with_held(scene.arm)
    assert (known.counted, known.fixed) == (("joint_6.z",), ("joint_1.offset",))
    assert alone.with_held(scene.arm).with_held(scene.arm).names == known.names
    before, after = (TipKinematics(scene.arm, NO_TOOL, each) for each in (alone, known))
    plausible, direction = held["joint_6.z"]
    random = np.random.default_rng(3)
    for q in random_readings(scene.nominal, random, 5):
        moved, _ = moved_by(scene.nominal, q, TRUTH, direction, 1e-3)
        within = random.uniform(-plausible, plausible, 20_000)
        wanted = np.hypot(before(q)[2], moved * np.std(within))
        np.testing.assert_allclose(after(q)[2], wanted, rtol=0.01)


def test_offsets_of_joints_that_slide_are_folded_too(tmp_path: Path):
    urdf = tmp_path / "slide.urdf"
    urdf.write_text(
        """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="tip"/>
        <joint name="turn" type="revolute"><parent link="a"/><child link="b"/>
          <origin xyz="0 0 .3" rpy=".2 0 .1"/><axis xyz="0 0 1"/>
          <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
        <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/>
          <origin xyz=".2 .1 0" rpy="0 .5 0"/><axis xyz="1 0 0"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="end" type="fixed"><parent link="c"/><child link="tip"/>
          <origin xyz="0 .3 0"/></joint></robot>""",
        encoding="utf-8",
    )
    truth = {"turn.offset": 0.1, "slide.offset": 0.05, "slide.rz": 0.2, "slide.y": 0.103}
    nominal = ArmModel.from_urdf(urdf, "tip")
    nominal.write_urdf(tmp_path / "calibrated.urdf", truth)
    std = {name: 1e-3 * (k + 1) for k, name in enumerate(truth)}
    entries = {name: {"value": truth[name], "std": std[name]} for name in truth}
    result = tmp_path / "result.json"
    result.write_text(json.dumps({"status": "converged", "parameters": entries}))
    arm = ArmModel.from_urdf(tmp_path / "calibrated.urdf", "tip")
    known = read_uncertainty(result, arm)
    assert known.source == "std"
    q = np.array([0.4, -0.2])
    _, _, found = TipKinematics(arm, NO_TOOL, known)(q)
    variance = sum((std[n] * moved_by(nominal, q, truth, {n: 1.0})[0]) ** 2 for n in truth)
    np.testing.assert_allclose(found, np.sqrt(variance), rtol=1e-6)


def test_sources_of_uncertainty_in_order_of_worth(scene: Calibrated, tmp_path: Path):
    file = tmp_path / "result.json"
    expected = {"covariance": 0.0, "correlations": 1e-12, "std": None}
    for source, tolerance in expected.items():
        data = dict(scene.result)
        if source != "covariance":
            del data["covariance"]
        if source == "std":
            del data["correlations"]
        file.write_text(json.dumps(data))
        found = read_uncertainty(file, scene.arm)
        assert found.source == source
        assert found.fixed == ("joint_1.offset",)
        wanted = scene.covariance if tolerance is not None else np.diag(np.diag(scene.covariance))
        np.testing.assert_allclose(found.covariance, wanted, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"status": "not_converged"}, "status: found 'not_converged'"),
        (
            {"verdict": {"level": "bad", "usable": False, "sentence": "", "notes": ["Worse."]}},
            r"result\.json: verdict: found a result that must not be used \(Worse\)",
        ),
        ({"parameters": None}, "no table of parameters"),
        (
            {"parameters": {"elbow.z": {"value": 1.0, "std": 0.1}}},
            "no parameter of calibrated.urdf",
        ),
        ({"covariance": {"parameters": ["joint_2.rx"], "matrix": [[1, 2]]}}, "1 x 1 finite"),
        ({"covariance": {"parameters": ["elbow.z"], "matrix": [[1]]}}, "found 'elbow.z'"),
    ],
)
def test_results_that_do_not_fit_are_refused(
    scene: Calibrated, tmp_path: Path, change: dict[str, object], said: str
):
    file = tmp_path / "result.json"
    file.write_text(json.dumps(scene.result | change))
    with pytest.raises(InputError, match=said):
        read_uncertainty(file, scene.arm)
    if "verdict" in change:  # where one insists it is taken
        assert read_uncertainty(file, scene.arm, anyway=True).source == "covariance"


def test_the_nominal_urdf_is_not_what_was_calibrated(scene: Calibrated):
    known = read_uncertainty(scene.path, scene.nominal)
    with pytest.raises(InputError, match=r"joint_4\.z: found 0\.574 m, but 0\.571 m in the URDF"):
        TipKinematics(scene.nominal, NO_TOOL, known)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"tip_mm": [1, 2]}', "tip_mm: found .1, 2.; expected 3 finite numbers"),
        (
            '{"tip_mm": [1, 2, 3], "verdict": {"usable": false, "sentence": "all on a line"}}',
            r"a result that must not be used \(all on a line\)",
        ),
        ('{"tip": [1, 2, 3]}', "only the keys tip"),
        ('{"tip_mm": [1, 2, "x"]}', "3 finite numbers"),
        ('{"tip_mm": [1, 2, 1e6]}', "within 10 m"),
        ('{"tip_mm": [1,\n 2', "tip.json:2: found text that is not JSON"),
        ("[1, 2, 3]", "a JSON list"),
    ],
)
def test_tools_that_are_none_are_refused(tmp_path: Path, text: str, said: str):
    file = tmp_path / "tip.json"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        read_tool(file)


def test_a_tool_is_in_millimetres(tmp_path: Path):
    file = tmp_path / "tip.json"
    file.write_text('{"tip_mm": [1, 2, -3], "tip_std_mm": [0.1, 0.1, 0.2]}')
    tool = read_tool(file)
    np.testing.assert_allclose(tool.tip, [1e-3, 2e-3, -3e-3])
    np.testing.assert_allclose(tool.std, [1e-4, 1e-4, 2e-4])


def test_joints_are_matched_by_name():
    arm = arm_named("suta")
    kinematics = TipKinematics(arm)
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    order = ["joint_6", "gripper", "joint_1", "joint_3", "joint_2", "joint_5", "joint_4"]
    tracker = Tracker(arm, order, kinematics)
    shuffled = np.array([0.6, 9.0, 0.1, 0.3, 0.2, 0.5, 0.4])
    pose = tracker.pose(reading(shuffled, error=(1,)))
    assert pose.valid, "the gripper is not on the chain"
    np.testing.assert_allclose(pose.angles, q)
    np.testing.assert_allclose(pose.position, arm.forward(q)[1])
    flagged = tracker.pose(reading(shuffled, error=(3,), warning=(0,)))
    assert (flagged.errors, flagged.warnings) == (("joint_3",), ("joint_6",))
    assert not flagged.valid
    assert np.isnan(flagged.position).all()
    assert np.isnan(flagged.quaternion).all()


def test_a_pose_takes_less_than_100_microseconds(scene: Calibrated):
    """A limit ten times what it takes, so that a busy machine does not fail it."""
    known = read_uncertainty(scene.path, scene.arm)
    tracker = Tracker(scene.arm, scene.arm.joints, TipKinematics(scene.arm, NO_TOOL, known))
    one = reading(np.full(6, 0.3))
    times = []
    for _ in range(300):
        began = time.process_time()
        tracker.pose(one)
        times.append(time.process_time() - began)
    assert np.median(times) < 300e-6


def test_the_same_reading_gives_poses_of_its_own():
    tracker = suta_tracker()
    first = tracker.pose(reading(np.zeros(6)))
    before = first.position.copy()
    tracker.pose(reading(np.full(6, 0.5)))
    np.testing.assert_array_equal(first.position, before)
