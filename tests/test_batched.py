"""Many rows are evaluated so many at a time, and are what they are one by one."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from suta_calib import batched
from suta_calib.batched import Batched


def function() -> ca.Function:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 3)
    return ca.Function("f", [x, y], [x[0] * y, ca.sin(x[1]) + y[2]])


@pytest.mark.parametrize("rows", [1, 4, 5, 8, 11])
@pytest.mark.parametrize("shared", [(), (0,)])
def test_a_part_at_a_time_is_the_whole(
    rows: int, shared: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batched, "CHUNK", 4)
    random = np.random.default_rng(0)
    many, one = Batched(function(), rows, shared), Batched(function(), 1)
    for _ in range(2):
        for array in many.inputs:
            array[:] = random.random(array.shape)
        answer = many()
        for row in range(rows):
            for k, (single, array) in enumerate(zip(one.inputs, many.inputs, strict=True)):
                single[:] = array if k in shared else array[row]
            for found, wanted in zip(answer, one(), strict=True):
                np.testing.assert_array_equal(found[row], wanted[0])
