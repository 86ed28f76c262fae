"""pivot, hand-eye and register end to end on good input: figures, files, exit codes, streams."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, printed
from pose_answers import within
from pose_scenes import (
    B_A,
    NOISE,
    PAIR,
    POSE,
    POSTS,
    TIP,
    TURN_NOISE,
    X_AND_Z,
    angle_deg,
    matrix,
    pair_numbers,
    pivot_numbers,
    write_csv,
)
from scipy.spatial.transform import Rotation

from suta_calib.units import std_text


# ── pivot ────────────────────────────────────────────────────────────────────────────────────
def test_pivot_finds_tip_post_and_outliers(pivot_file: Path) -> None:
    found = answer("pivot", pivot_file)
    within(found["tip_mm"], 1e3 * TIP, found["tip_std_mm"])
    within(found["post_mm"], 1e3 * POSTS["left"], found["post_std_mm"])
    assert max(found["tip_std_mm"]) < 0.1
    assert found["rms_mm"] == pytest.approx(1e3 * NOISE * np.sqrt(3), rel=0.2)
    assert found["outliers"] == [6, 21]
    assert found["outlier_lines"] == [8, 23]
    assert found["counts"] == {"rows": 40, "inliers": 38, "outliers": 2}
    unsure = np.linalg.norm(found["tip_std_mm"])
    sentence = (
        f"the tip is known to ± {std_text(1e-3 * unsure, 'm')} (one standard deviation, 3-D); "
        f"38 of 40 poses agree to {found['rms_mm']:.3f} mm RMS"
    )
    (relied_on,) = found["verdict"].pop("notes")
    assert relied_on.startswith("No residual shows an error of the tracker's scale")
    assert found["verdict"] == {"level": "good", "usable": True, "sentence": sentence}
    assert "posts_mm" not in found
    assert "files" not in found
    assert not [path for path in pivot_file.parent.iterdir() if path != pivot_file]


def test_pivot_in_millimetres_is_the_same(pivot_file: Path) -> None:
    metres = answer("pivot", pivot_file)
    numbers = np.loadtxt(pivot_file, delimiter=",", skiprows=1)
    numbers[:, :3] *= 1e3
    in_mm = write_csv(pivot_file, [*("x_mm", "y_mm", "z_mm"), *POSE[3:]], numbers)
    np.testing.assert_allclose(answer("pivot", in_mm)["tip_mm"], metres["tip_mm"], atol=1e-6)


def test_without_robustness_all_poses_count(pivot_file: Path) -> None:
    robust, plain = (answer("pivot", pivot_file, *o) for o in ((), ("--no-robust",)))
    assert plain["outliers"] == []
    assert (robust["robust"], plain["robust"]) == (True, False)
    errors = [np.abs(np.subtract(f["tip_mm"], 1e3 * TIP)).max() for f in (robust, plain)]
    assert errors[1] > 3 * errors[0]


def test_pivot_on_several_posts(tmp_path: Path) -> None:
    labels = ["right"] * 25 + ["left"] * 25
    path = write_csv(tmp_path / "p.csv", (*POSE, "point"), pivot_numbers(labels), labels)
    found = answer("pivot", path)
    assert list(found["posts_mm"]) == ["right", "left"]
    for name, post in POSTS.items():
        within(found["posts_mm"][name], 1e3 * post, found["posts_std_mm"][name])
    within(found["tip_mm"], 1e3 * TIP, found["tip_std_mm"])
    assert found["post_mm"] == found["posts_mm"]["right"]
    order = found["covariance"]["order"]
    assert order[:4] == ["tip.x", "tip.y", "tip.z", "right.x"]
    std = 1e3 * np.sqrt(np.diag(found["covariance"]["matrix"]))
    expected = [found["tip_std_mm"], *found["posts_std_mm"].values()]
    np.testing.assert_allclose(std, np.ravel(expected), rtol=1e-12)


def test_pivot_writes_its_files(pivot_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    found = answer("pivot", pivot_file, "--out", out)
    names = {"residuals.csv", "pivot.svg", "tip.json", "report.html", "result.json"}
    assert {path.name for path in out.iterdir()} == names
    assert found["files"] == {name: str(out / name) for name in found["files"]}
    assert set(found["files"]) == names
    assert json.loads((out / "result.json").read_text()) == found
    tool = json.loads((out / "tip.json").read_text())
    assert tool == {key: found[key] for key in ("tip_mm", "tip_std_mm")}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert pivot_file.name in page
    assert f"{found['tip_mm'][2]:.3f}" in page
    assert 'id="pivot"' in page
    assert "<script src" not in page


def test_residuals_are_those_of_the_answer(pivot_file: Path, tmp_path: Path) -> None:
    found = answer("pivot", pivot_file, "--out", tmp_path / "out")
    with (tmp_path / "out" / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["row"]) for row in rows] == list(range(40))
    assert [int(row["line"]) for row in rows] == list(range(2, 42))
    lost = [int(row["row"]) for row in rows if row["status"] == "outlier"]
    assert lost == found["outliers"]
    numbers = np.loadtxt(pivot_file, delimiter=",", skiprows=1)
    R = Rotation.from_quat(numbers[:, 3:])
    to_post = np.array(found["post_mm"]) - 1e3 * numbers[:, :3]
    expected = R.inv().apply(to_post) - found["tip_mm"]
    written = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(written, expected, rtol=1e-4, atol=1e-5)
    norms = np.array([float(row["norm_mm"]) for row in rows])
    np.testing.assert_allclose(norms, np.linalg.norm(expected, axis=1), rtol=1e-4)
    fitted = np.delete(norms, found["outliers"])
    assert found["rms_mm"] == pytest.approx(np.sqrt(np.mean(fitted**2)), rel=1e-4)


def test_an_answer_not_to_be_used_exits_with_1(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 40)
    random = np.random.default_rng(3)
    numbers[:18, :3] += random.uniform(0.02, 0.2, (18, 3))
    path = write_csv(tmp_path / "p.csv", POSE, numbers)
    found = answer("pivot", path, "--out", tmp_path / "out", code=1)
    assert found["verdict"]["level"] == "bad"
    assert not found["verdict"]["usable"]
    written = {p.name for p in (tmp_path / "out").iterdir()}
    assert written == {"result.json", "report.html", "residuals.csv", "pivot.svg"}
    assert "Do not use." in printed("pivot", path, code=1)


def test_the_seed_makes_an_answer_the_same(pivot_file: Path) -> None:
    first, again = (answer("pivot", pivot_file, "--seed", 5) for _ in range(2))
    assert first == again
    assert first["seed"] == 5


# ── hand-eye ─────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("model", ["AX=XB", "AX=ZB"])
def test_hand_eye_finds_x_and_z(tmp_path: Path, setup: str, model: str) -> None:
    numbers = pair_numbers(25, setup)
    numbers[7, 7:10] += [0.03, 0.0, -0.02]
    path = write_csv(tmp_path / "p.csv", PAIR, numbers)
    found = answer("hand-eye", path, "--setup", setup, "--model", model)
    X, Z = X_AND_Z[setup]
    truth = {"X": matrix(X)} | ({"Z": matrix(Z)} if model == "AX=ZB" else {})
    assert ("Z" in found) == (model == "AX=ZB")
    assert set(found["std"]) == set(truth)
    for name, true in truth.items():
        pose, std = np.array(found[name]), found["std"][name]
        position_std = [std[f"{axis}_mm"] for axis in "xyz"]
        within(1e3 * pose[:3, 3], 1e3 * true[:3, 3], position_std)
        turn = Rotation.from_matrix(true[:3, :3].T @ pose[:3, :3]).as_rotvec(degrees=True)
        within(turn, np.zeros(3), [std[f"r{axis}_deg"] for axis in "xyz"])
        quaternion = Rotation.from_quat(found[f"{name}_quaternion_xyzw"]).as_matrix()
        np.testing.assert_allclose(quaternion, pose[:3, :3], atol=1e-9)
        rpy = Rotation.from_euler("xyz", found[f"{name}_rpy_deg"], degrees=True).as_matrix()
        np.testing.assert_allclose(rpy, pose[:3, :3], atol=1e-9)
    in_hand = setup == "eye-in-hand"
    assert found["frames"]["X"] == ("T_hand_eye" if in_hand else "T_base_eye")
    assert found["outliers"] == [7]
    assert found["rms_mm"] == pytest.approx(1e3 * NOISE * np.sqrt(3), rel=0.3)
    assert found["rms_deg"] == pytest.approx(np.degrees(TURN_NOISE) * np.sqrt(3), rel=0.3)
    assert (found["setup"], found["model"]) == (setup, model)
    assert 0.0 <= found["hand_share"] <= 1.0
    assert len(found["covariance"]["matrix"]) == len(found["covariance"]["order"])
    assert found["verdict"]["level"] == "good"


def test_hand_eye_writes_its_files(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "p.csv", PAIR, pair_numbers(20, "eye-in-hand"))
    out = tmp_path / "out"
    found = answer("hand-eye", path, "--model", "AX=ZB", "--out", out)
    names = {"residuals.csv", "hand_eye.svg", "report.html", "result.json"}
    assert {p.name for p in out.iterdir()} == names
    assert json.loads((out / "result.json").read_text()) == found
    with (out / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 20
    for unit, key in (("mm", "norm_mm"), ("deg", "norm_deg")):
        rms = np.sqrt(np.mean([float(row[key]) ** 2 for row in rows]))
        assert found[f"rms_{unit}"] == pytest.approx(rms, rel=1e-4)
    assert {row["status"] for row in rows} == {"inlier"}


# ── register ─────────────────────────────────────────────────────────────────────────────────
def test_register_finds_the_transform(point_files: tuple[Path, Path]) -> None:
    found = answer("register", *point_files)
    pose, true, std = np.array(found["T_b_a"]), matrix(B_A), found["std"]
    within(1e3 * pose[:3, 3], 1e3 * true[:3, 3], [std[f"{axis}_mm"] for axis in "xyz"])
    assert angle_deg(pose, true) < 5 * max(std[f"r{axis}_deg"] for axis in "xyz")
    assert found["rms_mm"] == pytest.approx(1e3 * NOISE * np.sqrt(3), rel=0.35)
    assert found["outliers"] == [4]
    assert found["outlier_lines"] == [6]
    centre = found["std_at_centre"]
    # In the middle of n points noise averages; away from it the turn adds to it.
    # and of few points the scatter is known so well only (Student's variance).
    expected = found["sigma_mm"] / np.sqrt(11) * np.sqrt(27 / 25)
    assert centre["x_mm"] == pytest.approx(expected, rel=1e-3)
    assert all(std[f"{axis}_mm"] >= centre[f"{axis}_mm"] for axis in "xyz")
    assert "targets" not in found


def test_register_says_the_error_at_targets(point_files: tuple[Path, Path], tmp_path: Path) -> None:
    targets = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [1.5, 0.0, 0.0]])
    file = write_csv(tmp_path / "t.csv", ("x_mm", "y_mm", "z_mm"), 1e3 * targets)
    found = answer("register", *point_files, "--target", file)["targets"]
    assert [(t["row"], t["line"]) for t in found] == [(0, 2), (1, 3), (2, 4)]
    true = 1e3 * (B_A[0].apply(targets) + B_A[1])
    errors = [t["error_mm"] for t in found]
    assert errors == sorted(errors)
    assert errors[2] > 5 * errors[0]
    for target, at in zip(found, true, strict=True):
        within(target["b_mm"], at, target["std_mm"])
        assert np.linalg.norm(target["std_mm"]) == pytest.approx(target["error_mm"])


def test_register_writes_its_files(point_files: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    found = answer("register", *point_files, "--out", out)
    names = {"residuals.csv", "register.svg", "report.html", "result.json"}
    assert {p.name for p in out.iterdir()} == names
    with (out / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    a, b = (np.loadtxt(f, delimiter=",", skiprows=1) for f in point_files)
    pose = np.array(found["T_b_a"])
    expected = 1e3 * (a @ pose[:3, :3].T + pose[:3, 3] - b)
    written = [[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(written, expected, rtol=1e-4, atol=1e-5)
    assert [row["line_b"] for row in rows] == [str(k + 2) for k in range(12)]
