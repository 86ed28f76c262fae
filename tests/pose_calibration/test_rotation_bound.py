"""The lower bound of sums of squares over rotations: never above them, and tight."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from studies import of_size

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import random_rotations
from suta_calib.pose_calibration import rotation_bound
from suta_calib.pose_calibration.rotation_bound import (
    PoseSquares,
    best_rotations,
    bounded,
    descended,
    stacked_turns,
)


def registration(seed: int, noise: float, weighed: bool = False) -> FloatArray:
    """Rows (m, 13) of eight points that are turned, moved and scattered."""
    random = np.random.default_rng(seed)
    points, R = random.normal(size=(8, 3)), random_rotations(random, 1)[0]
    moved = points @ R.T + [1.0, 2.0, 3.0] + noise * random.normal(size=points.shape)
    rows = np.zeros((8, 3, 13))
    rows[:, :, :3], rows[:, :, 12] = np.eye(3), -moved
    rows[:, :, 3:12] = np.einsum("ij,nk->nijk", np.eye(3), points).reshape(8, 3, 9)
    mixed = random.normal(size=(24, 24)) / 5 if weighed else 0.0
    return np.asarray((np.eye(24) + mixed) @ rows.reshape(24, 13))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3))
def test_bound_is_below_the_cost_of_any_rotations(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(30, 9 * count + 1))
    start, others = random_rotations(random, count), random_rotations(random, 200 * count)
    found = bounded(jacobian, descended(jacobian, start))
    costs = [
        float(np.sum((jacobian @ stacked_turns(R)) ** 2)) for R in others.reshape(-1, count, 3, 3)
    ]
    assert found.cost - found.below <= min(costs)
    # Of any multipliers, however bad.
    anyhow = bounded(jacobian, start, random.normal(size=(count, 21)))
    assert anyhow.cost - anyhow.below <= min(costs)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 1.0), st.booleans())
def test_of_registration_the_minimum_is_proven_from_any_start(
    seed: int, noise: float, weighed: bool
) -> None:
    jacobian = PoseSquares.of([registration(seed, noise, weighed)], 1).turning
    random = np.random.default_rng(seed + 1)
    starts = random_rotations(random, 10)
    costs = [
        float(np.sum((jacobian @ stacked_turns(descended(jacobian, R[None]))) ** 2)) for R in starts
    ]
    found = best_rotations(jacobian, starts[:1], 1e-12)
    assert found.proven(1e-12)
    assert found.trouble == ""
    assert found.cost == pytest.approx(min(costs), rel=1e-9, abs=1e-20)


@pytest.mark.parametrize("seeds", of_size(25, 60))
def test_a_local_minimum_is_not_proven_and_the_program_leaves_it(seeds: int) -> None:
    """With a few rows that weigh by direction there are two minima."""
    for seed in range(seeds):
        jacobian = PoseSquares.of([registration(seed, 1.0, weighed=True)], 1).turning
        starts = random_rotations(np.random.default_rng(seed), 30)
        found = [bounded(jacobian, descended(jacobian, R[None])) for R in starts]
        costs = np.array([b.cost for b in found])
        worse = np.flatnonzero(costs > costs.min() * (1.0 + 1e-6))
        if len(worse):
            break
    local = found[worse[0]]
    assert not local.proven(1e-12)
    assert local.cost - local.below <= costs.min() * (1.0 + 1e-9)
    best = best_rotations(jacobian, local.rotations, 1e-12)
    assert best.proven(1e-12)
    assert best.cost == pytest.approx(costs.min(), rel=1e-9)


def test_where_the_relaxation_is_not_tight_the_bound_says_how_far() -> None:
    """Rows of random numbers are no calibration: rotations have no such sum of squares."""
    jacobian = np.random.default_rng(2).normal(size=(78, 19))
    starts = random_rotations(np.random.default_rng(0), 80).reshape(40, 2, 3, 3)
    costs = [np.sum((jacobian @ stacked_turns(descended(jacobian, s))) ** 2) for s in starts]
    found = best_rotations(jacobian, starts[0])
    assert "a lower minimum than any rotations that were found" in found.trouble
    assert not found.proven(0.0)
    # Far better than nothing: a few parts in a hundred below the best of many starts.
    assert min(costs) * 0.9 < found.cost - found.below <= min(costs)
    assert found.cost == pytest.approx(min(costs), rel=1e-9)


def test_many_rotations_need_no_program_where_rows_agree() -> None:
    jacobian = np.random.default_rng(2).normal(size=(300, 82))
    found = best_rotations(jacobian, random_rotations(np.random.default_rng(0), 9))
    assert "too many for the semidefinite program" in found.trouble
    assert 0.0 < found.below <= found.cost


def test_without_the_solver_a_local_minimum_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rotation_bound, "load", missing_clarabel)
    jacobian = np.random.default_rng(0).normal(size=(30, 19))
    for seed in range(20):
        start = random_rotations(np.random.default_rng(seed), 2)
        if not bounded(jacobian, descended(jacobian, start)).proven(0.0):
            break
    found = best_rotations(jacobian, start)
    assert not found.proven(0.0)
    assert "pip install 'suta_calib[certify]'" in found.trouble


def missing_clarabel(module: str, extra: str) -> None:
    """In place of an import: the package is not there."""
    from suta_calib.optional_packages import missing

    raise missing(module, extra)


def test_positions_are_where_they_fit_best() -> None:
    rows = registration(3, 0.1)
    squares = PoseSquares.of([rows[:9], rows[9:]], 1)
    R = random_rotations(np.random.default_rng(0), 1)
    place = squares.placed(R)
    cost = squares.cost(R, place)
    assert cost == pytest.approx(float(np.sum((squares.turning @ stacked_turns(R)) ** 2)))
    y = np.concatenate([place[0], stacked_turns(R)])
    assert cost == pytest.approx(float(np.sum((rows @ y) ** 2)))
    for step in np.eye(3):
        assert squares.cost(R, place + 1e-3 * step) > cost
    assert squares.rows == 24
