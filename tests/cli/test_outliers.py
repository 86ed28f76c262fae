"""``suta-calib outliers`` end to end: files, figures, exclusion, and bad input."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import answer, cli, printed, refused, write_simulated_job
from lxml import etree
from outlier_studies import SUTA, description, moved

from suta_calib.measurements import read_artefact, write_artefact
from suta_calib.simulation import simulate, write_simulation

# Its picture is read.
pytestmark = pytest.mark.usefixtures("all_drawn")

METRICS = {"contribution_pct", "cooks_distance", "leave_one_out_pct", "bias_mm"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """Folder of a job over simulated data whose certificate has S2 2 mm off."""
    folder = tmp_path_factory.mktemp("suta")
    write_simulation(simulate(description(), 1), folder)
    shutil.copy(suta_urdf, folder / "suta.urdf")
    certified = read_artefact(SUTA / "artefact.yaml")
    write_artefact(folder / "artefact.yaml", moved(certified, {"S2": np.array([0, 2e-3, 0])}))
    text = (SUTA / "calibration.yaml").read_text().replace("../../urdf/suta.urdf", "suta.urdf")
    (folder / "calibration.yaml").write_text(text.replace("starts: 8", "starts: 1"))
    return folder


@pytest.fixture(scope="module")
def listed(made: Path) -> dict[str, Any]:
    """What a run writes; its exit code is checked here."""
    assert cli("outliers", made / "calibration.yaml", "--out", made / "out", "--json") == 0
    found = json.loads((made / "out" / "outliers.json").read_text())
    assert isinstance(found, dict)
    return found


def excluding(made: Path, what: str) -> Path:
    """The same job, with something excluded from its observations."""
    text = (made / "calibration.yaml").read_text()
    job = made / "excluding.yaml"
    job.write_text(text.replace("huber_mm: 1.35}", f"huber_mm: 1.35, exclude: {{{what}}}}}"))
    return job


def test_the_displaced_landmark_is_named_with_everything_a_user_needs(
    listed: dict[str, Any],
) -> None:
    s2 = listed["landmarks"]["S2"]
    assert s2["outlier"] is True
    assert set(s2["flags"]) == METRICS
    assert s2.keys() > METRICS
    assert s2["as_calibrated"].keys() == METRICS
    assert abs(s2["displacement_mm"][1] + 2.0) < 0.3
    assert [name for name, g in listed["landmarks"].items() if g["outlier"]] == ["S2"]
    assert len(listed["landmarks"]) == len(listed["sets"]) == 15
    assert len(listed["placements"]) == 5
    assert sum(g["contribution_pct"] for g in listed["landmarks"].values()) == pytest.approx(100)
    assert listed["held_out"]["method"] == "validation"
    assert listed["held_out"]["landmarks"]["S2"].keys() > {"rms_before_mm", "rms_after_mm"}
    assert listed["exclude"] == [{"landmarks": ["S2"]}]
    assert listed["thresholds"]["bias_mm"] == 1.0
    assert listed["verdict"]["level"] == "care"
    assert "S2" in listed["verdict"]["sentence"]
    assert len(listed["touches"]) == 5
    assert {"row", "what", "size_mm"} == listed["touches"][0].keys()


def test_the_picture_and_the_section_are_written(listed: dict[str, Any], made: Path) -> None:
    assert set(listed["files"]) == {"outliers.svg", "report.html", "outliers.json"}
    svg = (made / "out" / "outliers.svg").read_text()
    etree.fromstring(svg.encode())
    assert "S2 " in svg
    assert "mm" in svg
    page = (made / "out" / "report.html").read_text()
    assert '<section id="outliers">' in page
    assert "exclude: {landmarks: [S2]}" in page


def test_the_console_says_what_was_not_done(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    job = excluding(made, "placements: [P4, P5]")
    out = " ".join(printed("outliers", job, "--out", made / "three", "--bias-mm", "50").split())
    assert "Nothing was excluded" in out
    assert "bias 50 mm" in out
    assert "3 of 4 metrics indicate it" in out


def test_the_job_excludes_it_and_the_result_says_so(made: Path) -> None:
    job = excluding(made, "landmarks: [S2]")
    found = answer("calibrate", job, "--out", made / "without")
    assert found["excluded"] == [
        {"in": "observations[0]", "kind": "pairwise_distance", "landmarks": ["S2"]}
    ]
    assert found["metrics"]["calibration"]["after"]["count"] == 15 * 14 * 13 // 2
    assert "excludes landmarks S2" in (made / "without" / "report.html").read_text()


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("landmarks: [S22]", ("exclude.landmarks", "'S22'", "did you mean 'S2'?")),
        ("landmark: [S2]", ("exclude.landmark", "unknown key", "landmarks")),
        ("points: [F1]", ("exclude.points", "point")),
        ("sets: [P1/9]", ("exclude.sets", "'P1/9'", "P1/1")),
        ("landmarks: [2]", ("exclude.landmarks", "quotes")),
        ("placements: [P1, P2, P3, P4, P5]", ("all 225 samples excluded",)),
    ],
)
def test_exclusions_that_cannot_be_are_refused(
    made: Path, what: str, said: tuple[str, ...]
) -> None:
    err = refused("outliers", excluding(made, what), "--out", made / "refused")
    assert "excluding.yaml" in err
    assert all(part in err for part in said)
    assert not (made / "refused").exists()


def test_other_kinds_are_judged_row_by_row(tmp_path: Path, suta_urdf: Path) -> None:
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    file = job.parent / "calibration" / "a.csv"
    lines = file.read_text().splitlines()
    column = lines[0].split(",").index("x")
    cells = lines[11].split(",")
    cells[column] = str(float(cells[column]) + 0.005)
    lines[11] = ",".join(cells)
    file.write_text("\n".join(lines) + "\n")
    found = answer("outliers", job)
    assert "landmarks" not in found
    assert [name for name, g in found["rows"].items() if g["outlier"]] == ["a.csv:12"]
    assert found["exclude"] == [{"rows": ["a.csv:12"]}]
    text = job.read_text().replace(
        "sigma_mm: 0.05}", "sigma_mm: 0.05, exclude: {rows: ['a.csv:12']}}"
    )
    job.write_text(text)
    assert answer("calibrate", job)["excluded"][0]["rows"] == ["a.csv:12"]


@pytest.mark.parametrize("bias", ["0", "-1", "nan", "one"])
def test_a_threshold_that_is_none_is_refused(made: Path, bias: str) -> None:
    assert "--bias-mm" in refused("outliers", made / "calibration.yaml", "--bias-mm", bias)


def test_a_calibration_that_does_not_converge_is_not_searched(made: Path) -> None:
    text = (made / "calibration.yaml").read_text()
    job = made / "hasty.yaml"
    job.write_text(text.replace("starts: 1", "max_iterations: 1, starts: 1"))
    found = answer("outliers", job, "--out", made / "hasty", code=1)
    assert found["verdict"]["level"] == "bad"
    assert "landmarks" not in found


def test_help_says_that_nothing_is_excluded() -> None:
    assert "Nothing is excluded" in " ".join(printed("outliers", "--help").split())
