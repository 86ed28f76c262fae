"""Samples files that are refused, each with its place; and no other exception for any input."""

from __future__ import annotations

import math
import warnings
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reading import PRISMATIC, REVOLUTE, SEEN, TOUCHED, TRACKED, refusal, write

from suta_calib.errors import InputError, SamplesError, SutaCalibWarning
from suta_calib.measurements import (
    JointRange,
    SampleColumns,
    Samples,
    read_samples,
    write_samples,
)


# ── refusals: file, line and column ──────────────────────────────────────────────────────────
@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (b"", None, "an empty file"),
        (b"\n# nothing\n", None, "an empty file"),
        (b"\nj1,point\n", 2, "a header without data"),
        (b"j1,point,j1\n0,A,0\n", 1, "'j1' more than once"),
        (b"j1;point\n0;A\n", 1, "separated by commas; suta-calib import converts"),
        (b"j1,point\n0,A\n0\n0,A\n", 3, "found 1 cells; expected 2"),
        (b"j1,point\n0,A\n0,A,B\n", 3, "found 3 cells; expected 2"),
        (b"j1,point\n0,A\n0.", 3, "in the middle of a row"),
        (b'j1,point\n0,"A\n1,B\n', 2, "not CSV"),
        (b"j1,point\n0,\xff\n", 2, "not UTF-8"),
        ("j1,point\n0,A\n".encode("utf-16"), 1, "not UTF-8"),
        (b"J1,point\n0,A\n", 1, "column 'j1': found only the columns J1, point.*mean 'J1'"),
        (b"j1,j1_deg,point\n0,0,A\n", 1, r"columns j1 and j1_deg; expected either j1 \(rad\)"),
        (b"j1,points\n0,A\n", 1, "column 'point': .*this kind needs point; did you mean 'points'"),
        (b"j1,point\n0,A\nhigh,B\n", 3, "column 'j1': found 'high'"),
        (b'j1,point\n"0,5",A\n', 2, "'0,5'; expected a finite number; a decimal comma.*import"),
        ("j1,point\n0,A\n".encode("utf-16-le"), 1, "zero bytes.*UTF-16"),
        (b"j1,point\n0,A\n\0\0\0", 3, "zero bytes.*the file is incomplete"),
        (b"j1,point\n,A\n", 2, "column 'j1': found ''"),
        (b"j1,point\n1_0,A\n", 2, "column 'j1': found '1_0'"),
        (b"j1,point\nnan,A\n", 2, "column 'j1': found 'nan'"),
        (b"j1,point\n-inf,A\n", 2, "column 'j1': found '-inf'"),
        (b"j1,point\n0,A\n1, \n", 3, "column 'point': found an empty cell; expected a label"),
    ],
)
def test_refused(tmp_path: Path, text: bytes, line: int | None, message: str) -> None:
    error = refusal(tmp_path, text, TOUCHED)
    assert error.line == line
    assert error.exit_code == 2
    with pytest.raises(SamplesError, match=message):
        raise error


@pytest.mark.parametrize(
    ("columns", "text", "line", "message"),
    [
        (TRACKED, "j1,x,y\n0,1,2\n", 1, "column 'z': .* x, y, z in m, or x_mm, y_mm, z_mm"),
        (TRACKED, "j1,x,y,z,x_mm\n0,1,2,3,4\n", 1, "found columns x, y, z, x_mm; expected either"),
        (TRACKED, "j1,x,y,z,qx,qy,qz\n0,1,2,3,0,0,0\n", 1, "column 'qw'"),
        (SEEN, "j1,x,y,z\n0,1,2,3\n", 1, "column 'qx': .* as a quaternion"),
        (SEEN, "j1,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,0\n", 2, "quaternion of length 0;"),
        (SEEN, "j1,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1e300\n", 2, "quaternion of length inf"),
        (SEEN, "j1,x,y,z,qx,qy,qz,qw\n0,1,nan,3,0,0,0,1\n", 2, "column 'y': found 'nan'"),
    ],
)
def test_refused_poses(
    tmp_path: Path, columns: SampleColumns, text: str, line: int, message: str
) -> None:
    error = refusal(tmp_path, text, columns)
    assert error.line == line
    with pytest.raises(SamplesError, match=message):
        raise error


def test_quaternions_off_unit_length_are_normalised_with_a_warning(tmp_path: Path) -> None:
    path = write(tmp_path, "j1,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1.005\n0,1,2,3,0,0,0,1.1\n")
    with pytest.warns(SutaCalibWarning, match=r"a\.csv:3: found a quaternion of length 1\.100"):
        samples = read_samples([path], [REVOLUTE], SEEN)
    np.testing.assert_array_equal(samples.rotation, [np.eye(3)] * 2)


