"""Certificates of cameras: every pose is on paper, and its budget is its standard deviation."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import many_eyes
import numpy as np
import pytest
from camera_scenes import SECOND, X, pictures, write_hand
from cli_job import cli
from depth_scenes import BOARD, depth_scene
from line_scans import line_scans
from pose_scenes import write_csv
from pypdf import PdfReader

from suta_calib.certificate import certificate_of, pdf_bytes
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements import write_board, write_camera, write_corners
from suta_calib.measurements.profiles import write_profiles
from suta_calib.measurements.seen_points import write_seen_points

PAIR = [f"{a}_{c}" for a in "ab" for c in ("x", "y", "z", "qx", "qy", "qz", "qw")]


def several(folder: Path) -> list[object]:
    data = many_eyes.scene(2, 2, 20, seed=1)
    labels = data.eye.tolist(), data.target.tolist()
    names = (*PAIR, "eye", "target")
    return ["hand-eye", write_csv(folder / "poses.csv", names, data.numbers, *labels)]


def depth_camera(folder: Path) -> list[object]:
    scene = depth_scene(3, "board", count=12)
    (folder / "poses.csv").write_text(scene.poses_csv(), encoding="utf-8")
    write_seen_points(folder / "points.csv", scene.seen)
    write_board(folder / "board.yaml", BOARD)
    words = ["--points", folder / "points.csv", "--board", folder / "board.yaml"]
    return ["hand-eye", folder / "poses.csv", *words]


def line_scanner(folder: Path) -> list[object]:
    scans = line_scans(7)
    write_profiles(folder / "profiles.csv", scans.profiles)
    turns = quaternion_from_rotation(scans.rotation)
    head = ["scan", "x", "y", "z", "qx", "qy", "qz", "qw"]
    numbers = np.hstack([scans.position, turns]).tolist()
    rows = [",".join([n, *map(repr, r)]) for n, r in zip(scans.scans, numbers, strict=True)]
    text = "\n".join([",".join(head), *rows])
    (folder / "poses.csv").write_text(text + "\n", encoding="utf-8")
    words = ["--profiles", folder / "profiles.csv", "--sphere-radius-mm", 20]
    return ["hand-eye", folder / "poses.csv", *words]


def two_cameras(folder: Path) -> list[object]:
    scene = pictures(12, pixel=0.1, robot=(1e-4, 1e-4), seed=2, eyes=(X, SECOND))
    write_hand(folder / "poses.csv", scene.hand)
    write_board(folder / "board.yaml", scene.views[0].board)
    words: list[object] = ["--board", folder / "board.yaml"]
    for name, view in zip(("left", "right"), scene.views, strict=True):
        write_corners(folder / f"{name}.csv", view.corners)
        assert view.camera is not None
        write_camera(folder / f"{name}.yaml", view.camera)
        words += ["--corners", f"{name}={folder / name}.csv"]
        words += ["--camera", f"{name}={folder / name}.yaml"]
    return ["hand-eye", folder / "poses.csv", *words]


def rig(folder: Path) -> list[object]:
    return ["rig", *two_cameras(folder)[2:]]


@pytest.mark.parametrize("made", [several, depth_camera, line_scanner, two_cameras, rig])
def test_every_pose_is_on_paper_with_its_budget(
    made: Callable[[Path], list[object]], tmp_path: Path
) -> None:
    out, words = tmp_path / "out", made(tmp_path)
    assert cli(*words, "--out", out) == 0
    result: dict[str, Any] = json.loads((out / "result.json").read_text(encoding="utf-8"))
    certificate = certificate_of(out)
    paper = " ".join(
        page.extract_text() for page in PdfReader(io.BytesIO(pdf_bytes(certificate))).pages
    )
    printed, said = " ".join(paper.split()), certificate.content
    for group in said.groups:
        assert " ".join(group.title.split()) in printed
    stds = _stds(result)
    assert len(said.budgets) == 2 * len(stds)
    for name, std in stds.items():
        budgets = [budget for budget in said.budgets if budget.name == name]
        parts = ("mm", "deg"), (("x", "y", "z"), ("rx", "ry", "rz"))
        for budget, unit, keys in zip(budgets, *parts, strict=True):
            rms = math.sqrt(sum(std[f"{key}_{unit}"] ** 2 for key in keys) / 3.0)
            per_si = 1e3 if unit == "mm" else math.degrees(1.0)
            assert budget.std * per_si == pytest.approx(rms, rel=1e-6)
            assert {part.evaluation for part in budget.contributions} <= {"A", "B"}
            assert budget.contributions[0].evaluation == "A"
            assert f"U_{name.replace(' ', '_')}_{unit}" in said.judged


def _stds(result: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Standard deviations of the poses that have a budget, by its name."""
    if "instants" in result:
        return {f"camera {one['eye']}": one["std"] for one in result["between_eyes"]}
    std = result["std"]
    if "x_mm" in std["X"]:
        return {"X": std["X"]}
    sides = ["X"] if "cameras" in result else ["X", "Z"]
    return {f"{side} of {name}": one for side in sides for name, one in std[side].items()}
