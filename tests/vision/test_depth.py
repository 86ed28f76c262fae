"""Corners in 3-D from pictures of depth: against the truth, and with bad files."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture

from suta_calib.cli._app import run
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import homogeneous, rotation_from_vector
from suta_calib.measurements import Camera, Chessboard, write_board, write_camera
from suta_calib.measurements.depth_noise import DepthNoise
from suta_calib.measurements.seen_points import read_seen_points
from suta_calib.vision import PictureFile, find_depth, read_depth, rendered, rendered_depth
from suta_calib.vision.depth import corners_in_depth

cv2 = pytest.importorskip("cv2")

BOARD = Chessboard(7, 6, 0.03)
CAMERA = Camera(640, 480, np.array([600.0, 602, 321, 238, -0.05, 0.01, 5e-4, -3e-4, 0.0]))
NOISE = DepthNoise((5e-4, 1e-3), 1e-4)


def pose(seed: int) -> np.ndarray:
    """A board some way ahead, tilted."""
    rng = np.random.default_rng(seed)
    turn = rotation_from_vector([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.3, 0.3)])
    middle = np.array([0.09, 0.06, 0.0])
    place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.4, 0.7)])
    return homogeneous(turn, place - turn @ middle)


def corners(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners in the camera, and where the picture has them."""
    points = np.array([*BOARD.points.values()]) @ T[:3, :3].T + T[:3, 3]
    return points, CAMERA.project(points)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five pictures with their depth in whole millimetres, some of it missing."""
    out, rng = tmp_path_factory.mktemp("depth"), np.random.default_rng(0)
    (out / "colour").mkdir()
    (out / "depth").mkdir()
    write_board(out / "board.yaml", BOARD)
    write_camera(out / "camera.yaml", CAMERA)
    for k in range(5):
        cv2.imwrite(str(out / f"colour/color_{k}.png"), rendered(BOARD, CAMERA, pose(k), rng))
        depth = np.round(1000 * rendered_depth(BOARD, CAMERA, pose(k), rng, NOISE))
        depth[rng.random(depth.shape) < 0.05] = 0
        cv2.imwrite(str(out / f"depth/depth_{k}.png"), depth.astype(np.uint16))
    return out


def detected(folder: Path, *more: object, depth: str = "depth") -> list[str]:
    paths = [
        folder / "colour",
        "--board",
        folder / "board.yaml",
        "--camera",
        folder / "camera.yaml",
    ]
    return [str(each) for each in ("detect", *paths, "--depth", folder / depth, *more)]


def copied(folder: Path, name: str, change: object) -> None:
    """The depth again, changed."""
    (folder / name).mkdir()
    for file in sorted((folder / "depth").iterdir()):
        picture = change(cv2.imread(str(file), cv2.IMREAD_UNCHANGED))  # type: ignore[operator]
        cv2.imwrite(str(folder / name / file.name), picture)


def test_corners_are_where_they_are(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "points.csv"
    assert run(detected(folder, "--points-out", out, "--json")) == 0
    answer, points = json.loads(capsys.readouterr().out), read_seen_points(out)
    assert answer["points"] == len(points) == 210
    assert answer["points_size"] == pytest.approx(1.0, abs=2e-3)
    assert answer["verdict"]["level"] == "good", answer["verdict"]
    errors = []
    for k in range(5):
        truth, _ = corners(pose(k))
        mine = points.image == f"color_{k}.png"
        errors.append(points.position[mine] - truth[points.point[mine].astype(int)])
    # A pixel scatters by 0.8 mm; some hundred of them tell a corner.
    assert np.sqrt(np.mean(np.square(np.concatenate(errors)[:, 2]))) < 2e-4
    assert answer["points_rms_mm"] < 0.3


def test_a_plane_is_better_than_a_pixel_and_than_their_mean() -> None:
    """Of a tilted board whose edge is near, with holes and flying pixels."""
    rng, T = np.random.default_rng(1), pose(3)
    truth, pixels = corners(T)
    depth = rendered_depth(BOARD, CAMERA, T, rng, NOISE)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    flying = rng.random(depth.shape) < 0.1
    depth[flying] += rng.uniform(0.05, 0.5, flying.sum())
    points, reasons = corners_in_depth(depth, pixels, CAMERA)
    assert not any(reasons)
    assert np.abs(points - truth)[:, 2].max() < 1e-3


def test_a_corner_beside_a_hole_is_left_out() -> None:
    rng, T = np.random.default_rng(1), pose(3)
    truth, pixels = corners(T)
    depth = rendered_depth(BOARD, CAMERA, T, rng, NOISE)
    u, v = np.round(pixels[10]).astype(int)
    # All about the corner, and half of what is about another.
    depth[v - 15 : v + 16, u - 15 : u + 16] = np.nan
    points, reasons = corners_in_depth(depth, pixels, CAMERA)
    assert "no depth" in reasons[10]
    assert np.isnan(points[10]).all()
    there = np.isfinite(points[:, 2])
    assert there.sum() >= 26
    assert np.abs(points - truth)[there, 2].max() < 1.5e-3


def test_smaller_depth_of_the_same_picture(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    copied(folder, "half", lambda picture: picture[::2, ::2])
    assert run(detected(folder, "--json", depth="half")) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["points"] == 210
    assert answer["points_rms_mm"] < 1.0


@pytest.mark.parametrize(
    ("name", "change", "more", "words"),
    [
        ("wide", lambda p: p[:, :600], (), "align the depth with the colour first"),
        ("metres", lambda p: p, ("--depth-unit", "m"), "seems to be in mm, where m are expected"),
        ("float-mm", lambda p: p.astype(np.float32), (), "seems to be in mm, where m are"),
        ("mirrored", lambda p: p[:, ::-1], (), "seems to be mirrored left to right"),
        ("coloured", lambda p: (p / 16).astype(np.uint8), (), "coloured to be looked at"),
        ("empty", lambda p: 0 * p, (), "no depth at any corner"),
    ],
)
def test_depth_that_cannot_be_used_is_named(
    name: str, change: object, more: tuple[str, ...], words: str, folder: Path, capsys: Capture
) -> None:
    if name == "float-mm":
        (folder / name).mkdir()
        for file in sorted((folder / "depth").iterdir()):
            picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(folder / name / f"{file.stem}.tif"), picture.astype(np.float32))
    else:
        copied(folder, name, change)
    assert run(detected(folder, *more, depth=name)) == 2
    assert words in capsys.readouterr().err


def test_another_scale_is_said(folder: Path, capsys: Capture) -> None:
    copied(folder, "long", lambda picture: np.round(1.02 * picture).astype(np.uint16))
    assert run(detected(folder, "--json", depth="long")) == 0
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert verdict["level"] == "care"
    assert any(re.search(r"The board is seen 2\.\d+% ± .* too large", n) for n in verdict["notes"])


def test_files_belong_together_by_name(tmp_path: Path) -> None:
    for name in ("rgb_01_depth.png", "rgb_02_depth.npy"):
        (tmp_path / name).write_bytes(b"")
    pictures = [PictureFile(n, Path(n)) for n in ("rgb_01_color.png", "rgb_02.jpg", "rgb_3.jpg")]
    found = find_depth(pictures, tmp_path)
    assert [path.name for path in found.values()] == ["rgb_01_depth.png", "rgb_02_depth.npy"]
    with pytest.raises(InputError, match="the same names"):
        find_depth(pictures[2:], tmp_path)
    with pytest.raises(InputError, match="no folder of depth"):
        find_depth(pictures, tmp_path / "none")
    (tmp_path / "depth_rgb_01.tif").write_bytes(b"")
    with pytest.raises(InputError, match="several files of depth"):
        find_depth(pictures, tmp_path)


def test_arrays_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.array([[0.5, np.nan], [0.0, -1.0]]))
    np.testing.assert_array_equal(read_depth(path), [[0.5, np.nan], [np.nan, np.nan]])
    np.save(path, np.array([[500, 65535]], dtype=np.uint16))
    np.testing.assert_allclose(read_depth(path), [[0.5, np.nan]])
    np.testing.assert_allclose(read_depth(path, 2e-4), [[0.1, np.nan]])
    path.write_bytes(b"no array")
    with pytest.raises(InputError, match="cannot be read"):
        read_depth(path)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--points-out", "p.csv"), "need the folder of the depth"),
        (("--depth", ".", "--depth-unit", "inch"), "expected mm, m, or the m of a step"),
    ],
)
def test_options_that_do_not_go_together(
    more: tuple[str, ...], words: str, folder: Path, capsys: Capture
) -> None:
    line = ["detect", str(folder / "colour"), "--board", str(folder / "board.yaml"), *more]
    assert run(line) == 2
    assert words in capsys.readouterr().err
