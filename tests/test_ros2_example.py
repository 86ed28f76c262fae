"""The ROS 2 node, without ROS: what it makes of the datagrams that the tracker sends."""

from __future__ import annotations

import importlib.util
import json
import sys
from hashlib import sha256
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cli_job import simulated, write_simulated_job

from suta_calib.job import CalibrationJob
from suta_calib.report import calibration_document
from suta_calib.report.files import write_document
from suta_calib.tracking.publisher import pose_dict
from suta_calib.tracking.tracker import TrackedPose


class Message:
    """Any message: every field is there, and is a message of its own until it is set."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        self.__dict__[name] = Message()
        return self.__dict__[name]


class StandInNode:
    """What the node asks of its base class."""

    def __init__(self, _: str) -> None:
        self.published: list[Message] = []

    def declare_parameter(self, name: str, value: object) -> SimpleNamespace:
        return SimpleNamespace(value=0 if name == "port" else value)

    def create_publisher(self, *_: object) -> SimpleNamespace:
        return SimpleNamespace(publish=self.published.append)

    def create_timer(self, *_: object) -> None:
        pass

    def get_clock(self) -> Message:
        clock = Message()
        clock.now = lambda: SimpleNamespace(to_msg=lambda: "now")
        return clock


@pytest.fixture
def node(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    sent: list[Message] = []
    modules = {
        "rclpy": {},
        "rclpy.node": {"Node": StandInNode},
        "geometry_msgs": {},
        "geometry_msgs.msg": dict.fromkeys(
            ("PoseWithCovarianceStamped", "TransformStamped"), Message
        ),
        "tf2_ros": {"TransformBroadcaster": lambda _: SimpleNamespace(sendTransform=sent.append)},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    path = repository / "examples/ros2/suta_pose_node.py"
    spec = importlib.util.spec_from_file_location("suta_pose_node", path)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    made = example.PoseNode()
    made.sent = sent
    yield made
    made.socket.close()


def tracked(**changes: Any) -> TrackedPose:
    fields: dict[str, Any] = {
        "sequence": 1,
        "time": 0.5,
        "host_time": 0.5,
        "valid": True,
        "position": np.array([0.1, -0.2, 0.3]),
        "quaternion": np.array([0.0, 0.6, 0.0, 0.8]),
        "std": np.array([1e-4, 2e-4, 3e-4]),
        "errors": (),
        "warnings": (),
        "shift": None,
        "shift_std": None,
    }
    return SimpleNamespace(**(fields | changes))  # type: ignore[return-value]


def test_a_pose_as_tf_and_with_its_covariance(node: Any) -> None:
    node.publish(json.loads(json.dumps(pose_dict(tracked()))))
    (transform,), (pose,) = node.sent, node.published
    assert transform.header.frame_id == pose.header.frame_id == "base_link"
    assert transform.child_frame_id == "tip"
    at, turn = transform.transform.translation, transform.transform.rotation
    assert (at.x, at.y, at.z) == (0.1, -0.2, 0.3)
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.6, 0.0, 0.8)
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    np.testing.assert_allclose(np.diag(covariance)[:3], [1e-8, 4e-8, 9e-8])
    assert np.count_nonzero(covariance) == 6


def test_datagrams_are_taken_until_there_are_none(node: Any) -> None:
    import socket

    port = node.socket.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for pose in (tracked(), tracked(valid=False), tracked(std=None)):
            sender.sendto(json.dumps(pose_dict(pose)).encode(), ("127.0.0.1", port))
    # On this computer they are there when they have been sent.
    node.receive()
    assert len(node.published) == 2
    assert np.reshape(node.published[1].pose.covariance, (6, 6))[0, 0] == 100.0
    node.receive()
    assert len(node.published) == 2


def test_the_node_that_checks_names_a_slipped_joint(
    repository: Path, tmp_path: Path, suta_urdf: Path
) -> None:
    """Its part without ROS: an arm that stands still is a row, once in each posture."""
    job = write_simulated_job(tmp_path, suta_urdf)
    result = CalibrationJob.load(job).run()
    inputs = {str(job): sha256(job.read_bytes()).hexdigest()}
    write_document(calibration_document(result), tmp_path / "results", inputs)
    spec = importlib.util.spec_from_file_location(
        "suta_check_node", repository / "examples/ros2/suta_check_node.py"
    )
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    rows = example.RowChecker(tmp_path / "results")
    later = simulated(rows.term.poses.arm, 12, seed=5)
    assert later.position is not None
    level, sentence = 0, ""
    for q, position in zip(later.q, later.position, strict=True):
        read = q + np.array([0, 0, 0.01, 0, 0, 0])
        assert rows.stands(rows.joints, read) is None
        at_rest = rows.stands(rows.joints, read + 1e-5)
        assert at_rest is not None
        level, sentence = rows.take(at_rest, position.tolist(), [0.0, 0.0, 0.0, 1.0])
        assert rows.stands(rows.joints, read) is None
        if level:
            break
    assert level == 2
    assert "joint_3" in sentence
