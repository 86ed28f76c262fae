"""An answer of `hand-eye`, `pivot` or `register` is checked by new poses, as by rows of a job."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import CAMERA, pictures
from cli_job import answer, cli, refused
from pose_scenes import PAIR, POSE, pair_numbers, pivot_numbers, point_numbers, write_csv
from scipy.spatial.transform import Rotation

from suta_calib.measurements import write_board, write_camera, write_corners

pytestmark = pytest.mark.usefixtures("undrawn")
MOVED = np.array([1e-3, 0.0, 0.0])


def pairs(folder: Path, name: str, count: int, seed: int, setup: str) -> Path:
    return write_csv(folder / name, PAIR, pair_numbers(count, setup, seed))


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_camera_that_was_moved_is_named(tmp_path: Path, setup: str) -> None:
    out = tmp_path / "hand_eye"
    given = pairs(tmp_path, "poses.csv", 25, 1, setup)
    assert cli("hand-eye", given, "--setup", setup, "--out", out) == 0
    new = pairs(tmp_path, "new.csv", 6, 2, setup)
    sound = answer("check", out, new, "--no-history")
    assert sound["unchanged"]
    assert {power["what"] for power in sound["power"]} >= {"camera", "board"}
    numbers = pair_numbers(6, setup, 2)
    numbers[:, 7:10] += MOVED
    moved = write_csv(tmp_path / "moved.csv", PAIR, numbers)
    (change,) = answer("check", out, moved, "--no-history", code=1)["changed"]
    assert change["what"] == "camera"
    assert change["by_mm"] == pytest.approx(1.0, abs=4 * change["std_mm"])


def test_a_camera_is_checked_by_pictures(tmp_path: Path) -> None:
    """Of a `hand-eye` of corners: the rest of its pictures, in which the camera was turned."""
    scene = pictures(22, pixel=0.1, robot=(1e-4, 1e-4), seed=1)
    (view,) = scene.views
    R, p = scene.hand.pose
    numbers = np.hstack([p, Rotation.from_matrix(R).as_quat()])
    files = tmp_path / "poses.csv", tmp_path / "new.csv"
    columns = (*PAIR[:7], "image")
    for file, rows in zip(files, (slice(0, 16), slice(16, 22)), strict=True):
        write_csv(file, columns, numbers[rows], scene.hand.image[rows].tolist())
    write_board(tmp_path / "board.yaml", view.board)
    write_camera(tmp_path / "camera.yaml", CAMERA)
    write_corners(tmp_path / "corners.csv", view.corners)
    turned = replace(view.corners, pixel=view.corners.pixel + np.array([4.0, 0.0]))
    write_corners(tmp_path / "turned.csv", turned)
    given = ["hand-eye", files[0], "--out", tmp_path / "hand_eye"]
    for option, name in (("corners", "csv"), ("board", "yaml"), ("camera", "yaml")):
        given += [f"--{option}", tmp_path / f"{option}.{name}"]
    assert cli(*given) == 0
    new = "check", tmp_path / "hand_eye", files[1]
    assert answer(*new, tmp_path / "corners.csv")["unchanged"]
    (change,) = answer(*new, tmp_path / "turned.csv", code=1)["changed"]
    assert change["what"] == "camera"
    assert "CORNERS.csv or pictures" in refused(*new)


def test_a_tip_that_was_bent_is_named_wherever_the_post_stands(tmp_path: Path) -> None:
    given = write_csv(tmp_path / "poses.csv", POSE, pivot_numbers(["left"] * 30, 1))
    assert cli("pivot", given, "--out", tmp_path / "pivot") == 0
    numbers = pivot_numbers(["right"] * 10, 2)
    new = write_csv(tmp_path / "new.csv", POSE, numbers)
    assert answer("check", tmp_path / "pivot", new)["unchanged"]
    # Another probe, a millimetre longer along the tool's axis.
    x, y, z, w = numbers[:, 3:].T
    axis = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    numbers[:, :3] -= 1e-3 * np.stack(axis, axis=1)
    longer = write_csv(tmp_path / "longer.csv", POSE, numbers)
    (change,) = answer("check", tmp_path / "pivot", longer, code=1)["changed"]
    assert change["what"] == "tip"
    assert change["by_mm"] == pytest.approx(1.0, abs=4 * change["std_mm"])


def test_an_instrument_that_was_moved_is_told_by_points(tmp_path: Path) -> None:
    def points(name: str, count: int, seed: int, moved: np.ndarray) -> list[Path]:
        a, b = point_numbers(count, seed)
        files = zip("ab", (a, b + moved), strict=True)
        return [write_csv(tmp_path / f"{name}_{of}.csv", POSE[:3], rows) for of, rows in files]

    out = tmp_path / "registered"
    assert cli("register", *points("first", 20, 1, np.zeros(3)), "--out", out) == 0
    assert answer("check", out, *points("sound", 6, 2, np.zeros(3)))["unchanged"]
    (change,) = answer("check", out, *points("moved", 6, 2, MOVED), code=1)["changed"]
    assert change["what"] == "instrument"
    assert "found 1 file" in refused("check", out, tmp_path / "sound_a.csv")


def test_what_cannot_be_checked_is_said(tmp_path: Path) -> None:
    out = tmp_path / "hand_eye"
    given = pairs(tmp_path, "poses.csv", 25, 1, "eye-in-hand")
    new = pairs(tmp_path, "new.csv", 6, 2, "eye-in-hand")
    assert cli("hand-eye", given, "--out", out) == 0
    assert "run suta-calib hand-eye again" in refused(
        "check", out, new, "--repair", "--out", tmp_path / "repaired"
    )
    given.write_text(new.read_text())
    assert "was changed since" in refused("check", out, new)
    given.unlink()
    assert "no file" in refused("check", out, new)
