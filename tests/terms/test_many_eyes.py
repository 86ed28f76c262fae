"""Several eyes and several targets in one problem: closed form, term, labels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from many_eyes import Scene, scene
from studies import first_of

from suta_calib.geometry.numbers import homogeneous, vector_from_rotation
from suta_calib.measurements import Samples
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import HandEye, MeasuredPoses, Poses
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.many_eyes_start import SeenTogether, eyes_and_targets, loop_errors
from suta_calib.terms.synthetic import EXACT

AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def off(found: Poses, true: Poses) -> float:
    """The farthest of poses, m or rad."""
    turn = vector_from_rotation(np.swapaxes(found[0], 1, 2) @ true[0])
    return float(max(np.abs(found[1] - true[1]).max(), np.abs(turn).max()))


@pytest.mark.parametrize(
    "what",
    [
        {"eyes": 3, "targets": 2},
        {"eyes": 1, "targets": 3},
        {"eyes": 4, "targets": 1},
        # Each eye alone leaves its X open along an axis, and about it: together they do not.
        {"eyes": 2, "targets": 1, "axes": AXES},
        # Two parts of the graph.
        {"eyes": 2, "targets": 2, "sees": np.eye(2, dtype=bool)},
    ],
)
@pytest.mark.parametrize("seed", first_of(range(3)))
def test_exact_poses_give_back_every_x_and_z(what: dict[str, Any], seed: int) -> None:
    data = scene(**what, seed=seed, hand=EXACT, eye=EXACT)
    X, Z = eyes_and_targets(data.hand, data.seen, data.together)
    assert off(X, data.X) < 1e-9
    assert off(Z, data.Z) < 1e-9
    slid, turned = loop_errors(data.hand, data.seen, X, Z, data.together)
    assert np.abs(slid).max() < 1e-9
    assert np.abs(turned).max() < 1e-9


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_a_fifth_of_wrong_rows_hardly_moves_the_start(seed: int) -> None:
    data = scene(3, 2, seed=seed, gross=0.2)
    X, _ = eyes_and_targets(data.hand, data.seen, data.together)
    assert off(X, data.X) < 5e-3


def test_an_eye_that_saw_a_known_target_once_is_placed_by_it() -> None:
    data = scene(3, 1, 20, hand=EXACT, eye=EXACT)
    chosen = (data.together.eye < 2) | (np.arange(60) == 2)
    together = SeenTogether.of(data.together.eye[chosen], data.together.target[chosen])
    hand, seen = ((R[chosen], p[chosen]) for R, p in (data.hand, data.seen))
    X, _ = eyes_and_targets(hand, seen, together)
    assert off(X, data.X) < 1e-9


def test_parts_of_the_graph_share_no_row() -> None:
    together = SeenTogether.of(np.array([0, 1, 2, 2]), np.array([0, 0, 1, 2]))
    of_eyes, of_targets = together.parts
    assert of_eyes[0] == of_eyes[1] != of_eyes[2]
    assert of_targets.tolist() == [of_eyes[0], of_eyes[2], of_eyes[2]]
    assert [(eye, target) for eye, target, _ in together.edges] == [(0, 0), (1, 0), (2, 1), (2, 2)]


def term_of(data: Scene, **more: Any) -> HandEye:
    n = len(data.eye)
    samples = Samples.from_arrays(
        [],
        np.zeros((n, 0)),
        labels={"eye": data.eye, "target": data.target},
        position=data.seen[1],
        rotation=data.seen[0],
    )
    return HandEye(MeasuredPoses(*data.hand, samples), **more)


def test_a_term_has_a_pose_for_every_eye_and_target() -> None:
    data = scene(3, 2, 30, seed=1)
    term = term_of(data)
    owners = sorted({p.owner for p in term.own_parameters})
    assert owners == [
        "hand_eye[left]",
        "hand_eye[right]",
        "hand_eye[top]",
        "target[A]",
        "target[B]",
    ]
    found = solve(Problem([term]), SolverOptions(weights=None))
    for k, owner in enumerate(owners[:3]):
        X = pose_named(found.values, owner)
        assert off((X[0][None], X[1][None]), (data.X[0][[k]], data.X[1][[k]])) < 5e-3
    ideal = term.observed(found.values, term.poses)
    np.testing.assert_allclose(ideal.place, data.seen[1], atol=0.01)
    part = term.take(np.flatnonzero(data.eye == "top"))
    np.testing.assert_array_equal(
        part.observed(found.values, part.poses).place, ideal.place[data.eye == "top"]
    )


def test_terms_of_two_eyes_share_a_target_by_its_label() -> None:
    data = scene(2, 1, 20, seed=2)
    parts = []
    for label in ("left", "right"):
        rows = np.flatnonzero(data.eye == label)
        samples = Samples.from_arrays(
            [],
            np.zeros((len(rows), 0)),
            position=data.seen[1][rows],
            rotation=data.seen[0][rows],
        )
        poses = MeasuredPoses(data.hand[0][rows], data.hand[1][rows], samples)
        parts.append(HandEye(poses, label=label, target_label="A"))
    problem = Problem(parts)
    owners = {p.owner for p in problem.parameters.values()}
    assert owners == {"hand_eye[left]", "hand_eye[right]", "target[A]"}
    apart = solve(problem, SolverOptions(weights=None)).values
    joint = solve(Problem([term_of(data)]), SolverOptions(weights=None)).values
    for owner in owners:
        np.testing.assert_allclose(
            homogeneous(*pose_named(apart, owner)),
            homogeneous(*pose_named(joint, owner)),
            atol=1e-6,
        )
