"""What is proven of pivot, registration and hand-eye calibration, and what is not."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suta_calib import calibrate_hand_eye, calibrate_pivot, register, with_proof
from suta_calib.cli._app import run
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.pose_calibration import proof
from suta_calib.pose_calibration.proof import loop_rows
from suta_calib.pose_calibration.rotation_bound import (
    Bound,
    PoseSquares,
    descended,
    stacked_turns,
)
from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.synthetic import OutlierModel, PoseNoise


def pairs(count: int, noise: PoseNoise | None = None, **options: object) -> tuple[Poses, Poses]:
    """Poses of a hand, and of a target that its eye saw with noise."""
    term = HandEye.simulate(count, eye=noise, **options).term  # type: ignore[arg-type]
    samples = term.poses.samples
    assert samples.rotation is not None
    assert samples.position is not None
    return term.poses.at({}), (samples.rotation, samples.position)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([0.0, 1e-4, 1e-3, 5e-3]))
def test_hand_eye_is_proven_on_clean_and_noisy_pairs(seed: int, noise: float) -> None:
    answer = with_proof(calibrate_hand_eye(*pairs(15, PoseNoise(noise, 2.0 * noise), seed=seed)))
    assert answer.optimality is not None
    assert answer.optimality.certified, answer.optimality
    assert answer.optimality.gap < 1e-9
    assert answer.optimality.sentence.startswith("Proven best")


def test_the_proven_minimum_is_the_best_of_a_hundred_starts() -> None:
    answer = with_proof(calibrate_hand_eye(*pairs(12, PoseNoise(2e-3, 5e-3), seed=4)))
    solution = answer.solution
    (term,) = solution.problem.terms
    assert isinstance(term, HandEye)
    squares = PoseSquares.of(loop_rows(solution, term), 2)
    jacobian = squares.turning
    starts = random_rotations(np.random.default_rng(0), 200).reshape(100, 2, 3, 3)
    costs = [np.sum((jacobian @ stacked_turns(descended(jacobian, s))) ** 2) for s in starts]
    poses = solution.x.reshape(-1, 6)
    own = squares.cost(rotation_from_vector(poses[:, 3:]), poses[:, :3])
    optimality = answer.optimality
    assert optimality is not None
    assert own * (1.0 - optimality.answer_gap) == pytest.approx(min(costs), rel=1e-9)


def test_the_sum_of_squares_is_that_of_the_residuals() -> None:
    """Without noise of the hand, and without Huber's weights, it is the solver's own cost."""
    answer = calibrate_hand_eye(*pairs(30, PoseNoise(1e-3, 1e-3), seed=1), robust=False)
    solution = answer.solution
    (term,) = solution.problem.terms
    assert isinstance(term, HandEye)
    squares = PoseSquares.of(loop_rows(solution, term), 2)
    poses = solution.x.reshape(-1, 6)
    cost = squares.cost(rotation_from_vector(poses[:, 3:]), poses[:, :3])
    assert cost == pytest.approx(2.0 * solution.minimum.cost, rel=1e-5)


def test_wrong_pairs_and_a_camera_beside_the_robot_are_proven_alike() -> None:
    hand, seen = pairs(40, PoseNoise(1e-3, 1e-3), seed=2, gross=OutlierModel(0.2))
    for setup in ("eye-in-hand", "eye-to-hand"):
        R, p = hand
        back = np.swapaxes(R, 1, 2)
        given = hand if setup == "eye-in-hand" else (back, -np.einsum("nij,nj->ni", back, p))
        answer = with_proof(calibrate_hand_eye(given, seen, setup=setup))
        assert answer.outliers
        assert answer.optimality is not None
        assert answer.optimality.certified


def test_pivot_has_one_minimum_only() -> None:
    term = FixedPoint.simulate(20, spread=PoseNoise(1e-3, 1e-3), posts=np.eye(3)).term
    answer = with_proof(calibrate_pivot(*term.poses.at({}), term.poses.samples.labels["point"]))
    assert answer.optimality is not None
    assert answer.optimality.method == "linear"
    assert answer.optimality.certified
    assert answer.optimality.gap < 1e-9
    assert "only one minimum" in answer.optimality.sentence


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("stated", [False, True])
def test_registration_is_proven_weighed_or_not(stated: bool, flat: bool) -> None:
    random = np.random.default_rng(5)
    points = random.normal(size=(12, 3)) * [0.3, 0.2, 0.0 if flat else 0.1]
    moved = points @ random_rotations(random, 1)[0].T + [0.1, 0.2, 0.3]
    moved += random.normal(size=moved.shape) * 1e-3
    sigma = np.tile([1e-3, 1e-3, 4e-3], (12, 1)) if stated else None
    answer = with_proof(register(points, moved, target_sigma=sigma))
    assert answer.optimality is not None
    assert answer.optimality.certified, answer.optimality
    assert answer.optimality.gap < 1e-9
    by = {"eigenvalues": "by the eigenvalues of a matrix", "program": "by a semidefinite program"}
    assert by[answer.optimality.method] in answer.optimality.sentence


def test_what_is_not_proven_is_said_with_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def unproven(jacobian: object, start: np.ndarray, least: float) -> Bound:
        del jacobian, least
        return Bound(start, 1.0, 0.5, "the convex relaxation is not tight")

    monkeypatch.setattr(proof, "best_rotations", unproven)
    answer = with_proof(calibrate_hand_eye(*pairs(15, PoseNoise(1e-3, 1e-3))))
    assert answer.optimality is not None
    assert not answer.optimality.certified
    told = [note for note in answer.assessment.notes if note.startswith("Not proven best")]
    assert len(told) == 1
    assert "not tight" in told[0]
    assert "by up to 0.5" in told[0]
    assert answer.assessment.level == "care"


def test_what_is_not_determined_is_refused_before_anything_is_proven(
    repository: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (repository / "data" / "poses" / "hand_eye.csv").read_text().splitlines()
    file = tmp_path / "one_pose.csv"
    names = lines[0].split(",")
    first = lines[1].split(",")
    same = [
        ",".join(
            a if n.startswith("a_") else b
            for n, a, b in zip(names, first, row.split(","), strict=True)
        )
        for row in lines[1:]
    ]
    file.write_text("\n".join([lines[0], *same]))
    assert run(["hand-eye", str(file), "--certify"]) == 2
    said = capsys.readouterr()
    assert "expected a new pose in every row" in said.err
    assert "roven" not in said.out + said.err


def test_another_minimum_of_the_robust_cost_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proof, "leads_to", lambda *_: False)
    answer = with_proof(calibrate_hand_eye(*pairs(15, PoseNoise(1e-3, 1e-3))))
    assert answer.optimality is not None
    assert not answer.optimality.certified
    assert "leads to another minimum" in answer.optimality.sentence


def test_thirty_pairs_take_less_than_a_second() -> None:
    answer = calibrate_hand_eye(*pairs(30, PoseNoise(1e-3, 1e-3)))
    began = time.perf_counter()
    with_proof(answer)
    assert time.perf_counter() - began < 1.0


@pytest.mark.parametrize(
    "command",
    [
        ["hand-eye", "hand_eye.csv"],
        ["hand-eye", "hand_eye.csv", "--model", "AX=ZB"],
        ["pivot", "pivot.csv"],
        ["register", "register_a.csv", "register_b.csv"],
    ],
    ids=" ".join,
)
def test_commands_show_the_proof(
    repository: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    folder = repository / "data" / "poses"
    name, *rest = command
    arguments = [name, *(str(folder / a) if a.endswith(".csv") else a for a in rest)]
    assert run([*arguments, "--certify"]) == 0
    assert "Proven best" in capsys.readouterr().out
    assert run([*arguments, "--certify", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["optimality"]["certified"] is True
    assert record["optimality"]["gap"] < 1e-9
    assert run([*arguments, "--json"]) == 0
    assert "optimality" not in json.loads(capsys.readouterr().out)
