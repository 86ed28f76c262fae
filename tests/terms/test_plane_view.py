"""Planes that a depth camera saw: the camera's pose and its ±, what views leave open, files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plane_clouds import cloud, points_of
from simulated import arm_named, dh_parameters, perturbed, plane_view_scene

from suta_calib.errors import SamplesError
from suta_calib.geometry.cloud_plane import plane_in
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Samples, write_samples
from suta_calib.measurements.depth_noise import DepthNoise
from suta_calib.measurements.seen_points import SeenPoints, read_seen_points, write_seen_points
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import KINDS, ArmPoses, GivenPose, MeasuredPoses, PlaneView, Setup
from suta_calib.terms.external_frame import pose_values

X = rotation_from_vector([0.1, -0.2, 0.6]), np.array([0.03, -0.06, 0.07])
TABLE = np.array([0.05, 0.02, 1.0]) / np.linalg.norm([0.05, 0.02, 1.0])
HEIGHT = -0.1
DOWN = np.diag([1.0, -1.0, -1.0])
# A camera that looks down tilts about two axes, and turns.
TILTS = np.random.default_rng(3).uniform([-0.5, -0.5, -1.0], [0.5, 0.5, 1.0], (14, 3))


def eyes(tilts: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotations and places in the base of a camera above the table."""
    rng = np.random.default_rng(seed)
    turned = rotation_from_vector(tilts * [1.0, 1.0, 0.0])
    about = rotation_from_vector(tilts * [0.0, 0.0, 1.0])
    place = rng.uniform([0.2, -0.3, 0.35], [0.6, 0.3, 0.6], (len(tilts), 3))
    return DOWN @ about @ turned, place


def seen_from(tilts: np.ndarray, seed: int = 0, noise: float = 2e-3) -> PlaneView:
    """The table in a cloud for each tilt, by a hand whose poses are known."""
    rotation, place = eyes(tilts, seed)
    marks, sigmas, images = [], [], []
    for k in range(len(tilts)):
        # What the camera sees faces away from it.
        normal = -rotation[k].T @ TABLE
        points = cloud(
            normal, TABLE @ place[k] - HEIGHT, seed=100 * seed + k, noise=noise, size=(45, 60)
        )
        plane = plane_in(points_of(points))
        assert plane is not None
        marks.append(plane.marks)
        sigmas.append(np.full((3, 3), plane.sigma))
        images += [str(k)] * 3
    hand = rotation @ X[0].T
    position = place - np.einsum("nij,j->ni", hand, X[1])
    samples = Samples.from_arrays(
        [],
        np.zeros((3 * len(tilts), 0)),
        position=np.concatenate(marks),
        labels={"plane": ["table"] * len(images), "image": images},
    )
    samples = replace(samples, position_sigma=np.concatenate(sigmas))
    rows = np.repeat(np.arange(len(tilts)), 3)
    return PlaneView(MeasuredPoses(hand[rows], position[rows], samples, exact=True))


def solved(term: PlaneView) -> Solution:
    return solve(Problem([term]), SolverOptions(starts=1, confirm=False))


