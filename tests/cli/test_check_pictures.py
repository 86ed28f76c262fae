"""A job with the poses of a target is checked by pictures of it: their own poses of the board."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from camera_job import CAMERA, SIMULATION
from cli_job import answer, cli, refused

from suta_calib.check.target_poses import with_target_poses
from suta_calib.measurements import (
    Chessboard,
    read_board,
    read_camera,
    read_corners,
    write_board,
    write_corners,
)

pytestmark = pytest.mark.usefixtures("undrawn")
JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters: [{select: ["joint_[2-5].offset"], bound_deg: 5}]
observations: [{kind: hand_eye, samples: seen.csv}]
"""


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """A job whose samples are the poses of a board, and pictures of another day."""
    folder = tmp_path_factory.mktemp("pictures")
    (folder / "arm.urdf").write_bytes(suta_urdf.read_bytes())
    (folder / "camera.yaml").write_text(CAMERA)
    write_board(folder / "board.yaml", Chessboard(7, 5, 0.03))
    (folder / "simulation.yaml").write_text(
        SIMULATION.replace(", {select: [joint_4.z], std_mm: 1}", "")
    )
    assert cli("simulate", folder / "simulation.yaml", "--out", folder) == 0
    (first,) = (folder / "calibration").glob("*.csv")
    given = read_board(folder / "board.yaml"), read_camera(folder / "camera.yaml")
    (folder / "made").mkdir()
    made = with_target_poses(first, folder / "corners" / "calibration.csv", *given, folder / "made")
    made.rename(folder / "seen.csv")
    (folder / "job.yaml").write_text(JOB)
    assert cli("calibrate", folder / "job.yaml") == 0
    (later,) = (folder / "validation").glob("*.csv")
    later.rename(folder / "later.csv")
    return folder


def test_pictures_are_read_as_poses_of_the_board(calibrated: Path) -> None:
    corners = calibrated / "corners" / "validation.csv"
    files = calibrated / "results", calibrated / "later.csv"
    given = "--board", calibrated / "board.yaml", "--camera", calibrated / "camera.yaml"
    assert answer("check", *files, corners, *given)["unchanged"]
    seen = read_corners(corners)
    # A camera that was turned sees everything beside where it was.
    write_corners(calibrated / "turned.csv", type(seen)(seen.image, seen.point, seen.pixel + 4.0))
    (change,) = answer("check", *files, calibrated / "turned.csv", *given, code=1)["changed"]
    # What carries the camera moves it as well.
    assert "camera" in (change["what"], *change["instead"])
    assert change["by_deg"] == pytest.approx(np.degrees(np.hypot(4, 4) / 1000), rel=0.3)
    assert "--camera" in refused("check", *files, corners)
