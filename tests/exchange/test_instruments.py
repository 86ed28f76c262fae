"""Files of instruments: the tool's poses, also relative to a reference, without lost frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported
from foreign_samples import BODIES, KEPT, REFERENCE, TOOL, P, R, leica_gsi

from suta_calib.errors import InputError


@pytest.mark.parametrize("form", BODIES)
def test_the_tool(form: str, tmp_path: Path) -> None:
    """Recognised from the file, in m, without the frame in which it was not seen."""
    sample = BODIES[form](tmp_path)
    found = imported(sample.path, **sample.options)
    assert (found.form, found.dropped) == (form, 1)
    check(found, tmp_path / "o.csv", R[KEPT], P[KEPT])


@pytest.mark.parametrize("form", BODIES)
def test_relative_to_a_reference_body(form: str, tmp_path: Path) -> None:
    sample = BODIES[form](tmp_path)
    found = imported(sample.path, form, **sample.options, reference=sample.reference)
    relative = (np.linalg.inv(REFERENCE) @ TOOL)[KEPT]
    check(found, tmp_path / "o.csv", relative[:, :3, :3], relative[:, :3, 3])
    # Of two bodies the other one is meant.
    options = {name: value for name, value in sample.options.items() if name != "body"}
    other = imported(sample.path, form, **options, reference=sample.reference)
    assert other.text() == found.text()
    options = {**sample.options, "body": sample.reference, "reference": sample.options["body"]}
    other = imported(sample.path, form, **options)
    back = np.linalg.inv(relative)
    check(other, tmp_path / "o.csv", back[:, :3, :3], back[:, :3, 3])


@pytest.mark.parametrize("form", BODIES)
def test_which_body_is_asked(form: str, tmp_path: Path) -> None:
    sample = BODIES[form](tmp_path)
    options = {name: value for name, value in sample.options.items() if name != "body"}
    with pytest.raises(
        InputError, match=rf"2 bodies or markers: .*{sample.reference}.*--body NAME"
    ):
        imported(sample.path, **options)
    with pytest.raises(InputError, match=r"no body or marker 'nobody'; expected one of"):
        imported(sample.path, **options, body="nobody")


@pytest.mark.parametrize("form", BODIES)
def test_several_bodies_are_told_apart(form: str, tmp_path: Path) -> None:
    sample = BODIES[form](tmp_path)
    found = imported(sample.path, **{**sample.options, "body": "*"})
    targets, counts = np.unique(found.columns["target"], return_counts=True)
    assert dict(zip(targets, counts, strict=True)) == {
        sample.options["body"]: 7,
        sample.reference: 8,
    }


@pytest.mark.parametrize("form", ["motive", "vicon", "qualisys", "plus-sequence"])
def test_time_comes_along(form: str, tmp_path: Path) -> None:
    sample = BODIES[form](tmp_path)
    time = imported(sample.path, **sample.options).columns["time"]
    step = 0.05 if form == "plus-sequence" else 0.01
    np.testing.assert_allclose(time, KEPT * step, atol=1e-12)


def test_vicon_asks_what_its_angles_are(tmp_path: Path) -> None:
    sample = BODIES["vicon"](tmp_path)
    with pytest.raises(InputError, match=r":4: .*--rotation vector"):
        imported(sample.path, body="s:probe")


TURN = np.array([[[0.28, -0.96, 0], [0.96, 0.28, 0], [0, 0, 1]]])
WRITTEN = {
    "vicon.csv": (
        "Objects\n50\n,,tool,,,,,,\nFrame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ\n,,,,,,mm,mm,mm\n"
        "1,0,0,0,0.6,0.8,1000,0,0\n\nTrajectories\n50\n,,tool:A,,\n"
        "Frame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3000\n",
        {"tool": (TURN, [[1.0, 0, 0]], 0), "tool:A": (None, [[0.001, 0.002, 3.0]], 0)},
    ),
    "qualisys.tsv": (
        "NO_OF_FRAMES\t2\nFREQUENCY\t100\nMARKER_NAMES\tA\tB\n"
        "Frame\tTime\tA X\tA Y\tA Z\tB X\tB Y\tB Z\n"
        "1\t0.00\t1\t2\t1003\t4\t5\t1006\n2\t0.01\t1\t2\t1004\t4\t5\t1007\n",
        {"B": (None, [[0.004, 0.005, 1.006], [0.004, 0.005, 1.007]], 0)},
    ),
    # A marker that was not seen is all zeros, and a row of names may stand above the data.
    "zeros.tsv": (
        "NO_OF_FRAMES\t2\nNO_OF_CAMERAS\t13\nNO_OF_MARKERS\t2\nFREQUENCY\t120\n"
        "DESCRIPTION\t--\nTIME_STAMP\t2024-04-15, 10:39:38.777\t406646.66\nDATA_INCLUDED\t3D\n"
        "MARKER_NAMES\tTip\tBase\nTRAJECTORY_TYPES\tMeasured\tMeasured\n"
        "Frame\tTime\tTip X\tTip Y\tTip Z\tBase X\tBase Y\tBase Z\n"
        "1\t0.0\t-473.5\t0.000\t613.3\t-677.0\t164.8\t615.4\n"
        "2\t0.00833\t-473.5\t191.9\t613.3\t0.000\t0.000\t0.000\n",
        {
            "Base": (None, [[-0.677, 0.1648, 0.6154]], 1),
            "Tip": (None, [[-0.4735, 0, 0.6133], [-0.4735, 0.1919, 0.6133]], 0),
        },
    ),
    # Numbers that are nowhere, and a tool out of sight.
    "ndi.tsv": (
        "Port 1: probe\tFrame\tState\tQ0\tQx\tQy\tQz\tTx\tTy\tTz\n"
        "\t1\tOK\t1\t0\t0\t0\t1\t2\t-1500\n"
        "\t2\tOK" + "\t-3.697314E28" * 7 + "\n\t3\tOut of volume\t1\t0\t0\t0\t1\t2\t-1500\n",
        {"Port 1: probe": (np.eye(3)[None], [[0.001, 0.002, -1.5]], 2)},
    ),
    # Of one name what was measured counts, not where the rigid body says it should be.
    "motive.csv": (
        "Format Version,1.23,Take Name,S_04,Take Notes,,Rotation Type,Quaternion,"
        "Length Units,Meters,Coordinate Space,Global\r\n\r\n"
        f",Type,{'Rigid Body,' * 8}{'Rigid Body Marker,' * 4}Marker,Marker,Marker\r\n"
        f",Name,{'RB,' * 8}{'RB:Marker1,' * 6}RB:Marker1\r\n"
        ",ID," + ",".join(['"1"'] * 15) + "\r\n"
        f",,{'Rotation,' * 4}{'Position,' * 3}Mean Marker Error,{'Position,' * 3}Marker Quality,"
        "Position,Position,Position\r\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,,X,Y,Z\r\n"
        "0,0.0,0,0,0,1,0.1,0.2,0.3,0.0001,1,2,3,1.0,0.11,0.21,0.31\r\n"
        "1,0.1,,,,,,,,,,,,,0.12,0.22,0.32\r\n",
        {
            "RB": (np.eye(3)[None], [[0.1, 0.2, 0.3]], 1),
            "RB:Marker1": (None, [[0.11, 0.21, 0.31], [0.12, 0.22, 0.32]], 0),
        },
    ),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_files_as_instruments_write_them(name: str, tmp_path: Path) -> None:
    text, bodies = WRITTEN[name]
    path = tmp_path / name
    path.write_bytes(text.encode())
    for body, (rotation, position, dropped) in bodies.items():
        rows = imported(path, body=body)
        assert rows.dropped == dropped
        check(rows, tmp_path / "o.csv", rotation, np.array(position))


def test_motive_wants_quaternions(tmp_path: Path) -> None:
    sample = BODIES["motive"](tmp_path)
    text = sample.path.read_text().replace("Rotation Type,Quaternion", "Rotation Type,XYZ")
    sample.path.write_text(text)
    with pytest.raises(InputError, match=r"as XYZ; expected an export with .*Quaternion"):
        imported(sample.path, **sample.options)


def test_leica_coordinates(tmp_path: Path) -> None:
    found = imported(leica_gsi(tmp_path).path)
    assert found.columns["point"].tolist() == [f"P{k}" for k in range(8)]
    position = np.stack([found.columns[axis] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(position, P, rtol=0, atol=0.5e-5)


def test_leica_directions_and_distances(tmp_path: Path) -> None:
    """GSI-8: 30 gon, 45° and 45° 30' 36.0" from north, at 100 gon or 90° from above, 2 m away."""
    path = tmp_path / "polar.gsi"
    path.write_text(
        "110001+0000000A 21.102+03000000 22.102+10000000 31...0+00002000\n"
        "110002+0000000B 21.103+04500000 22.103+09000000 31...6+00020000\n"
        "110003+0000000C 21.104+04530360 22.104+09000000 31...8+00200000\n"
        "410004+00000001 11...4+0000000D\n"
    )
    found = imported(path)
    angle = np.deg2rad([27.0, 45.0, 45.51])
    assert found.columns["point"].tolist() == ["A", "B", "C"]
    np.testing.assert_allclose(found.columns["x"], 2 * np.sin(angle), atol=1e-9)
    np.testing.assert_allclose(found.columns["y"], 2 * np.cos(angle), atol=1e-9)
    np.testing.assert_allclose(found.columns["z"], 0, atol=1e-9)
    assert found.dropped == 1
    path.write_text("110001+0000000A 81..01+00001000 82..01+00001000 83..01+00001000\n")
    with pytest.raises(InputError, match=r":1: word 81: found the unit '1'; expected one of 0, 6"):
        imported(path)


