"""A camera that sees a board: what is particular to it, and every command over a job of it."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_job import CAMERA, JOB, SIMULATION
from cli_job import answer, cli, refused
from simulated import arm_named, camera_scene, dh_parameters, perturbed

from suta_calib.arrays import FloatArray
from suta_calib.emulation import read_truth
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry import projected
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import (
    Chessboard,
    read_board,
    read_camera,
    read_corners,
    write_camera,
    write_corners,
)
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import read_simulation, simulate
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms.block import Noise
from suta_calib.terms.camera_row import with_corners
from suta_calib.terms.camera_start import board_poses, closed_form_intrinsics
from suta_calib.terms.camera_view import CameraView

BOARD = "type: chessboard\ncorners: [4, 3]\nsquare_mm: 40\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    """A simulated job."""
    path = tmp_path_factory.mktemp("pictures")
    (path / "arm.urdf").write_bytes((repository / "urdf" / "suta.urdf").read_bytes())
    for name, text in (
        ("simulation.yaml", SIMULATION),
        ("job.yaml", JOB),
        ("board.yaml", BOARD),
        ("camera.yaml", CAMERA),
    ):
        (path / name).write_text(text)
    assert cli("simulate", path / "simulation.yaml", "--out", path) == 0
    return path


def test_corners_that_noise_drives_out_of_the_picture_are_not_seen(folder: Path) -> None:
    """Whatever a simulation writes can be read."""
    noisy = SIMULATION.replace("corner_px: 0.2", "corner_px: 30")
    slipped = "    samples: 16\n    outliers: {fraction: 0.2, size_mm: [100, 200]}\n"
    (folder / "noisy.yaml").write_text(noisy.replace("    samples: 16\n", slipped))
    made = simulate(read_simulation(folder / "noisy.yaml"))
    board, camera = read_board(folder / "board.yaml"), read_camera(folder / "camera.yaml")
    quiet = simulate(read_simulation(folder / "simulation.yaml"))
    for file, before in zip(made.files, quiet.files, strict=True):
        assert file.corners is not None
        assert before.corners is not None
        (_, corners), (_, all_of_them) = file.corners, before.corners
        corners.check(board, camera)
        assert 0.6 * len(all_of_them) < len(corners) < len(all_of_them)


def test_pictures_tell_the_arm(folder: Path) -> None:
    found = answer("calibrate", folder / "job.yaml", "--out", folder / "results")
    assert not found["unidentified"]
    for data in ("calibration", "validation"):
        metrics = found["metrics"][data]
        assert metrics["after"]["rms_px"] < 0.4 < 2.0 < metrics["before"]["rms_px"]
        assert 0.0 < metrics["after"]["rms_mm"] < 1.0
    x = [found["parameters"][f"hand_eye.{key}"] for key in "xyz"]
    for entry, true in zip(x, (0.02, -0.03, 0.04), strict=True):
        assert abs(entry["value"] - true) < 5 * entry["std"]


def test_a_reading_that_never_came_is_believed_less_than_all_others(folder: Path) -> None:
    header, *rows = (folder / "calibration" / "samples.csv").read_text().splitlines()
    joints = sum(name.startswith("joint") for name in header.split(","))

    def found(lost: int, code: int) -> dict[str, Any]:
        sent = [",".join(["0.0"] * joints + row.split(",")[joints:]) for row in rows[:lost]]
        (folder / "lost").mkdir(exist_ok=True)
        (folder / "lost" / "samples.csv").write_text("\n".join([header, *sent, *rows[lost:]]))
        job = JOB.replace("'calibration/*.csv'", "'lost/*.csv'")
        (folder / "lost.yaml").write_text(job)
        files = folder / "lost.yaml", "--out", folder / "lost_results"
        return answer("calibrate", *files, code=code)

    truth = read_truth(folder / "truth.yaml", ArmModel.from_urdf(folder / "arm.urdf", "tip"))
    told = found(1, 0)
    assert told["verdict"]["usable"]
    for name in ("joint_3.offset", "joint_4.offset", "joint_4.z"):
        row = told["parameters"][name]
        assert abs(row["value"] - truth[name]) < 4 * row["std"]
    # A fifth of all pictures outweighs the others; why is said.
    said = found(3, 1)["verdict"]
    assert "3 rows of camera view" in " ".join(said["notes"])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("{mm: 0.5}", "deg"),
        ("{mm: 0, deg: 0.1}", "hand_error.mm"),
        ("{mm: 0.5, deg: much}", "hand_error.deg"),
        ("0.5", "hand_error"),
    ],
)
def test_what_play_leaves_is_two_positive_numbers(folder: Path, given: str, says: str) -> None:
    job = folder / "play.yaml"
    job.write_text(JOB.replace("huber_px: 1", f"huber_px: 1, hand_error: {given}"))
    assert says in refused("calibrate", job)


def test_the_camera_is_corrected_too(folder: Path) -> None:
    (folder / "other.yaml").write_text(CAMERA.replace("1000,", "1015,").replace("1002,", "1017,"))
    free = JOB.replace("camera.yaml", "other.yaml").replace("px: 1}", "px: 1, intrinsics: free}")
    (folder / "free.yaml").write_text(free)
    found = answer("calibrate", folder / "free.yaml", "--out", folder / "free")
    focal = found["parameters"]["camera.fx"]
    assert (focal["unit"], focal["nominal"]) == ("px", 1015.0)
    assert abs(focal["value"] - 1000.0) < 5 * focal["std"] < 15.0
    assert found["parameters"]["camera.k1"]["unit"] == "1"


@pytest.mark.parametrize(("focal", "contradicted"), [(1000, False), (1015, True)])
def test_held_intrinsics_that_the_pictures_contradict_are_named(
    folder: Path, focal: int, contradicted: bool
) -> None:
    """Also in silence about right ones, whatever the arm has wrong."""
    file = CAMERA.replace("1000,", f"{focal},").replace("1002,", f"{focal + 2},")
    (folder / "held.yaml").write_text(file)
    (folder / "held_job.yaml").write_text(JOB.replace("camera.yaml", "held.yaml"))
    files = folder / "held_job.yaml", "--out", folder / "held"
    found = answer("calibrate", *files, code=int(contradicted))
    notes = [note for note in found["verdict"]["notes"] if "contradict the fixed values" in note]
    assert len(notes) == contradicted
    assert all("of camera (fx 1015.000 → 100" in note for note in notes)
    assert all("intrinsics: free" in note for note in notes)


def test_a_corrected_camera_is_told_without_being_asked_for(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "told.yaml").write_text(JOB.replace("px: 1}", "px: 1, intrinsics: free}"))
    told = ("calibrate", folder / "told.yaml", "--out", folder / "told")
    capsys.readouterr()
    assert cli(*told) == 0
    said = capsys.readouterr().out
    assert "camera.fx" in said
    assert "hand_eye.x" not in said


@pytest.mark.parametrize(
    "command",
    [
        ("observe", "job.yaml"),
        ("outliers", "job.yaml"),
        ("budget", "job.yaml"),
        ("tip-map", "job.yaml"),
        ("plan", "job.yaml", "-n", 1),
        ("study", "job.yaml", "--trials", 2, "--sizes", "8", "--jobs", 1),
        ("study", "job.yaml", "--kind", "monte-carlo", "--trials", 10, "--jobs", 1),
    ],
    ids=lambda command: " ".join(map(str, command[:3:2])),
)
def test_every_command_takes_the_job(folder: Path, command: tuple[Any, ...]) -> None:
    name, job, *more = command
    out = () if name == "observe" else ("--out", folder / name)
    assert answer(name, folder / job, *more, *out)["verdict"]["usable"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (", board: board.yaml", "", "board: found no such key"),
        ("corners: corners/calibration.csv, ", "", "corners: found no such key"),
        ("huber_px", "huber_mm", "a key that camera_view does not use"),
        (", camera: camera.yaml", ", intrinsics: fixed", "no camera for intrinsics: fixed"),
        ("huber_px", "lens: fisheye, huber_px", "lens beside camera"),
        ("camera: camera.yaml", "lens: wide", "one of plumb_bob, rational_polynomial, equid"),
        ("corners/calibration", "corners/validation", "the same names in both"),
        ("huber_px: 1", "setup: eye", "one of eye-in-hand, eye-to-hand"),
        ("px: 1}", "px: 1, intrinsics: free}", "another intrinsics than in an earlier row"),
    ],
)
def test_a_row_that_cannot_be_used_is_refused(
    folder: Path, old: str, new: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "bad.yaml").write_text(JOB.replace(old, new, 1))
    capsys.readouterr()
    assert cli("observe", folder / "bad.yaml") == 2
    assert said in capsys.readouterr().err


def test_a_board_that_looks_the_same_turned_is_numbered_from_one_end(folder: Path) -> None:
    """Two of the board's rows: by the turns of the arm, whichever end a picture begins from."""
    (folder / "same.yaml").write_text(BOARD.replace("[4, 3]", "[4, 2]"))
    corners = read_corners(folder / "corners" / "calibration.csv")
    corners = corners.take(corners.point < 8)
    turned = np.isin(corners.image, corners.images[::2])
    other = np.where(turned, 7 - corners.point, corners.point)
    seen = []
    for name, point in (("one", corners.point), ("both", other)):
        write_corners(folder / "corners" / f"{name}.csv", replace(corners, point=point))
        row = JOB.replace("corners/calibration", f"corners/{name}", 1)
        job = folder / f"{name}.yaml"
        job.write_text(row.replace("board.yaml", "same.yaml").split("validation: [")[0])
        with nullcontext() if name == "one" else pytest.warns(SutaCalibWarning, match="half a tur"):
            (term,) = CalibrationJob.load(job).observations
        seen.append(term.pixels)
    first, second = seen
    # Of two halves either may be the one that is turned.
    same = np.array_equal(first, second, equal_nan=True)
    assert same or np.array_equal(first, second[:, ::-1], equal_nan=True)