def errors(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Of the six unknowns of the camera, m and rad, and their standard deviations."""
    names = [f"hand_eye.{key}" for key in ("x", "y", "z", "rx", "ry", "rz")]
    found = np.array([solution.values[name] for name in names])
    stds = [solution.estimates[name].std for name in names]
    assert None not in stds
    return found - pose_values(*X), np.array(stds)


def test_the_camera_is_found_by_clouds_of_a_table() -> None:
    off, std = errors(solved(seen_from(TILTS)))
    assert np.abs(off / std).max() < 4.0
    assert np.abs(off[:3]).max() < 1e-3
    assert std[:3].max() < 5e-4


@pytest.mark.slow
def test_the_spread_is_true() -> None:
    """Forty sets of clouds: errors over their standard deviations are one."""
    squares = [
        (off / std) ** 2 for off, std in (errors(solved(seen_from(TILTS, k))) for k in range(40))
    ]
    assert 0.75 < np.mean(squares) < 1.3


@pytest.mark.parametrize(
    ("tilts", "words"),
    [
        (0.0 * TILTS, "where the camera is, nor how it is turned about"),
        (TILTS * [1, 0, 0], "where the camera is along"),
        (
            0.4 * np.array([[np.cos(a), np.sin(a), 0] for a in range(14)]),
            "where the camera is along",
        ),
        (TILTS, ""),
    ],
    ids=["no tilt", "one axis", "all by one angle", "enough"],
)
def test_what_views_leave_open_is_said(tilts: Any, words: str) -> None:
    term = seen_from(np.array(tilts))
    assert [words in sentence for sentence in term.doubts] == [True] * bool(words)


def test_another_plane_tells_what_one_leaves_open() -> None:
    """A hand that turns about the vertical alone, and two walls beside the table."""
    arm = arm_named("suta")
    s = plane_view_scene(arm, perturbed(dh_parameters(arm), seed=1))
    assert not s.exact().doubts


def test_mirrored_clouds_are_read_otherwise() -> None:
    term = seen_from(TILTS)
    samples = term.poses.samples
    mirrored = replace(samples, position=samples.position * [-1.0, 1.0, 1.0])
    wrong = replace(term, poses=term.poses.with_samples(mirrored))
    ((sentence, other),) = wrong.misread
    assert "mirrored" in sentence
    assert isinstance(other, PlaneView)
    assert solved(other).noise[0] < 0.1 * solved(wrong).noise[0]


def test_another_step_of_the_depth_is_named() -> None:
    term = seen_from(TILTS)
    samples = replace(term.poses.samples, position=0.2 * term.in_eye)
    with pytest.raises(SamplesError, match="if all are 5 times as far away"):
        replace(term, poses=term.poses.with_samples(samples)).check_enough()


def test_a_plane_that_is_known_is_held() -> None:
    term = seen_from(TILTS)
    turn = rotation_from_vector([-np.arctan2(0.02, 1.0), np.arctan2(0.05, 1.0), 0.0])
    given = {
        "table": GivenPose(np.array([0.3, 0.1, (HEIGHT - TABLE[:2] @ [0.3, 0.1]) / TABLE[2]]), turn)
    }
    held = replace(term, given=given)
    free = {p.name: p.free for p in held.unknowns}
    assert not any(free[f"plane[table].{key}"] for key in ("z", "rx", "ry"))
    off, _ = errors(solved(held))
    assert np.abs(off[:3]).max() < 1e-3
    with pytest.raises(SamplesError, match="without an orientation"):
        _ = replace(term, given={"table": GivenPose(np.zeros(3))}).unknowns


# ── files ────────────────────────────────────────────────────────────────────────────────────
def job_folder(folder: Path) -> SeenPoints:
    """Samples with a row for each cloud, and the planes in a file of their own."""
    arm = arm_named("suta")
    s = plane_view_scene(arm, perturbed(dh_parameters(arm), seed=1), n=6)
    samples = s.samples()[0]
    first = np.unique(samples.labels["image"], return_index=True)[1]
    clouds = Samples.from_arrays(
        arm.joints, samples.q[first], labels={"image": samples.labels["image"][first]}
    )
    write_samples(folder / "samples.csv", clouds)
    planes = SeenPoints(samples.labels["image"], samples.labels["plane"], samples.position)
    write_seen_points(folder / "planes.csv", planes, "plane")
    return planes


def test_planes_stand_in_a_file_of_their_own(tmp_path: Path) -> None:
    planes = job_folder(tmp_path)
    again = read_seen_points(tmp_path / "planes.csv", "plane", once=False)
    np.testing.assert_allclose(again.position, planes.position, atol=1e-6)
    with pytest.raises(SamplesError, match="same point as in line 2"):
        read_seen_points(tmp_path / "planes.csv", "plane")
    with pytest.raises(SamplesError, match="'point'"):
        read_seen_points(tmp_path / "planes.csv")


def test_a_row_of_a_job_joins_them_by_their_clouds(tmp_path: Path) -> None:
    planes, arm = job_folder(tmp_path), arm_named("suta")
    samples = Samples.from_arrays(
        arm.joints, np.eye(6), labels={"image": [f"{k}.ply" for k in range(6)]}
    )
    settings: dict[str, Any] = {"planes": tmp_path / "planes.csv"}
    kind = KINDS["plane_view"]
    assert [*kind.columns_in(settings).labels] == ["image"]
    term = kind.over(ArmPoses(arm, samples), Setup(settings=settings))
    assert len(term.poses) == len(planes)
    assert term.equations() == len(planes)


def test_what_is_seen_too_rarely_is_refused() -> None:
    term = seen_from(TILTS)
    with pytest.raises(SamplesError, match="planes at 2 postures"):
        term.take(range(6)).check_enough()
    labels = term.poses.samples.labels["plane"].copy()
    labels[:3] = "tabel"
    samples = term.poses.samples
    other = replace(samples, labels={**samples.labels, "plane": labels})
    with pytest.raises(SamplesError, match="plane tabel seen once"):
        replace(term, poses=term.poses.with_samples(other)).check_enough()


def test_noise_follows_from_the_distance_where_rows_state_none() -> None:
    term = seen_from(TILTS)
    samples = replace(term.poses.samples, position_sigma=None)
    noise = DepthNoise((1e-3, 2e-3), 5e-4)
    term = replace(
        *(term,),
        poses=term.poses.with_samples(samples),
        depth_noise=noise,
        weights=None,
        typical_sigma=None,
    )
    along = noise.sigmas(term.in_eye[:, 2])[:, 2]
    np.testing.assert_allclose(term.sigmas[:, 0], along)
    assert term.weights == noise