def test_a_place_beyond_any_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n1,2,3\n1,1e300,3\n")
    with pytest.raises(InputError, match=r":3: found a position 1e\+300 m away"):
        imported(path)


def test_a_word_of_half_its_length_is_refused(tmp_path: Path) -> None:
    """A line of GSI-16 that lost the end of its last word has one of GSI-8."""
    path = leica_gsi(tmp_path).path
    first, *others = path.read_text().splitlines()
    path.write_text("\n".join([first.rstrip()[:-8], *others]) + "\n")
    with pytest.raises(InputError, match=r"gsi:1: found words of both 8 and 16 characters"):
        imported(path)


GRID = np.array([3_455_012.25, 5_428_530.5, 312.125])


def test_coordinates_of_a_grid_are_taken_from_an_origin(tmp_path: Path) -> None:
    """GSI words of 16 digits, in 0.01 mm: east, north and height of a national grid."""
    lines = []
    for k in range(8):
        words = [f"*11{k + 1:04d}+{f'P{k}':0>16}"]
        for index, value in zip((81, 82, 83), GRID + P[k], strict=True):
            words.append(f"{index}..08+{round(value * 1e5):016d}")
        lines.append(" ".join(words) + " ")
    path = tmp_path / "grid.gsi"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(
        InputError, match=r"grid\.gsi:1: found a position 5\.43e\+06 m .*--origin f"
    ):
        imported(path)
    origin = ",".join(map(repr, GRID.tolist()))
    found = imported(path, origin=origin)
    np.testing.assert_allclose(found.columns["y"], P[:, 1], atol=6e-6)
    assert f"The origin {origin.replace(',', ', ')} m was subtracted" in found.remarks[0]
    first = imported(path, origin="first")
    np.testing.assert_allclose(first.columns["x"], P[:, 0] - P[0, 0], atol=1.1e-5)
    for wrong in ("last", "1,2", "1,2,inf"):
        with pytest.raises(
            InputError, match=r"--origin: found .*; expected first, or three numbers"
        ):
            imported(path, origin=wrong)


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_a_point_list_of_a_grid(unit: str, tmp_path: Path) -> None:
    scale = 1e3 if unit == "mm" else 1.0
    rows = "".join(
        "P{}\t{:.5f}\t{:.5f}\t{:.5f}\n".format(k, *scale * (GRID + P[k])) for k in range(8)
    )
    path = tmp_path / "grid.txt"
    path.write_text("point\tx\ty\tz\n" + rows)
    with pytest.raises(
        InputError, match=r"grid\.txt:2: .*coordinates of a grid, give --origin first"
    ):
        imported(path, unit=unit)
    found = imported(path, unit=unit, origin="first")
    np.testing.assert_allclose(found.columns["z"], P[:, 2] - P[0, 2], atol=2e-5)
    assert found.columns["point"][1] == "P1"
