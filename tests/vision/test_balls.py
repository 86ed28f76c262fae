"""Balls in clouds: against the truth, and with clouds that cannot be used."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from ball_clouds import CENTRE, RADIUS, cloud
from cli_job import Capture
from studies import of_size

from suta_calib.cli._app import run
from suta_calib.errors import InputError
from suta_calib.geometry.ball import ball_in
from suta_calib.measurements.cloud_files import read_cloud
from suta_calib.measurements.seen_points import read_seen_points
from suta_calib.vision.clouds import find_clouds

BESIDE = np.array([-0.12, 0.05, 0.0])


@pytest.mark.parametrize("seeds", of_size(5, 12))
def test_the_spread_of_the_centre_is_true(seeds: int) -> None:
    squares = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        centre = CENTRE + rng.uniform(-0.05, 0.05, 3)
        ball = ball_in(cloud((centre, RADIUS), seed=seed).reshape(-1, 3), RADIUS)
        assert ball is not None
        off = ball.centre - centre
        squares.append(off @ np.linalg.solve(ball.covariance, off) / 3)
        assert np.linalg.norm(off) < 5e-4
    assert 0.4 < np.mean(squares) < 2.0


@pytest.mark.parametrize("seeds", of_size(4, 8))
def test_neighbours_that_err_together_count_as_few(seeds: int) -> None:
    """Smoothed noise: ± stays true, and is larger than what the scatter alone says."""
    rng, squares = np.random.default_rng(0), []
    for seed in range(seeds):
        exact = cloud((CENTRE, RADIUS), noise=0.0)
        waves = np.pad(rng.standard_normal((130, 160)), 2, mode="wrap")
        smooth = sum(waves[i : i + 130, j : j + 160] for i in range(5) for j in range(5)) / 5
        points = exact * (1 + 1e-3 * smooth[..., None])
        ball = ball_in(points.reshape(-1, 3), RADIUS)
        assert ball is not None, seed
        off = ball.centre - CENTRE
        squares.append(off @ np.linalg.solve(ball.covariance, off) / 3)
    assert 0.3 < np.mean(squares) < 3.0


def test_flying_points_and_holes_do_no_harm() -> None:
    rng, points = np.random.default_rng(2), cloud((CENTRE, RADIUS)).reshape(-1, 3)
    flying = rng.random(len(points)) < 0.1
    points[flying] *= rng.uniform(0.8, 1.2, (int(flying.sum()), 1))
    ball = ball_in(points[rng.random(len(points)) > 0.2], RADIUS)
    assert ball is not None
    assert np.linalg.norm(ball.centre - CENTRE) < 7e-4


def test_what_is_no_ball_is_not_taken_for_one() -> None:
    assert ball_in(cloud().reshape(-1, 3), RADIUS) is None
    # Three times as large, and a box.
    assert ball_in(cloud((CENTRE, 3 * RADIUS)).reshape(-1, 3), RADIUS) is None
    rng = np.random.default_rng(0)
    box = np.column_stack([rng.uniform(-0.1, 0.1, (4000, 2)), np.full(4000, 0.5)])
    side = np.column_stack(
        [np.full(2000, 0.1), rng.uniform(-0.1, 0.1, 2000), rng.uniform(0.5, 0.6, 2000)]
    )
    assert ball_in(np.vstack([box, side]), RADIUS) is None
    assert ball_in(np.zeros((0, 3)), RADIUS) is None


def test_a_ball_of_another_radius_beside_it_is_told_apart() -> None:
    other = CENTRE + BESIDE
    points = cloud((CENTRE, RADIUS), (other, 0.045)).reshape(-1, 3)
    for centre, radius in ((CENTRE, RADIUS), (other, 0.045)):
        ball = ball_in(points, radius)
        assert ball is not None
        assert np.linalg.norm(ball.centre - centre) < 5e-4
    twins = ball_in(cloud((CENTRE, RADIUS), (other, RADIUS)).reshape(-1, 3), RADIUS)
    assert twins is not None
    assert twins.rival > 0.5


# ── files ────────────────────────────────────────────────────────────────────────────────────
POINTS = np.array([[0.1, 0.2, 1.0], [np.nan, np.nan, np.nan], [0.0, 0.0, 0.0], [-0.1, 0.5, 2.0]])
KEPT = POINTS[[0, 3]]


def pcd(how: str) -> bytes:
    """A cloud with an intensity between its coordinates."""
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x intensity y z\nSIZE 4 1 4 4\nTYPE F U F F\n"
        f"COUNT 1 1 1 1\nWIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA {how}\n"
    ).encode()
    x, y, z = POINTS.astype("<f4").T
    if how == "ascii":
        rows = "".join(f"{a} 7 {b} {c}\n" for a, b, c in zip(x, y, z, strict=True))
        return header + rows.encode()
    if how == "binary":
        rows = b"".join(struct.pack("<fBff", a, 7, b, c) for a, b, c in zip(x, y, z, strict=True))
        return header + rows
    plain = x.tobytes() + bytes([7] * 4) + y.tobytes() + z.tobytes()
    # Bytes as they are; the sevens as one, and what goes back to it.
    first, rest = plain[:17], plain[20:]
    packed = bytes([len(first) - 1]) + first + bytes([1 << 5, 0])
    for k in range(0, len(rest), 32):
        part = rest[k : k + 32]
        packed += bytes([len(part) - 1]) + part
    return header + struct.pack("<II", len(packed), len(plain)) + packed


@pytest.mark.parametrize("how", ["ascii", "binary", "binary_compressed"])
def test_pcd_is_read(how: str, tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd(how))
    np.testing.assert_allclose(read_cloud(path).points, KEPT, rtol=1e-6)
    path.write_bytes(pcd(how)[:-5])
    with pytest.raises(InputError, match=r"a\.pcd"):
        read_cloud(path)


def test_ply_is_read(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    path = tmp_path / "a.ply"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat {{}}\nelement vertex 4\n{axes}end_header\n"
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS)
    path.write_text(header.format("ascii 1.0") + rows)
    np.testing.assert_allclose(read_cloud(path).points, KEPT, rtol=1e-6)
    binary = header.format("binary_little_endian 1.0").encode() + POINTS.astype("<f4").tobytes()
    path.write_bytes(binary)
    np.testing.assert_allclose(read_cloud(path).points, KEPT, rtol=1e-6)
    path.write_bytes(binary[:-4])
    with pytest.raises(InputError, match="a file that cannot be read"):
        read_cloud(path)


def test_arrays_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.hstack([POINTS, np.ones((4, 1))]).reshape(2, 2, 4))
    np.testing.assert_allclose(read_cloud(path).points, KEPT)
    fields = np.zeros(4, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("rgb", "u4")])
    for axis, values in zip("xyz", POINTS.T, strict=True):
        fields[axis] = values
    np.save(path, fields)
    np.testing.assert_allclose(read_cloud(path).points, KEPT, rtol=1e-6)
    np.save(path, 1000.0 * POINTS)
    with pytest.raises(InputError, match="looks like mm"):
        read_cloud(path)
    np.testing.assert_allclose(read_cloud(path, 1e-3).points, KEPT)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.npy", b"", "an empty file"),
        ("a.npy", b"no array", "cannot be read"),
        ("a.pcd", b"FIELDS x y z\n", "no line DATA"),
        ("a.pcd", pcd("ascii").replace(b"WIDTH 4", b"WIDTH 4000000000"), "a header of 4000000000"),
        ("a.pcd", pcd("ascii").replace(b"DATA ascii", b"DATA other"), "DATA other"),
        ("a.txt", b"1 2 3\n", r"expected a cloud: \.ply, \.pcd or \.npy"),
    ],
)
def test_other_files_are_refused(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_cloud(tmp_path / name)


def test_a_cloud_of_nothing_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((5, 3), np.nan))
    with pytest.raises(InputError, match="5 points, all of them zero or not finite"):
        read_cloud(tmp_path / "a.npy")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="a folder without clouds"):
        find_clouds([tmp_path / "empty"])
    (tmp_path / "b").mkdir()
    np.save(tmp_path / "b" / "a.npy", POINTS)
    with pytest.raises(InputError, match=r"two clouds called a\.npy"):
        find_clouds([tmp_path, tmp_path / "b"])


# ── the command ──────────────────────────────────────────────────────────────────────────────
def test_clouds_become_points(tmp_path: Path, capsys: Capture) -> None:
    folder, out, other = tmp_path / "clouds", tmp_path / "points.csv", CENTRE + BESIDE
    folder.mkdir()
    for k in range(2):
        np.save(folder / f"{k}.npy", cloud((CENTRE, RADIUS), (other, 0.045), seed=k))
    balls = ["--ball", "A=30", "--ball", "B=45"]
    assert run(["balls", str(folder), *balls, "--out", str(out), "--json"]) == 0
    answer, points = json.loads(capsys.readouterr().out), read_seen_points(out)
    assert answer["found"] == 4
    assert answer["verdict"]["level"] == "good", answer["verdict"]
    assert points.image.tolist() == ["0.npy", "0.npy", "1.npy", "1.npy"]
    assert points.point.tolist() == ["A", "B", "A", "B"]
    truth = np.array([CENTRE, other, CENTRE, other])
    assert points.sigma is not None
    assert np.abs((points.position - truth) / points.sigma).max() < 4.5
    assert answer["balls"][0]["position_mm"] == pytest.approx(1000 * points.position[0], abs=1e-2)


def test_a_ball_of_another_size_is_said(tmp_path: Path, capsys: Capture) -> None:
    np.save(tmp_path / "a.npy", cloud((CENTRE, 0.034), noise=3e-4))
    assert run(["balls", str(tmp_path / "a.npy"), "--ball", "A=30", "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert verdict["level"] == "care"
    assert "looks like one of radius 3" in verdict["notes"][0]


@pytest.mark.parametrize(
    ("ball", "words"),
    [
        ("A", "expected NAME=RADIUS"),
        ("A=0.03", "expected NAME=RADIUS"),
        ("A=30", "no ball of radius 30 mm in any cloud"),
    ],
)
def test_what_cannot_be_found_is_said(
    ball: str, words: str, tmp_path: Path, capsys: Capture
) -> None:
    np.save(tmp_path / "a.npy", cloud())
    assert run(["balls", str(tmp_path / "a.npy"), "--ball", ball]) == 2
    assert words in capsys.readouterr().err
