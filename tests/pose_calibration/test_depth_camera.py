"""A depth camera by poses of the hand alone: found with a true ±; wrong data are named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import answer, cli
from depth_scenes import BALLS, BOARD, TARGET, DepthScene, depth_scene

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.measurements.seen_points import write_seen_points
from suta_calib.pose_calibration import DepthCameraCalibration, calibrate_depth_camera
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, inverse_poses


def solved(scene: DepthScene, what: str = "table", **options: Any) -> DepthCameraCalibration:
    mark = "planes" if what in ("table", "room") else "points"
    seen: dict[str, Any] = {mark: scene.seen, "board": BOARD if what == "board" else None}
    return calibrate_depth_camera(scene.hand, scene.images, **seen, **options)


def off(found: DepthCameraCalibration, scene: DepthScene) -> np.ndarray:
    """Errors (6,) in units of the standard deviations."""
    R, p = scene.camera
    turn = vector_from_rotation(R.T @ found.X[:3, :3])
    return np.asarray(np.concatenate([found.X[:3, 3] - p, turn]) / found.std)


CASES = [
    *(("table", EYE_IN_HAND), ("room", EYE_IN_HAND), ("balls", EYE_IN_HAND)),
    *(("board", EYE_IN_HAND), ("table", EYE_TO_HAND), ("ball", EYE_TO_HAND)),
]


@pytest.mark.parametrize(("what", "setup"), CASES)
def test_it_is_found_within_what_it_says(what: str, setup: Any) -> None:
    scene = depth_scene(1, what, setup)
    found = solved(scene, what, setup=setup)
    assert np.abs(off(found, scene)).max() < 3.5
    assert found.assessment.usable
    assert found.inliers.all()


@pytest.mark.slow
@pytest.mark.parametrize(("what", "setup"), CASES)
def test_its_standard_deviations_are_true(what: str, setup: Any) -> None:
    scenes = [depth_scene(seed, what, setup) for seed in range(40)]
    errors = np.array([off(solved(scene, what, setup=setup), scene) for scene in scenes])
    # Of 240 numbers, of which those of one set are not independent.
    assert 0.75 < np.sqrt(np.mean(errors**2)) < 1.25
    assert np.mean(np.abs(errors) < 3.0) > 0.985


def test_what_was_seen_and_what_the_hand_errs_by() -> None:
    scene = depth_scene(2, "balls", count=40)
    found = solved(scene, "balls")
    for thing in found.things:
        assert np.all(np.abs(thing.place - TARGET - BALLS[thing.name]) < 4.0 * thing.std)
    assert found.hand_noise == pytest.approx(2e-4, rel=0.5)
    assert found.camera_noise == pytest.approx(1.0, rel=0.2)
    (plane,) = solved(depth_scene(2)).things
    assert plane.normal is not None
    assert np.linalg.norm(plane.normal[:2]) < 4.0 * plane.tilt_std
    assert abs(plane.place[2]) < 4.0 * plane.distance_std


def test_a_point_of_the_camera_in_the_base_with_its_std() -> None:
    scene = depth_scene(3, "balls")
    found = solved(scene, "balls")
    hand = np.eye(4)
    hand[:3, :3], hand[:3, 3] = scene.rotation[0], scene.position[0]
    mine = scene.seen.image == scene.images[0]
    place, std = found.in_base(hand, scene.seen.position[mine])
    true = TARGET + np.array([*BALLS.values()])
    assert np.all(np.abs(place - true) < 4.0 * std + 1e-3)
    assert np.all(std < 1e-3)


@pytest.mark.parametrize("what", ["table", "balls"])
def test_a_scale_of_the_depth_is_told_and_allowed_for(what: str) -> None:
    scene = depth_scene(4, what).larger(1.015)
    found = solved(scene, what)
    assert found.scale == pytest.approx(0.015, abs=4.0 * found.scale_std)
    assert np.abs(off(found, scene)).max() < 3.5
    (note,) = [n for n in found.assessment.notes if n.startswith("The camera's lengths are 1.")]
    assert "too long against what the hand moves" in note
    assert not solved(depth_scene(4, what), what).scale_sentence


def test_the_uncertainty_follows_what_the_pictures_tell_of_the_scale() -> None:
    scene = depth_scene(5, "balls")
    stated, unsure = (solved(scene, "balls", scale_ppm=ppm) for ppm in (5e3, 1e5))
    assert unsure.std[2] == pytest.approx(stated.std[2], rel=0.05)
    assert unsure.scale_std < 1.5e-3


def test_wrong_pictures_are_left_out_and_exchanged_ones_named() -> None:
    scene = depth_scene(6)
    scene.position[[4, 11]] += [[0.02, 0.01, 0.02], [0.0, 0.01, -0.02]]
    found = solved(scene)
    assert found.outliers == (4, 11)
    assert np.abs(off(found, scene)).max() < 3.5
    plain = solved(scene, robust=False)
    assert plain.assessment.level == "bad"
    assert "c04.ply, c11.ply contradict the others" in plain.assessment.notes[0]
    scene = depth_scene(6)
    scene.images[3], scene.images[8] = scene.images[8], scene.images[3]
    assert any("two are exchanged" in note for note in solved(scene).assessment.notes)


def _late(scene: DepthScene) -> DepthScene:
    return replace(scene, images=[*scene.images[1:], scene.images[0]])


def _inverted(scene: DepthScene) -> DepthScene:
    rotation, position = inverse_poses(scene.hand)
    return replace(scene, rotation=rotation, position=position)


def _shuffled(scene: DepthScene) -> DepthScene:
    order = np.random.default_rng(0).permutation(len(scene.images))
    return replace(scene, images=[scene.images[k] for k in order])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_inverted, "if the poses of the hand are inverted, or if setup is eye-to-hand"),
        (_late, "if the pictures are a row early"),
        (_shuffled, "whatever X"),
        (lambda scene: scene.larger(np.array([-1.0, 1.0, 1.0])), "mirrored"),
        (lambda scene: scene.larger(1000.0), "they look like mm"),
        (lambda scene: scene.larger(5.0), "all are 0.2 times as far away"),
        (lambda scene: replace(scene, position=1e3 * scene.position), "they look like mm"),
        (lambda _: depth_scene(7, tilt=1e-4), "do not determine X: the camera may slide"),
        (lambda _: depth_scene(7, count=3), "3 pictures that show something"),
    ],
)
def test_data_that_are_wrong_are_refused_with_the_reason(spoil: Any, said: str) -> None:
    with pytest.raises(SamplesError, match=said):
        solved(spoil(depth_scene(7)))


def test_a_hand_that_turned_about_one_axis_only_is_said() -> None:
    scene = depth_scene(8, "balls", tilt=1e-5, hand=1e-5)
    with pytest.raises(SamplesError, match=r"may slide along \(-?0\.\d+, -?0\.\d+, -?0\.9"):
        solved(scene, "balls")


def test_the_command_writes_what_the_answer_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = depth_scene(9, "room")
    poses = tmp_path / "poses.csv"
    poses.write_text(scene.poses_csv())
    files = []
    # A file for each plane, as the command writes them.
    for name in ("table", "wall"):
        rows = scene.seen.point == name
        part = replace(
            scene.seen, **{k: getattr(scene.seen, k)[rows] for k in ("image", "point", "position")}
        )
        write_seen_points(tmp_path / f"{name}.csv", replace(part, sigma=None), "plane")
        files += ["--planes", tmp_path / f"{name}.csv"]
    found = answer("hand-eye", poses, *files, "--out", tmp_path / "out")
    assert np.linalg.norm(np.array(found["X"])[:3, 3] - scene.camera[1]) < 2e-3
    assert [*found["planes"]] == ["table", "wall"]
    assert found["points"] == {}
    assert found["counts"] == {"rows": 20, "inliers": 20, "outliers": 0}
    assert found["assumed_scale_ppm"] == 5000
    assert json.loads((tmp_path / "out" / "result.json").read_text())["rms_mm"] < 0.6
    assert cli("hand-eye", poses, *files, "--plane") == 2
    assert "are for a depth camera" in capsys.readouterr().err
    assert cli("hand-eye", poses, *files, "--board", poses) == 2
    assert "of the board whose corners --points are" in capsys.readouterr().err
    half = (tmp_path / "wall.csv").read_text()
    (tmp_path / "wall.csv").write_text(half[: len(half) // 2 - 9])
    assert cli("hand-eye", poses, *files) == 2
    assert "wall.csv" in capsys.readouterr().err
    (tmp_path / "wall.csv").write_text(half.replace(half.splitlines()[4].split(",")[2], "nan"))
    assert cli("hand-eye", poses, *files) == 2
    assert "found 'nan'; expected a finite number" in capsys.readouterr().err
