"""What pictures say is in a few sums: nothing of how rows err is lost with the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from simulated import Spread, arm_named, camera_scene, dh_parameters, perturbed

from suta_calib import Problem, solve
from suta_calib.arrays import FloatArray
from suta_calib.check import Checker
from suta_calib.check.row_errors import RowErrors
from suta_calib.solver.information import whitened_rows
from suta_calib.terms import Term
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.neighbour_correlation import Freed


def pictures(count: int, wrong: float) -> Term:
    """Corners in pictures, of an arm that reads each joint wrongly by so much, rad."""
    arm = arm_named("suta")
    scene = camera_scene(arm, perturbed(dh_parameters(arm), 1, 1e-3, 3e-3), count)
    term = scene.term(scene.samples(Spread(5e-5), seed=2)[0])
    samples = term.poses.samples
    random = np.random.default_rng(3)
    read = samples.q + wrong * random.standard_normal(samples.q.shape)
    return term.over_poses(term.poses.with_samples(replace(samples, q=read)))


def restricted(errors: RowErrors, fit: LinearFit, posture: float, near: float) -> Freed:
    """Of rows with so large joint errors."""
    covariance = errors.own + posture * errors.by_posture + near * errors.near(errors, 0.5)
    root = np.linalg.cholesky(covariance)
    both = np.linalg.solve(root, np.hstack([fit.jacobian, fit.residual[:, None]]))
    return Freed.of(both, fit, 2.0 * float(np.sum(np.log(np.diag(root)))))


def test_the_likelihood_of_sums_is_that_of_all_corners() -> None:
    problem = Problem([pictures(8, 3e-4)], dh_parameters(arm_named("suta")))
    x = problem.start()
    rows = whitened_rows(problem, x, [1e-4])
    residual = np.concatenate([(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows])
    # Where camera and board are: a well-determined fit.
    jacobian: FloatArray = np.vstack([r.jacobian for r in rows])[:, -12:]
    logs = []
    for summed in (False, True):
        errors = RowErrors.of(problem, x, rows, summed=summed)
        fit = LinearFit(errors.combine(jacobian), errors.combine(residual))
        rest = errors.sums.rest(residual, np.ones(len(residual))) if errors.sums else (0.0, 0)
        sizes = (0.0, 0.0), (1e-7, 0.0), (1e-8, 1e-6)
        freed = [restricted(errors, fit, *size).beside(*rest) for size in sizes]
        logs.append([one.of_any_noise for one in freed])
        assert len(fit.residual) == (6 * 8 if summed else len(residual))
    full, sums = (np.array(log) for log in logs)
    np.testing.assert_allclose(np.diff(full), np.diff(sums), rtol=1e-6)


def test_pictures_err_as_much_as_a_check_expects() -> None:
    """Of joints that read wrongly, all corners of a picture tell the same."""
    every = pictures(50, 3e-4)
    solution = solve(Problem([every.take(range(25))], dh_parameters(arm_named("suta"))))
    checking = Checker(solution).checking(every.take(range(25, 50)))
    shared = checking.start.shared
    tips = np.hstack([shared.of_sample(k) for k in range(25)])
    axes, _ = np.linalg.qr(tips)
    root = np.linalg.cholesky(axes.T @ checking.total @ axes)
    score = np.linalg.solve(root, axes.T @ checking.start.residual)
    assert 0.6 < float(np.mean(score**2)) < 1.5
    assert checking.run().unchanged