@pytest.mark.parametrize("count", [1, 4, 16])
def test_held_out_pictures_of_such_a_board_are_numbered_as_those_that_were_fitted(
    folder: Path, count: int
) -> None:
    """Most of few pictures may be numbered from the other end: they follow those of the fit."""
    (folder / "same.yaml").write_text(BOARD.replace("[4, 3]", "[4, 2]"))
    for name in ("calibration", "validation"):
        corners = read_corners(folder / "corners" / f"{name}.csv")
        corners = corners.take(corners.point < 8)
        if name == "validation":
            few = corners.take(np.isin(corners.image, corners.images[:count]))
            corners = replace(few, point=7 - few.point)
        write_corners(folder / "corners" / f"{name}_same.csv", corners)
    job = folder / "same_job.yaml"
    job.write_text(JOB.replace(".csv, board: board", "_same.csv, board: same"))
    with pytest.warns(SutaCalibWarning) as said:
        read = CalibrationJob.load(job)
    assert any(
        "from the other end than in the pictures of an earlier row" in str(w.message) for w in said
    )
    (term,) = read.run().accuracy.validation
    assert term.after.rms < 2e-3


def test_a_camera_that_was_calibrated_from_these_corners_counts_them_once(folder: Path) -> None:
    corners = read_corners(folder / "corners" / "calibration.csv")
    known = read_camera(folder / "camera.yaml")
    variances = np.array([1.0, 1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-6, 1e-6, 1e-4])
    camera = replace(known, covariance=np.diag(variances), corners=corners.digest)
    write_camera(folder / "own.yaml", camera)
    job = folder / "own_job.yaml"
    job.write_text(
        JOB.replace("camera.yaml", "own.yaml").replace("px: 1}", "px: 1, intrinsics: free}")
    )
    read = CalibrationJob.load(job)
    for term in (*read.observations, *read.validation):
        assert isinstance(term, CameraView)
        assert term.prior is not None
        assert np.all(term.prior > 10.0 * np.sqrt(variances))


