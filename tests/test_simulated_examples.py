"""The simulated examples: made again the same, and calibrated they find what was put in."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli

from suta_calib import CalibrationJob
from suta_calib.emulation import read_truth

# Parameters that nothing can tell, so that they stay where they are drawn.
REDUNDANT = {"two_arms": {"left_6.offset", "right_6.offset"}}
ARMS = ("so101_printed_sheet", "camera_on_arm", "two_arms", "whole_robot", "phone_on_arm")
# An arm that bends needs more than its URDF.
CARE = {"whole_robot"}
# A parameter's error over its standard deviation that chance alone does not make.
CHANCE = 4.0


@pytest.fixture(scope="module")
def examples(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the folder; its READMEs name the commands relative to what is above it."""
    folder = tmp_path_factory.mktemp("repository") / "examples"
    ignored = shutil.ignore_patterns("results*")
    shutil.copytree(repository / "examples", folder, ignore=ignored)
    return folder


def numbers(file: Path) -> tuple[list[str], np.ndarray]:
    """Everything of a CSV file that is no number, and the numbers, NaN in place of the rest."""

    def number(cell: str) -> float:
        try:
            return float(cell)
        except ValueError:
            return math.nan

    with file.open(encoding="utf-8", newline="") as stream:
        cells = [cell for row in csv.reader(stream) for cell in row]
    values = np.array([number(cell) for cell in cells])
    texts = [cell for cell, value in zip(cells, values, strict=True) if math.isnan(value)]
    return texts, values


def figures(readme: Path) -> list[float]:
    """The last numbers of the rows of a README's table."""
    rows = re.findall(r"^\|.*\| \**([\d.]+)\** \|$", readme.read_text(encoding="utf-8"), re.M)
    return [float(value) for value in rows]


@pytest.mark.parametrize("name", ARMS)
def test_simulated_again_it_is_the_same(name: str, examples: Path, tmp_path: Path) -> None:
    folder = examples / name
    assert cli("simulate", folder / "simulation.yaml", "--out", tmp_path) == 0
    kept = folder / "simulated"
    files = {file.relative_to(kept) for file in kept.rglob("*.csv")}
    assert files == {file.relative_to(tmp_path) for file in tmp_path.rglob("*.csv")}
    assert len(files) >= 2
    for file in files:
        texts, values = numbers(tmp_path / file)
        expected_texts, expected = numbers(kept / file)
        assert texts == expected_texts
        # Postures are searched by iteration, whose last digits are the processor's.
        np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_calibrated_it_finds_what_was_put_in(name: str, examples: Path) -> None:
    folder = examples / name
    assert cli("calibrate", folder / "calibration.yaml") == 0
    result = json.loads((folder / "results" / "result.json").read_text(encoding="utf-8"))
    assert result["verdict"]["level"] == ("care" if name in CARE else "good")
    held_out = result["metrics"]["validation"]
    unit = "deg" if name == "phone_on_arm" else "mm"
    found = [held_out[state][f"rms_{unit}"] for state in ("before", "after")]
    assert found == pytest.approx(figures(folder / "README.md"), abs=6e-4)
    job = CalibrationJob.load(folder / "calibration.yaml")
    truth = read_truth(folder / "simulated" / "truth.yaml", job.arm)
    assert set(result["unidentified"]) == REDUNDANT.get(name, set())
    of_the_arm = {parameter: result["parameters"][parameter] for parameter in job.parameters}
    told = {key: row for key, row in of_the_arm.items() if row["std"] is not None}
    assert {*told} == {*of_the_arm} - REDUNDANT.get(name, set())
    for parameter, row in told.items():
        assert abs(row["value"] - truth[parameter]) < CHANCE * row["std"], parameter


def test_the_pointer(examples: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = examples / "pivot_tool"
    assert cli("pivot", folder / "poses.csv", "--out", folder / "results", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    readme = (folder / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (simulated|found) \| (.*) \|$", readme, re.M))
    said = {state: [float(x) for x in row.split("|")] for state, row in rows.items()}
    assert answer["tip_mm"] == pytest.approx(said["found"], abs=6e-4)
    off = np.subtract(said["found"], said["simulated"])
    assert np.all(np.abs(off) < CHANCE * np.array(answer["tip_std_mm"]))
    assert answer["outliers"] == [11, 52, 53]
    assert (folder / "results" / "tip.json").is_file()


def test_the_pointer_is_simulated_by_its_script(examples: Path, tmp_path: Path) -> None:
    names: dict[str, object] = {"__name__": "make", "__file__": str(tmp_path / "make.py")}
    source = (examples / "pivot_tool" / "make.py").read_text(encoding="utf-8")
    exec(compile(source, "make.py", "exec"), names)
    main = names["main"]
    assert callable(main)
    main()
    texts, values = numbers(tmp_path / "poses.csv")
    expected_texts, expected = numbers(examples / "pivot_tool" / "poses.csv")
    assert texts == expected_texts
    np.testing.assert_allclose(values, expected, atol=1e-7)


def test_every_example_is_listed(repository: Path) -> None:
    folders = {path.name for path in (repository / "examples").iterdir() if path.is_dir()}
    listed = (repository / "examples" / "README.md").read_text(encoding="utf-8")
    assert folders - {"ros2"} <= set(re.findall(r"^\| \[(\w+)\]\(\w+\)", listed, re.M))
