"""How far the tip is off, as vectors in the base, of every kind of observation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Spread
from terms_cases import each_case, problem_of, scene, truth_of

from suta_calib.terms import ArmPoses
from suta_calib.trust.tip import tip_displacements


@each_case
def test_they_vanish_at_the_truth(name: str) -> None:
    problem = problem_of(name, Spread())
    at, vector = tip_displacements(problem.terms[0], problem.values(truth_of(problem, name)))
    np.testing.assert_allclose(vector, 0.0, atol=1e-8)
    assert np.isfinite(at).all()


@each_case
def test_they_are_as_long_as_the_residuals(name: str) -> None:
    """For kinds with one residual of lengths per sample, whichever frame that is written in."""
    problem = problem_of(name)
    (term,), x = problem.terms, truth_of(problem, name)
    _, vector = tip_displacements(term, problem.values(x))
    lengths = np.linalg.norm(vector, axis=1)
    # What is turned, and no more, is displaced by nothing.
    assert (lengths.max() > 1e-5) == (term.error_unit == "m")
    line = problem.linearise(x, problem.assumed_sigmas())[0]
    # What a profile shows follows from points, and is no place: a radius, or two heights.
    of_place = not term.columns.pixels and term.error_unit == "m"
    if len(line.residual) == len(lengths) and of_place:
        expected = np.linalg.norm(line.error, axis=1)
        np.testing.assert_allclose(lengths, expected, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("name", ["tracked_point", "camera_view", "camera_view beside", "hand_eye"])
def test_an_arm_that_is_elsewhere_is_displaced_by_that_much(name: str) -> None:
    problem = problem_of(name, Spread())
    (term,), values = problem.terms, problem.values(truth_of(problem, name))
    # The whole arm 0.1 mm aside: every tip is, and what is outside stays where it is.
    values["joint_1.y"] = term.poses.arm.parameters["joint_1.y"].nominal + 1e-4
    at, vector = tip_displacements(term, values)
    _, position = term.poses.at(values)
    np.testing.assert_allclose(at + vector, position, atol=1e-12)
    np.testing.assert_allclose(vector, np.tile([0.0, 1e-4, 0.0], (len(vector), 1)), atol=3e-7)


def test_what_was_seen_elsewhere_displaces_the_tip_the_other_way() -> None:
    problem = problem_of("tracked_point", Spread())
    (term,), shift = problem.terms, np.array([1e-3, -2e-3, 5e-4])
    values = problem.values(truth_of(problem, "tracked_point"))
    R, _ = term.outside[0].pose(values)
    samples = replace(term.poses.samples, position=term.poses.samples.position + R @ shift)
    moved = term.over_poses(ArmPoses(scene("tracked_point").arm, samples))
    _, vector = tip_displacements(moved, values)
    np.testing.assert_allclose(vector, np.tile(-shift, (len(vector), 1)), atol=1e-9)
