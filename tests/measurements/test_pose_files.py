"""Readers of the closed problems' CSV files."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pose_scenes import PAIR, POSE, pair_numbers, pivot_numbers, point_numbers, write_csv
from scipy.spatial.transform import Rotation

from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.measurements.pose_files import (
    read_corresponding_points,
    read_points,
    read_pose_pairs,
    read_tool_poses,
)


def test_tool_poses_are_read_with_their_lines_and_labels(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 4)
    path = write_csv(tmp_path / "p.csv", (*POSE, "point"), numbers, ["b", "a", "b", "c"])
    path.write_text("# a tracker\n\n" + path.read_text())
    found = read_tool_poses(path)
    assert found.path == path
    assert found.lines == (4, 5, 6, 7)
    assert found.point.tolist() == ["b", "a", "b", "c"]
    np.testing.assert_array_equal(found.position, numbers[:, :3])
    expected = Rotation.from_quat(numbers[:, 3:]).as_matrix()
    np.testing.assert_allclose(found.rotation, expected, atol=1e-12)


def test_columns_may_stand_in_any_order_and_others_are_ignored(tmp_path: Path) -> None:
    numbers = pair_numbers(5, "eye-in-hand")
    path = write_csv(
        tmp_path / "p.csv", ("time", *PAIR[::-1]), np.hstack([np.ones((5, 1)), numbers[:, ::-1]])
    )
    found = read_pose_pairs(path)
    np.testing.assert_array_equal(found.hand[1], numbers[:, :3])
    np.testing.assert_array_equal(found.target[1], numbers[:, 7:10])
    expected = Rotation.from_quat(numbers[:, 10:]).as_matrix()
    np.testing.assert_allclose(found.target[0], expected, atol=1e-12)


def test_each_pose_of_a_pair_may_have_its_own_unit(tmp_path: Path) -> None:
    numbers = pair_numbers(5, "eye-in-hand")
    path = write_csv(tmp_path / "m.csv", PAIR, numbers)
    in_mm = numbers.copy()
    in_mm[:, 7:10] *= 1e3
    names = [f"{name}_mm" if name in ("b_x", "b_y", "b_z") else name for name in PAIR]
    mixed = read_pose_pairs(write_csv(tmp_path / "mm.csv", names, in_mm))
    np.testing.assert_allclose(mixed.target[1], read_pose_pairs(path).target[1], rtol=1e-14)
    np.testing.assert_array_equal(mixed.hand[1], numbers[:, :3])


def test_a_file_without_labels_has_none(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "p.csv", POSE, pivot_numbers(["left"] * 4))
    assert read_tool_poses(path).point is None


def coordinates(size: float) -> st.SearchStrategy[float]:
    return st.floats(-size, size, allow_nan=False)


@given(st.lists(st.tuples(*[coordinates(9.0)] * 3), min_size=1, max_size=6))
def test_points_are_read_back_exactly(scratch: Path, points: list[tuple[float, ...]]) -> None:
    path = write_csv(scratch, ("x", "y", "z"), np.array(points))
    np.testing.assert_array_equal(read_points(path).position, points)


@given(st.text(alphabet='xyzq_m,.-+e0123456789na\n"# ', max_size=80))
def test_whatever_is_in_a_file_it_is_read_or_refused(scratch: Path, text: str) -> None:
    scratch.write_text("x,y,z\n" + text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SutaCalibWarning)
        try:
            found = read_points(scratch).position
        except SamplesError as error:
            said = str(error)
        else:
            said = str(scratch)
            assert found.shape[1:] == (3,)
            assert np.isfinite(found).all()
    assert str(scratch) in said


@pytest.mark.parametrize(
    ("columns", "factor", "says"),
    [
        (POSE, 1e3, r"p\.csv:1: column 'x': .*looks like millimetres.*x_mm, y_mm, z_mm"),
        (("x_mm", "y_mm", "z_mm", *POSE[3:]), 1.0, r"column 'x_mm': .*looks like metres.*x, y, z"),
    ],
)
def test_an_evident_unit_is_hinted_at(
    tmp_path: Path, columns: tuple[str, ...], factor: float, says: str
) -> None:
    numbers = pivot_numbers(["left"] * 6)
    numbers[:, :3] *= factor
    path = write_csv(tmp_path / "p.csv", columns, numbers)
    with pytest.warns(SutaCalibWarning, match=says):
        found = read_tool_poses(path)
    scale = 1e-3 if columns[0] == "x_mm" else 1.0
    np.testing.assert_allclose(found.position, scale * numbers[:, :3], rtol=1e-14)


def test_metres_that_a_program_took_for_millimetres(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 6)
    numbers[:, :3] *= 1e-3
    path = write_csv(tmp_path / "p.csv", POSE, numbers)
    with pytest.warns(SutaCalibWarning, match="If metres were read as mm"):
        found = read_tool_poses(path)
    assert found.unit_notes


def test_a_single_far_position_is_no_other_unit(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 6)
    numbers[2, 0] = 1500.0
    read_tool_poses(write_csv(tmp_path / "p.csv", POSE, numbers))


def test_a_repeated_pose_is_told(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 6)
    path = write_csv(tmp_path / "p.csv", POSE, numbers[[0, 1, 2, 3, 3, 3]])
    with pytest.warns(SutaCalibWarning, match="found 2 rows that repeat another"):
        assert len(read_tool_poses(path).position) == 6


@pytest.mark.parametrize("rows", [[0] * 6, [0, 1] * 4])
def test_copies_of_one_or_two_poses_are_refused(tmp_path: Path, rows: list[int]) -> None:
    path = write_csv(tmp_path / "p.csv", PAIR, pair_numbers(3, "eye-in-hand")[rows])
    with pytest.raises(SamplesError, match=f"all but {len(set(rows))} repeat .*at least 3"):
        read_pose_pairs(path)


def test_a_fiducial_may_be_there_twice_but_not_only_it(tmp_path: Path) -> None:
    a, b = point_numbers(5)
    file_b = write_csv(tmp_path / "b.csv", ("x", "y", "z"), b)
    twice = write_csv(tmp_path / "a.csv", ("x", "y", "z"), a[[0, 1, 2, 3, 3]])
    assert len(read_corresponding_points(twice, file_b)[0].position) == 5
    write_csv(twice, ("x", "y", "z"), a[[0, 0, 1, 1, 1]])
    with pytest.raises(SamplesError, match=r"a\.csv: found 5 rows, of which all but 2 repeat"):
        read_corresponding_points(twice, file_b)


def test_one_file_in_metres_and_one_in_millimetres(tmp_path: Path) -> None:
    a, b = point_numbers(6)
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    write_csv(files[0], ("x", "y", "z"), a)
    write_csv(files[1], ("x", "y", "z"), 1e3 * b)
    said = r"b\.csv: found points (9|10)\d\d times as far apart.*a\.csv"
    for order in (files, files[::-1]):
        with pytest.raises(SamplesError, match=said):
            read_corresponding_points(*order)
    write_csv(files[1], ("x_mm", "y_mm", "z_mm"), 1e3 * b)
    np.testing.assert_allclose(read_corresponding_points(*files)[1].position, b, rtol=1e-14)


def test_different_numbers_of_rows(tmp_path: Path) -> None:
    a, b = point_numbers(6)
    parts = {"a.csv": a, "b.csv": b[:5]}
    files = [write_csv(tmp_path / name, ("x", "y", "z"), part) for name, part in parts.items()]
    with pytest.raises(
        SamplesError, match=r"b\.csv: found 5 rows; expected 6 rows, as in .*a\.csv"
    ):
        read_corresponding_points(*files)


def test_numbers_no_position_has(tmp_path: Path) -> None:
    numbers = pivot_numbers(["left"] * 6)
    numbers[3, 1] = 1e200
    path = write_csv(tmp_path / "p.csv", POSE, numbers)
    with pytest.raises(SamplesError, match=r"p\.csv:5: column 'y': found '1e\+200'"):
        read_tool_poses(path)
