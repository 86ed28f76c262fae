"""The planner's files and its command: candidates in, a plan for the bench out, honest refusals."""

from __future__ import annotations

import csv
import io
import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import Capture, answer, cli, printed, refused, write_simulated_job
from hypothesis import given
from hypothesis import strategies as st
from simulated import arm_named

from suta_calib.analysis.planning import Placement, Posture, TouchPoint, read_candidates, tilted
from suta_calib.errors import InputError, JobError
from suta_calib.geometry.numbers import rotation_from_rpy

ARM = arm_named("suta")
GOOD = """\
repeats: 2
placements:
  N1: {position_mm: [400, 50, 0], rotation_rpy_deg: [0, 20, 90]}
grids:
  G: {x_mm: [300, 400], y_mm: 0, z_mm: 0, yaw_deg: [0, 90], tilt_deg: 30, towards_deg: 90}
points:
  F1: {position_mm: [450, 0, 150], directions: 12, axis: [0, 0, -2], cone_deg: 45}
poses:
  A1:
    posture_deg: {joint_1: 10, joint_2: 170, joint_3: 160, joint_4: 100, joint_5: -90, joint_6: 0}
"""


def written(folder: Path, text: str) -> Path:
    """A candidates file."""
    path = folder / "candidates.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_places_are_read_in_si(tmp_path: Path) -> None:
    found = read_candidates(written(tmp_path, GOOD), ARM)
    assert found.repeats == 2
    by_name = {place.name: place for place in found.places}
    assert list(by_name) == ["N1", "G_1", "G_2", "G_3", "G_4", "F1", "A1"]
    first, point, pose = by_name["N1"], by_name["F1"], by_name["A1"]
    assert isinstance(first, Placement)
    np.testing.assert_allclose(first.position, [0.4, 0.05, 0.0])
    np.testing.assert_allclose(first.rotation, rotation_from_rpy(np.radians([0, 20, 90])))
    assert isinstance(by_name["G_4"], Placement)
    assert np.degrees(by_name["G_4"].tilt) == pytest.approx(30)
    np.testing.assert_allclose(by_name["G_4"].rotation[:2, 2], [0, 0.5], atol=1e-12)
    assert isinstance(point, TouchPoint)
    assert (point.directions, point.cone) == (12, pytest.approx(np.pi / 4))
    np.testing.assert_allclose(point.axis, [0, 0, -1])
    assert isinstance(pose, Posture)
    np.testing.assert_allclose(np.degrees(pose.readings), [10, 170, 160, 100, -90, 0])


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", None, "mapping"),
        ("repeats: 3\n", None, "no candidate"),
        ("placments: {}\n", 1, "did you mean 'placements'"),
        ("placements:\n  A: {position: [1, 2, 3]}\n", 2, "position without its unit"),
        ("placements:\n  A: {position_mm: [1, 2]}\n", 2, "a list of 3 numbers"),
        ("placements:\n  A: {position_mm: [1, 2, .nan]}\n", 2, "a finite number"),
        ("points:\n  A: {position_mm: [1, 2, 3], axis: [0, 0, 0]}\n", 2, "length zero"),
        ("points:\n  A: {position_mm: [1, 2, 3], cone_deg: 200}\n", 2, "at most 180"),
        ("points:\n  A: {position_mm: [1, 2, 3], directions: 1}\n", 2, "whole number from 2"),
        ("grids:\n  G: {x_mm: [1], y_mm: [2]}\n", 2, "this key is required"),
        ("grids:\n  G: {x_mm: [], y_mm: 1, z_mm: 0}\n", 2, "an empty list"),
        ("poses:\n  A: {posture_deg: {joint_9: 1}}\n", 2, "no joint 'joint_9'"),
        ("poses:\n  A: {posture_mm: {joint_1: 1}}\n", 2, "under posture_deg"),
        ("poses:\n  A: {posture_deg: {joint_1: 1}}\n", 2, "no reading of joint_2"),
        (
            "placements:\n  A: {position_mm: [1, 2, 3]}\npoints:\n  A: {position_mm: [1, 2, 3]}\n",
            None,
            "two candidates named 'A'",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, text: str, line: int | None, said: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(JobError, match=re.escape(said)) as refused:
        read_candidates(path, ARM)
    assert str(path) in str(refused.value)
    assert line is None or refused.value.line == line


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=6),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    ["placements", "points", "grids", "poses", "A", "position_mm", "x_mm"]
                ),
                inner,
                max_size=3,
            )
        ),
        max_leaves=8,
    )
)
def test_no_file_ends_in_anything_but_places_or_one_error(scratch: Path, content: Any) -> None:
    path = scratch.with_name("candidates.yaml")
    path.write_text(json.dumps(content), encoding="utf-8")
    places: object = ()
    said = ""
    try:
        places = read_candidates(path, ARM).places
    except InputError as error:
        said = str(error)
    assert bool(places) != ("expected" in said)


