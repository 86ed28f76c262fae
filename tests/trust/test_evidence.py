"""The one test of what a fit may lack: it is the F test of a fit with the columns freed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats

from suta_calib.arrays import FloatArray
from suta_calib.solver.losses import huber
from suta_calib.trust import Effect, LinearFit, Rule, Stretches, supported_effects, weigh_effects

ROWS, PARAMETERS = 40, 5


def data(rng: np.random.Generator, size: Any = 0.0, k: int = 2) -> tuple[LinearFit, Effect]:
    """A fit of normal noise, with an effect of that size in the data."""
    jacobian, columns = rng.standard_normal((ROWS, PARAMETERS)), rng.standard_normal((ROWS, k))
    # The residual of data that the effect is added to changes by the columns times the size.
    residual = rng.standard_normal(ROWS) - columns @ np.broadcast_to(size, k)
    residual -= jacobian @ np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    return LinearFit(jacobian, residual), Effect("effect", columns)


def test_it_equals_a_fit_with_the_columns_freed() -> None:
    fit, effect = data(np.random.default_rng(1), 0.3)
    (found,) = weigh_effects(fit, [effect])
    both = np.hstack([fit.jacobian, effect.columns])
    step, left = np.linalg.lstsq(both, -fit.residual, rcond=None)[:2]
    freedom = ROWS - PARAMETERS - 2
    covariance = left[0] / freedom * np.linalg.inv(both.T @ both)
    np.testing.assert_allclose(found.size, step[PARAMETERS:], rtol=1e-10)
    np.testing.assert_allclose(found.moves, step[:PARAMETERS], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance[PARAMETERS:, PARAMETERS:], rtol=1e-9)
    assert found.gain == pytest.approx(fit.squares - left[0], rel=1e-10)
    ratio = (fit.squares - left[0]) / 2 / (left[0] / freedom)
    assert found.p_single == pytest.approx(stats.f.sf(ratio, 2, freedom), rel=1e-8)


def test_weights_and_priors_equal_a_weighted_fit_with_prior_rows() -> None:
    rng = np.random.default_rng(2)
    plain, effect = data(rng, 0.4)
    weight, prior = rng.uniform(0.2, 1.0, ROWS), rng.uniform(0.5, 2.0, PARAMETERS)
    away = 0.1 * rng.standard_normal(PARAMETERS)
    fit = LinearFit(plain.jacobian, plain.residual, prior, away, weight)
    (found,) = weigh_effects(fit, [effect])
    root = np.sqrt(weight)[:, None]
    rows = np.vstack(
        [
            np.hstack([root * plain.jacobian, root * effect.columns]),
            np.hstack([np.diag(np.sqrt(prior)), np.zeros((PARAMETERS, 2))]),
        ]
    )
    right = -np.concatenate([root[:, 0] * plain.residual, np.sqrt(prior) * away])
    step = np.linalg.lstsq(rows, right, rcond=None)[0]
    np.testing.assert_allclose(found.size, step[PARAMETERS:], rtol=1e-9)
    # What is left are the squares of the rows and of the priors' pulls.
    assert fit.squares - found.gain == pytest.approx(np.sum((rows @ step - right) ** 2), rel=1e-9)


def test_without_an_effect_p_values_are_uniform() -> None:
    """Monte-Carlo: the share of p below any level is that level."""
    rng = np.random.default_rng(3)
    p = [weigh_effects(*single(data(rng)))[0].p_single for _ in range(1500)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


def single(pair: tuple[LinearFit, Effect]) -> tuple[LinearFit, list[Effect]]:
    return pair[0], [pair[1]]


def test_sizes_scatter_as_their_covariance_says() -> None:
    rng = np.random.default_rng(4)
    true, squares = np.array([0.5, -0.2]), []
    for _ in range(800):
        (found,) = weigh_effects(*single(data(rng, true)))
        off = found.size - true
        squares.append(off @ np.linalg.solve(found.covariance, off) / 2)
    freedom = ROWS - PARAMETERS - 2
    assert stats.kstest(squares, stats.f(2, freedom).cdf).pvalue > 0.01


def test_repeated_rows_say_it_once() -> None:
    """Three copies of every row, declared as such, are the rows alone."""
    fit, effect = data(np.random.default_rng(5), 0.4)
    (once,) = weigh_effects(fit, [effect])
    copies = LinearFit(
        np.tile(fit.jacobian, (3, 1)), np.tile(fit.residual, 3), rows_per_independent_row=3.0
    )
    (again,) = weigh_effects(copies, [Effect("effect", np.tile(effect.columns, (3, 1)))])
    assert again.p_single == pytest.approx(once.p_single, rel=1e-9)
    np.testing.assert_allclose(again.covariance, once.covariance, rtol=1e-9)


def test_rows_that_share_an_error_say_less() -> None:
    """Monte-Carlo: rows of one touch have one error; by clusters no false alarm comes of it."""
    rng, touches, each = np.random.default_rng(6), 60, 5
    clusters = np.repeat(np.arange(touches), each)[:, None]
    naive = clustered = 0
    for _ in range(300):
        columns = np.repeat(rng.standard_normal((touches, 2)), each, axis=0)
        noise = np.repeat(rng.standard_normal(touches), each) + rng.standard_normal(touches * each)
        jacobian = rng.standard_normal((touches * each, 3))
        noise -= jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
        effect = Effect("effect", columns)
        naive += weigh_effects(LinearFit(jacobian, noise), [effect])[0].p_single < 0.01
        fit = LinearFit(jacobian, noise, clusters=clusters)
        clustered += weigh_effects(fit, [effect])[0].p_single < 0.01
    assert naive > 30
    assert clustered <= 9


def test_a_pair_of_touches_belongs_to_both() -> None:
    """The variance of scores of distances is that of errors of the touches."""
    rng, touches = np.random.default_rng(7), 14
    pairs = np.array([(a, b) for a in range(touches) for b in range(a)])
    column = rng.standard_normal((len(pairs), 1))
    sums = []
    for _ in range(400):
        error = rng.standard_normal(touches)
        residual = error[pairs[:, 0]] - error[pairs[:, 1]]
        fit = LinearFit(np.zeros((len(pairs), 1)), residual, clusters=pairs)
        sums.append((column[:, 0] @ residual, fit.score_variance(column, residual)[0, 0]))
    scores, variances = np.array(sums).T
    assert np.mean(variances) == pytest.approx(np.var(scores), rel=0.3)


def test_the_window_is_found() -> None:
    rng = np.random.default_rng(8)
    fit, effect = data(rng)
    windows = [(np.arange(ROWS) >= since).astype(float) for since in range(5, 35, 5)]
    residual = fit.residual - 3.0 * effect.columns[:, 0] * windows[3]
    changed = LinearFit(fit.jacobian, residual)
    (found,) = supported_effects(changed, [Effect("moved", effect.columns[:, :1], windows=windows)])
    assert found.window == 3
    assert abs(found.size[0] - 3.0) < 4 * found.std[0]


def test_what_the_parameters_imitate_is_no_evidence() -> None:
    fit, effect = data(np.random.default_rng(9), 1.0)
    imitated = Effect("imitated", fit.jacobian[:, :2] @ np.array([[1.0], [2.0]]))
    assert not weigh_effects(fit, [imitated])
    coarse = Effect("coarse", effect.columns, plausible=np.full(2, 1e-3))
    assert not weigh_effects(fit, [coarse])


def test_a_rule_asks_for_chance_share_and_size() -> None:
    fit, effect = data(np.random.default_rng(10), 2.0)
    assert supported_effects(fit, [effect])
    (found,) = weigh_effects(fit, [effect])
    assert not found.supported(Rule(share=found.share))
    assert not found.supported(Rule(false_alarm=0.5 * found.p_value))
    assert not found.supported(Rule(times_std=found.significance))
    # Allowing for a thousand tests, chance explains a thousand times as much.
    more = [Effect(str(k), effect.columns) for k in range(1000)]
    assert weigh_effects(fit, more)[0].p_value == pytest.approx(
        min(1.0, 1000 * found.p_value), rel=1e-9
    )


@pytest.mark.parametrize("plausible", [None, np.array([2.0, 1.5])])
def test_sums_over_stretches_are_those_of_each_window(plausible: FloatArray | None) -> None:
    rng = np.random.default_rng(4)
    jacobian, columns = rng.standard_normal((90, 3)), rng.standard_normal((90, 2))
    residual = rng.standard_normal(90) - np.where(np.arange(90) >= 54, columns @ [0.5, 1.0], 0.0)
    weight = rng.uniform(0.5, 1.0, 90)
    fit = LinearFit(jacobian, residual, np.full(3, 0.1), weight=weight)
    places = np.array([(first, end) for first in range(0, 27, 3) for end in (first + 4, 30)])
    stretches = Stretches(np.repeat(np.arange(30), 3), places)
    arrays = [stretches[k] for k in range(len(stretches))]
    (one,), (other,) = (
        weigh_effects(fit, [Effect("change", columns, plausible, windows)])
        for windows in (stretches, arrays)
    )
    assert one.window == other.window
    assert places[one.window or 0].tolist() == [18, 30]
    for name in ("size", "gain", "p_single", "p_value", "noise"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9)


def test_a_robust_step_ends_at_the_minimum_of_hubers_loss() -> None:
    """Rows of two components, some far beyond their threshold."""
    rng = np.random.default_rng(11)
    jacobian, residual = rng.standard_normal((ROWS, 3)), rng.standard_normal(ROWS)
    residual[:6] += 8.0
    row, threshold = np.arange(ROWS) // 2, np.full(ROWS // 2, 1.8)
    done = LinearFit(jacobian, residual, np.full(3, 0.2), row=row, threshold=threshold).robust

    def cost(step: FloatArray) -> float:
        squared = np.sum((residual + jacobian @ step).reshape(-1, 2) ** 2, axis=1)
        return float(np.sum(huber(squared, threshold)) + 0.2 * step @ step)

    best = optimize.minimize(cost, np.zeros(3), tol=1e-12)
    assert done.cost == pytest.approx(best.fun, rel=1e-5)
    np.testing.assert_allclose(done.step, best.x, atol=2e-3)
    assert np.any(done.fit.weights < 0.5)
