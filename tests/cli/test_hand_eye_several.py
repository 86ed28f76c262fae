"""hand-eye of several eyes and targets end to end: JSON, files, exit codes."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, refused
from many_eyes import EYES, TARGETS, Scene, pose_errors, scene
from pose_scenes import PAIR, write_csv


def written(path: Path, data: Scene) -> Path:
    labels = data.eye.tolist(), data.target.tolist()
    return write_csv(path, (*PAIR, "eye", "target"), data.numbers, *labels)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_every_eye_and_target_is_found_by_name(tmp_path: Path, setup: str) -> None:
    data = scene(3, 2, 20, seed=1, setup=setup)  # type: ignore[arg-type]
    out = tmp_path / "out"
    found = answer("hand-eye", written(tmp_path / "p.csv", data), "--setup", setup, "--out", out)
    for side, names, truth in (("X", EYES[:3], data.X), ("Z", TARGETS[:2], data.Z)):
        assert set(found[side]) == set(found["std"][side]) == set(names)
        off = pose_errors(np.array([found[side][name] for name in names]), truth)
        for name, (*shift, rx, ry, rz) in zip(names, off, strict=True):
            std = found["std"][side][name]
            for value, axis in zip(shift, "xyz", strict=True):
                assert abs(1e3 * value) < 4.0 * std[f"{axis}_mm"]
            for value, axis in zip((rx, ry, rz), "xyz", strict=True):
                assert abs(np.degrees(value)) < 4.0 * std[f"r{axis}_deg"]
    assert found["verdict"]["usable"]
    assert len(found["covariance"]["order"]) == 30
    assert found["eyes"]["left"]["seen_with"] in (["A", "B"], ["B", "A"])
    pairs = [row["eye"] for row in found["between_eyes"]]
    assert pairs == ["right", "top"]
    assert json.loads((out / "result.json").read_text()) == found
    assert {p.name for p in out.iterdir()} == {
        *("residuals.csv", "hand_eye.svg", "report.html", "result.json")
    }
    with (out / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["eye"] for row in rows] == data.eye.tolist()
    assert [row["target"] for row in rows] == data.target.tolist()


def test_a_column_of_eyes_alone_has_one_target(tmp_path: Path) -> None:
    data = scene(2, 1, 15)
    path = write_csv(tmp_path / "p.csv", (*PAIR, "eye"), data.numbers, data.eye.tolist())
    found = answer("hand-eye", path)
    assert list(found["X"]) == ["left", "right"]
    assert list(found["Z"]) == ["default"]


def test_an_eye_that_cannot_be_determined_has_no_number(tmp_path: Path) -> None:
    """The second eye looks only while the hand stands: its rows are ten readings of one pose."""
    data = scene(3, 3, 20, seed=1, sees=np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]], dtype=bool))
    numbers = data.numbers.copy()
    top = np.flatnonzero(data.eye == "top")
    numbers[top] = numbers[top[0]] + 1e-4 * np.random.default_rng(1).normal(size=(len(top), 14))
    labels = data.eye.tolist(), data.target.tolist()
    path = write_csv(tmp_path / "p.csv", (*PAIR, "eye", "target"), numbers, *labels)
    found = answer("hand-eye", path, "--out", tmp_path / "out")
    assert found["X"]["top"] is None
    assert found["Z"]["C"] is None
    assert found["std"]["X"]["top"] is None
    assert not found["eyes"]["top"]["usable"]
    assert found["eyes"]["left"]["usable"]
    assert found["eyes"]["right"]["usable"]
    assert found["eyes"]["top"]["undetermined"]
    assert "eye top only" in found["targets"]["C"]["because"]
    assert found["verdict"]["level"] == "care"
    with (tmp_path / "out" / "residuals.csv").open() as file:
        rows = [int(row["row"]) for row in csv.DictReader(file)]
    assert rows == np.flatnonzero(data.eye != "top").tolist()


def test_exchanged_eyes_are_bad_input(tmp_path: Path) -> None:
    data = scene(2, 1, 20)
    labels = data.eye.tolist()
    labels[20:] = ["right" if name == "left" else "left" for name in labels[20:]]
    path = write_csv(tmp_path / "p.csv", (*PAIR, "eye"), data.numbers, labels)
    said = refused("hand-eye", path)
    assert "eyes left and right are exchanged from row 20 on" in said
    assert "p.csv" in said


def test_a_row_without_an_eye_is_named(tmp_path: Path) -> None:
    data = scene(2, 1, 10)
    labels = data.eye.tolist()
    labels[4] = ""
    path = write_csv(tmp_path / "p.csv", (*PAIR, "eye"), data.numbers, labels)
    said = refused("hand-eye", path)
    assert "p.csv:6: column 'eye': found an empty cell" in said


def test_an_eye_and_a_target_that_never_agree_are_left_out(tmp_path: Path) -> None:
    """Rows of one eye and one target err alike: of three eyes, that one is named."""
    data = scene(3, 2, 30, seed=2)
    numbers = data.numbers.copy()
    wrong = (data.eye == "left") & (data.target == "B")
    numbers[wrong, 7] += 0.3
    labels = data.eye.tolist(), data.target.tolist()
    path = write_csv(tmp_path / "p.csv", (*PAIR, "eye", "target"), numbers, *labels)
    found = answer("hand-eye", path, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "report.html").is_file()
    assert set(data.eye[found["outliers"]]) == {"left"}
    assert len(found["outliers"]) in (wrong.sum(), 30 - wrong.sum())
    assert any("rows of eye left do not agree" in note for note in found["verdict"]["notes"])


def test_two_eyes_that_agree_only_by_themselves_are_told(tmp_path: Path) -> None:
    data = scene(2, 2, 30, seed=2)
    numbers = data.numbers.copy()
    numbers[(data.eye == "left") & (data.target == "B"), 7] += 0.3
    labels = data.eye.tolist(), data.target.tolist()
    path = write_csv(tmp_path / "p.csv", (*PAIR, "eye", "target"), numbers, *labels)
    said = refused("hand-eye", path)
    assert "each two agree by themselves" in said
