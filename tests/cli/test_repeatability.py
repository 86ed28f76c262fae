"""``suta-calib repeatability`` end to end: figures, files, and one line for bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, refused
from lxml import html
from visits import visits

from suta_calib.measurements import Samples, write_samples


@pytest.fixture
def arm(suta_urdf: Path) -> tuple[object, ...]:
    return ("--urdf", suta_urdf, "--tip", "tip")


@pytest.fixture
def visited(tmp_path: Path) -> Path:
    labels = {
        "direction": ["left", "right", "front"] * 20,
        "protocol": ["free"] * 30 + ["guided"] * 30,
    }
    samples = visits(60, 0.2e-3, **labels)
    q = samples.q.copy()
    q[:, 3] += np.where(np.array(labels["direction"]) == "left", 4e-3, 0)
    write_samples(tmp_path / "v.csv", Samples.from_arrays(samples.joints, q, labels=labels))
    return tmp_path / "v.csv"


@pytest.fixture
def resting(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    rows = [f"{k / 100},{0.1 + 1e-5 * rng.standard_normal()},0.5" for k in range(500)]
    (tmp_path / "rest.csv").write_text("\n".join(["time,joint_1,joint_2", *rows]) + "\n")
    return tmp_path / "rest.csv"


def test_figures_of_visits_are_printed_as_json(visited: Path, arm) -> None:
    found = answer("repeatability", visited, *arm)
    assert found["visits"] == 60
    position = found["position"]
    assert position["rp_mm"] == pytest.approx(position["mean_mm"] + 3 * position["std_mm"])
    low, high = position["rp_interval_mm"]
    assert low < position["rp_mm"] < high
    assert set(found["protocols"]) == {"free", "guided"}
    assert found["comparisons"][0]["rms"]["proved"] is False
    assert found["directions"]["giving"] == "joint_4"
    assert found["directions"]["joints"]["joint_4"]["play_deg"] == pytest.approx(
        np.degrees(4e-3), rel=0.3
    )
    assert "left" in found["directions"]["joints"]["joint_4"]["between"]
    assert found["joints_rms_deg"] == pytest.approx(
        np.sqrt(np.mean([each["std_deg"] ** 2 for each in found["joints"].values()]))
    )
    assert found["comparisons"][0]["joints"].keys() == found["joints"].keys()
    assert list(found["joints"]) == [f"joint_{k}" for k in range(1, 7)]
    assert "stationary" not in found
    assert not list(visited.parent.glob("*.json"))


def test_the_same_call_gives_the_same_answer(visited: Path, arm) -> None:
    assert answer("repeatability", visited, *arm) == answer("repeatability", visited, *arm)


def test_files_are_written_and_the_section_is_replaced(
    visited: Path, resting: Path, arm, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "out"
    for _ in range(2):
        assert cli("repeatability", visited, *arm, "--out", out) == 0
    text = capsys.readouterr().out
    assert "joint_4" in text
    assert "has play or bends" in text
    assert max(len(line) for line in text.splitlines()[:-1] if "Written" not in line) <= 80
    names = {path.name for path in out.iterdir()}
    assert names == {"repeatability.json", "repeatability.svg", "report.html"}
    page = html.fromstring((out / "report.html").read_text())
    assert [each.get("id") for each in page.iter("section")] == ["repeatability"]
    assert json.loads((out / "repeatability.json").read_text())["visits"] == 60


def test_a_stream_alone_needs_no_arm(resting: Path, tmp_path: Path) -> None:
    found = answer("repeatability", "--stationary", resting, "--out", tmp_path / "out")
    assert set(found) == {"stationary", "verdict", "files", "run"}
    joints = found["stationary"]["joints"]
    assert joints["joint_1"]["std_deg"] == pytest.approx(np.degrees(1e-5), rel=0.1)
    assert joints["joint_2"]["stuck"] is True
    assert found["stationary"]["verdict"]["level"] == "care"
    assert (tmp_path / "out" / "repeatability.svg").is_file()


def test_an_arm_that_moved_is_not_usable(tmp_path: Path) -> None:
    rows = [f"{k / 100},{0.001 * k}" for k in range(500)]
    (tmp_path / "m.csv").write_text("\n".join(["time,joint_1", *rows]) + "\n")
    found = answer("repeatability", "--stationary", tmp_path / "m.csv", code=1)
    assert found["stationary"]["joints"]["joint_1"]["moved"] is True


def spoilt(visited: Path, line: int, column: str, value: str) -> None:
    rows = [row.split(",") for row in visited.read_text().splitlines()]
    rows[line - 1][rows[0].index(column)] = value
    visited.write_text("\n".join(map(",".join, rows)) + "\n")


@pytest.mark.parametrize(
    ("line", "column", "value", "said"),
    [
        (5, "joint_3", "157.0", "looks like degrees"),
        (9, "direction", "", "expected a label"),
        (9, "direction", "up", "1 visits with direction 'up'"),
        (1, "joint_2", "joint_two", "column 'joint_2'"),
    ],
)
def test_bad_cells_are_one_line(
    visited: Path, arm, line: int, column: str, value: str, said: str
) -> None:
    spoilt(visited, line, column, value)
    assert said in refused("repeatability", visited, *arm, "--out", visited.parent / "out")
    assert not (visited.parent / "out").exists()


def test_bad_streams_are_one_line(resting: Path) -> None:
    resting.write_text("joint_1\n" + "0.1\n" * 200)
    assert "time" in refused("repeatability", "--stationary", resting)
    resting.with_suffix(".parquet").write_bytes(b"PAR1")
    assert "Parquet" in refused("repeatability", "--stationary", resting.with_suffix(".parquet"))


def test_bad_usage_is_one_line(visited: Path, arm) -> None:
    assert "SAMPLES.csv" in refused("repeatability")
    assert "--urdf" in refused("repeatability", visited)
    assert "--tip" in refused("repeatability", visited, *arm[:2])
    assert "--urdf" in refused("repeatability", "--stationary", visited, "--tip", "tip")
    assert "nowhere" in refused("repeatability", visited, *arm[:2], "--tip", "nowhere")
    assert "no folder" in refused("repeatability", visited, *arm, "--out", visited)


def test_files_of_a_calibration_are_pooled_over_their_points(
    repository: Path, tmp_path: Path, capsys: Capture
) -> None:
    files = sorted((repository / "data/suta/calibration").glob("P*.csv"))
    arm = ("--urdf", repository / "urdf/suta.urdf", "--tip", "tip")
    found = answer("repeatability", *files, *arm)
    assert (found["touches"], found["points"]) == (225, 75)
    assert 0.2 < found["rms_of_others_mm"] < 0.4 < found["rms_mm"]
    joint = found["joints"]["joint_3"]
    assert joint["std_interval_deg"][0] < joint["std_deg"] < joint["std_interval_deg"][1]
    assert joint["peak_to_peak_deg"] < joint["largest_deg"]
    assert found["joints_rms_deg"] > 0
    out = tmp_path / "out"
    assert cli("repeatability", *files, *arm, "--out", out) == 0
    assert {path.name for path in out.iterdir()} >= {"repeatability.json", "report.html"}
    assert "joint_3" in capsys.readouterr().out
