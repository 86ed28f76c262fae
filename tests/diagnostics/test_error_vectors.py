"""Errors as vectors in the base, of every kind of observation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from simulated import Spread
from terms_cases import each_case, problem_of, scene, truth_of

from suta_calib.diagnostics.error_vectors import error_vectors, eye_poses
from suta_calib.terms import ArmPoses


@each_case
def test_they_vanish_at_the_truth(name: str) -> None:
    problem = problem_of(name, Spread())
    found = error_vectors(problem.terms[0], problem.values(truth_of(problem, name)))
    np.testing.assert_allclose(found.vector, 0.0, atol=1e-9)
    assert np.isfinite(found.at).all()


@each_case
def test_they_are_as_long_as_the_residuals(name: str) -> None:
    """For kinds with one residual of lengths per sample, whichever frame that is written in."""
    problem = problem_of(name)
    (term,), x = problem.terms, truth_of(problem, name)
    found = error_vectors(term, problem.values(x))
    assert found.norm.max() > 1e-5
    line = problem.linearise(x, problem.assumed_sigmas())[0]
    if len(line.residual) == len(found.norm):
        lengths = np.linalg.norm(line.residual, axis=1)
        np.testing.assert_allclose(found.norm, lengths, rtol=1e-6, atol=1e-12)


@each_case
def test_what_is_seen_is_where_the_eye_sees_it(name: str) -> None:
    problem = problem_of(name, Spread())
    (term,) = problem.terms
    if term.medium == "touch":
        return
    values = problem.values(truth_of(problem, name))
    R, p = eye_poses(term, values)
    ideal = term.observed(values, term.poses).position
    at = error_vectors(term, values).at
    np.testing.assert_allclose(np.einsum("nji,nj->ni", R, at - p), ideal, atol=1e-12)


def test_a_shift_of_what_was_seen_is_the_same_shift_in_the_base() -> None:
    problem = problem_of("tracked_point", Spread())
    (term,), shift = problem.terms, np.array([1e-3, -2e-3, 5e-4])
    values = problem.values(truth_of(problem, "tracked_point"))
    R, _ = eye_poses(term, values)
    samples = term.poses.samples
    moved = replace(samples, position=samples.position + shift @ R[0])
    poses = ArmPoses(scene("tracked_point").arm, moved)
    found = error_vectors(term.over_poses(poses), values).vector
    np.testing.assert_allclose(found, np.tile(shift, (len(found), 1)), atol=1e-9)


def test_what_is_far_from_all_others_is_outlying() -> None:
    problem = problem_of("tracked_point")
    (term,) = problem.terms
    values = problem.values(truth_of(problem, "tracked_point"))
    assert not error_vectors(term, values).outlying.any()
    samples = term.poses.samples
    position = samples.position.copy()
    position[4] += 5e-3
    poses = ArmPoses(scene("tracked_point").arm, replace(samples, position=position))
    outlying = error_vectors(term.over_poses(poses), values).outlying
    assert np.flatnonzero(outlying).tolist() == [4]
