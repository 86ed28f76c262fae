"""Two arms on one torso, in every command over a job."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from cli_job import answer, printed, refused
from torso_robot import torso_robot_urdf

ARM = """\
arm:
  urdf: robot.urdf
  chains:
    left: {tip: left_hand}
    right: {tip: right_hand}
"""
SIMULATION = """\
errors:
  - {select: ["*.offset"], std_deg: 0.5}
  - {select: geometric, std_mm: 0.5, std_deg: 0.1}
noise: {instrument_mm: 0.1}
sets:
  left: {kind: tracked_point, chain: left, samples: 60}
  right: {kind: tracked_point, chain: right, samples: 60}
  left_held: {kind: tracked_point, chain: left, samples: 20}
  right_held: {kind: tracked_point, chain: right, samples: 20}
"""
JOB = """\
parameters:
  - {select: ["*.offset"], prior_deg: 1}
  - {select: geometric, prior_mm: 1, prior_deg: 0.2}
observations:
  - {kind: tracked_point, chain: left, samples: left/*.csv}
  - {kind: tracked_point, chain: right, samples: right/*.csv}
validation:
  - {kind: tracked_point, chain: left, samples: left_held/*.csv}
  - {kind: tracked_point, chain: right, samples: right_held/*.csv}
"""


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulated and calibrated; its results are beside it."""
    folder = tmp_path_factory.mktemp("chains")
    (folder / "robot.urdf").write_text(torso_robot_urdf())
    (folder / "simulation.yaml").write_text(ARM + SIMULATION)
    (folder / "calibration.yaml").write_text(ARM + JOB)
    printed("simulate", folder / "simulation.yaml", "--out", folder)
    printed("calibrate", folder / "calibration.yaml")
    return folder / "calibration.yaml"


def test_errors_are_told_of_each_chain(job: Path) -> None:
    result = json.loads((job.parent / "results/result.json").read_text())
    whole, chains = result["metrics"], result["metrics"]["by_chain"]
    assert {*chains} == {"left", "right"}
    for figures in (whole, *chains.values()):
        held_out = figures["validation"]
        assert held_out["before"]["rms_mm"] > 5 * held_out["after"]["rms_mm"]
        assert held_out["after"]["rms_mm"] < 0.35
    assert sum(c["validation"]["after"]["count"] for c in chains.values()) == 40
    with (job.parent / "results/residuals.csv").open() as file:
        rows = [row["chain"] for row in csv.DictReader(file)]
    assert rows.count("left") == rows.count("right") == 80


def test_a_shared_joint_has_one_answer_and_one_urdf(job: Path) -> None:
    result = json.loads((job.parent / "results/result.json").read_text())
    assert "torso_1.offset" in result["parameters"]
    urdf = job.parent / "results/calibrated.urdf"
    expected = result["metrics"]["validation"]["after"]["rms_mm"]
    for more in ((), ("--result", job.parent / "results/result.json")):
        validated = answer("validate", urdf, job, *more)["metrics"]["validation"]["after"]
        assert validated["rms_mm"] == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("command", ["observe", "budget", "outliers"])
def test_the_whole_robot_is_looked_at(job: Path, command: str) -> None:
    assert answer(command, job)


@pytest.mark.parametrize("command", ["plan", "tip-map", "iso10360"])
def test_a_command_about_one_tip_asks_which(job: Path, command: str) -> None:
    assert "several chains; expected the name of one of left, right" in refused(command, job)
    assert "the chain 'middle'" in refused(command, job, "--chain", "middle")


def test_one_chain_is_mapped(job: Path) -> None:
    mapped = answer("tip-map", job, "--chain", "left", "--grid", 5)
    assert mapped


def test_it_is_seen_as_a_whole(job: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    page = tmp_path / "robot.html"
    printed("view", job.parent / "results", "--html", page)
    assert page.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("chain: left, samples: left/*", "samples: left/*", "the chain that its samples are of"),
        ("chain: left, samples: left/*", "chain: lef, samples: left/*", "did you mean 'left'?"),
        ("chain: left, samples: left/*", "chain: left, samples: right/*", "left_1"),
        (
            "right: {tip: right_hand}",
            "right: {tip: left_hand}",
            "the tip of the chain left",
        ),
        ("right: {tip: right_hand}", "right: {tip: hand}", "hand"),
        ("  chains:", "  tip: left_hand\n  chains:", "tip beside chains"),
        ("samples: left/*.csv", "samples: [left/*.csv, right/*.csv]", "left_1"),
    ],
)
def test_what_contradicts_the_chains_is_refused(
    job: Path, tmp_path: Path, old: str, new: str, said: str
) -> None:
    text = job.read_text()
    assert old in text
    wrong = job.parent / f"wrong_{abs(hash((old, new)))}.yaml"
    wrong.write_text(text.replace(old, new, 1))
    assert said in refused("calibrate", wrong)
