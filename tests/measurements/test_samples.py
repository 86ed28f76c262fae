"""Samples in memory, and from files and back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reading import PRISMATIC, REVOLUTE, TOUCHED, TRACKED, write
from scipy.spatial.transform import Rotation

from suta_calib.errors import SamplesError
from suta_calib.measurements import (
    JointRange,
    SampleColumns,
    Samples,
    expand,
    positions,
    read_csv_table,
    read_samples,
    rotations,
    write_samples,
)

# ── round trips ──────────────────────────────────────────────────────────────────────────────
labels = (
    st.text(min_size=1, max_size=8)
    .map(str.strip)
    .filter(lambda text: text and not set(text) & {"\n", "\r", "\0"})
)
readings = st.floats(-3, 3)


@given(rows=st.lists(st.tuples(readings, readings, labels, st.integers(0, 2**31)), min_size=1))
def test_what_is_written_is_read_back(scratch: Path, rows: list[tuple]) -> None:
    first, second, label, seeds = zip(*rows, strict=True)
    rotation = Rotation.from_quat([np.random.default_rng(seed).normal(size=4) for seed in seeds])
    written = Samples.from_arrays(
        ["j1", "j2"],
        np.column_stack([first, second]),
        labels={"point": label},
        position=np.column_stack([second, first, first]),
        rotation=rotation.as_matrix(),
    )
    write_samples(scratch, written)
    columns = SampleColumns(("point",), position=True, orientation="required")
    joints = [JointRange(name, "rad", -math.inf, math.inf) for name in ("j1", "j2")]
    read = read_samples([scratch], joints, columns)
    np.testing.assert_array_equal(read.q, written.q)
    np.testing.assert_array_equal(read.position, written.position)
    np.testing.assert_allclose(read.rotation, written.rotation, atol=1e-14)
    assert list(read.labels["point"]) == list(label)


def test_columns_in_any_order_with_comments_marks_and_blank_lines(tmp_path: Path) -> None:
    text = b"\xef\xbb\xbf# arm 1\r\n\r\npoint , other, j1\r\nF1,x, 0.5\r\n# pause\r\n\r\nF2,y,1e-1"
    samples = read_samples([write(tmp_path, text)], [REVOLUTE], TOUCHED)
    np.testing.assert_array_equal(samples.q, [[0.5], [0.1]])
    assert samples.labels["point"].tolist() == ["F1", "F2"]
    assert samples.origin == ("a.csv:4", "a.csv:7")


def test_columns_of_q_follow_the_chain_and_files_their_order(tmp_path: Path) -> None:
    first = write(tmp_path, "lift,j1,point\n0.1,1,A\n", "b.csv")
    second = write(tmp_path, "j1,lift,point\n2,0.2,B\n3,0.3,C\n", "a.csv")
    samples = read_samples([first, second], [REVOLUTE, PRISMATIC], TOUCHED)
    np.testing.assert_array_equal(samples.q, [[1, 0.1], [2, 0.2], [3, 0.3]])
    assert samples.origin == ("b.csv:2", "a.csv:2", "a.csv:3")


def test_positions_in_metres_or_millimetres(tmp_path: Path) -> None:
    metres = read_csv_table(write(tmp_path, "x,y,z\n0.001,2,-3\n"))
    millimetres = read_csv_table(write(tmp_path, "b_x_mm,b_y_mm,b_z_mm\n1,2000,-3000\n"))
    np.testing.assert_allclose(positions(metres), positions(millimetres, "b_"), rtol=1e-15)
    np.testing.assert_allclose(positions(metres), [[0.001, 2, -3]], rtol=1e-15)


def test_joints_in_degrees_or_millimetres_where_their_columns_say_so(tmp_path: Path) -> None:
    file = write(tmp_path, "lift_mm,j1_deg,point\n100,90,A\n200,-45,B\n")
    samples = read_samples(file, [REVOLUTE, PRISMATIC], TOUCHED)
    np.testing.assert_allclose(samples.q, [[np.pi / 2, 0.1], [-np.pi / 4, 0.2]], rtol=1e-15)


def test_quaternions_are_x_y_z_w(tmp_path: Path) -> None:
    table = read_csv_table(write(tmp_path, "qw,qx,qy,qz\n0.70710678,0,0,0.70710678\n"))
    np.testing.assert_allclose(rotations(table)[0] @ [1, 0, 0], [0, 1, 0], atol=1e-7)


def test_optional_orientation(tmp_path: Path) -> None:
    without = write(tmp_path, "j1,x,y,z\n0,1,2,3\n", "without.csv")
    with_ = write(tmp_path, "j1,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n", "with.csv")
    assert read_samples([without], [REVOLUTE], TRACKED).rotation is None
    np.testing.assert_array_equal(
        read_samples([with_], [REVOLUTE], TRACKED).rotation, np.eye(3)[None]
    )
    for order in ([without, with_], [with_, without]):
        with pytest.raises(
            SamplesError, match=r"without\.csv: found no orientation, although .*with\.c"
        ):
            read_samples(order, [REVOLUTE], TRACKED)


def test_measured_files_are_read(shared: Path) -> None:
    folder = shared / "real" / "mukca_panda_2_clean"
    joints = [JointRange(f"panda_joint{i}", "rad", -3.8, 3.8) for i in range(1, 8)]
    columns = SampleColumns(("placement", "repeat", "landmark"))
    samples = read_samples(expand("calibration/*.csv", folder), joints, columns)
    assert samples.q.shape == (len(samples), 7)
    assert set(samples.labels["landmark"]) == {"hole_0", "hole_1"}


# ── Samples in memory ────────────────────────────────────────────────────────────────────────
def three_samples() -> Samples:
    return Samples.from_arrays(
        ["j1"], [[0.0], [1.0], [2.0]], labels={"point": ["A", "B", "C"]}, position=np.eye(3)
    )


@pytest.mark.parametrize(
    ("index", "expected"),
    [([2, 0, 2], [2, 0, 2]), ([False, True, True], [1, 2]), (slice(1), [0])],
)
def test_take(index: object, expected: list[int]) -> None:
    taken = three_samples().take(index)
    assert taken.q[:, 0].tolist() == expected
    assert taken.labels["point"].tolist() == ["ABC"[row] for row in expected]
    assert taken.origin == tuple(f"row {row}" for row in expected)
    np.testing.assert_array_equal(taken.position, np.eye(3)[expected])
    assert taken.rotation is None
    assert len(taken) == len(expected)


def test_rows_without_an_origin_are_named_by_their_number() -> None:
    assert three_samples().origin == ("row 0", "row 1", "row 2")


def test_samples_are_immutable_copies() -> None:
    q = np.zeros((3, 1))
    samples = Samples.from_arrays(["j1"], q)
    q[0] = 7.0
    assert samples.q[0, 0] == 0.0
    for array in (samples.q, samples.take([0]).q, three_samples().labels["point"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": [[0.0, 1.0]]}, r"q: found shape \(1, 2\); expected shape \(1, 1\)"),
        ({"q": [[math.nan]]}, r"q\[0, 0\]: found nan"),
        ({"q": [["a"]]}, "q: found no array of numbers"),
        ({"q": np.empty((0, 1))}, "q: found no samples"),
        ({"joints": ["j1", "j1"]}, "joints: found joints j1, j1"),
        ({"labels": {"point": ["A", "B"]}}, "point: found 2 labels"),
        ({"labels": {"point": [" "]}}, r"point\[0\]: found ''"),
        ({"labels": {"point": ["A\nB"]}}, r"point\[0\]: found 'A\\nB'"),
        ({"position": [[0, 0]]}, "position: found shape"),
        ({"position": [[0, math.inf, 0]]}, r"position\[0, 1\]: found inf"),
        ({"rotation": [2 * np.eye(3)]}, r"rotation\[0\]: found a matrix that is not a rotation"),
        ({"rotation": [-np.eye(3)]}, r"rotation\[0\]: found a matrix that is not a rotation"),
        ({"origin": ["a", "b"]}, "origin: found 2 entries"),
    ],
)
def test_from_arrays_refuses(change: dict, message: str) -> None:
    with pytest.raises(SamplesError, match=message):
        Samples.from_arrays(**({"joints": ["j1"], "q": [[0.0]]} | change))


def test_concatenate_refuses_different_columns() -> None:
    with pytest.raises(SamplesError, match="different columns"):
        Samples.concatenate([three_samples(), Samples.from_arrays(["j1"], [[0.0]])])
