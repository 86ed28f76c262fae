"""hand-eye from the pictures of several cameras, told apart by name or by a column."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_scenes import SECOND, Pictures, X, Z, pictures, write_hand
from cli_job import answer, refused

from suta_calib.geometry.numbers import homogeneous
from suta_calib.measurements import write_board, write_camera
from suta_calib.measurements.corners import corners_text


@pytest.fixture(scope="module")
def scene() -> Pictures:
    """Two cameras on one hand, that take pictures of one name at every pose."""
    return pictures(14, pixel=0.1, eyes=(X, SECOND))


def named(scene: Pictures, folder: Path, eyes: list[str]) -> list[object]:
    """One file of corners with columns eye and target, and files by name."""
    rows = ["image,point,u,v,eye,target"]
    for view, eye in zip(scene.views, eyes, strict=True):
        rows += [f"{row},{eye},wall" for row in corners_text(view.corners).splitlines()[1:]]
        assert view.camera is not None
        write_camera(folder / f"{eye}.yaml", view.camera)
    (folder / "corners.csv").write_text("\n".join(rows) + "\n")
    write_board(folder / "board.yaml", scene.views[0].board)
    write_hand(folder / "poses.csv", scene.hand)
    cameras: list[object] = []
    for eye in eyes:
        cameras += ["--camera", f"{eye}={folder / eye}.yaml"]
    board = f"wall={folder / 'board.yaml'}"
    return [folder / "poses.csv", "--corners", folder / "corners.csv", "--board", board, *cameras]


def check(found: dict[str, Any]) -> None:
    assert set(found["X"]) == set(found["std"]["X"]) == {"left", "right"}
    assert set(found["Z"]) == set(found["std"]["Z"]) == {"wall"}
    for pose, true in ((found["X"]["left"], X), (found["X"]["right"], SECOND)):
        np.testing.assert_allclose(pose, homogeneous(*true), atol=3e-3)
    np.testing.assert_allclose(found["Z"]["wall"], homogeneous(*Z), atol=3e-3)
    assert found["cameras"]["left"]["reprojection_rms_px"] < 0.2
    assert found["counts"]["images"] == 28


def test_one_file_of_corners_names_cameras_and_boards(scene: Pictures, tmp_path: Path) -> None:
    check(answer("hand-eye", *named(scene, tmp_path, ["left", "right"])))


def test_a_board_seen_twice_by_a_camera_is_left_out(scene: Pictures, tmp_path: Path) -> None:
    """Two pictures of another board, of which the camera tells too little."""
    options = named(scene, tmp_path, ["left", "right"])
    file = tmp_path / "corners.csv"
    rows = file.read_text().splitlines()
    moved = [
        row.replace("wall", "floor") if row[:3] in ("000", "001") and "left" in row else row
        for row in rows
    ]
    file.write_text("\n".join(moved) + "\n")
    floor = f"floor={tmp_path / 'board.yaml'}"
    found = answer("hand-eye", *options, "--board", floor)
    assert set(found["Z"]) == {"wall"}
    notes = found["verdict"]["notes"]
    assert any("left saw target floor in 2 usable pictures" in note for note in notes)


def test_rows_may_be_of_one_camera_each(scene: Pictures, tmp_path: Path) -> None:
    """Both cameras call their pictures alike; a column says whose pose a row is."""
    options = named(scene, tmp_path, ["left", "right"])
    head, *rows = (tmp_path / "poses.csv").read_text().splitlines()
    both = [f"{row},{eye}" for row in rows for eye in ("left", "right")]
    (tmp_path / "poses.csv").write_text("\n".join([f"{head},eye", *both]) + "\n")
    check(answer("hand-eye", *options))


def test_a_camera_that_cannot_be_determined_has_no_number(scene: Pictures, tmp_path: Path) -> None:
    """The right camera looked from one pose of the hand only: the left one keeps its X."""
    options = named(scene, tmp_path, ["left", "right"])
    file, poses = tmp_path / "corners.csv", tmp_path / "poses.csv"
    rows = file.read_text().splitlines()
    left = [row for row in rows if ",right," not in row]
    once = [row.split(",") for row in rows if row.startswith("000.png") and ",right," in row]
    random = np.random.default_rng(1)
    for k in range(8):
        for _, point, u, v, eye, target in once:
            at = (float(u) + 0.1 * random.normal(), float(v) + 0.1 * random.normal())
            left.append(f"still{k}.png,{point},{at[0]},{at[1]},{eye},{target}")
    file.write_text("\n".join(left) + "\n")
    lines = poses.read_text().splitlines()
    _, x, *pose = lines[1].split(",")
    lines += [",".join([f"still{k}.png", str(float(x) + 1e-5 * (k + 1)), *pose]) for k in range(8)]
    poses.write_text("\n".join(lines) + "\n")
    found = answer("hand-eye", *options, "--out", tmp_path / "out")
    np.testing.assert_allclose(found["X"]["left"], homogeneous(*X), atol=3e-3)
    assert found["X"]["right"] is None
    assert found["std"]["X"]["right"] is None
    assert not found["cameras"]["right"]["usable"]
    assert found["cameras"]["right"]["undetermined"]
    assert found["cameras"]["left"]["usable"]
    notes = found["verdict"]["notes"]
    assert notes[0].startswith("X of camera right could not be determined and is not given")


def test_exchanged_cameras_are_named(scene: Pictures, tmp_path: Path) -> None:
    late = [np.isin(view.corners.image, scene.hand.image[7:]) for view in scene.views]
    parts = [
        (view.corners.take(~at), view.corners.take(at))
        for view, at in zip(scene.views, late, strict=True)
    ]
    views = []
    for k, view in enumerate(scene.views):
        (before, _), (_, after) = parts[k], parts[1 - k]
        corners = replace(
            before,
            image=np.concatenate([before.image, after.image]),
            point=np.concatenate([before.point, after.point]),
            pixel=np.concatenate([before.pixel, after.pixel]),
            lines=(),
        )
        views.append(replace(view, corners=corners))
    said = refused(
        "hand-eye", *named(replace(scene, views=tuple(views)), tmp_path, ["left", "right"])
    )
    assert f"eyes left and right are exchanged from picture {scene.hand.image[7]} on:" in said


def test_names_that_do_not_fit_are_told(scene: Pictures, tmp_path: Path) -> None:
    options = named(scene, tmp_path, ["left", "right"])
    camera = f"lefft={tmp_path / 'left.yaml'}"
    said = refused("hand-eye", *options[:5], "--camera", camera)
    assert "--camera lefft; expected EYE=FILE of one of left, right" in said
    board = f"floor={tmp_path / 'board.yaml'}"
    said = refused("hand-eye", *options[:3], "--board", board)
    assert "target wall, and --board of floor" in said
    said = refused("hand-eye", *options[:5], "--camera", f"left={tmp_path / 'left.yaml'}")
    assert "no --camera of right" in said
