"""The likelihood by which pictures are weighed: against V written out, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.arrays import FloatArray
from suta_calib.pose_calibration.correlation import WAYS
from suta_calib.pose_calibration.picture_likelihood import Likelihood, PriorKnowledge, Sums

# The last two unknowns are what poses share.
POSES, CORNERS, UNKNOWNS = 5, 12, 10
LEVELS = np.log([0.2, 0.4, 3e-3, 6e-3, 0.7, 1.5, 0.4])


def rows() -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """r (n,), J (n, p) and P (n, 6 poses) of two cameras, both at every pose of the hand."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(2):
        n = POSES * CORNERS
        by_pose = np.zeros((n, POSES, WAYS))
        by_pose[np.arange(n), np.repeat(np.arange(POSES), CORNERS)] = 100 * rng.normal(
            size=(n, WAYS)
        )
        found.append((rng.normal(size=n), rng.normal(size=(n, UNKNOWNS)), by_pose.reshape(n, -1)))
    return found


def known() -> PriorKnowledge:
    precision = np.array([0, 0, 0, 4.0, 9.0, 1.0, 0.0, 2.0, 1.0, 1.0])
    groups = np.zeros((2, UNKNOWNS), dtype=np.bool_)
    groups[0, 3:5] = groups[1, [5, 7]] = True
    shared = np.arange(UNKNOWNS)[None] >= 8
    return PriorKnowledge(precision, np.linspace(-1.0, 1.0, UNKNOWNS), groups, 1.3, shared)


def likelihood() -> Likelihood:
    shape = (POSES, WAYS)
    parts = [
        (
            float(len(r)),
            J.T @ J,
            J.T @ r,
            r @ r,
            (P.T @ J).reshape(*shape, UNKNOWNS),
            (P.T @ r).reshape(shape),
            np.array([(P.T @ P).reshape(*shape, *shape)[g, :, g] for g in range(POSES)]),
        )
        for r, J, P in rows()
    ]
    return Likelihood(Sums(*map(np.array, zip(*parts, strict=True))), known())


def by_definition(levels: FloatArray) -> float:
    """-log of the restricted likelihood, with the covariance V of all corners written out."""
    scatter = np.tile(np.repeat(np.exp(2 * levels[2:4]), 3), POSES)
    r, J, P = (np.concatenate(each) for each in zip(*rows(), strict=True))
    V = np.diag(np.repeat(np.exp(2 * levels[:2]), POSES * CORNERS)) + (P * scatter) @ P.T
    beliefs = known()
    precision = beliefs.at(np.exp(levels[4:]))
    told = precision > 0
    J = np.vstack([J, np.eye(UNKNOWNS)[told]])
    r = np.concatenate([r, beliefs.away[told]])
    whole = np.zeros((len(r), len(r)))
    whole[: len(V), : len(V)] = V
    whole[len(V) :, len(V) :] = np.diag(1.0 / precision[told])
    inverse = np.linalg.inv(whole)
    information = J.T @ inverse @ J
    left = inverse - inverse @ J @ np.linalg.solve(information, J.T @ inverse)
    logs = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(information)[1]
    hyper = -levels[2:4].sum() + 0.5 * np.sum((levels[4:6] / beliefs.spread) ** 2) - levels[6]
    return float(0.5 * (r @ left @ r + logs) + hyper)


def test_sums_give_the_likelihood_of_all_corners() -> None:
    for levels in (LEVELS, LEVELS + 0.5, LEVELS * 0.8):
        assert likelihood().at(levels).value == pytest.approx(by_definition(levels), rel=1e-9)


@pytest.mark.parametrize("levels", [LEVELS, LEVELS + np.linspace(-1.0, 1.0, len(LEVELS))])
def test_the_gradient_is_that_of_central_differences(levels: FloatArray) -> None:
    ours, step = likelihood(), 1e-5
    differences = [
        (ours.at(levels + away).value - ours.at(levels - away).value) / (2 * step)
        for away in step * np.eye(len(levels))
    ]
    gradient = ours.gradient(levels, ours.at(levels))
    assert gradient == pytest.approx(np.array(differences), rel=1e-6, abs=1e-6)


def test_at_the_best_levels_nothing_pulls() -> None:
    ours = likelihood()
    best = ours.best(LEVELS)
    assert np.abs(ours.gradient(best, ours.at(best))).max() < 1e-2


def test_levels_are_as_uncertain_as_the_value_is_curved() -> None:
    ours = likelihood()
    best, step = ours.best(LEVELS), 0.02 * np.eye(len(LEVELS))
    hessian = [
        [
            sum(s * t * ours.at(best + s * a + t * b).value for s in (1, -1) for t in (1, -1))
            / (4 * 0.02**2)
            for b in step
        ]
        for a in step
    ]
    assert np.linalg.inv(ours.uncertainty(best)) == pytest.approx(
        np.array(hessian), rel=0.02, abs=0.02
    )
