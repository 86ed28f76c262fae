"""`suta-calib hand-eye` with pictures: what it answers, writes, says and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import CAMERA, X, pictures
from cli_job import Capture, answer, cli

from suta_calib.measurements import corners_of, read_camera, write_corners


def test_the_command_answers_and_writes(tmp_path: Path) -> None:
    options = pictures(14, pixel=0.1).written(tmp_path)
    out = tmp_path / "out"
    found = answer("hand-eye", *options, "--model", "AX=ZB", "--out", out)
    assert found["frames"] == {"X": "T_hand_eye", "Z": "T_base_target"}
    assert np.linalg.norm(np.array(found["X"])[:3, 3] - X[1]) < 2e-3
    assert 0.1 < found["reprojection_rms_px"] < 0.2
    assert found["outliers"] == []
    assert found["counts"]["images"] == 14
    camera = found["camera"]
    assert camera["fx"] == pytest.approx(1000.0, abs=5.0)
    assert len(camera["distortion"]) == len(camera["std"]["distortion"]) == 5
    assert 0.0 < camera["std"]["fx"] < 5.0
    assert {p.name for p in out.iterdir()} == {
        *("residuals.csv", "hand_eye.svg", "result.json", "report.html", "camera.yaml")
    }
    written = read_camera(out / "camera.yaml")
    assert written.covariance is not None
    assert written.intrinsics[0] == pytest.approx(camera["fx"])
    run = json.loads((out / "result.json").read_text())["run"]
    assert {Path(name).name for name in run["inputs"]} == {
        *("poses.csv", "corners.csv", "board.yaml", "camera.yaml")
    }


def test_the_screen_says_what_counts(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    options = pictures(14, pixel=0.1, setup="eye-to-hand").written(tmp_path)
    assert cli("hand-eye", *options, "--setup", "eye-to-hand", "--intrinsics", "fixed") == 0
    said, err = capsys.readouterr()
    assert err == ""
    assert max(map(len, said.splitlines())) <= 80
    assert "X = T_base_eye" in said
    assert "reprojection rms 0.1" in said
    assert "14 of 14 pictures fitted" in said
    assert "Intrinsics" not in said


def test_of_pictures_the_start_is_proven(tmp_path: Path, capsys: Capture) -> None:
    options = pictures(14, pixel=0.1).written(tmp_path)
    assert cli("hand-eye", *options, "--certify") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Not proven best: reprojection errors have no convex bound." in said
    assert "The start is proven best" in said
    assert "The reprojection errors lead from there to this answer." in said


def test_of_two_cameras_each_start_is_proven(tmp_path: Path) -> None:
    options = pictures(14, pixel=0.1).written(tmp_path)
    again = tmp_path / "again.csv"
    again.write_bytes((tmp_path / "corners.csv").read_bytes())
    options = [*options, "--corners", again, "--camera", tmp_path / "camera.yaml"]
    proven = answer("hand-eye", *options, "--certify")["optimality"]
    assert proven["certified"] is False
    assert proven["poses_certified"] is True
    assert proven["poses_gap"] < 1e-9
    assert proven["reached"] is True


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--board", "b.yaml"], "need --corners"),
        (["--corners", "c.csv"], "--corners needs --board"),
        (["--corners", "c.csv", "--board", "b.yaml", "--intrinsics", "fixed"], "needs --camera"),
        (
            ["--corners", "c.csv", "--corners", "d.csv", "--board", "b", "--camera", "k"],
            "1 --camera for 2 --corners",
        ),
        (["--lens", "equidistant"], "need --corners"),
        (
            ["--corners", "c.csv", "--board", "b.yaml", "--camera", "k", "--lens", "plumb_bob"],
            "give either --camera or --lens",
        ),
        (["--corners", "c.csv", "--board", "b.yaml"], "found no such file"),
    ],
)
def test_options_that_do_not_go_together(
    options: list[str], said: str, tmp_path: Path, capsys: Capture
) -> None:
    assert cli("hand-eye", tmp_path / "poses.csv", *options) == 2
    assert said in capsys.readouterr().err


def test_a_corner_outside_the_cameras_picture_is_refused(tmp_path: Path, capsys: Capture) -> None:
    scene = pictures()
    options = scene.written(tmp_path)
    corners = scene.views[0].corners
    outside = corners_of(corners.image, corners.point, np.add(corners.pixel, [900.0, 0.0]))
    write_corners(tmp_path / "corners.csv", outside)
    assert cli("hand-eye", *options) == 2
    err = capsys.readouterr().err
    assert "corners.csv:" in err
    assert f"a corner in the picture, which is {CAMERA.width} x {CAMERA.height} px" in err
