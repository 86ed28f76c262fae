"""Tables of other programs: every usual form gives the same poses, or is asked about."""

from __future__ import annotations

import re
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported, poses, read_back, transforms, written
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.exchange.rotations import EULER

R, P = poses()
T = transforms(R, P)
XYZW = Rotation.from_matrix(R).as_quat()
WXYZ = np.roll(XYZW, 1, axis=1)


def euler(order: str) -> FloatArray:
    return np.asarray(Rotation.from_matrix(R).as_euler(order, degrees=True))


FORMS: dict[str, tuple[FloatArray, dict[str, object]]] = {
    "xyz xyzw": (np.hstack([P, XYZW]), {"rotation": "xyzw"}),
    "xyz wxyz": (np.hstack([P, WXYZ]), {"rotation": "wxyz"}),
    "wxyz xyz": (np.hstack([WXYZ, P]), {"rotation": "wxyz"}),
    "xyzw xyz": (np.hstack([XYZW, P]), {"rotation": "xyzw"}),
    "12 by rows": (T[:, :3].reshape(-1, 12), {}),
    "12 by columns": (T[:, :3].swapaxes(1, 2).reshape(-1, 12), {"rotation": "columns"}),
    "9 by rows and 3": (np.hstack([R.reshape(-1, 9), P]), {"rotation": "rows"}),
    "16 by rows": (T.reshape(-1, 16), {}),
    "16 by columns": (T.swapaxes(1, 2).reshape(-1, 16), {}),
    "stacked": (T.reshape(-1, 4), {}),
    "stacked by columns": (T.swapaxes(1, 2).reshape(-1, 4), {}),
    "rotation vector": (
        np.hstack([P, Rotation.from_matrix(R).as_rotvec()]),
        {"rotation": "vector"},
    ),
    **{
        f"Euler {order}": (np.hstack([P, euler(order)]), {"rotation": order, "unit": "deg"})
        for order in ("xyz", "XYZ", "zyx", "ZYX", "zyz", "ZYZ")
    },
}


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same_poses(form: str, separator: str, tmp_path: Path) -> None:
    rows, options = FORMS[form]
    path = written(tmp_path / "t.txt", rows, separator)
    check(imported(path, **options), tmp_path / "o.csv", R, P)


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_decimal_commas(separator: str, tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", T[:, :3].reshape(-1, 12), separator, decimal=",")
    check(imported(path), tmp_path / "o.csv", R, P)


def test_every_order_of_euler_angles_is_scipys(tmp_path: Path) -> None:
    assert len(EULER) == len(set(EULER)) == 24
    for order in EULER:
        path = written(tmp_path / "t.txt", np.hstack([P, euler(order)]))
        check(imported(path, rotation=order, unit="deg"), tmp_path / "o.csv", R, P)


NAMED: dict[str, tuple[str, FloatArray, dict[str, object]]] = {
    "NDI": ("Q0,Qx,Qy,Qz,Tx,Ty,Tz", np.hstack([WXYZ, 1e3 * P]), {"unit": "mm"}),
    "unit in the name": ("x [mm],y [mm],z [mm],qx,qy,qz,qw", np.hstack([1e3 * P, XYZW]), {}),
    "ours": ("x_mm,y_mm,z_mm,qx,qy,qz,qw", np.hstack([1e3 * P, XYZW]), {}),
    "ROS": (
        ",".join(f"pose.position.{a}" for a in "xyz")
        + ","
        + ",".join(f"pose.orientation.{a}" for a in "xyzw"),
        np.hstack([P, XYZW]),
        {},
    ),
    "a matrix": (
        "tx,ty,tz," + ",".join(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
        np.hstack([P, R.reshape(-1, 9)]),
        {},
    ),
    "names that say nothing": (
        ",".join(f"T{i}{j}" for i in range(3) for j in range(4)),
        T[:, :3].reshape(-1, 12),
        {},
    ),
    "roll, pitch, yaw": (
        "x,y,z,roll_deg,pitch_deg,yaw_deg",
        np.hstack([P, euler("xyz")]),
        {"rotation": "xyz"},
    ),
    "counted": ("x,y,z,q0,q1,q2,q3", np.hstack([P, WXYZ]), {"rotation": "wxyz"}),
    "counted from one": (
        "X,Y,Z,Q1,Q2,Q3,Q4",
        np.hstack([1e3 * P, XYZW]),
        {"rotation": "xyzw", "unit": "mm"},
    ),
    "normal, orientation, approach": (
        ",".join(letter + axis for letter in "noap" for axis in "xyz"),
        np.hstack([R[..., 0], R[..., 1], R[..., 2], P]),
        {},
    ),
    "joints and a matrix": (
        ",".join(["joint_1", *(f"m{i}{j}" for i in range(4) for j in range(4))]),
        np.hstack([P[:, :1], T.reshape(-1, 16)]),
        {},
    ),
    "given": (
        "one,two,three,four,five,six,seven",
        np.hstack([XYZW, P]),
        {"columns": "one=qx,two=qy,three=qz,four=qw,five=x,six=y,seven=z"},
    ),
}


@pytest.mark.parametrize("form", NAMED)
def test_columns_with_names(form: str, tmp_path: Path) -> None:
    header, rows, options = NAMED[form]
    path = written(tmp_path / "t.csv", rows, header=header)
    check(imported(path, **options), tmp_path / "o.csv", R, P)


@pytest.mark.parametrize("header", ["", "frame,time," + ",".join(f"v{k}" for k in range(16))])
def test_columns_in_front_of_a_pose(header: str, tmp_path: Path) -> None:
    ahead = np.arange(len(P))[:, None] * [1, 0.01]
    path = written(tmp_path / "t.csv", np.hstack([ahead, T.reshape(-1, 16)]), header=header)
    check(imported(path, pose_from="3"), tmp_path / "o.csv", R, P)
    with pytest.raises(InputError, match=r"18 columns: .*--pose-from N"):
        imported(path)
    for number in ("0", "1.5", "many", "nan", "99"):
        with pytest.raises(InputError, match="--pose-from: found"):
            imported(path, pose_from=number)


def test_pairs_of_poses_for_hand_eye(tmp_path: Path) -> None:
    header = ",".join(f"{p}_{n}" for p in "ab" for n in ("x", "y", "z", "qx", "qy", "qz", "qw"))
    rows = np.hstack([P, XYZW, P + 0.1, XYZW])
    found = imported(written(tmp_path / "t.csv", rows, header=header))
    check(found, tmp_path / "o.csv", R, P, "a_")
    check(found, tmp_path / "o.csv", R, P + 0.1, "b_")


def test_inverted_poses(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", np.linalg.inv(T).reshape(-1, 16))
    check(imported(path, invert=True), tmp_path / "o.csv", R, P)


def test_joint_readings_in_degrees_and_ticks(tmp_path: Path) -> None:
    q = np.random.default_rng(0).uniform(-2, 2, (6, 2))
    degrees = written(tmp_path / "d.csv", np.rad2deg(q), header="q1,q2")
    found = imported(degrees, columns="q1=joint_1,q2=joint_2", unit="deg")
    np.testing.assert_allclose(found.columns["joint_2"], q[:, 1], atol=1e-12)
    ticks = 2048 + np.array([1, -3]) * q * 4096 / (2 * np.pi)
    options = {"counts_per_turn": "4096", "zero": "joint_1=2048,joint_2=2048"}
    path = written(tmp_path / "t.csv", ticks, header="joint_1,joint_2")
    found = imported(path, unit="ticks", sign="joint_2=-1", ratio="joint_2=3", **options)
    for k, name in enumerate(("joint_1", "joint_2")):
        np.testing.assert_allclose(found.columns[name], q[:, k], atol=1e-12)


def test_one_zero_of_all_joints(tmp_path: Path) -> None:
    q = np.random.default_rng(0).uniform(-2, 2, (6, 2))
    ticks = np.array([2048, 2000]) + np.array([-1, 1]) * q * 4096 / (2 * np.pi)
    # Names of an arm's own, beside what a new job's file has.
    rows = np.hstack([ticks, np.full((6, 1), 21.5)])
    path = written(tmp_path / "t.csv", rows, header="pan,lift,temperature")
    options = {"zero": "2048,lift=2000", "sign": "-1,lift=1", "counts_per_turn": "4096"}
    found = imported(path, unit="ticks", **options)
    np.testing.assert_allclose(found.columns["pan"], q[:, 0], atol=1e-12)
    np.testing.assert_allclose(found.columns["lift"], q[:, 1], atol=1e-12)
    assert set(found.columns["temperature"].tolist()) == {21.5}
    assert any("joint readings in ticks: pan, lift; choose" in said for said in found.remarks)
    with pytest.raises(InputError, match="--zero: found 1 and 2"):
        imported(path, unit="ticks", counts_per_turn="4096", zero="1,2")


@pytest.mark.parametrize("behind", [True, False])
def test_joints_beside_a_matrix_without_names(behind: bool, tmp_path: Path) -> None:
    q = np.random.default_rng(0).uniform(-2, 2, (len(T), 6))
    parts = [q, T.reshape(-1, 16)]
    path = written(tmp_path / "t.txt", np.hstack(parts if behind else parts[::-1]))
    found = imported(path)
    check(found, tmp_path / "o.csv", R, P)
    np.testing.assert_allclose(found.columns["joint_6"], q[:, 5], atol=1e-12)
    first = 1 if behind else 17
    assert any(f"--columns {first}=NAME" in said for said in found.remarks)
    found = imported(path, columns=f"{first}=pan")
    check(found, tmp_path / "o.csv", R, P)
    np.testing.assert_allclose(found.columns["pan"], q[:, 0], atol=1e-12)


def test_numbers_beside_no_matrix_are_asked_about(tmp_path: Path) -> None:
    rows = np.random.default_rng(0).uniform(-2, 2, (6, 22))
    with pytest.raises(InputError, match=r"22 columns.*--pose-from"):
        imported(written(tmp_path / "t.txt", rows))


def test_which_columns_are_joints(tmp_path: Path) -> None:
    """By their usual names, by --joints, or by a name that they were given; labels never are."""
    path = tmp_path / "t.csv"
    path.write_text(
        "arm_joint_1,elbow,c,placement,arm_joint_1.direction\n90,90,90,1,1\n180,45,0,2,-1\n"
    )
    found = imported(path, unit="deg")
    assert found.columns["arm_joint_1"].tolist() == pytest.approx([np.pi / 2, np.pi])
    assert found.columns["arm_joint_1.direction"].tolist() == [1, -1]
    assert found.columns["elbow"].tolist() == [90, 45]
    found = imported(path, unit="deg", joints="elbow", columns="c=wrist,placement=repeat")
    assert found.columns["elbow"].tolist() == pytest.approx([np.pi / 2, np.pi / 4])
    assert found.columns["wrist"].tolist() == pytest.approx([np.pi / 2, 0])
    assert found.columns["repeat"].tolist() == ["1", "2"]
    assert found.columns["arm_joint_1"].tolist() == [90, 180]


def test_missing_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", np.hstack([P, XYZW]), header="x,y,z,qx,qy,qz,qw")
    lines = path.read_text().splitlines()
    lines[3] = ",".join(["MISSING"] * 7)
    lines[5] = lines[5].rpartition(",")[0] + ","
    path.write_text("\n".join(lines) + "\n")
    found = imported(path)
    assert (len(found), found.dropped) == (len(P) - 2, 2)
    kept = np.delete(np.arange(len(P)), [2, 4])
    check(found, tmp_path / "o.csv", R[kept], P[kept])


def test_labels_and_other_columns_come_along(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("joint_1;joint_2;placement;landmark\n0,5;1,5;P1;A\n0,25;1,75;P1;B\n")
    found = imported(path)
    assert found.columns["landmark"].tolist() == ["A", "B"]
    assert found.columns["joint_1"].tolist() == [0.5, 0.25]


def test_spreadsheets(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.title = "notes"
    sheet = book.create_sheet("poses")
    sheet.append(["x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"])
    for row in np.hstack([1e3 * P, XYZW]).tolist():
        sheet.append(row)
    book.save(tmp_path / "t.xlsx")
    check(imported(tmp_path / "t.xlsx", sheet="poses"), tmp_path / "o.csv", R, P)
    with pytest.raises(InputError, match=r"2 sheets: notes, poses.*--sheet"):
        imported(tmp_path / "t.xlsx")


def rewritten(path: Path, out: Path, old: str, new: str) -> Path:
    """A spreadsheet with other XML of its first sheet."""
    with zipfile.ZipFile(path) as book, zipfile.ZipFile(out, "w") as other:
        for name in book.namelist():
            text = book.read(name)
            if name.endswith("sheet1.xml"):
                assert re.search(old, text.decode())
                text = re.sub(old, new, text.decode()).encode()
            other.writestr(name, text)
    return out


def test_a_spreadsheet_is_as_large_as_its_cells(tmp_path: Path) -> None:
    """Whatever size it states: a huge one took for ever, and cells beyond a small one were lost."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["x", "y", "z"], [1, 2, 3], [1, 2, 4]):
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    size = r'<dimension ref="[^"]*"'
    for stated in ("A1:ZZ1048576", "A1:XFD1048576", "A1:B2"):
        path = rewritten(
            tmp_path / "a.xlsx", tmp_path / "b.xlsx", size, f'<dimension ref="{stated}"'
        )
        found = imported(path)
        assert (list(found.columns), found.columns["z"].tolist()) == (["x", "y", "z"], [3.0, 4.0])
    cell = '<row r="900"><c r="XFD900"><v>1</v></c></row></sheetData>'
    path = rewritten(tmp_path / "a.xlsx", tmp_path / "b.xlsx", "</sheetData>", cell)
    with pytest.raises(InputError, match=r":900: found 16384 columns; expected at most 10000"):
        imported(path)


def test_a_table_of_very_many_columns(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(",".join(f"joint_{k}" for k in range(10_000)) + "\n" + "1," * 9_999 + "1\n")
    begin = time.process_time()
    found = imported(path)
    assert (len(found.columns), len(found.sentence) < 500) == (10_000, True)
    assert time.process_time() - begin < 2.0


def test_options_in_a_file(tmp_path: Path) -> None:
    from suta_calib.exchange.option import options_from_file

    path = written(tmp_path / "t.txt", np.hstack([1e3 * P, XYZW]))
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("unit: mm\nrotation: xyzw\nheader: no\n")
    check(imported(path, **options_from_file(mapping)), tmp_path / "o.csv", R, P)
    mapping.write_text("unit: {a: {b: c}}\n")
    with pytest.raises(InputError, match=r"mapping.yaml"):
        options_from_file(mapping)


ASKED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "scalar first or last": (
        lambda path: written(path, np.hstack([P, XYZW])),
        "--rotation xyzw|wxyz, or --guess",
    ),
    "scalar of a counted quaternion": (
        lambda path: written(path, np.hstack([P, WXYZ]), header="x,y,z,q0,q1,q2,q3"),
        "columns q0, q1, q2, q3.*--rotation wxyz|xyzw, or --guess",
    ),
    "which angles": (
        lambda path: written(path, np.hstack([P, euler("xyz")])),
        "kind of angles.*--rotation vector",
    ),
    "columns, or rows and a position": (
        lambda path: written(path, np.hstack([R.reshape(-1, 9), P])),
        "--rotation columns|rows",
    ),
    "millimetres": (lambda path: written(path, 1e3 * P), "millimetres.*--unit mm or --unit m"),
    "degrees": (
        lambda path: written(path, np.full((3, 1), 90.0), header="joint_1"),
        "look like degrees.*--unit deg",
    ),
}


@pytest.mark.parametrize("what", ASKED)
def test_what_may_be_several_things_is_asked(what: str, tmp_path: Path) -> None:
    make, says = ASKED[what]
    path = make(tmp_path / "t.txt")
    options = {"separator": "comma"} if what == "degrees" else {}
    with pytest.raises(InputError, match=says) as refused:
        imported(path, **options)
    assert str(refused.value).startswith(f"{path}:")
    assert imported(path, guess=True, **options).assessment.usable


def test_a_guess_is_told(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", np.hstack([P, XYZW]))
    found = imported(path, guess=True)
    assert any("--unit m, --rotation xyzw" in each for each in found.assessment.notes)
    assert read_back(found, tmp_path / "o.csv")[1].shape == P.shape


def test_four_joints_that_are_counted_are_no_quaternion(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", np.hstack([P, 2 * XYZW]), header="x,y,z,q1,q2,q3,q4")
    assert {"q1", "q2", "q3", "q4"} < set(imported(path).columns)


def test_the_unit_that_angles_were_taken_in_is_told(tmp_path: Path) -> None:
    """Few degrees may be rad: nothing in the file says."""
    path = written(tmp_path / "t.csv", np.hstack([P, 0.01 * euler("xyz")]))
    found = imported(path, rotation="xyz")
    assert any("were treated as rad" in each for each in found.assessment.notes)
    assert not any("as rad" in each for each in imported(path, rotation="xyz", unit="rad").remarks)


def test_lengths_are_questioned_and_never_scaled(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", 1e3 * P)
    found = imported(path, unit="m")
    assert found.assessment.level == "care"
    assert "check whether they are millimetres" in found.assessment.notes[0]
    check(found, tmp_path / "o.csv", None, 1e3 * P)


def test_columns_that_name_degrees_are_joints_whatever_they_are_called(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("No,A1 [deg],A2_deg,X [mm],Y [mm],Z [mm]\n1,90,-45,1,2,3\n2,0,30,1,2,4\n")
    found = imported(path)
    assert [*found.columns] == ["No", "A1", "A2", "x", "y", "z"]
    np.testing.assert_allclose(found.columns["A1"], [np.pi / 2, 0.0])
    np.testing.assert_allclose(found.columns["A2"], [-np.pi / 4, np.pi / 6])


def test_a_column_with_another_name_keeps_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("A1 [deg],A2 [deg],East [mm],Y [mm],Z [mm]\n90,-45,1,2,3\n0,30,1,2,4\n")
    found = imported(path, columns="A1 [deg]=a1,A2 [deg]=joint_2_deg,East [mm]=x")
    np.testing.assert_allclose(found.columns["a1"], [np.pi / 2, 0.0])
    np.testing.assert_allclose(found.columns["joint_2"], [-np.pi / 4, np.pi / 6])
    np.testing.assert_allclose(found.columns["x"], [1e-3, 1e-3])


REFUSED: dict[str, tuple[str, dict[str, object], str]] = {
    "a word": ("x,y,z\n1,2,3\n1,two,3\n", {}, r":3: column 2: found 'two'; expected a finite"),
    "infinity": ("x,y,z\n1,2,3\n1,inf,3\n", {}, r":3: column 2: found 'inf'"),
    "a short row": ("x,y,z\n1,2,3\n1,2\n", {}, r":3: found 2 cells; expected 3, as in the header"),
    "decimal commas and commas between cells": (
        "x,y,z\n0,5,1,5,2,5\n1,5,2,5,3,5\n",
        {},
        r":2: found 6 cells; expected 3, as in the header; decimal commas and commas between",
    ),
    "a last line cut off": ("x,y,z\n1,2,3\n4\n", {}, r":3: found 1 cell; expected 3.*cut off"),
    "not a quaternion": ("x,y,z,qx,qy,qz,qw\n1,2,3,9,9,9,9\n", {}, r":2: .*not a quaternion"),
    "nothing": ("\n\n", {}, "an empty file"),
    "a header only": ("x,y,z\n", {}, "a header without data"),
    "all missing": ("x,y,z\nNaN,NaN,NaN\n", {}, "no complete row"),
    "unknown columns": ("u,v\n1,2\n", {"columns": "w=joint_1"}, "no column 'w'"),
    "two of a name": ("x,x,z\n1,2,3\n", {}, r":1: found the column 'x' more than once"),
    "an option of another": ("x,y,z\n1,2,3\n", {"topic": "a"}, "option 'topic' for the format"),
    "no choice": ("x,y,z\n1,2,3\n", {"unit": "inch"}, "--unit: found 'inch'; expected one of m"),
    "ticks of what": ("joint_1,joint_2\n1,2\n", {"unit": "ticks"}, "--counts-per-turn"),
    "a unit of nothing": (
        "x,y,z\n1,2,3\n",
        {"unit": "deg"},
        "--unit deg, but no columns of joint .*--j",
    ),
    "a unit of columns of any name": (
        "A1,A2,x,y,z,repeat\n10,20,1,2,3,1\n",
        {"unit": "deg"},
        "--joints A1,A2$",
    ),
    "a length of nothing": ("joint_1,v\n1,2\n", {"unit": "mm"}, "--unit mm, but no columns of a p"),
    "lengths in two units": ("x,y,z\n1,2,3\n", {"unit": ("mm", "m")}, "--unit: found mm and m"),
    "two positions": (
        "tx,ty,tz,w,x,y,z\n1,2,3,1,0,0,0\n",
        {},
        r":2: found tx, ty, tz and x, y, z, which are both a position.*--columns",
    ),
    "a quaternion of three": (
        "x,y,z,qx,qy,qz\n1,2,3,0,0,0\n",
        {},
        r":2: found columns qx, qy, qz, but no qw; expected all four",
    ),
    "a quaternion of three, of a hand-eye pair": (
        "a_x,a_y,a_z,b_x,b_y,b_z,b_qx,b_qz,b_qw\n1,2,3,4,5,6,0,0,1\n",
        {},
        r":2: found columns b_qx, b_qz, b_qw, but no b_qy",
    ),
    "a unit for each axis": ("x_mm,y_m,z_mm\n1,2,3\n", {}, r":2: found columns x in mm, y in m, z"),
    "a unit for one axis": ("x_mm,y,z\n1,2,3\n", {}, r":2: found columns x in mm, y in no unit"),
    "positions twice": (
        "x_mm,y_mm,z_mm,x,y,z\n1,2,3,4,5,6\n",
        {},
        r":2: found several columns of 'x' in different units",
    ),
    "an origin of joints": (
        "joint_1\n1\n2\n",
        {"origin": "first", "separator": "comma"},
        "--origin",
    ),
    "far away": ("x,y,z\n100,200,300\n", {}, r":2: found positions about 374 m away.*--unit mm"),
    "both units": (
        "x_mm,y_mm,z_mm\n1,2,3\n",
        {"unit": "m"},
        "with mm in their names, but --unit m",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_used_is_refused_with_its_line(what: str, tmp_path: Path) -> None:
    text, options, says = REFUSED[what]
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        imported(path, **options)
    assert re.search(says, str(refused.value)), refused.value


@pytest.mark.parametrize(
    ("header", "options"),
    [
        ("x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm", {}),
        ("x,y,z,sigma_x [mm],sigma_y [mm],sigma_z [mm]", {"unit": "mm"}),
        ("x [mm],y [mm],z [mm],sigma_x,sigma_y,sigma_z", {}),
        ("x,y,z,ux,uy,uz", {"unit": "mm", "columns": "ux=sigma_x,uy=sigma_y,uz=sigma_z"}),
    ],
)
def test_stated_standard_deviations_come_with_the_points(
    header: str, options: dict[str, object], tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text(f"{header}\n100,200,300,0.01,0.02,0.03\n400,5,6,0.1,0.2,0.3\n")
    columns = imported(tmp_path / "t.csv", **options).columns
    assert set(columns) == {"x", "y", "z", "sigma_x", "sigma_y", "sigma_z"}
    np.testing.assert_allclose(columns["x"], [0.1, 0.4])
    np.testing.assert_allclose(columns["sigma_z"], [3e-5, 3e-4])


# ── Many rows ────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize(
    "odd",
    ["", "0.1,,0.3\n", " 0.1 , 0.2,0.3\n", "0.1,0.2,0.3,\n", '"0.1",0.2,0.3\n', "\n0.1,0.2,0.3\n"],
)
def test_rows_are_the_same_however_they_are_read(odd: str, tmp_path: Path) -> None:
    """Plain numbers are parsed at once; a line of another form changes no other row, nor lines."""
    rows = np.random.default_rng(0).uniform(-1, 1, (30, 3))
    body = "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())
    path = tmp_path / "t.csv"
    path.write_text("joint_1,joint_2,joint_3\n" + body + odd)
    found = imported(path, "table")
    read = np.stack([found.columns[f"joint_{k}"] for k in (1, 2, 3)], axis=1)
    np.testing.assert_array_equal(read[:30], rows)
    assert len(found) + found.dropped == 30 + bool(odd)
    path.write_text("joint_1,joint_2,joint_3\n" + body + odd + "0.1,oh,0.3\n")
    line = 32 + odd.count("\n")
    with pytest.raises(InputError, match=rf"t\.csv:{line}: column 2: found 'oh'"):
        imported(path, "table")
    path.write_text("joint_1,joint_2,joint_3\n" + body + odd + "0.1,inf,0.3\n")
    with pytest.raises(InputError, match=rf"t\.csv:{line}: column 2: found 'inf'"):
        imported(path, "table")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_may_end_in_any_way(end: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(end.join(["joint_1,joint_2", "0.1,0.2", "0.3,0.4", ""]).encode())
    assert imported(path, "table").columns["joint_2"].tolist() == [0.2, 0.4]


def test_a_row_of_very_many_cells_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("1," * 300_000 + "1\n")
    with pytest.raises(InputError, match="found 300001 columns; expected at most 10000"):
        imported(path, "table")


def test_text_behind_many_numbers_is_kept_as_it_is(tmp_path: Path) -> None:
    """A column is text as a whole, from its first row on, whatever row says so."""
    path, count = tmp_path / "t.csv", 10_100
    labels = ["07"] * (count - 1) + ["A"]
    path.write_text("joint_1,target\n" + "".join(f"0.5,{label}\n" for label in labels))
    found = imported(path, "table")
    assert found.columns["target"].tolist() == labels
    found.write(tmp_path / "o.csv")
    assert (tmp_path / "o.csv").read_text().splitlines()[1 :: count - 1] == ["0.5,07", "0.5,A"]
