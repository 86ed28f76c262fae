"""Planes in clouds: against the truth, and with clouds that cannot be used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from cli_job import Capture
from plane_clouds import DISTANCE, NORMAL, cloud, points_of

from suta_calib.cli._app import run
from suta_calib.geometry.cloud_plane import CloudPlane, plane_in
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements.seen_points import read_seen_points


def seen(points: np.ndarray) -> CloudPlane:
    plane = plane_in(points)
    assert plane is not None
    return plane


def squares(plane: CloudPlane, normal: np.ndarray, distance: float) -> float:
    """Mean squared heights of the marks over the true plane, over their variance."""
    return float(np.mean(((plane.marks @ normal - distance) / plane.sigma) ** 2))


def tilted(seed: int) -> np.ndarray:
    turn = np.append(np.random.default_rng(seed).uniform(-0.5, 0.5, 2), 0.0)
    return np.asarray(rotation_from_vector(turn)[:, 2])


@pytest.mark.parametrize("smooth", [0, 2])
def test_the_spread_of_a_plane_is_true(smooth: int) -> None:
    """Also where neighbours err together, so that ± is larger than the scatter alone says."""
    found = []
    for seed in range(12):
        normal = tilted(seed)
        plane = seen(points_of(cloud(normal, seed=seed, smooth=smooth)))
        assert plane.distance == pytest.approx(DISTANCE, abs=1e-3)
        found.append(squares(plane, normal, DISTANCE))
    assert 0.4 < np.mean(found) < 2.0


def test_noise_by_distance_is_learnt() -> None:
    plane = seen(points_of(cloud(tilted(3), noise=2e-3)))
    a, b = plane.noise
    # Along the ray it is longer than along z by at most a tenth.
    assert a + b * DISTANCE**2 == pytest.approx(2e-3 * DISTANCE**2, rel=0.15)


def flying(points: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(2)
    wrong = rng.random(len(points)) < 0.1
    return np.asarray(
        np.where(wrong[:, None], points * rng.uniform(0.8, 1.2, (len(points), 1)), points)
    )


@pytest.mark.parametrize(
    "spoilt",
    [
        flying,
        lambda p: p[p[:, 0] > 0.0],
        lambda p: p[np.abs(p[:, 0]) > 0.08],
        lambda p: p[np.random.default_rng(1).permutation(len(p))[:3000]],
        lambda p: np.round(p, 3),
    ],
    ids=["flying points", "half empty", "cut in its middle", "in any order", "whole mm"],
)
def test_what_is_wrong_with_a_cloud_does_no_harm(spoilt: Any) -> None:
    plane = seen(spoilt(points_of(cloud(seed=4))))
    assert np.abs(plane.marks @ NORMAL - DISTANCE).max() < 3e-4
    assert np.degrees(np.arccos(min(plane.normal @ NORMAL, 1.0))) < 0.1


def test_things_on_a_table_are_not_the_table() -> None:
    points = points_of(cloud(seed=5))
    box = np.abs(points[:, :2] - [0.05, 0.02]).max(axis=1) < 0.08
    points[box] *= 0.85
    plane = seen(points)
    assert squares(plane, NORMAL, DISTANCE) < 10.0
    assert plane.rival < 0.5


def test_exact_points_are_a_plane() -> None:
    plane = seen(points_of(cloud(noise=0.0)))
    np.testing.assert_allclose(plane.normal, NORMAL, atol=1e-6)
    assert plane.sigma < 1e-5


def test_what_is_no_plane_is_not_taken_for_one() -> None:
    assert plane_in(np.zeros((0, 3))) is None
    rng = np.random.default_rng(0)
    assert plane_in(rng.uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 1.2], (4000, 3))) is None
    towards = rng.standard_normal((6000, 3))
    towards /= -np.linalg.norm(towards, axis=1, keepdims=True) * np.sign(towards[:, 2:])
    ball = np.array([0.0, 0.0, 0.6]) + 0.05 * towards + 2e-4 * rng.standard_normal((6000, 3))
    assert plane_in(ball) is None


# ── the command ──────────────────────────────────────────────────────────────────────────────
def test_clouds_become_planes(tmp_path: Path, capsys: Capture) -> None:
    folder, out = tmp_path / "clouds", tmp_path / "planes.csv"
    folder.mkdir()
    normals = [tilted(k) for k in range(2)]
    for k, normal in enumerate(normals):
        points = cloud(normal, seed=k)
        points[:20] = np.nan
        points[20:30] = 0.0
        np.save(folder / f"{k}.npy", points)
    given = ["planes", str(folder), "--name", "table", "--out", str(out)]
    assert run([*given, "--json", "--report", str(tmp_path)]) == 0
    answer = json.loads(capsys.readouterr().out)
    points = read_seen_points(out, "plane", once=False)
    assert answer["found"] == answer["clouds"] == 2
    assert answer["verdict"]["level"] == "good", answer["verdict"]
    assert [row["dropped"] for row in answer["planes"]] == [3600, 3600]
    assert "33% of all points had no place" in (tmp_path / "report.html").read_text()
    assert points.image.tolist() == ["0.npy"] * 3 + ["1.npy"] * 3
    assert set(points.point.tolist()) == {"table"}
    for k, normal in enumerate(normals):
        row = answer["planes"][k]
        assert row["distance_mm"] == pytest.approx(1000 * DISTANCE, abs=0.5)
        np.testing.assert_allclose(row["normal"], normal, atol=2e-3)
        assert 0 < row["std_mm"] < 0.1
        assert 0 < row["tilt_std_deg"] < 0.1


def test_another_plane_that_is_as_large_is_said_and_cut_off(
    tmp_path: Path, capsys: Capture
) -> None:
    np.save(tmp_path / "a.npy", cloud(radius=0.17, behind=1.2))
    assert run(["planes", str(tmp_path / "a.npy"), "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert "another plane is nearly as large" in verdict["notes"][0]
    assert run(["planes", str(tmp_path / "a.npy"), "--json", "--range", "200", "900"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert not answer["verdict"]["notes"]
    assert answer["planes"][0]["distance_mm"] == pytest.approx(1000 * DISTANCE, abs=0.5)


CAMERA = """\
image_width: {0}
image_height: {1}
camera_matrix: {{rows: 3, cols: 3, data: [{2}, 0, {3}, 0, {2}, {4}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}
"""


def depth_picture(folder: Path, unit: float = 1e-3) -> None:
    """A picture of depth, 120 by 90, and camera files of its size, of twice it, and of another."""
    depth = cloud(seed=1)[..., 2]
    cv2.imwrite(str(folder / "a.png"), np.round(depth / unit).astype(np.uint16))
    focal = 119 / 0.9
    (folder / "same.yaml").write_text(CAMERA.format(120, 90, focal, 59.5, 44.5))
    (folder / "larger.yaml").write_text(CAMERA.format(240, 180, 2 * focal, 119.5, 89.5))
    (folder / "other.yaml").write_text(CAMERA.format(160, 90, focal, 79.5, 44.5))


@pytest.mark.parametrize("camera", ["same", "larger"])
def test_pictures_of_depth_are_clouds(camera: str, tmp_path: Path, capsys: Capture) -> None:
    depth_picture(tmp_path)
    given = ["planes", str(tmp_path / "a.png"), "--camera", str(tmp_path / f"{camera}.yaml")]
    assert run([*given, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["planes"]
    assert row["distance_mm"] == pytest.approx(1000 * DISTANCE, abs=2.0)
    np.testing.assert_allclose(row["normal"], NORMAL, atol=0.01)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--camera", "other.yaml"], "depth of 120x90 px where the camera has 160x90"),
        (["--camera", "same.yaml", "--unit", "m"], "looks like mm"),
        (["--camera", "same.yaml", "--unit", "0.000001"], "looks like m, read in a smaller unit"),
        (["--camera", "same.yaml", "--range", "10", "20"], "no point from 0.01 to 0.02 m away"),
        (["--camera", "same.yaml", "--range", "20", "10"], "--range needs the nearest distance"),
        ([], "expected a cloud: .ply, .pcd or .npy"),
    ],
)
def test_what_cannot_be_used_is_said(
    more: list[str], words: str, tmp_path: Path, capsys: Capture
) -> None:
    depth_picture(tmp_path)
    paths = [str(tmp_path / word) if word.endswith(".yaml") else word for word in more]
    assert run(["planes", str(tmp_path / "a.png"), *paths]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_clouds_without_a_plane_are_named(tmp_path: Path, capsys: Capture) -> None:
    np.save(tmp_path / "a.npy", cloud())
    blob = np.random.default_rng(0).uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 1.2], (4000, 3))
    np.save(tmp_path / "b.npy", blob)
    assert run(["planes", str(tmp_path), "--json"]) == 0
    assert (
        "1 clouds have no plane: b.npy"
        in json.loads(capsys.readouterr().out)["verdict"]["notes"][0]
    )
    assert run(["planes", str(tmp_path / "b.npy")]) == 2
    assert "no plane in any cloud" in capsys.readouterr().err
