"""From a recording with pictures to a calibrated arm, by the commands a user types."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from ros_recordings import write_recording
from scipy.spatial.transform import Rotation
from vision_scenes import CAMERA, CHESSBOARD, facing

from suta_calib.arrays import FloatArray
from suta_calib.geometry import projected
from suta_calib.geometry.numbers import homogeneous
from suta_calib.measurements import write_board
from suta_calib.model.arm import ArmModel
from suta_calib.vision import RenderOptions, rendered

pytest.importorskip("rosbags")
pytest.importorskip("cv2")

TRUTH = {"joint_2.offset": 0.01, "joint_3.offset": -0.008}
MIDDLE = np.array([0.1, -0.6, 1.2, 0.1, 0.9, 0.2])
HAND_EYE = homogeneous(
    Rotation.from_rotvec([0.05, -0.03, 1.5]).as_matrix(), np.array([0.03, -0.05, 0.04])
)
# Corners nearer to a picture's rim than this, px, have no room for their squares.
RIM = 15.0


def seen_from(arm: ArmModel, count: int) -> tuple[FloatArray, FloatArray]:
    """Postures (count, joints) from which the whole board is seen, and ``T_camera_board``."""
    around = np.random.default_rng(0).uniform(-0.35, 0.35, (300, len(MIDDLE)))
    q = np.vstack([MIDDLE, MIDDLE + around])
    rotation, position = arm.forward(q, TRUTH)
    eye = np.array([homogeneous(*each) for each in zip(rotation, position, strict=True)]) @ HAND_EYE
    board = np.linalg.inv(eye) @ (eye[0] @ facing(CHESSBOARD))
    corners = np.array(list(CHESSBOARD.points.values()))
    points = np.einsum("nij,kj->nki", board[:, :3, :3], corners) + board[:, None, :3, 3]
    pixels = projected(points, CAMERA.intrinsics)
    inside = (pixels > RIM) & (pixels < np.array([CAMERA.width, CAMERA.height]) - RIM)
    whole = np.flatnonzero(inside.all(axis=(1, 2)) & (points[..., 2] > 0.2).all(axis=1))[:count]
    assert len(whole) == count
    return q[whole], board[whole]


def test_import_detect_calibrate(tmp_path: Path, repository: Path) -> None:
    """The job that `init` writes takes the files as the other commands leave them."""
    urdf, job = repository / "examples/camera_on_arm/arm.urdf", tmp_path / "job"
    arm = ArmModel.from_urdf(urdf, "hand")
    assert cli("init", urdf, "--tip", "hand", "--kind", "camera_view", "--out", job) == 0
    write_board(job / "board.yaml", CHESSBOARD)
    q, board = seen_from(arm, 16)
    random = np.random.default_rng(1)
    greys = [rendered(CHESSBOARD, CAMERA, T, random, RenderOptions(samples=4)) for T in board]
    for name, rows in (("calibration", slice(12)), ("validation", slice(12, None))):
        recording = write_recording(
            tmp_path / f"bag_{name}",
            encoding="mono8",
            joints=arm.joints,
            postures=q[rows],
            taken=(CAMERA, greys[rows]),
            parted=True,
        )
        out = job / name / "samples.csv"
        assert cli("import", recording, "--image-topic", "/camera/image_raw", "--out", out) == 0
    camera = job / "calibration/samples_camera.yaml"
    folders = [job / name / "samples_images" for name in ("calibration", "validation")]
    options = ["--board", job / "board.yaml", "--camera", camera, "--out", job / "corners.csv"]
    assert cli("detect", *folders, *options) == 0
    text = (job / "calibration.yaml").read_text().replace("camera.yaml", f"{camera}")
    lines = [line for line in text.splitlines() if "select: geometric" not in line]
    (job / "calibration.yaml").write_text("\n".join(lines).replace("starts: 8", "starts: 1"))
    assert cli("calibrate", job / "calibration.yaml", "--no-report") == 0
    found = json.loads((job / "results/result.json").read_text())
    assert found["verdict"]["usable"]
    for name, value in TRUTH.items():
        entry = found["parameters"][name]
        assert entry["state"] == "identified"
        assert abs(entry["value"] - value) < 4 * entry["std"]
    metrics = found["metrics"]["validation"]
    assert metrics["after"]["rms_px"] < 0.2 < metrics["before"]["rms_px"]