CONTINUOUS = JointRange("j1", "rad", -math.inf, math.inf)


@pytest.mark.parametrize(
    ("joint", "reading", "meant"),
    [
        (REVOLUTE, 6.7, None),  # a turn and a little: a raw reading may be
        (REVOLUTE, -6.9, "degrees"),
        (JointRange("j1", "rad", -9.0, 1.0), 9.4, None),
        (JointRange("j1", "rad", -9.0, 1.0), 9.6, "degrees"),
        (CONTINUOUS, 25.0, None),
        (CONTINUOUS, -25.2, "degrees"),
        (PRISMATIC, 0.5, None),
        (PRISMATIC, 4.3, None),
        (PRISMATIC, 4.5, "millimetres"),
        (PRISMATIC, -4.1, "millimetres"),
        (PRISMATIC, 390.5, "millimetres"),
        (JointRange("lift", "m", 0.0, 0.0), 0.4, None),
        (JointRange("lift", "m", 0.0, 0.01), 0.6, "millimetres"),
    ],
)
def test_units_of_readings(
    tmp_path: Path, joint: JointRange, reading: float, meant: str | None
) -> None:
    text = f"{joint.name},point\n0,A\n{reading},A\n"
    if meant is None:
        far = joint.unit == "m" and reading > 0.6
        with pytest.warns(SutaCalibWarning) if far else nullcontext():
            samples = read_samples([write(tmp_path, text)], [joint], TOUCHED)
        assert samples.q[1, 0] == reading
        return
    error = refusal(tmp_path, text, TOUCHED, joint)
    assert (error.line, error.where) == (3, f"column {joint.name!r}")
    assert f"found {reading}" in str(error)
    assert f"joint range [{joint.lower:.4g}, {joint.upper:.4g}] {joint.unit}" in str(error)
    assert f"looks like {meant}: convert to" in error.hint


def test_a_file_that_a_new_job_began_with_may_stay_beside_others(tmp_path: Path) -> None:
    begun, own = tmp_path / "samples.csv", tmp_path / "a.csv"
    begun.write_text("j1,point\n")
    own.write_text("j1,point\n0.5,A\n")
    with pytest.warns(SutaCalibWarning, match=r"samples\.csv: found a header without data"):
        samples = read_samples([begun, own], [REVOLUTE], TOUCHED)
    assert samples.q.tolist() == [[0.5]]
    own.write_text("j1,point\n")
    with pytest.raises(SamplesError, match="a header without data"):
        read_samples([begun, own], [REVOLUTE], TOUCHED)


def test_a_slide_without_limits_may_be_anywhere(tmp_path: Path) -> None:
    joint = JointRange("lift", "m", -math.inf, math.inf)
    assert read_samples([write(tmp_path, "lift,point\n300,A\n")], [joint], TOUCHED).q == 300.0


def test_a_slide_that_is_read_far_beyond_its_range_is_told_of_once(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("a.csv", "b.csv")]
    for file in files:
        file.write_text("lift,point\n0.3,A\n0.61,A\n-0.3,A\n")
    with pytest.warns(SutaCalibWarning) as told:
        read = read_samples(files, [PRISMATIC], TOUCHED)
    assert read.q.T.tolist() == [[0.3, 0.61, -0.3] * 2]
    (only,) = told
    assert "a.csv:3: found 0.61 m for lift; expected its range [0, 0.4] m" in str(only.message)
    assert "4 of 6 samples are beyond it, by up to 0.3 m" in str(only.message)


def test_what_no_unit_makes_a_reading_of_a_slide_is_called_none(tmp_path: Path) -> None:
    error = refusal(tmp_path, "lift,point\n0,A\n9999,A\n", TOUCHED, PRISMATIC)
    assert error.hint == "check whether the column belongs to another joint"


