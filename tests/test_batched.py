"""Many rows are evaluated so many at a time, and are what they are one by one, whoever computes."""

from __future__ import annotations

import copy

import casadi as ca
import numpy as np
import pytest

from suta_calib import batched
from suta_calib.arrays import FloatArray
from suta_calib.batched import OPERATIONS, Batched, formula

BINARY = {"ADD", "SUB", "MUL", "DIV", "POW", "CONSTPOW", "ATAN2", "HYPOT", "COPYSIGN"} | {
    *("FMIN", "FMAX", "LT", "LE", "EQ", "NE", "AND", "OR", "IF_ELSE_ZERO")
}


def function() -> ca.Function:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 3)
    return ca.Function("f", [x, y], [x[0] * y, ca.sin(x[1]) + y[2]])


def one_by_one(function: ca.Function, inputs: list[FloatArray]) -> list[FloatArray]:
    """What CasADi answers row by row; inputs with one dimension are the same for all."""
    rows = max(len(array) for array in inputs if array.ndim == 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batched, "MANY", 2)
        one = Batched(function, 1)
    answers = [np.zeros((rows, array.shape[1])) for array in one.outputs]
    for row in range(rows):
        for single, array in zip(one.inputs, inputs, strict=True):
            single[:] = array if array.ndim == 1 else array[row]
        for answer, array in zip(answers, one(), strict=True):
            answer[row] = array[0]
    return answers


@pytest.mark.parametrize("rows", [1, 4, 5, 8, 11])
@pytest.mark.parametrize("shared", [(), (0,)])
@pytest.mark.parametrize("numpy", [False, True])
def test_a_part_at_a_time_is_the_whole(
    rows: int, shared: tuple[int, ...], numpy: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batched, "CHUNK", 4)
    monkeypatch.setattr(batched, "HEIGHT", 4)
    monkeypatch.setattr(batched, "MANY", 0 if numpy else 1000)
    random = np.random.default_rng(0)
    many = Batched(function(), rows, shared)
    for _ in range(2):
        for array in many.inputs:
            array[:] = random.random(array.shape)
        for found, wanted in zip(many(), one_by_one(function(), many.inputs), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-15)


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("shared", [(), (1,), (0, 1)])
def test_numpy_does_what_casadi_does(
    name: str, shared: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batched, "MANY", 0)
    x, y, z = (ca.SX.sym(n) for n in "xyz")
    code = getattr(ca, f"OP_{name}")
    value = ca.SX.binary(code, x, y) if name in BINARY else ca.SX.unary(code, x)
    # Operands and results are needed again, and one answer is the same for all rows.
    asked = ca.Function("f", [x, y, z], [ca.vertcat(value, x * value, 2 * y), value - z])
    assert formula(asked, shared) is not None
    numbers = np.array([-1.5, -1.0, -0.25, 0.0, 0.25, 1.0, 2.5])
    many = Batched(asked, 49, shared)
    every = [a.reshape(-1, 1) for a in np.meshgrid(numbers, numbers)]
    for k, array in enumerate(many.inputs[:2]):
        array[:] = 0.75 if k in shared else every[k]
    many.inputs[2][:] = np.linspace(-1.0, 1.0, 49)[:, None]
    for found, wanted in zip(many(), one_by_one(asked, many.inputs), strict=True):
        # A difference has the rounding of what it is between.
        rounding = 1e-15 * np.abs(wanted[np.isfinite(wanted)]).max(initial=0.0)
        np.testing.assert_allclose(found, wanted, rtol=1e-14, atol=rounding)


@pytest.mark.parametrize("rows", [3, 300])
@pytest.mark.parametrize("wanted", [(0,), (1,), (1, 0)])
def test_some_outputs_are_computed_from_the_inputs_of_another(
    rows: int, wanted: tuple[int, ...]
) -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    # What both need, what only one does, and what depends on shared inputs alone.
    both = ca.sin(x) * y
    asked = ca.Function("f", [x, y], [ca.vertcat(both, ca.exp(y), x[0]), ca.sqrt(both**2 + 1) - y])
    every = Batched(asked, rows, [1])
    every.inputs[0][:] = np.random.default_rng(0).random((rows, 2))
    every.inputs[1][:] = 0.3
    found = Batched(asked, rows, [1], wanted=wanted, inputs=every.inputs)()
    for k, array in zip(wanted, found, strict=True):
        np.testing.assert_array_equal(array, every()[k])


def test_what_numpy_lacks_is_casadis() -> None:
    x = ca.SX.sym("x")
    assert formula(ca.Function("f", [x], [ca.erf(x)]), ()) is None
    y = ca.MX.sym("y", 2)
    asked = ca.Function("f", [y], [ca.norm_2(y)])
    many = Batched(asked, batched.MANY)
    many.inputs[0][:] = np.random.default_rng(0).random(many.inputs[0].shape)
    np.testing.assert_allclose(many()[0][:, 0], np.linalg.norm(many.inputs[0], axis=1), rtol=1e-14)


@pytest.mark.parametrize("rows", [3, 300])
def test_a_copy_that_would_fill_the_arrays_of_the_original_is_refused(rows: int) -> None:
    with pytest.raises(TypeError, match="bound to its arrays"):
        copy.deepcopy(Batched(function(), rows))