def test_a_picture_that_is_named_twice_was_taken_at_one_posture(folder: Path) -> None:
    (term,) = CalibrationJob.load(folder / "job.yaml").observations
    corners = read_corners(folder / "corners" / "calibration.csv")
    poses, board = term.poses, read_board(folder / "board.yaml")
    again = with_corners(poses.take([0, 1, 1]), corners, board)
    assert len(again) == 3
    images = poses.samples.labels["image"].copy()
    images[3] = images[2]
    wrong = poses.with_samples(
        replace(poses.samples, labels={**poses.samples.labels, "image": images})
    )
    with pytest.raises(SamplesError, match="at another posture than in"):
        with_corners(wrong, corners, board)


def test_a_corner_that_is_no_corner_of_the_board_is_named(folder: Path) -> None:
    (term,) = CalibrationJob.load(folder / "job.yaml").observations
    assert not term.doubts
    names = term.poses.samples.labels["image"].tolist()
    pixels = term.pixels.copy()
    pixels[2, 5, 0] += 80.0
    pixels[4] = np.random.default_rng(0).permutation(pixels[4])
    samples = replace(term.poses.samples, pixels=pixels)
    wrong = replace(term, poses=term.poses.with_samples(samples))
    said = list(wrong.doubts.items())
    assert said[0][0].startswith(f"In {names[2]} corner 5 is 8")
    assert said[1][0].startswith(f"In {names[4]} no pose of the board has its corners")
    assert {level for _, level in said} == {"care"}
    assert set(replace(wrong, noise=Noise(1e-3)).doubts.values()) == {"bad"}