@given(st.floats(-3, 3), st.floats(0, 1.5), st.floats(-3, 3))
def test_a_tilt_leans_as_far_and_where_it_says(yaw: float, tilt: float, towards: float) -> None:
    z = tilted(yaw, tilt, towards)[:, 2]
    np.testing.assert_allclose(
        z, [np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)], atol=1e-9
    )


@pytest.fixture(scope="module")
def suta(repository: Path) -> Path:
    """The shipped job."""
    return repository / "data" / "suta" / "calibration.yaml"


CANDIDATES = """\
placements:
  N1: {position_mm: [390, 100, 250], rotation_rpy_deg: [8.499, 28.879, 137.192]}
  N2: {position_mm: [462.5, 62.5, 0], rotation_rpy_deg: [0, 0, 30]}
  far: {position_mm: [4000, 0, 0]}
points:
  F1: {position_mm: [600, 110, 290], directions: 20}
"""


@pytest.mark.usefixtures("drawn")
def test_the_command_chooses_among_the_candidates_and_writes_a_plan(
    suta: Path, tmp_path: Path
) -> None:
    file = written(tmp_path, CANDIDATES)
    told = answer("plan", suta, "-n", 2, "--candidates", file, "--out", tmp_path / "o")
    assert [c["name"] for c in told["chosen"]] == ["F1", "N1"]
    assert told["makes_identified"] == {"tip.y": ["F1"]}
    assert [u["name"] for u in told["unreachable"]] == ["far"]
    assert told["predicted"]["after"]["tip_mm"] < told["predicted"]["before"]["tip_mm"]
    names = {"plan.json", "plan.csv", "plan.yaml", "plan_1.svg", "plan_2.svg", "report.html"}
    assert {p.name for p in (tmp_path / "o").iterdir()} == names
    rows = list(csv.DictReader(io.StringIO((tmp_path / "o" / "plan.csv").read_text())))
    assert [(r["name"], r["kind"], r["samples"]) for r in rows] == [
        ("F1", "point", "20"),
        ("N1", "placement", "45"),
    ]
    again = {p.name: p for p in read_candidates(tmp_path / "o" / "plan.yaml", ARM).places}
    first = {p.name: p for p in read_candidates(file, ARM).places}
    assert set(again) == {"F1", "N1"}
    for name, place in again.items():
        other = first[name]
        assert not isinstance(place, Posture)
        assert not isinstance(other, Posture)
        np.testing.assert_allclose(place.position, other.position, atol=1e-6)


