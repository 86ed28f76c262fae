"""Derivatives by pose velocities become those by parameters."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.batched import formula
from suta_calib.geometry.lens import PLUMB_BOB
from suta_calib.solver import compiled_residual
from suta_calib.solver.compiled_residual import RowPattern
from suta_calib.solver.problem import Problem
from suta_calib.terms import FixedPoint, HandEye, Term
from suta_calib.terms.block import Block, Noise
from suta_calib.terms.hand_eye_start import EYE_IN_HAND
from suta_calib.terms.reprojection import reprojection

SAMPLES, ROWS, SIZE = 7, 40, 2
# Many rows look at one sample, and one row at the same sample twice.
LOOKED_AT = np.random.default_rng(3).integers(0, SAMPLES, (ROWS, 2))
COLUMNS = (6 * LOOKED_AT[:, :, None] + np.arange(3)).reshape(ROWS, 6)


@pytest.fixture
def pattern() -> RowPattern:
    none = np.zeros((ROWS, 0), dtype=np.intp)
    block = Block(
        name="distance",
        unit="m",
        size=SIZE,
        residual=lambda tools, *_: (tools[0].p - tools[1].p)[:SIZE],
        samples=LOOKED_AT,
        own_columns=none,
        data=np.zeros((ROWS, 0)),
        noise=Noise(1e-3),
        known_sigma=np.zeros(ROWS),
        labels=("",) * ROWS,
    )
    return RowPattern(block, COLUMNS, none, 6 * SAMPLES, 0)


@pytest.mark.parametrize("width", [0, 1, 5])
def test_derivatives_by_velocities_become_those_by_parameters(
    pattern: RowPattern, width: int
) -> None:
    random = np.random.default_rng(4)
    by_pose = random.normal(size=(ROWS, SIZE, 6))
    velocity = random.normal(size=(6 * SAMPLES, width))
    rows = random.normal(size=(ROWS * SIZE, width))
    wide = np.zeros((ROWS, SIZE, 6 * SAMPLES))
    for row, columns in enumerate(COLUMNS):
        for k, column in enumerate(columns):
            wide[row, :, column] += by_pose[row, :, k]
    matrix = wide.reshape(ROWS * SIZE, -1)
    for found, expected in (
        (pattern.by_parameters(by_pose, velocity), matrix @ velocity),
        (
            pattern.by_parameters(by_pose, velocity, slice(10, 25)),
            matrix[10 * SIZE : 25 * SIZE] @ velocity,
        ),
        (pattern.summed(by_pose, rows), matrix.T @ rows),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("numbers", [[], [0, 1, 2], [3, 4], [4, 3], [2, 2, 0], [0, 2]])
def test_rows_are_taken_whether_they_follow_one_another_or_not(numbers: list[int]) -> None:
    source, taken = np.random.default_rng(0).normal(size=(5, 3)), np.array(numbers, dtype=np.intp)
    out = np.full((len(taken), 3), np.nan)
    compiled_residual._take(source, compiled_residual._rows(taken), out)
    np.testing.assert_array_equal(out, source[taken])


@pytest.mark.parametrize("free", [False, True])
def test_no_row_is_taken_through_the_formula_of_a_rotation_vector(free: bool) -> None:
    residual, own = reprojection(EYE_IN_HAND, PLUMB_BOB, free, False), 21 if free else 12
    function, *_ = compiled_residual._compiled(residual, 1, own, 15, 2, True, False)
    rule = formula(function, (function.n_in() - 2,))
    assert rule is not None
    assert np.sqrt in {operation for operation, _ in rule.once}
    assert np.sqrt not in {operation for operation, _ in rule.per_row}
    # By hand it is some 350: three products with matrices for each derivative of a pixel.
    assert len(rule.per_row) < 700


@pytest.mark.parametrize("term", [HandEye.simulate(9).term, FixedPoint.simulate(9).term])
def test_what_is_made_of_own_parameters_may_be_computed_apart(
    monkeypatch: pytest.MonkeyPatch, term: Term
) -> None:
    x, found = 0.3 * np.random.default_rng(0).normal(size=len(term.own_parameters)), []
    for many in (10, 9):
        monkeypatch.setattr(compiled_residual, "MANY", many)
        lines = Problem([term]).linearise(x, [1.0] * len(term.blocks))
        found.append([a for line in lines for a in (line.residual, line.by_pose, line.by_own)])
    for apart, together in zip(*found, strict=True):
        np.testing.assert_allclose(apart, together, rtol=1e-12, atol=1e-14)
