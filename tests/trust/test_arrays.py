"""Samples made of arrays, which come from no file, pass through every diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from judging import assessed
from terms_cases import AVAILABLE, CASES, problem_of

from suta_calib import Problem, solve
from suta_calib.assessment import Assessment
from suta_calib.measurements import Samples

# Kinds whose other readings cost more than a second; `make test-all` tries them too.
QUICK = ("pairwise_distance", "tracked_point", "hand_eye")
BACKWARDS = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in AVAILABLE
]


def judged(name: str, *, backwards: str = "") -> Assessment:
    """Of arrays of one kind, with one joint that counts backwards where one is named."""
    problem = problem_of(name)
    (term,) = problem.terms
    samples = term.poses.samples
    sign = [-1.0 if joint == backwards else 1.0 for joint in samples.joints]
    bare = replace(samples, q=samples.q * sign, origin=())
    again = term.over_poses(term.poses.with_samples(bare))
    half = again.take(np.arange(len(bare)) < len(bare) // 2) if name == "tracked_point" else again
    solution = solve(Problem([half], problem.arm_parameters))
    return assessed(solution, [] if half is again else [again])


@pytest.mark.parametrize("name", AVAILABLE)
def test_arrays_are_judged(name: str) -> None:
    assert judged(name).level in ("good", "care")


@pytest.mark.parametrize("name", BACKWARDS)
def test_a_joint_that_counts_backwards_is_named(name: str) -> None:
    found = judged(name, backwards="joint_3")
    assert found.level == "bad"
    assert "if joint_3 counts the other way (sign: -1)" in found.notes[0]


def test_rows_of_arrays_have_names() -> None:
    bare = Samples(("a", "b"), np.zeros((3, 2)))
    assert tuple(bare.origin) == ("row 0", "row 1", "row 2")
    assert bare.file_names.tolist() == ["", "", ""]
    assert tuple(bare.take([2, 0]).origin) == ("row 2", "row 0")
    assert len(Samples.concatenate([bare, bare]).origin) == 6
    assert [name for _, name in bare.files()] == ["the samples"] * 3


def test_every_case_is_tried() -> None:
    assert {CASES[name].kind for name in AVAILABLE} >= {"plane", "range", "camera_view"}