def test_the_table_fits_a_terminal(
    suta: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    file = written(tmp_path, CANDIDATES)
    options = ("--candidates", file, "--target-mm", "0.01", "--out", tmp_path / "o")
    shown = printed("plan", suta, "-n", 1, *options)
    assert max(map(len, shown.split("Written to")[0].splitlines())) <= 80
    assert "is not reached" in " ".join(shown.split())
    assert "No candidate can determine" in shown


def test_an_instrument_gets_postures(tmp_path: Path, suta_urdf: Path) -> None:
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    pose = (
        "{posture_deg: {joint_1: %d, joint_2: 20, joint_3: %d, joint_4: 5, joint_5: 9, joint_6: 0}}"
    )
    text = "poses:\n" + "".join(f"  A{k}: {pose % (20 * k, 30 * k)}\n" for k in range(4))
    file = written(tmp_path, text + "  B: " + pose.replace("%d", "400") + "\n")
    told = answer("plan", job, "-n", 2, "--candidates", file, "--out", tmp_path / "o")
    assert told["unreachable"] == [
        {"name": "B", "kind": "pose", "reason": "joint_1 beyond its limits"}
    ]
    header, first, _ = (tmp_path / "o" / "plan.csv").read_text().splitlines()
    assert header.endswith(
        "joint_1_deg,joint_2_deg,joint_3_deg,joint_4_deg,joint_5_deg,joint_6_deg"
    )
    assert first.startswith("A")
    assert len(read_candidates(tmp_path / "o" / "plan.yaml", ARM).places) == 2


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("placements: {A: {position: [1, 2, 3]}}\n", (), "position_mm"),
        ("placements: {A: {position_mm: [9000, 0, 0]}}\n", (), "the arm reaches none of them"),
        (CANDIDATES, ("--region", "1,0,0,1,0,1"), "a lower corner that is below"),
        (CANDIDATES, ("--target-mm", "nan"), "expected a finite number"),
        (CANDIDATES, ("-n", "0"), "0 is not in the range"),
        ("poses: {A: {posture_deg: {}}}\n", (), "a mapping of keys to values"),
        ("placements: {A: {position_mm", (), "candidates.yaml"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    suta: Path, tmp_path: Path, text: str, options: tuple[str, ...], said: str
) -> None:
    file = written(tmp_path, text)
    assert said in refused("plan", suta, "--candidates", file, "--out", tmp_path / "o", *options)
    assert not (tmp_path / "o").exists()


def test_a_plan_over_data_that_cannot_be_fitted_may_not_be_used(suta: Path, tmp_path: Path) -> None:
    artefact = suta.parent / "artefact.yaml"
    # Centimetres where millimetres are said: metres are refused when they are read.
    in_centimetres = re.sub(
        r"position_mm: \[(.*?)\]",
        lambda m: f"position_mm: [{', '.join(f'{float(x) / 10:g}' for x in m[1].split(','))}]",
        artefact.read_text(),
    )
    (tmp_path / "artefact.yaml").write_text(in_centimetres, encoding="utf-8")
    job = tmp_path / "calibration.yaml"
    job.write_text(
        suta.read_text()
        .replace("starts: 8", "starts: 1")
        .replace("calibration/", f"{suta.parent}/calibration/")
        .replace("validation/", f"{suta.parent}/validation/")
        .replace("../../urdf/", f"{suta.parent}/../../urdf/"),
        encoding="utf-8",
    )
    file = written(tmp_path, CANDIDATES)
    told = answer("plan", job, "--candidates", file, "-n", 1, code=1)
    assert told["verdict"]["level"] == "bad"
    assert told["verdict"]["notes"][0].startswith("Do not use the calibration itself (not ")


def test_a_calibration_offers_the_command_that_helps(
    tmp_path: Path, repository: Path, capsys: Capture
) -> None:
    """As it is printed it may be copied, also from a folder with a blank in its name."""
    job = Path(shutil.copytree(repository / "data/suta", tmp_path / "my job")) / "calibration.yaml"
    text = job.read_text(encoding="utf-8")
    text = text.replace("../../urdf", str(repository / "urdf")).replace("starts: 8", "starts: 1")
    job.write_text(text, encoding="utf-8")
    assert cli("calibrate", job, "--out", tmp_path / "o") == 0
    (line,) = (
        line for line in capsys.readouterr().out.splitlines() if line.startswith("suta-calib plan ")
    )
    program, *words = shlex.split(line, comments=True)
    assert (program, words[1]) == ("suta-calib", str(job))
    assert cli(*words, "--tilt", "0", "--out", tmp_path / "p") == 0
    assert "What to measure next" in capsys.readouterr().out
