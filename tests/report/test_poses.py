"""Answers of the closed problems as JSON, tables and pictures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree
from matplotlib.figure import Figure
from pose_scenes import PAIR, POSE, matrix, pair_numbers, pivot_numbers, point_numbers, write_csv
from rich.console import Console
from scipy.spatial.transform import Rotation

from suta_calib import units
from suta_calib.measurements.pose_files import (
    PointSet,
    PosePairs,
    ToolPoses,
    read_corresponding_points,
    read_pose_pairs,
    read_tool_poses,
)
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.pose_calibration.pivot import PivotCalibration, calibrate_pivot
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.report.console import rendered
from suta_calib.report.document import Document
from suta_calib.report.hand_eye import hand_eye_document
from suta_calib.report.listing import json_text
from suta_calib.report.pivot import pivot_document
from suta_calib.report.pose_plots import draw_axes, hand_eye_plot, pivot_plot, register_plot
from suta_calib.report.poses import pose_record
from suta_calib.report.registration import register_document

SVG = "{http://www.w3.org/2000/svg}"


def pivoted(
    folder: Path, labels: list[str], noise: float = 1e-4
) -> tuple[PivotCalibration, ToolPoses]:
    numbers = pivot_numbers(labels, noise=noise)
    numbers[3, :3] += [0.02, 0.0, 0.01]
    data = read_tool_poses(write_csv(folder / "p.csv", (*POSE, "point"), numbers, labels))
    return calibrate_pivot(data.rotation, data.position, data.point), data


def eye_in(folder: Path, setup: Any, model: Any = "AX=ZB") -> tuple[HandEyeCalibration, PosePairs]:
    data = read_pose_pairs(write_csv(folder / "h.csv", PAIR, pair_numbers(15, setup)))
    return calibrate_hand_eye(data.hand, data.target, setup=setup, model=model), data


def registered(folder: Path, noise: float = 1e-4) -> tuple[Registration, PointSet, PointSet]:
    files = [
        write_csv(folder / f"{name}.csv", ("x", "y", "z"), points)
        for name, points in zip("ab", point_numbers(8, noise=noise), strict=True)
    ]
    a, b = read_corresponding_points(*files)
    return register(a.position, b.position), a, b


def drawn(svg: str) -> str:
    """Text in an SVG document, which must be whole."""
    root = etree.fromstring(svg.encode())
    assert root.tag == f"{SVG}svg"
    return "\n".join("".join(e.itertext()) for e in root.iter(f"{SVG}text"))


def on_screen(shown: Document, width: int = 80) -> str:
    console = Console(width=width, markup=False, highlight=False, record=True, file=None)
    with console.capture() as captured:
        console.print(rendered(shown))
    return captured.get()


# ── numbers ──────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("vector", [[0.0, 0.0, 0.0], [1e-9, 0, 0], [np.pi, 0, 0], [1, -2, 0.5]])
def test_rotations_in_other_words_are_the_same(vector: list[float]) -> None:
    pose = matrix((Rotation.from_rotvec(vector), np.zeros(3)))
    written = pose_record(pose)
    found = written["quaternion_xyzw"]
    assert found[3] >= 0
    assert np.linalg.norm(found) == pytest.approx(1.0)
    np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), pose[:3, :3], atol=1e-12)
    again = Rotation.from_euler("xyz", written["rpy_deg"], degrees=True)
    np.testing.assert_allclose(again.as_matrix(), pose[:3, :3], atol=1e-12)


def test_answers_are_json_and_si_only_where_said(tmp_path: Path) -> None:
    pivot, poses = pivoted(tmp_path, ["left"] * 20)
    eye, pairs = eye_in(tmp_path, "eye-in-hand")
    points = registered(tmp_path)
    answers = [
        each.json()
        for each in (
            pivot_document(pivot, poses),
            hand_eye_document(eye, pairs),
            register_document(*points),
        )
    ]
    for answer in answers:
        assert json.loads(json.dumps(answer, allow_nan=False)) == answer
    assert answers[0]["tip_mm"] == pytest.approx(list(1e3 * pivot.tip))
    np.testing.assert_array_equal(answers[1]["X"], eye.X)
    np.testing.assert_array_equal(answers[2]["T_b_a"], points[0].matrix)
    x, y, z, rx, ry, rz = eye.std["Z"]
    lengths = {"x_mm": 1e3 * x, "y_mm": 1e3 * y, "z_mm": 1e3 * z}
    turns = {"rx_deg": np.degrees(rx), "ry_deg": np.degrees(ry), "rz_deg": np.degrees(rz)}
    assert answers[1]["std"]["Z"] == pytest.approx(lengths | turns)


def test_x_alone_carries_nothing_of_z(tmp_path: Path) -> None:
    answer = hand_eye_document(*eye_in(tmp_path, "eye-in-hand", "AX=XB")).json()
    assert not [key for key in answer if key.startswith("Z")]
    assert list(answer["std"]) == ["X"]
    assert np.shape(answer["covariance"]["matrix"]) == (6, 6)
    assert not [name for name in answer["covariance"]["order"] if name.startswith("Z")]


def test_the_origin_is_less_sure_than_the_middle_of_the_points(tmp_path: Path) -> None:
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    a, b = point_numbers(8)
    for file, points in zip(files, (a + np.array([2.0, 0.0, 0.0]), b), strict=True):
        write_csv(file, ("x", "y", "z"), points)
    read = read_corresponding_points(*files)
    found = register(read[0].position, read[1].position)
    answer = register_document(found, *read).json()
    size = {
        key: np.linalg.norm([answer[key][f"{axis}_mm"] for axis in "xyz"])
        for key in ("std", "std_at_centre")
    }
    assert size["std"] > 5 * size["std_at_centre"]
    assert size["std"] == pytest.approx(1e3 * found.target_error([[0.0, 0.0, 0.0]])[0])


# ── tables ───────────────────────────────────────────────────────────────────────────────────
def test_tables_fit_and_say_what_was_found(tmp_path: Path) -> None:
    pivot = on_screen(pivot_document(*pivoted(tmp_path, ["left"] * 20 + ["right"] * 20)))
    assert "post left" in pivot
    assert "1 outlier: row 3 (line 5)" in pivot
    eye = on_screen(hand_eye_document(*eye_in(tmp_path, "eye-to-hand")))
    assert "X = T_base_eye: the eye in the base" in eye
    assert "Z = T_hand_target: the target in the hand" in eye
    found, a, b = registered(tmp_path)
    moved = on_screen(register_document(found, a, b, a))
    assert "target registration error" in moved
    for text in (pivot, eye, moved):
        assert max(len(line) for line in text.splitlines()) <= 80
        assert "Good." in text
        assert "…" not in text


def test_labels_and_long_lists_stay_legible(tmp_path: Path) -> None:
    labels = [f"[P{k % 14}]" for k in range(70)]
    numbers = pivot_numbers(["left"] * 70)
    data = read_tool_poses(write_csv(tmp_path / "p.csv", (*POSE, "point"), numbers, labels))
    shown = on_screen(
        pivot_document(calibrate_pivot(data.rotation, data.position, data.point), data)
    )
    assert "post [P0]" in shown
    assert "post [P13]" not in shown
    assert "2 more posts" in shown


# ── pictures ─────────────────────────────────────────────────────────────────────────────────
def test_pictures_name_their_axes_and_outliers(tmp_path: Path) -> None:
    pivot = drawn(pivot_plot(*pivoted(tmp_path, ["left"] * 20)))
    assert "outlier" in pivot
    assert "distance, mm" in pivot
    assert "Directions of the tool" in pivot
    eye = drawn(hand_eye_plot(eye_in(tmp_path, "eye-in-hand")[0]))
    assert "outlier" not in eye
    assert "turn, deg" in eye
    assert "in the hand (angle from its z)" in eye
    beside = drawn(hand_eye_plot(eye_in(tmp_path, "eye-to-hand")[0]))
    assert "in the base (angle from its z)" in beside
    found, _, b = registered(tmp_path)
    assert re.search(
        r"Residuals in the points' plane,\s+enlarged \d+ times", drawn(register_plot(found, b))
    )


def test_axes_of_motions_are_drawn_on_axes_of_ones_own(tmp_path: Path) -> None:
    found, _ = eye_in(tmp_path, "eye-in-hand")
    axes = Figure().subplots()
    draw_axes(axes, found.axes, found.inliers[1:] & found.inliers[:-1])
    assert [text.get_text() for text in axes.texts][-1] == "90°"
    places = np.asarray(axes.collections[0].get_offsets())
    units = found.axes / np.linalg.norm(found.axes, axis=1)[:, None]
    units *= np.where(units[:, 2:] < 0, -1.0, 1.0)
    # Lambert's projection keeps the chord from the pole.
    chords = np.linalg.norm(units - [0.0, 0.0, 1.0], axis=1)
    assert np.sort(np.linalg.norm(places, axis=1)) == pytest.approx(np.sort(chords))


def test_the_same_answer_is_the_same_picture(tmp_path: Path) -> None:
    answer = pivoted(tmp_path, ["left"] * 20)
    assert pivot_plot(*answer) == pivot_plot(*answer)


def test_exact_data_are_drawn_at_zero(tmp_path: Path) -> None:
    """No arrows of rounding errors, and no scale that makes them look like residuals."""
    found, _, b = registered(tmp_path, noise=0.0)
    assert "enlarged 1 times" in drawn(register_plot(found, b))
    random = np.random.default_rng(0)
    data = ToolPoses(
        path=tmp_path,
        lines=tuple(range(8)),
        rotation=np.asarray(Rotation.random(8, random).as_matrix()),
        position=np.zeros((8, 3)),
    )
    exact = calibrate_pivot(data.rotation, data.position - data.rotation @ [0, 0, 0.1])
    assert "1e−6" in drawn(pivot_plot(exact, data))


def test_an_outlier_beyond_the_rings_is_told(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 20)
    numbers[5, 3:] = [1, 0, 0, 0]
    data = read_tool_poses(write_csv(tmp_path / "p.csv", POSE, numbers))
    found = calibrate_pivot(data.rotation, data.position)
    assert found.outliers == (5,)
    assert "outliers farther out: 1" in drawn(pivot_plot(found, data))


# ── files ────────────────────────────────────────────────────────────────────────────────────
def test_what_is_no_number_is_null_in_files() -> None:
    assert json.loads(json_text({"a": [float("nan"), 1.5], "b": -np.inf})) == {
        "a": [None, 1.5],
        "b": None,
    }


# ── notebooks ────────────────────────────────────────────────────────────────────────────────
def test_answers_on_poses_are_a_line_on_a_console_and_tables_in_a_notebook(tmp_path: Path) -> None:
    pivot, _ = pivoted(tmp_path, ["left"] * 20 + ["right"] * 20)
    eye, _ = eye_in(tmp_path, "eye-to-hand")
    points, *_ = registered(tmp_path)
    for each in (pivot, eye, points):
        assert len(repr(each)) < 150
        assert f"RMS {units.text(each.rms, 'm')} mm" in repr(each)
        assert each.assessment.word in each._repr_html_()
    cells = [cell for tree in (pivot, eye, points) for cell in table_cells(tree._repr_html_())]
    assert f"{units.text(pivot.tip[0], 'm')} ± {units.text(pivot.tip_std[0], 'm')}" in cells
    assert {"post left", "post right"} <= set(cells)
    assert units.text(eye.X[0, 3], "m") in cells
    assert units.text(points.position[2], "m") in cells


def table_cells(page: str) -> list[str]:
    return [str(cell.text) for cell in etree.HTML(page).iter("td") if cell.text]
