"""What is proven where several eyes see several targets: one problem, one proof."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_job import answer
from many_eyes import scene
from pose_scenes import PAIR, write_csv

from suta_calib import calibrate_many_eyes, with_proof
from suta_calib.geometry.numbers import random_rotations
from suta_calib.pose_calibration.proof import loop_rows
from suta_calib.pose_calibration.rotation_bound import (
    PoseSquares,
    best_rotations,
    descended,
    stacked_turns,
)
from suta_calib.terms.hand_eye import HandEye


@pytest.mark.parametrize(
    ("count", "gross", "apart"), [((3, 2), 0.0, False), ((3, 2), 0.15, False), ((4, 2), 0.0, True)]
)
def test_several_eyes_are_proven_in_one_problem(
    count: tuple[int, int], gross: float, apart: bool
) -> None:
    # Eyes that share no target with the others are a problem of their own within it.
    sees = np.array([[True, False], [True, False], [False, True], [False, True]]) if apart else None
    data = scene(*count, 20, seed=3, gross=gross, sees=sees)
    found = calibrate_many_eyes(data.hand, data.seen, eye=data.eye, target=data.target)
    optimality = with_proof(found).optimality
    assert optimality is not None
    assert optimality.certified, optimality
    assert optimality.gap < 1e-9
    assert optimality.method == "eigenvalues"


def test_any_start_leads_to_the_proven_minimum_of_several_eyes() -> None:
    data = scene(3, 2, 15, seed=5)
    found = calibrate_many_eyes(data.hand, data.seen, eye=data.eye, target=data.target)
    (term,) = found.solution.problem.terms
    assert isinstance(term, HandEye)
    jacobian = PoseSquares.of(loop_rows(found.solution, term), 5).turning
    starts = random_rotations(np.random.default_rng(0), 100).reshape(20, 5, 3, 3)
    best = best_rotations(jacobian, starts[0])
    costs = [np.sum((jacobian @ stacked_turns(descended(jacobian, s))) ** 2) for s in starts]
    assert best.below < 1e-9 * best.cost
    assert best.cost == pytest.approx(min(costs), rel=1e-9)


def test_the_command_proves_several_eyes(tmp_path: Path) -> None:
    data = scene(2, 2, 15, seed=1)
    columns = (*PAIR, "eye", "target")
    labels = data.eye.tolist(), data.target.tolist()
    file = write_csv(tmp_path / "p.csv", columns, data.numbers, *labels)
    assert answer("hand-eye", file, "--certify")["optimality"]["certified"] is True
