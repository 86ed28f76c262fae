"""``suta-calib certify`` from a file to files, and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from certified_artefact import truth, write_points
from cli_job import answer, printed, refused

from suta_calib.arrays import FloatArray
from suta_calib.measurements import Artefact, read_artefact, write_artefact


@pytest.fixture
def points(tmp_path: Path) -> Path:
    return write_points(tmp_path / "points.csv")


def test_from_points_to_files(points: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "artefact.yaml", tmp_path / "report"
    write_artefact(tmp_path / "drawing.yaml", truth())
    drawing = ("--nominal", tmp_path / "drawing.yaml", "--spacer", "A=40")
    found = answer("certify", points, "--out", out, "--report", report, *drawing)
    certified = read_artefact(out)
    assert found["artefact"] == str(out)
    for name, mark in certified.landmarks.items():
        row = found["landmarks"][name]
        np.testing.assert_allclose(row["position_mm"], 1e3 * mark.position, atol=1e-8)
        assert row["sigma_mm"] == pytest.approx(1e3 * mark.sigma, abs=1e-8)
        assert row["sigma_mm"] == max(row["std_mm"])
        assert np.linalg.norm(row["nominal"]["deviation_mm"]) < 0.01
    assert found["damaged"] == []
    assert found["verdict"]["level"] == "good"
    assert found["spacers"][0]["deviation_mm"] == pytest.approx(0, abs=0.01)
    assert np.shape(found["covariance"]["matrix"]) == (18, 18)
    written = sorted(path.name for path in report.iterdir())
    assert written == ["certify.json", "certify.svg", "report.html"]
    page = (report / "report.html").read_text(encoding="utf-8")
    assert "Certification of points" in page
    assert page.count("<svg") == 1


def test_a_terminal_of_80_columns(points: Path, tmp_path: Path) -> None:
    write_artefact(tmp_path / "drawing.yaml", truth())
    shown = printed("certify", points, "--nominal", tmp_path / "drawing.yaml")
    assert max(map(len, shown.splitlines())) <= 80
    assert "Good." in shown
    assert "Spacers" in shown


def test_a_damaged_pillar_is_exit_1_and_stands_in_the_file(tmp_path: Path) -> None:
    def lean(feature: str, name: str, index: int, point: FloatArray) -> FloatArray:
        return point + np.array(
            [0, 0, 0.02 * (point[0] - 0.05) * ((feature, name) == ("top", "S2"))]
        )

    points, out = write_points(tmp_path / "points.csv", lean), tmp_path / "artefact.yaml"
    found = answer("certify", points, "--out", out, code=1)
    assert found["damaged"] == ["S2"]
    assert found["landmarks"]["S2"]["faults"][0]["what"] == "slope of its top"
    assert "DAMAGED OR TOUCHED WRONGLY: S2" in out.read_text(encoding="utf-8")
    assert answer("certify", points, "--tolerance-mm", 0.5)["damaged"] == []


def test_millimetres_and_metres_are_the_same(points: Path, tmp_path: Path) -> None:
    header, *lines = points.read_text(encoding="utf-8").splitlines()[1:]
    scaled = []
    for line in lines:
        *labels, x, y, z = line.split(",")
        scaled.append(",".join([*labels, *(f"{1e3 * float(v):.9f}" for v in (x, y, z))]))
    other = tmp_path / "mm.csv"
    named = header.replace("x,y,z", "x_mm,y_mm,z_mm")
    other.write_text("\n".join([named, *scaled]) + "\n", encoding="utf-8")
    first, second = (answer("certify", path)["landmarks"] for path in (points, other))
    for name in truth().landmarks:
        np.testing.assert_allclose(
            first[name]["position_mm"], second[name]["position_mm"], atol=1e-6
        )


def refuses(folder: Path, *arguments: object) -> str:
    """The one line of a command that must refuse, without writing anything."""
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    line = refused("certify", *arguments, "--json")
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
    return line


def without(pattern: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        return "".join(x for x in text.splitlines(keepends=True) if not re.match(pattern, x))

    return change


def replaced(old: str, new: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        assert re.search(old, text)
        return re.sub(old, new, text, count=1)

    return change


def copied(pattern: str) -> Callable[[str], str]:
    return lambda text: text + next(x for x in text.splitlines(True) if re.match(pattern, x))


# What is spoilt → what the one line must say after the file's name.
BAD: dict[str, tuple[Callable[[str], str], str]] = {
    "column": (replaced("index", "number"), r":2: column 'index': found only the columns"),
    "feature": (
        replaced("ground", "grund"),
        r":3: column 'feature': found 'grund'; expected one of .*did you mean 'ground'",
    ),
    "far too large": (
        replaced(r"(top,O,0,)[^,]*", r"\g<1>1e308"),
        r"28: column 'x': found '1e308'; expected a position within",
    ),
    "no number": (replaced(r"(top,O,0,)[^,]*", r"\1one"), r":\d+: column 'x': found 'one'"),
    "no name": (replaced("top,O,0", "top,,0"), r":\d+: column 'landmark': found an empty cell"),
    "hole index": (replaced("hole,O,3", "hole,O,5"), r"column 'index': found '5'.* from 0 to 4"),
    "hole left out": (replaced("hole,O,3", "hole,O,4"), r"'O': found 4 .* the indices 0, 1, 2, 4"),
    "flat index": (replaced("flat,O,1", "flat,O,2"), r"column 'index': found '2'.* from 0 to 1"),
    "both units": (replaced("feature,", "x_mm,"), r"column 'feature': found only the columns"),
    "no ground": (without("ground"), r"found 0 touches of the ground; expected at least 3"),
    "ground in line": (without("ground,,([5-9]|..),"), r"ground: found 5 touches .* on a line"),
    "no landmark": (without("top|hole|flat"), r"found no landmark; expected touches of 'top'"),
    "no holes": (without("hole,M1"), r"landmark 'M1': found 0 touches of its holes"),
    "a hole twice": (copied("hole,M1,2"), r"landmark 'M1': found 5 touches of its holes"),
    "two touches": (without("top,S1,[234]"), r"landmark 'S1': found 2 touches of its top"),
    "top in line": (without("top,S1,[24]"), r"landmark 'S1': found 3 touches .* on a line"),
    "one flat": (without("flat,S1,1"), r"landmark 'S1': found touches of only one flat"),
    "one side": (without("side,,([1-9]|..),"), r"found 1 touch of the side"),
    "one end": (without("spacer,A,1"), r"spacer 'A': found 1 ends; expected an even number"),
    "millimetres": (
        lambda t: re.sub(r"(-?\d\.\d+)", r"\1e3", t),
        r"found points within [\d.]+ m; .* millimetres",
    ),
    "another pillar's top": (
        lambda t: t.replace("top,S1", "top,@").replace("top,S2", "top,S1").replace("@", "S2"),
        r":\d+: landmark 'S2': found a top [\d.]+ mm away from .* belong to this landmark",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_points_are_refused(points: Path, what: str) -> None:
    change, expected = BAD[what]
    old = points.read_text(encoding="utf-8")
    points.write_text(change(old), encoding="utf-8")
    assert points.read_text(encoding="utf-8") != old
    folder = points.parent
    err = refuses(folder, points, "--out", folder / "a.yaml", "--report", folder / "r")
    assert re.search(re.escape(str(points)) + ".*" + expected, err), err


def swapped(folder: Path) -> Path:
    """A drawing with the right names in the wrong places."""
    exact = truth().landmarks
    places = [mark.position for mark in exact.values()]
    turned = zip(exact.values(), [*places[2:], *places[:2]], strict=True)
    marks = {mark.name: replace(mark, position=place) for mark, place in turned}
    write_artefact(folder / "swapped.yaml", Artefact("swapped", marks))
    return folder / "swapped.yaml"


def test_bad_options_are_refused(points: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("landmarks:\n  o1: {position_mm: [0, 0, 0]}\n", encoding="utf-8")
    bad = {
        ("--nominal", other): r"0 of the touched landmarks are in the drawing 'other'; expected at",
        ("--nominal", swapped(tmp_path)): r"--nominal: found landmarks that do not fit the drawing",
        ("--nominal", tmp_path / "none.yaml"): r"none.yaml: found no such file",
        ("--out", points): r"found an input of the same command",
        ("--out", tmp_path): r"found a folder",
        ("--out", tmp_path / "none" / "a.yaml"): r"found no folder",
        ("--origin", "M2"): r"no touches of landmark 'M2'; expected one of O, M1",
        ("--spacer", "A"): r"found 'A'; expected NAME=LENGTH",
        ("--spacer", "C=40"): r"no touches of spacer 'C'; expected one of A, B",
        ("--sigma-um", "0"): r"0.* is not in the range",
        ("--sigma-um", "nan"): r"nan",
        ("--tolerance-mm", "-1"): r"-1.* is not in the range",
    }
    for options, expected in bad.items():
        assert re.search(expected, refuses(tmp_path, points, *options))
    assert "no such file" in refuses(tmp_path, tmp_path / "none.csv")


def test_too_few_touches_to_learn_the_noise_from(tmp_path: Path) -> None:
    points = write_points(tmp_path / "points.csv")
    text = without(r"top,.*,[34],|ground,,([135-9]|1\d|2[1-4]),")
    few = text(points.read_text(encoding="utf-8"))
    points.write_text(few, encoding="utf-8")
    assert "give it with --sigma-um" in refuses(tmp_path, points)
    found = answer("certify", points, "--sigma-um", 1)
    assert found["verdict"]["level"] == "care"


def test_the_example_files(repository: Path) -> None:
    folder = repository / "data" / "artefact"
    drawing = ("--nominal", repository / "data" / "suta" / "artefact.yaml")
    exact = read_artefact(folder / "truth.yaml")
    found = answer("certify", folder / "points.csv", *drawing)
    for name, mark in exact.landmarks.items():
        row = found["landmarks"][name]
        off = np.abs(np.array(row["position_mm"]) - 1e3 * mark.position)
        assert np.all(off <= 4 * np.array(row["std_mm"]) + 1e-9)
    worse = answer("certify", folder / "points_damaged.csv", *drawing, code=1)
    assert worse["damaged"] == ["S2"]
    assert len(worse["wrong_touches"]) == 1