@pytest.mark.parametrize(
    ("column", "hint"),
    [
        (
            [8.0, 7.2, 6.9],
            "a whole turn (360 deg) more than its range, although the other joints are",
        ),
        ([1.7, 0.9, 8.0], "a whole turn (360 deg) more than its range"),  # it jumped
        ([-8.0, -7.2, -5.3], "a whole turn (360 deg) less than its range"),
        ([12.7, 12.1, 13.5], "2 whole turns (720 deg) more than its range"),
        ([8.0, 80.0, -45.0], "looks like degrees"),
        ([38.0, 38.2, 38.4], "looks like degrees"),
    ],
)
def test_whole_turns_are_no_degrees_beside_joints_in_rad(
    tmp_path: Path, column: list[float], hint: str
) -> None:
    joints = [JointRange("j0", "rad", -3.14, 3.14), REVOLUTE]
    for others, meant in (([0.1, -1.2, 2.0], hint), ([20.0, -1.2, 40.0], "looks like degrees")):
        rows = "".join(f"{a},{b},A\n" for a, b in zip(others, column, strict=True))
        error = refusal(tmp_path, f"j0,j1,point\n{rows}", TOUCHED, *joints)
        assert meant in error.hint
    rows = "".join(f"0,{b},A\n" for b in column)  # the other joint tells nothing
    error = refusal(tmp_path, f"j0,j1,point\n{rows}", TOUCHED, *joints)
    assert "looks like degrees" in error.hint
    assert error.where == "column 'j1'"


def test_a_joint_named_like_a_column_is_ambiguous(tmp_path: Path) -> None:
    with pytest.raises(SamplesError, match=r"found a joint named 'x'.*rename the joint"):
        read_samples([tmp_path], [JointRange("x", "m", 0, 1)], TRACKED)
    samples = Samples.from_arrays(["x"], [[0.0]], position=[[0, 0, 0]])
    with pytest.raises(SamplesError, match=r"a\.csv: found columns x, x, y, z"):
        write_samples(tmp_path / "a.csv", samples)
    assert not list(tmp_path.iterdir())


# ── any input: a valid object or an InputError ───────────────────────────────────────────────
def read_or_refuse(path: Path) -> None:
    columns = SampleColumns(("point",), position=True, orientation="optional")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SutaCalibWarning)
        try:
            samples = read_samples([path], [REVOLUTE], columns)
        except InputError as error:
            assert str(path) in str(error)  # noqa: PT017 (whether it raises depends on the example)
            return
    assert np.isfinite(samples.q).all()
    assert np.isfinite(samples.position).all()


@given(content=st.binary())
def test_arbitrary_bytes(scratch: Path, content: bytes) -> None:
    scratch.write_bytes(content)
    read_or_refuse(scratch)


cells = st.one_of(st.floats().map(repr), st.sampled_from(["", "A", "0", "1e308", '"', "#"]))


@given(rows=st.lists(st.lists(cells, min_size=9, max_size=9)), tail=st.text())
def test_arbitrary_rows(scratch: Path, rows: list[list[str]], tail: str) -> None:
    text = "\n".join(["j1,point,x,y,z,qx,qy,qz,qw", *(",".join(row) for row in rows), tail])
    scratch.write_text(text, encoding="utf-8")
    read_or_refuse(scratch)


def test_optional_labels_are_read_where_every_file_has_them(tmp_path: Path) -> None:
    (tmp_path / "with.csv").write_text("j1,point,articulation\n0.1,A,left\n")
    (tmp_path / "without.csv").write_text("j1,point\n0.2,A\n")
    joints = [JointRange("j1", "rad", -1.0, 1.0)]
    columns = SampleColumns(labels=("point",), optional_labels=("articulation",))
    alone = read_samples([tmp_path / "with.csv"], joints, columns)
    assert alone.labels["articulation"].tolist() == ["left"]
    both = read_samples([tmp_path / "with.csv", tmp_path / "without.csv"], joints, columns)
    assert set(both.labels) == {"point"}
    assert both.labels["point"].tolist() == ["A", "A"]


# ── strokes ──────────────────────────────────────────────────────────────────────────────────
def test_strokes_are_those_of_their_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "j1,point,stroke\n0,A,1\n1,A,1\n2,A,\n3,A,2\n", encoding="utf-8"
    )
    (tmp_path / "b.csv").write_text("j1,point,stroke\n0,B,1\n", encoding="utf-8")
    (tmp_path / "c.csv").write_text("j1,point\n0,C\n1,C\n", encoding="utf-8")
    files = [tmp_path / f"{name}.csv" for name in "abc"]
    samples = read_samples(files, [REVOLUTE], TOUCHED)
    _, number = np.unique(samples.labels["stroke"], return_inverse=True)
    # A row without a stroke is by itself, and so is every row of a file without the column.
    assert number[0] == number[1]
    assert len(set(number)) == len(samples) - 1
    assert "stroke" not in read_samples(files[2:], [REVOLUTE], TOUCHED).labels


def test_a_joint_may_be_called_stroke(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("stroke,point\n0.1,A\n0.1,A\n", encoding="utf-8")
    samples = read_samples([tmp_path / "a.csv"], [replace(PRISMATIC, name="stroke")], TOUCHED)
    assert list(samples.labels) == ["point"]
