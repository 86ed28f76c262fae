"""Gauss-Newton steps within bounds: each the exact minimum of its quadratic, and where they end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from suta_calib.arrays import FloatArray
from suta_calib.solver.descent import Basin, bounded_step, descend

EVERYWHERE = (np.full(2, -np.inf), np.full(2, np.inf))


@pytest.mark.parametrize("seed", range(20))
def test_a_step_is_the_minimum_over_the_box(seed: int) -> None:
    """SciPy's bounded-variable least squares on the factors of the same quadratic."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 12))
    a = random.standard_normal((n + 3, n)) * 10.0 ** random.uniform(-4, 4, n)
    b = random.standard_normal(n + 3)
    size = np.abs(np.linalg.lstsq(a, b, rcond=None)[0])
    lower, upper = (-size * random.uniform(0, 1.5, n), size * random.uniform(0, 1.5, n))
    lower[random.random(n) < 0.2] = -np.inf
    step = bounded_step(a.T @ a, -a.T @ b, lower, upper)
    assert np.all((step >= lower) & (step <= upper))
    cluster = lsq_linear(a, b, (lower, upper), method="bvls", tol=1e-14).x
    np.testing.assert_allclose(step / size, cluster / size, atol=1e-7)


def test_a_bound_that_is_met_is_left_where_the_gradient_leads_away() -> None:
    """The whole step's first bound is none of the minimum's."""
    hessian = np.array([[1.0, 0.9], [0.9, 1.0]])
    # Without bounds at (4, -3): the second component is stopped, then the first goes on.
    step = bounded_step(
        hessian, -hessian @ [4.0, -3.0], np.array([-1.0, -0.5]), np.array([2.0, 9.0])
    )
    np.testing.assert_allclose(step, [1.75, -0.5])


def test_what_nothing_is_known_of_stays() -> None:
    hessian, gradient = np.diag([2.0, 0.0, 1e-12]), np.array([-4.0, 0.0, -1e-12])
    far = np.full(3, np.inf)
    np.testing.assert_allclose(bounded_step(hessian, gradient, -far, far), [2.0, 0.0, 1.0])
    np.testing.assert_allclose(bounded_step(np.ones((2, 2)), -np.ones(2), *EVERYWHERE), [0.5, 0.5])


@pytest.mark.parametrize("seed", range(10))
def test_where_all_are_held_a_step_ends_in_the_corner(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 5))
    hessian, gradient = np.diag(10.0 ** random.uniform(-4, 4, n)), random.standard_normal(n)
    near = np.abs(gradient) / np.diag(hessian) / 2.0
    np.testing.assert_array_equal(
        bounded_step(hessian, gradient, -near, near), -np.sign(gradient) * near
    )
    # Nor does one begin where there is no room at all.
    nowhere = np.zeros(n)
    np.testing.assert_array_equal(bounded_step(hessian, gradient, nowhere, nowhere), nowhere)


def test_what_is_let_go_does_not_depend_on_units() -> None:
    """Bounds met one by one and left again, the unknowns in units 16 magnitudes apart."""
    hessian = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    whole, low, up = np.array([4.0, -3.0, 1.0]), [-1.0, -0.5, -5.0], [2.0, 9.0, 5.0]
    unit = np.array([1.0, 1.0, 1e-10])
    step = bounded_step(
        hessian / np.outer(unit, unit), -hessian @ whole / unit, low * unit, up * unit
    )
    np.testing.assert_allclose(step / unit, [1.75, -0.5, 1.0])


