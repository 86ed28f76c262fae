"""Poses of a body from the markers on it, one frame or many, with wrong markers."""

from __future__ import annotations

import numpy as np
import pytest
from stereotactic_scenes import TRIANGLE

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points, rotation_from_vector
from suta_calib.stereotactic.marker_cloud import MarkerCloud


def moved(cloud: np.ndarray, frames: int = 7, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    rotation = rotation_from_vector(random.normal(size=(frames, 3)))
    return cloud @ np.swapaxes(rotation, 1, 2) + random.normal(size=(frames, 1, 3))


def test_poses_are_those_of_one_registration_after_the_other() -> None:
    frames = moved(TRIANGLE) + 1e-4 * np.random.default_rng(1).normal(size=(7, 5, 3))
    poses = MarkerCloud(TRIANGLE).poses(frames)
    for k, frame in enumerate(frames):
        rotation, position = register_points(TRIANGLE, frame)
        np.testing.assert_allclose(poses.rotation[k], rotation, atol=1e-12)
        np.testing.assert_allclose(poses.position[k], position, atol=1e-12)
    np.testing.assert_allclose(poses.to_body(poses.to_tracker(TRIANGLE)), [TRIANGLE] * 7, atol=1e-9)


def test_a_probe_is_defined_by_its_first_frame() -> None:
    frames = moved(TRIANGLE)
    poses = MarkerCloud.from_frame(frames[0]).poses(frames)
    np.testing.assert_allclose(poses.rotation[0], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(poses.position[0], frames[0].mean(axis=0), atol=1e-12)


def test_robust_poses_leave_single_markers_out() -> None:
    frames = moved(TRIANGLE)
    frames[2, 4] += [0.0, 0.05, 0.0]
    frames[5, 0] += [0.02, 0.0, 0.0]
    poses = MarkerCloud(TRIANGLE).poses(frames, robust=True)
    assert poses.outliers == 2
    assert not poses.used[2, 4]
    assert not poses.used[5, 0]
    clean = MarkerCloud(TRIANGLE).poses(moved(TRIANGLE))
    np.testing.assert_allclose(poses.position, clean.position, atol=1e-9)
    np.testing.assert_allclose(poses.rotation, clean.rotation, atol=1e-9)


def test_robust_poses_survive_any_single_marker() -> None:
    frames = moved(TRIANGLE)
    frames[1, 3] = 1e6
    poses = MarkerCloud(TRIANGLE).poses(frames, robust=True)
    assert poses.outliers == 1
    np.testing.assert_allclose(poses.position, moved(np.zeros((1, 3)))[:, 0], atol=1e-9)
    with pytest.raises(SamplesError, match="frame 2"):
        MarkerCloud(TRIANGLE).poses(frames)


def test_impossible_bodies_and_frames_are_refused() -> None:
    frames = moved(TRIANGLE)
    with pytest.raises(SamplesError, match="2 markers"):
        MarkerCloud(TRIANGLE[:2]).poses(frames[:, :2])
    line = np.outer(np.arange(5.0), [1, 2, 3])
    with pytest.raises(SamplesError, match="line"):
        MarkerCloud(line).poses(moved(line))
    frames[3] = frames[3, :1]
    with pytest.raises(SamplesError, match="frame 4"):
        MarkerCloud(TRIANGLE).poses(frames)
    with pytest.raises(SamplesError, match="frame 1: found markers that are the mirror image"):
        MarkerCloud(TRIANGLE).poses(moved(-TRIANGLE))


def test_flat_bodies_are_fine() -> None:
    flat = TRIANGLE * [1, 1, 0]
    poses = MarkerCloud(flat).poses(moved(flat))
    np.testing.assert_allclose(poses.to_tracker(flat), moved(flat), atol=1e-9)
