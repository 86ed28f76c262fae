"""Where cameras, instruments, artefacts and planes are: against the truth, and by drawing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from simulated import placements
from terms_cases import AVAILABLE, SIGMA, scene

from suta_calib.geometry.numbers import (
    quaternion_from_rotation,
    rotation_from_rpy,
    rotation_from_vector,
    vector_from_rotation,
)
from suta_calib.model.parameters import PLACEMENT, ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses
from suta_calib.trust.external_poses import external_poses

# Rotation and position of some frames, as the scenes have them.
TRUTH = {
    "base": (rotation_from_vector([0.3, -1.2, 0.7]), [1.1, -0.4, 0.6]),
    "hand_eye": (rotation_from_vector([0.1, 0.2, -1.5]), [0.02, -0.05, 0.08]),
    "target": (rotation_from_vector([2.0, 0.4, 0.3]), [0.6, 0.2, -0.1]),
    "fixed_point[F1]": (None, [-0.2, 0.4, 0.2]),
    "placement[P2]": placements(4)[2],
}
WORDS = {
    "base": "base in instrument",
    "hand_eye": "eye in tip",
    "target": "target in base",
    "fixed_point[F1]": "point in base",
    "placement[P2]": "placement in base",
    "plane[S2]": "plane in base",
    "line[S1]": "line in base",
    "anchor[S1]": "anchor in base",
    "target[T1]": "target in tip",
}
CAMERAS = {
    "camera_view": {"hand_eye": "camera in tip", "target": "board in base"},
    "camera_view of a hand with play": {"hand_eye": "camera in tip", "target": "board in base"},
    "camera_view beside": {"hand_eye": "camera in base", "target": "board in tip"},
    "points": {"hand_eye": "camera in tip"},
    "points on the tip": {"hand_eye": "camera in base"},
    "points of a board": {"hand_eye": "camera in tip", "target": "board in base"},
    "points that state their noise": {"hand_eye": "camera in tip"},
    "plane_view": {"hand_eye": "camera in tip"},
    "plane_view of planes on the tip": {"hand_eye": "camera in base", "plane[A]": "plane in tip"},
    "plane_view that states its noise": {"hand_eye": "camera in tip"},
    "profile of a ball": {"hand_eye": "scanner in tip", "sphere": "ball in base"},
    "profile of a ball of unknown radius": {"hand_eye": "scanner in tip", "sphere": "ball in base"},
    "profile of a plane": {"hand_eye": "scanner in tip", "plane": "plane in base"},
}


@cache
def solved(name: str) -> Solution:
    """The unknowns of one term over an arm that is known."""
    measured = scene(name)
    term = measured.term(measured.samples(SIGMA, seed=1)[0])
    known = term.over_poses(ArmPoses(measured.arm.at(measured.truth), term.poses.samples))
    return solve(Problem([known], ParameterSet()))


# Distances between seats are the same wherever the artefact stands, and gravity is everywhere.
NOWHERE = ("pairwise_distance", "gravity")
each_with_frames = pytest.mark.parametrize("name", [n for n in AVAILABLE if n not in NOWHERE])


def test_only_distances_and_gravity_stand_nowhere() -> None:
    assert {name for name in AVAILABLE if not scene(name).exact().outside} == {*NOWHERE}


@each_with_frames
def test_every_frame_is_told_where_it_is(name: str) -> None:
    found = {pose.name: pose for pose in external_poses(solved(name))}
    # All but a radius, and what a camera's lens does.
    owners = {p.owner for p in solved(name).problem.parameters.values() if p.key in PLACEMENT}
    assert set(found) == owners
    words = WORDS | CAMERAS.get(name, {})
    for frame in found.keys() & words.keys():
        assert found[frame].words == words[frame]
        given = ("probe_radius_mm",) if name == "plane with a ball" else ()
        assert (found[frame].held, found[frame].given) == ((), given)
    # A camera looks at a board of its own.
    for frame in found.keys() & TRUTH.keys() - CAMERAS.get(name, {}).keys():
        pose, (rotation, position) = found[frame], TRUTH[frame]
        off = pose.position - position
        if rotation is not None:
            assert pose.rotation is not None
            off = np.concatenate([off, vector_from_rotation(rotation.T @ pose.rotation)])
        # Beyond 3.5 of them is one number in 2000.
        assert np.all(np.abs(off) < 3.5 * pose.std[: len(off)]), frame


def test_a_plane_is_told_by_its_point_and_normal() -> None:
    found = {pose.name: pose for pose in external_poses(solved("plane"))}
    centre, normal = np.array([0.45, 0.05, -0.05]), rotation_from_rpy([0.0, 0.1, 0.0])[:, 2]
    plane = found["plane[S0]"]
    assert plane.rotation is not None
    np.testing.assert_allclose(plane.rotation[:, 2], normal, atol=2e-3)
    np.testing.assert_allclose(plane.position, normal * (normal @ centre), atol=2e-3)


@each_with_frames
def test_standard_deviations_are_those_of_drawn_unknowns(name: str) -> None:
    solution = solved(name)
    draws = 1000
    drawn = np.random.default_rng(0).multivariate_normal(solution.x, solution.covariance, draws)
    pose = external_poses(solution)[-1]
    rows = [solution.problem.values(x) for x in drawn]
    poses = [pose.frame.pose(values) for values in rows]
    found = [np.std([p for _, p in poses], axis=0)]
    predicted = [pose.std[:3]]
    if pose.rotation is not None:
        rotations = np.array([R for R, _ in poses])
        turns = vector_from_rotation(pose.rotation.T @ rotations)
        found += [turns.std(axis=0), quaternion_from_rotation(rotations).std(axis=0)]
        predicted += [pose.std[3:], pose.quaternion_std]
    # A standard deviation of 1000 draws scatters by 2.2 %; what is exactly known is rounding.
    np.testing.assert_allclose(
        np.concatenate(found), np.concatenate(predicted), rtol=0.09, atol=3e-7
    )


def test_what_cannot_be_told_has_no_standard_deviation() -> None:
    """Two places of the tip leave open how the instrument turns about the line between them."""
    measured = scene("tracked_point")
    term = measured.term(measured.samples(SIGMA, seed=1)[0]).take([0, 1] * 6)
    (pose,) = external_poses(solve(Problem([term], ParameterSet())))
    assert len(pose.held) == 1
    assert np.isnan(pose.std[3:]).any()