def test_a_picture_is_one_cluster(folder: Path) -> None:
    (term,) = CalibrationJob.load(folder / "job.yaml").observations
    assert len(np.unique(term.clusters)) == 16
    assert term.equations() == 2 * len(term.blocks[0])
    assert len(term.take(range(8)).blocks[0]) < len(term.blocks[0])


def test_two_cameras_share_a_board() -> None:
    arm = arm_named("suta")
    scene = camera_scene(arm, perturbed(dh_parameters(arm), seed=1), n=12)
    first: Any = scene.exact()
    problem = Problem([first, replace(first, label="second")], dh_parameters(arm))
    solution = solve(problem)
    assert {"hand_eye[second].x", "hand_eye.x", "target.x"} <= set(problem.names)
    assert "target[second].x" not in problem.names
    assert solution.values["hand_eye.x"] == pytest.approx(solution.values["hand_eye[second].x"])


def test_closed_forms_are_exact() -> None:
    random, board = np.random.default_rng(0), Chessboard(5, 4, 0.03)
    points = np.array(list(board.points.values()))
    lens, pictures = np.array([1000.0, 1010, 630, 350, 0, 0, 0, 0, 0]), []
    for _ in range(6):
        R = rotation_from_vector(random.uniform(-0.5, 0.5, 3))
        p = np.array([*random.uniform(-0.1, 0.1, 2), 0.6])
        pictures.append(projected(points @ R.T + p, lens))
        for body in (points, points + random.normal(size=points.shape) * 0.02):
            there = body @ R.T + p
            seen = np.tile(there[:, :2] / there[:, 2:], (3, 1, 1))
            seen[1, ::3] = np.nan  # of which not all is seen, and too little
            seen[2, 3:] = np.nan
            rotation, position = board_poses(body, seen)
            np.testing.assert_allclose(rotation[:2], [R, R], atol=1e-9)
            np.testing.assert_allclose(position[:2], [p, p], atol=1e-9)
            assert np.isnan(rotation[2]).all()
            assert np.isnan(position[2]).all()
    found_lens = closed_form_intrinsics([points] * 6, pictures)
    np.testing.assert_allclose(found_lens, lens[:4], rtol=1e-6)
    for few in (points[:3], points[:5]):  # the first row of the board: a line
        assert np.isnan(board_poses(few, few[None, :, :2])[1]).all()


def test_a_small_board_that_looks_alike_from_two_sides_is_where_it_is_expected() -> None:
    random = np.random.default_rng(0)
    points = np.array([[x, y, 0.0] for y in (0.0, 0.03) for x in (0.0, 0.03, 0.06)])
    R = rotation_from_vector(random.uniform(-0.5, 0.5, (60, 3)))
    p = np.array([0.0, 0.0, 1.0]) + 0.05 * random.standard_normal((60, 3))
    seen = np.einsum("nij,kj->nki", R, points) + p[:, None]
    pixels = seen[..., :2] / seen[..., 2:] + 2e-4 * random.standard_normal((60, 6, 2))
    near = R @ rotation_from_vector(0.02 * random.standard_normal((60, 3))), p + 2e-3

    def turns(found: tuple[FloatArray, FloatArray]) -> FloatArray:
        return np.degrees(
            np.linalg.norm(vector_from_rotation(np.swapaxes(R, 1, 2) @ found[0]), axis=1)
        )

    assert turns(board_poses(points, pixels)).max() > 20.0
    assert turns(board_poses(points, pixels, near)).max() < 10.0
    # What would be behind the camera tells nothing of where the board is.
    behind = board_poses(points, pixels, (near[0], -near[1]))
    np.testing.assert_array_equal(behind[1], board_poses(points, pixels)[1])