def rosenbrock(z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Least squares along a bent valley, where whole steps leave it."""
    residual = np.array([10.0 * (z[1] - z[0] ** 2), 1.0 - z[0]])
    jacobian = np.array([[-20.0 * z[0], 10.0], [-1.0, 0.0]])
    cost = 0.5 * float(residual @ residual) + 1.0
    return cost, jacobian.T @ residual, jacobian.T @ jacobian


@pytest.mark.parametrize("start", [(-1.2, 1.0), (8.0, -3.0), (0.0, 50.0)])
def test_a_bent_valley_is_gone_down(start: tuple[float, float]) -> None:
    found = descend(rosenbrock, np.array(start), EVERYWHERE)
    assert found.settled
    np.testing.assert_allclose(found.z, [1.0, 1.0], atol=1e-6)
    assert found.cost == pytest.approx(1.0, rel=1e-12)


def test_a_bound_in_the_valley_is_where_it_ends() -> None:
    bounds = np.array([-2.0, -2.0]), np.array([0.5, 2.0])
    found = descend(rosenbrock, np.array([-1.2, 1.0]), bounds)
    assert found.settled
    assert found.z[0] == 0.5

    def residual(z: FloatArray) -> FloatArray:
        return np.array([10.0 * (z[1] - z[0] ** 2), 1.0 - z[0]])

    cluster = least_squares(residual, [-1.2, 1.0], bounds=bounds, xtol=1e-15, ftol=1e-15)
    np.testing.assert_allclose(found.z, cluster.x, atol=1e-6)


def test_steps_that_do_not_suffice_are_said() -> None:
    few = descend(rosenbrock, np.array([-1.2, 1.0]), EVERYWHERE, steps=2)
    assert (few.settled, few.steps, few.basin) == (False, 2, None)
    assert few.cost < rosenbrock(np.array([-1.2, 1.0]))[0]


def two_wells(z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """One component, minima at ±1, that at -1 the lower."""
    value, slope = z[0] ** 2 - 1.0 + 0.05 * z[0], 2.0 * z[0] + 0.05
    return 0.5 * value**2 + 0.1 * z[0], np.array([value * slope + 0.1]), np.array([[slope**2]])


def test_only_the_minimum_that_a_step_leads_to_is_joined() -> None:
    bounds = np.array([-4.0]), np.array([4.0])
    right, left = (descend(two_wells, np.array([s]), bounds) for s in (2.0, -2.0))
    assert right.basin is not None
    assert left.basin is not None
    known: list[Basin] = [right.basin, left.basin]
    for start, number in ((3.0, 0), (-3.0, 1)):
        evaluated: list[float] = []

        def counted(z: FloatArray, seen: list[float] = evaluated) -> tuple:
            seen.append(float(z[0]))
            return two_wells(z)

        alone = descend(counted, np.array([start]), bounds)
        once = len(evaluated)
        joined = descend(counted, np.array([start]), bounds, basins=known, joins=1e-4)
        assert joined.joined == number
        assert len(evaluated) - once < once
        assert joined.cost == pytest.approx(alone.cost, rel=1e-9)
        assert joined.z == pytest.approx(alone.z, abs=1e-5)


def test_a_minimum_above_is_joined_by_no_step() -> None:
    """Whose quadratic, far from the truth, leads up there."""
    above = Basin(np.array([1.0]), 2.0, np.zeros(1), np.ones((1, 1)))

    def cost(z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        return 1.0 + z[0] ** 2, np.array([2.0 * z[0] - 0.2]), np.full((1, 1), 0.2)

    found = descend(cost, np.zeros(1), (np.array([-9.0]), np.array([9.0])), basins=[above], joins=1)
    assert found.joined is None
    assert found.cost == 1.0


def test_where_nothing_is_finite_no_step_is_taken() -> None:
    def nowhere(z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        return np.nan, z * np.nan, np.full((2, 2), np.nan)

    found = descend(nowhere, np.array([1.0, 2.0]), EVERYWHERE)
    assert (found.settled, found.steps) == (False, 0)
    np.testing.assert_array_equal(found.z, [1.0, 2.0])


def test_a_step_to_where_nothing_is_finite_is_taken_shorter() -> None:
    """√z, whose quadratic at the start leads to where it has no value."""

    def root(z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        if z[0] < 0.5:
            return np.nan, np.full(1, np.nan), np.full((1, 1), np.nan)
        value, slope = np.sqrt(z[0] - 0.5) - 0.3, 0.5 / np.sqrt(max(z[0] - 0.5, 1e-12))
        return 0.5 * value**2 + 1.0, np.array([value * slope]), np.array([[slope**2]])

    found = descend(root, np.array([9.0]), (np.array([-np.inf]), np.array([np.inf])))
    assert found.settled
    assert found.z[0] == pytest.approx(0.59, abs=1e-6)


def test_a_point_as_low_as_a_minimum_elsewhere_is_not_in_its_bowl() -> None:
    bounds = np.array([-4.0]), np.array([4.0])
    left = descend(two_wells, np.array([-2.0]), bounds).basin
    right = descend(two_wells, np.array([2.0]), bounds).basin
    assert left is not None
    assert right is not None
    assert left.holds(left.z + 0.01, two_wells(left.z + 0.01)[0])
    assert not left.holds(right.z, right.cost)
    # Nor is a lower point, whatever the quadratic says.
    assert not right.holds(right.z, left.cost)
