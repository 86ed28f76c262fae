"""Two arms on one torso, in every command over a job."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import yaml
from cli_job import answer, printed, refused
from torso_robot import torso_robot_urdf

from suta_calib import CalibrationJob
from suta_calib.analysis.planning import situation_of_job
from suta_calib.exchange import read_result

BOARD = "type: chessboard\ncorners: [9, 6]\nsquare_mm: 25\n"
CAMERA = """\
image_width: 1280
image_height: 960
camera_matrix: {rows: 3, cols: 3, data: [1220, 0, 641, 0, 1221, 478, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""

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
    return calibrated(tmp_path_factory.mktemp("chains"), SIMULATION, JOB)


def calibrated(folder: Path, simulation: str, rows: str) -> Path:
    """The job of the torso robot in a folder, simulated, and calibrated beside it."""
    (folder / "robot.urdf").write_text(torso_robot_urdf())
    (folder / "simulation.yaml").write_text(ARM + simulation)
    (folder / "calibration.yaml").write_text(ARM + rows)
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


def test_the_whole_robot_is_looked_at(job: Path) -> None:
    names = answer("observe", job)["parameters"]
    assert {"torso_1.offset", "left_1.offset", "right_1.offset"} <= {*names}


@pytest.mark.parametrize("command", ["plan", "tip-map", "residual-map", "iso10360"])
def test_a_command_about_one_tip_asks_which(job: Path, command: str) -> None:
    assert "several chains; expected the name of one of left, right" in refused(command, job)
    assert "the chain 'middle'" in refused(command, job, "--chain", "middle")


def test_one_chain_is_mapped(job: Path) -> None:
    mapped = answer("tip-map", job, "--chain", "left", "--grid", 5)
    assert mapped


def test_what_one_chain_leaves(job: Path, tmp_path: Path) -> None:
    left = answer("residual-map", job, "--chain", "right", "--out", tmp_path)
    assert left["rows"] == 60
    assert not left["used"]
    assert {rows["name"] for rows in left["validation"]} == {"right_held/*.csv"}


def test_it_is_seen_as_a_whole(job: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    page = tmp_path / "robot.html"
    printed("view", job.parent / "results", "--html", page)
    assert page.stat().st_size > 10_000


def test_a_row_without_its_chain_is_refused_in_one_line(job: Path) -> None:
    """`tests/job/test_several_chains.py` has all that may be wrong with chains."""
    wrong = job.parent / "wrong.yaml"
    wrong.write_text(job.read_text().replace("chain: left, samples: left/*", "samples: left/*", 1))
    assert "the chain that its samples are of" in refused("calibrate", wrong)


def test_errors_are_budgeted_and_searched_by_chain(job: Path) -> None:
    blocks = answer("budget", job)["blocks"]
    assert [(block["data"], block["chain"]) for block in blocks] == [
        (data, chain) for data in ("calibration", "validation") for chain in ("left", "right")
    ]
    assert [term["chain"] for term in answer("outliers", job)["by_term"]] == ["left", "right"]


def test_one_arm_of_the_robot_is_emulated(job: Path) -> None:
    start = ("emulate", job.parent / "robot.urdf", "--script")
    simulation = job.parent / "simulation.yaml"
    for script in (job, simulation):
        assert "several chains; expected the name of" in refused(*start, script)
    point = ("--chain", "right", "--point", "F1=300,-300,400")
    playing = ("--seconds", "0.05", "--start", "now", "--device-out", job.parent / "device.yaml")
    printed(*start, job, *point, *playing)
    joints = (job.parent / "device.yaml").read_text()
    assert "right_6" in joints
    assert "left" not in joints


SEEN = """\
  seen:
    kind: camera_view
    chain: left
    base_chain: right
    samples: 25
    board: board.yaml
    camera: camera.yaml
    camera_pose: {position_mm: [0, 20, 10], rotation_rpy_deg: [180, 0, 0]}
    board_pose: {position_mm: [10, 20, -20]}
"""
SEEN_ROW = (
    "  - {kind: camera_view, chain: left, base_chain: right, samples: seen/*.csv, "
    "corners: corners/seen.csv, board: board.yaml, camera: camera.yaml}\n"
)


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A camera in the left hand sees a board in the right hand; a tracker sees both hands."""
    folder = tmp_path_factory.mktemp("seen")
    (folder / "board.yaml").write_text(BOARD)
    (folder / "camera.yaml").write_text(CAMERA)
    noise = "noise: {instrument_mm: 0.1, corner_px: 0.1}"
    simulation = SIMULATION.replace("noise: {instrument_mm: 0.1}", noise) + SEEN
    return calibrated(folder, simulation, JOB.replace("validation:", f"{SEEN_ROW}validation:"))


def test_one_hand_sees_the_other(seen: Path) -> None:
    result = json.loads((seen.parent / "results/result.json").read_text())
    assert {*result["metrics"]["by_chain"]} == {"left", "right", "left seen from right"}
    # What the truth calls the camera and the board is what the result calls them.
    truth = yaml.safe_load((seen.parent / "truth.yaml").read_text())["external_poses"]["seen"]
    assert {*truth} == {"hand_eye[left]", "target[right]"}
    for name, pose in truth.items():
        found = result["external_poses"][name]["position_mm"]
        assert found == pytest.approx(pose["position_mm"], abs=2.0)
    frames = {(p.parent, p.child) for p in read_result(seen.parent / "results").transforms}
    assert {("left_hand", "camera_left"), ("right_hand", "board_right")} <= frames


def test_what_one_hand_sees_of_the_other_is_shown(seen: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    page = tmp_path / "robot.html"
    printed("view", seen.parent / "results", "--html", page)
    assert page.stat().st_size > 10_000
    kinds = [(b["kind"], b["chain"]) for b in answer("budget", seen)["blocks"]]
    assert ("camera_view", "left seen from right") in kinds


def test_a_chain_that_is_named_in_a_row_is_no_other(seen: Path) -> None:
    """The chain that begins in the other hand ends at the same tip."""
    situation = situation_of_job(CalibrationJob.load(seen), chain="left")
    assert situation.arm.chain.base == "base_link"
    assert {term.kind for term in situation.terms} == {"tracked_point"}
