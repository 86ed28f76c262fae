"""What is tracked with a result follows its job: where gravity points, loads, chains, cells."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import refused
from simulated import SUTA_URDF
from tracking_scene import Calibrated, calibrated

from suta_calib import ArmModel, CalibrationJob, Robot, Samples
from suta_calib.errors import InputError
from suta_calib.measurements import write_samples
from suta_calib.tracking import TrackOptions
from suta_calib.tracking.live import Tracking
from suta_calib.tracking.tracker import TipKinematics, matched_joints

YIELDS = {"joint_2.compliance": 2e-4, "joint_4.compliance_x": 1e-4}
Q = np.array([0.3, -0.4, 0.9, 0.2, -1.0, 0.5])
DEVICE = "port: /dev/null\nunit: rad\nformat: lines\njoints: [{}]\n"


def of_job(folder: Path, loads: list[float], arm: str = "") -> Calibrated:
    """The calibrated arm of a job on a wall, which yields; each row carries one of the loads."""
    scene = calibrated(folder)
    rng, n = np.random.default_rng(0), 3 * max(len(loads), 1)
    payload = np.zeros((n, 4))
    payload[:, 0] = np.resize(loads or [0.0], n)
    payload[:, 3] = 0.05
    samples = Samples.from_arrays(
        scene.nominal.joints,
        rng.uniform(-0.5, 0.5, (n, 6)),
        position=rng.uniform(0, 1, (n, 3)),
        payload=payload if loads else None,
    )
    write_samples(folder / "samples.csv", samples)
    (folder / "arm.urdf").write_bytes(SUTA_URDF.read_bytes())
    job = folder / "calibration.yaml"
    job.write_text(
        f"arm: {{urdf: arm.urdf, tip: tip{arm}}}\nparameters: [{{select: '*.offset'}}]\n"
        "observations: [{kind: tracked_point, samples: samples.csv}]\n"
    )
    for name, value in YIELDS.items():
        scene.result["parameters"][name] = {"value": value, "std": None, "state": "fixed"}
    made = {str(job): hashlib.sha256(job.read_bytes()).hexdigest()}
    scene.path.write_text(json.dumps(scene.result | {"run": {"inputs": made}}))
    (folder / "device.yaml").write_text(
        DEVICE.format(", ".join(f"{{name: {n}}}" for n in scene.nominal.joints))
    )
    return scene


def tracking(folder: Path, **options: object) -> Tracking:
    given = {"result": folder / "result.json", **options}
    return Tracking(TrackOptions(folder / "calibrated.urdf", None, folder / "device.yaml", **given))


def tip(found: Tracking) -> np.ndarray:
    return TipKinematics(found.arm, found.tool, found.uncertainty, found.payload)(Q)[1]


def expected(scene: Calibrated, load: list[float] | None) -> np.ndarray:
    """Where the calibrated arm on its wall is, as it yields."""
    conditions = {} if load is None else {"payload": np.array([load])}
    return scene.arm.with_gravity([1, 0, 0]).forward(Q[None], YIELDS, conditions)[1][0]


ON_A_WALL = ", gravity: [1, 0, 0]"


def test_gravity_and_the_load_of_all_samples_are_those_of_the_job(tmp_path: Path) -> None:
    scene = of_job(tmp_path, [2.0], ON_A_WALL)
    found = tracking(tmp_path)
    assert found.notes == []
    at = expected(scene, [2.0, 0.0, 0.0, 0.05])
    np.testing.assert_allclose(tip(found), at, atol=1e-9)
    assert np.linalg.norm(at - expected(scene, None)) > 1e-4
    # Upright it would be elsewhere.
    plain = TipKinematics(scene.arm, uncertainty=found.uncertainty, payload=found.payload)(Q)[1]
    assert np.linalg.norm(at - plain) > 1e-4


def test_a_load_may_be_given(tmp_path: Path) -> None:
    scene = of_job(tmp_path, [2.0], ON_A_WALL)
    found = tracking(tmp_path, payload=(1.0, 0.1, 0.0, 0.0))
    np.testing.assert_allclose(tip(found), expected(scene, [1.0, 0.1, 0.0, 0.0]), atol=1e-9)


def test_several_loads_are_none_and_are_told(tmp_path: Path) -> None:
    scene = of_job(tmp_path, [0.0, 3.0], ON_A_WALL)
    found = tracking(tmp_path)
    (note,) = found.notes
    assert "loads of 0 to 3 kg" in note
    assert "--payload" in note
    np.testing.assert_allclose(tip(found), expected(scene, None), atol=1e-9)


def test_samples_without_a_load_carry_none(tmp_path: Path) -> None:
    scene = of_job(tmp_path, [], ON_A_WALL)
    found = tracking(tmp_path)
    assert (found.payload, found.notes) == (None, [])
    np.testing.assert_allclose(tip(found), expected(scene, None), atol=1e-9)


def test_a_job_that_is_gone_is_told_where_the_arm_yields(tmp_path: Path) -> None:
    scene = of_job(tmp_path, [2.0], ON_A_WALL)
    (tmp_path / "calibration.yaml").unlink()
    with pytest.raises(InputError, match="no job"):
        tracking(tmp_path)
    urdf, device = tmp_path / "calibrated.urdf", tmp_path / "device.yaml"
    (note,) = Tracking(TrackOptions(urdf, "tip", device, result=scene.path)).notes
    assert "The job of the result is not there" in note


@pytest.mark.parametrize("given", ["two", "1,2", "-1", "1,0,0,nan", "1,0,0,1e15"])
def test_what_is_no_load_is_refused(tmp_path: Path, given: str) -> None:
    urdf, device = tmp_path / "arm.urdf", tmp_path / "device.yaml"
    said = refused("track", urdf, "--tip", "tip", "--device", device, "--payload", given)
    assert "--payload" in said


def test_a_load_moves_no_stiff_arm(tmp_path: Path) -> None:
    scene = calibrated(tmp_path)
    device = tmp_path / "device.yaml"
    device.write_text(DEVICE.format(", ".join(f"{{name: {n}}}" for n in scene.nominal.joints)))
    urdf = tmp_path / "calibrated.urdf"
    options = TrackOptions(urdf, "tip", device, result=scene.path, payload=(1.0, 0, 0, 0))
    with pytest.raises(InputError, match="an arm with compliances"):
        Tracking(options)


def cell_result(folder: Path) -> tuple[Path, Path]:
    """The calibrated URDF of two arms, and a result that names its job."""
    for name in "ab":
        (folder / f"{name}.urdf").write_bytes(SUTA_URDF.read_bytes())
    samples = Samples.from_arrays(
        [f"joint_{k}" for k in range(1, 7)], np.outer(range(3), np.ones(6)), position=np.eye(3)
    )
    write_samples(folder / "samples.csv", samples)
    job = folder / "calibration.yaml"
    job.write_text(
        "robots:\n  a: {urdf: a.urdf, tip: tip}\n  b: {urdf: b.urdf, tip: tip, couplings: "
        "{joint_3: {joint_2: -1}}, pose: {position_mm: [700, 0, 0]}}\n"
        "parameters: [{select: '*.offset'}]\n"
        "observations: [{kind: tracked_point, chain: a, samples: samples.csv}]\n"
    )
    robot = CalibrationJob.load(job).arm
    assert isinstance(robot, Robot)
    urdf, result = folder / "calibrated.urdf", folder / "result.json"
    urdf.write_bytes(robot.calibrated_urdf({"b/joint_2.offset": 0.02}))
    (folder / "calibrated_b.urdf").write_bytes(SUTA_URDF.read_bytes())
    made = {str(job): hashlib.sha256(job.read_bytes()).hexdigest()}
    result.write_text(json.dumps({"run": {"inputs": made}}))
    return urdf, result


def test_a_robot_of_a_cell_is_tracked_in_the_base_of_the_first(tmp_path: Path) -> None:
    urdf, result = cell_result(tmp_path)
    device = tmp_path / "device.yaml"
    in_cell = TrackOptions(urdf, None, device, result=result, chain="b").model()
    base = TrackOptions(urdf, None, device, base="b/base_link", result=result, chain="b").model()
    assert in_cell.chain.ends == ("a/base_link", "b/tip")
    alone = ArmModel.from_urdf(SUTA_URDF, "tip")
    turned = Q - Q[1] * np.eye(6)[2]
    at = alone.forward(turned, {"joint_2.offset": 0.02})[1]
    np.testing.assert_allclose(in_cell.forward(Q)[1], at + np.array([0.7, 0, 0]), atol=1e-9)
    # Another base, with what the result says of couplings.
    assert base.chain.ends == ("b/base_link", "b/tip")
    # Its own device calls the joints as its own URDF does, and so may that of the cell.
    for names in (alone.joints, [f"a/{n}" for n in alone.joints] + [*in_cell.joints]):
        columns = matched_joints(in_cell, names)
        assert [names[k].rpartition("/")[2] for k in columns] == [*alone.joints]
    one = TrackOptions(tmp_path / "calibrated_b.urdf", None, device, result=result, chain="b")
    with pytest.raises(InputError, match=r"one robot of a cell.*give the calibrated\.urdf"):
        one.model()
