"""Whole numbers that nobody means: refused at once, in one line, wherever they stand."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_job import refused

HUGE = "1000000000"
TOUCHED = "arm: {urdf: arm.urdf, tip: tip}\nsets:\n  a:\n    kind: KIND\n    PLACES\n    WHAT\n"
POINTS = "points: {F1: {position_mm: [400, 0, 100]}}"
PLACEMENTS = "placements: {P1: {position_mm: [437.5, 12.5, 0]}}\n    artefact: artefact.yaml"


@pytest.fixture
def folder(scene: Path, tmp_path: Path) -> Path:
    for name in ("arm.urdf", "artefact.yaml", "device.yaml", "calibration.yaml"):
        (tmp_path / name).write_bytes((scene / name).read_bytes())
    for name in ("calibration", "validation"):
        (tmp_path / name).symlink_to(scene / name)
    return tmp_path


@pytest.mark.parametrize("number", [HUGE, "1" + "0" * 30])
@pytest.mark.parametrize(
    ("old", "new", "at_most"),
    [("starts: 2", "starts: {}", "1,000"), ("seed: 0", "seed: 0, max_iterations: {}", "100,000")],
)
def test_of_a_job(folder: Path, old: str, new: str, at_most: str, number: str) -> None:
    job = folder / "calibration.yaml"
    job.write_text(job.read_text().replace(old, new.format(number)))
    error = refused("calibrate", job)
    assert f"expected a whole number from 1 to {at_most}" in error
    assert "calibration.yaml:9: solver." in error


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (TOUCHED.replace("KIND", "fixed_point").replace("PLACES", POINTS), "directions"),
        (TOUCHED.replace("KIND", "pairwise_distance").replace("PLACES", PLACEMENTS), "repeats"),
        (TOUCHED.replace("KIND", "tracked_point").replace("    PLACES\n", ""), "samples"),
    ],
)
def test_of_a_simulation(folder: Path, text: str, key: str) -> None:
    (folder / "simulation.yaml").write_text(text.replace("WHAT", f"{key}: {HUGE}"))
    error = refused("simulate", folder / "simulation.yaml", "--out", folder / "out")
    assert f"{key}: found {HUGE}; expected a whole number from 1 to " in error
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    "line",
    [
        ("study", "calibration.yaml", "--trials", HUGE),
        ("study", "calibration.yaml", "--sizes", f"1-{HUGE}"),
        ("study", "calibration.yaml", "--jobs", HUGE),
        ("plan", "calibration.yaml", "-n", HUGE),
        ("plan", "calibration.yaml", "-n", "1", "--repeats", HUGE),
        ("tip-map", "calibration.yaml", "--region", "0,1,0,1,0,1", "--grid", HUGE),
        ("measure", "calibration.yaml", "--device", "device.yaml", "--free", "--rests", HUGE),
        ("emulate", "arm.urdf", "--tip", "tip", "--rate", HUGE),
        ("emulate", "arm.urdf", "--tip", "tip", "--directions", HUGE),
        ("emulate", "arm.urdf", "--tip", "tip", "--counts-per-turn", HUGE + "0"),
    ],
)
def test_of_options(folder: Path, line: tuple[str, ...]) -> None:
    words = [folder / word if (folder / word).is_file() else word for word in line]
    error = refused(*words)
    assert line[-1] in error


def test_of_a_device(folder: Path) -> None:
    (folder / "device.yaml").write_text(
        "port: loop://\nunit: counts\nformat: lines\njoints: [{name: a}]\n"
        f"counts_per_turn: {HUGE}0\n"
    )
    assert "counts_per_turn: found 10000000000; expected a whole number from 2 to" in (
        refused("monitor", "--device", folder / "device.yaml")
    )
