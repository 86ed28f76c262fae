"""A job whose camera sees markers that nobody measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from camera_job import CAMERA, JOB, SIMULATION
from cli_job import cli

from suta_calib.measurements import read_board
from suta_calib.measurements.board import Markers

# Another seed; the board that is simulated is not the one that is sought.
MARKERS = SIMULATION.replace("seed: 3", "seed: 1").replace("board.yaml", "true.yaml")
TRUE = """\
type: markers
dictionary: DICT_APRILTAG_36h11
markers:
  3: {position_mm: [0, 0, 0], size_mm: 60}
  4: {position_mm: [120, 5, 0], rotation_rpy_deg: [0, 0, 20], size_mm: 60}
  7: {position_mm: [10, 110, 20], rotation_rpy_deg: [5, 0, 100], size_mm: 50}
  9: {position_mm: [130, 120, 0], rotation_rpy_deg: [0, 10, 200], size_mm: 70}
"""


def sought(markers: str) -> str:
    return f"type: markers\ndictionary: DICT_APRILTAG_36h11\nmarkers: {markers}\nscale_ppm: 20\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    path = tmp_path_factory.mktemp("markers")
    (path / "arm.urdf").write_bytes((repository / "urdf" / "suta.urdf").read_bytes())
    files = {"simulation.yaml": MARKERS, "job.yaml": JOB, "true.yaml": TRUE}
    for name, text in (files | {"camera.yaml": CAMERA}).items():
        (path / name).write_text(text)
    assert cli("simulate", path / "simulation.yaml", "--out", path) == 0
    return path


def test_a_job_places_the_markers(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "board.yaml").write_text(sought("{3: {size_mm: 60}, 4: {size_mm: 60}, 7: {}, 9: {}}"))
    cli("calibrate", folder / "job.yaml", "--out", folder / "out")
    assert "Markers in the frame of marker 3" in capsys.readouterr().out
    result = json.loads((folder / "out" / "result.json").read_text())
    assert not result["unidentified"]
    assert result["metrics"]["validation"]["after"]["rms_mm"] < 0.3
    measured, true = read_board(folder / "out" / "board.yaml"), read_board(folder / "true.yaml")
    assert isinstance(measured, Markers)
    assert isinstance(true, Markers)
    assert set(result["markers"]["default"]) == {"3", "4", "7", "9"}
    for number, marker in measured.markers.items():
        assert marker.position_std is not None
        assert marker.size == pytest.approx(true.markers[number].size, rel=2e-3)
        off = abs(marker.position - true.markers[number].position)
        assert (off <= 4.0 * marker.position_std + 1e-9).all()
    # The size that is held carries the scale, so that a length of the arm is known.
    assert result["parameters"]["joint_4.z"]["std"] < 1e-3


def test_without_any_size_the_report_says_what_carries_the_scale(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "board.yaml").write_text(sought("{3: {}, 4: {}, 7: {}, 9: {}}"))
    cli("calibrate", folder / "job.yaml", "--out", folder / "unsized")
    assert "No observation measures a length" in capsys.readouterr().out


def test_what_is_not_placed_cannot_be_simulated(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "board.yaml").write_text(sought("{3: {}, 4: {}}"))
    (folder / "bad.yaml").write_text(MARKERS.replace("true.yaml", "board.yaml"))
    assert cli("simulate", folder / "bad.yaml", "--out", folder / "bad") == 2
    assert "markers of unknown places" in capsys.readouterr().err
