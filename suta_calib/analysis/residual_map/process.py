"""Gaussian processes over the error of the tip, by scikit-learn (the extra ``maps``).

Two sorts, with squared-exponential covariances (Rasmussen, Williams, Gaussian Processes for Machine
Learning, chapters 2 and 5):

* ``joints``: each joint turns by a curve f_j of its own reading more than it says, so that the tip
  is off by Σ_j J_j(q) f_j(q_j). The covariance of two errors is Σ_j J_j k_j(q_j, q_j') J_jᵀ.
* ``posture``: the error is any smooth function of all readings, each axis of the base by itself.

Far from the data both return to zero with the standard deviation they had without data.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy.optimize import minimize
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Hyperparameter,
    Kernel,
    WhiteKernel,
)

from suta_calib.analysis.residual_map.residuals import TipResiduals
from suta_calib.arrays import FloatArray, IntArray

Sort = Literal["joints", "posture"]
# Lengths that the search starts from, as a share of the range of each reading: a ripple, or a bow.
STARTS: Final[dict[Sort, tuple[float, ...]]] = {"joints": (0.05, 0.4), "posture": (0.5,)}
# Bounds of amplitudes in units of the error's RMS.
AMPLITUDES: Final = (1e-3, 10.0)
# Longest length, in ranges of the reading: such a curve is straight.
LONGEST: Final = 10.0


class JointCurves(Kernel):  # type: ignore[misc]
    """Covariance of the errors that curves of the joints make at the tip.

    Rows hold c readings, then the derivative of one coordinate of the tip by each of them.
    """

    def __init__(
        self,
        amplitude: Any = 1.0,
        length: Any = 1.0,
        amplitude_bounds: Any = AMPLITUDES,
        length_bounds: Any = (1e-2, LONGEST),
    ) -> None:
        self.amplitude, self.length = amplitude, length
        self.amplitude_bounds, self.length_bounds = amplitude_bounds, length_bounds

    @property
    def hyperparameter_amplitude(self) -> Any:
        """Standard deviation of each curve."""
        return Hyperparameter("amplitude", "numeric", self.amplitude_bounds, self._count)

    @property
    def hyperparameter_length(self) -> Any:
        """Reading over which each curve changes."""
        return Hyperparameter("length", "numeric", self.length_bounds, self._count)

    @property
    def _count(self) -> int:
        return len(np.atleast_1d(self.amplitude))

    def __call__(self, X: Any, Y: Any = None, eval_gradient: bool = False) -> Any:
        """Covariance (n, m), and its derivative (n, m, 2c) by the logarithms."""
        against, count = X if Y is None else Y, self._count
        amplitude, length = np.atleast_1d(self.amplitude), np.atleast_1d(self.length)
        total = np.zeros((len(X), len(against)))
        slopes = np.empty((2 * count if eval_gradient else 0, *total.shape))
        for k in range(count):
            square = np.subtract.outer(X[:, k], against[:, k])
            square *= square / length[k] ** 2
            part = np.exp(-0.5 * square)
            part *= np.outer(amplitude[k] ** 2 * X[:, count + k], against[:, count + k])
            total += part
            if eval_gradient:
                np.multiply(part, 2.0, out=slopes[k])
                np.multiply(part, square, out=slopes[count + k])
        return (total, np.moveaxis(slopes, 0, -1)) if eval_gradient else total

    def diag(self, X: Any) -> Any:
        """(n,) variances."""
        count = self._count
        return (X[:, count:] ** 2) @ (np.atleast_1d(self.amplitude) ** 2)

    def is_stationary(self) -> bool:
        """No: the lever of a joint differs from posture to posture."""
        return False


@dataclass(frozen=True, eq=False)
class Process:
    """A process that has seen residuals.

    Attributes:
        sort: which.
        columns: (c,) the readings that it depends on.
        centre, width: (c,) middle and range of each in the data, rad or m.
        lever: (c,) RMS of the derivative of a coordinate by each, m per rad or m.
        size: RMS of a coordinate of the error, m.
        regressor: scikit-learn's, over scaled numbers.
        theta: logarithms of what was learnt, the noise last.
    """

    sort: Sort
    columns: IntArray
    centre: FloatArray
    width: FloatArray
    lever: FloatArray
    size: float
    regressor: Any
    theta: FloatArray

    @property
    def noise(self) -> float:
        """Standard deviation of what it does not explain, of one coordinate, m."""
        return float(self.size * np.exp(self.theta[-1] / 2.0))

    @property
    def length(self) -> FloatArray:
        """(c,) reading over which it changes, rad or m."""
        return np.asarray(np.exp(self.theta[-1 - len(self.columns) : -1]) * self.width)

    @property
    def amplitude(self) -> FloatArray:
        """Standard deviation without data: (c,) of each curve, rad or m, or (1,) of the tip, m."""
        if self.sort == "posture":
            return np.array([self.size * np.exp(self.theta[0] / 2.0)])
        return np.asarray(np.exp(self.theta[: len(self.columns)]) * self.size / self.lever)

    @property
    def unknown(self) -> float:
        """Standard deviation of one coordinate of the tip far from all data, m."""
        lever = self.lever if self.sort == "joints" else np.ones(1)
        return float(np.linalg.norm(self.amplitude * lever))

    def scaled(self, q: FloatArray) -> FloatArray:
        """(n, c) readings as the regressor has them."""
        return np.asarray((q[:, self.columns] - self.centre) / self.width)

    def predict(self, q: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Error of the tip (n, 3) and its standard deviation (n, 3), m, base axes."""
        rows = _rows(self, q, jacobian)
        mean, std = (np.asarray(part).reshape(len(q), 3) for part in self._predict(rows))
        return mean * self.size, std * self.size

    def curve(self, k: int, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The curve of a joint (n,), by its place in `columns`, and its ±, rad or m."""
        # A coordinate that moves with this joint alone, by its lever.
        rows = np.zeros((len(reading), 2 * len(self.columns)))
        rows[:, k] = (reading - self.centre[k]) / self.width[k]
        rows[:, len(self.columns) + k] = 1.0
        mean, std = self._predict(rows)
        return mean * self.size / self.lever[k], std * self.size / self.lever[k]

    def _predict(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        with warnings.catch_warnings():
            # A variance that rounding makes negative is zero.
            warnings.simplefilter("ignore")
            mean, std = self.regressor.predict(rows, return_std=True)
        return np.asarray(mean), np.asarray(std)


def fitted_process(
    sort: Sort, residuals: TipResiduals, seed: int = 0, start: FloatArray | None = None
) -> Process:
    """Learn a process from residuals.

    Args:
        sort: which.
        residuals: of at least two postures.
        seed: of the choice of rows from which lengths and amplitudes are learnt.
        start: logarithms to begin the search from; the usual ones by default.
    """
    width = np.ptp(residuals.q, axis=0)
    lever = np.sqrt(np.mean(residuals.jacobian**2, axis=(0, 1)))
    # A reading that never changed tells no curve, nor does one that does not move the tip.
    moved = width > 1e-9
    if sort == "joints":
        # Share of the largest lever below which a joint does not move the tip.
        moved &= lever > 1e-3 * max(float(lever.max()), 1e-300)
    columns = np.flatnonzero(moved)
    middle = (residuals.q.max(axis=0) + residuals.q.min(axis=0)) / 2.0
    size = max(float(np.sqrt(np.mean(residuals.error**2))), 1e-12)
    unlearnt = Process(
        sort, columns, middle[columns], width[columns], lever[columns], size, None, np.zeros(0)
    )
    random = np.random.default_rng(seed)
    # Rows from which lengths and amplitudes are learnt: on a measured UR5, 150 of 700 rows give the
    # same left-out error as all of them within 4 %, in a hundredth of the time.
    chosen = np.sort(random.permutation(len(residuals))[:150])
    few = residuals.take(chosen)
    # No curve is shorter than the mean distance of the rows that it is learnt from.
    shortest = max(0.005, 1.0 / len(few))
    best: tuple[float, FloatArray] | None = None
    for share in STARTS[sort] if start is None else STARTS[sort][:1]:
        kernel = _kernel(sort, len(columns), shortest, share) + WhiteKernel(0.5, (1e-4, 4.0))
        # Another joint may not have moved in these rows.
        if start is not None and len(start) == len(kernel.theta):
            kernel.theta = np.clip(start, *kernel.bounds.T)
        # Of a search that begins where another over most of the rows ended, a few are enough.
        steps = 40 if start is None else 8
        rows, values = _rows(unlearnt, few.q, few.jacobian), _values(unlearnt, few)
        model = _fitted(kernel, 1e-10, rows, values, steps)
        likelihood = float(model.log_marginal_likelihood_value_)
        if best is None or likelihood > best[0]:
            best = likelihood, np.array(model.kernel_.theta)
    assert best is not None
    theta = best[1]
    kernel = _kernel(sort, len(columns), shortest, 1.0)
    kernel.theta = theta[:-1]
    rows = _rows(unlearnt, residuals.q, residuals.jacobian)
    values, noise = _values(unlearnt, residuals), float(np.exp(theta[-1]))
    model = _fitted(kernel, noise, rows, values)
    return Process(**{**vars(unlearnt), "regressor": model, "theta": theta})


def _kernel(sort: Sort, count: int, shortest: float, share: float) -> Any:
    bounds, lengths = (shortest, LONGEST), np.full(count, share)
    if sort == "joints":
        # As if all joints had an equal part in the error.
        return JointCurves(np.full(count, count**-0.5), lengths, AMPLITUDES, bounds)
    squares = (AMPLITUDES[0] ** 2, AMPLITUDES[1] ** 2)
    return ConstantKernel(0.5, squares) * RBF(lengths, bounds)


def _rows(process: Process, q: FloatArray, jacobian: FloatArray) -> FloatArray:
    """What the regressor takes: a row for each posture, or for each coordinate of its tip."""
    scaled = process.scaled(q)
    if process.sort == "posture":
        return scaled
    levers = jacobian[:, :, process.columns] / process.lever
    return np.hstack([np.repeat(scaled, 3, axis=0), levers.reshape(-1, len(process.columns))])


def _values(process: Process, residuals: TipResiduals) -> FloatArray:
    values = residuals.error / process.size
    return values if process.sort == "posture" else values.reshape(-1)


def _fitted(kernel: Any, noise: float, rows: FloatArray, values: FloatArray, steps: int = 0) -> Any:
    def search(
        objective: Callable[..., Any], theta: FloatArray, bounds: FloatArray
    ) -> tuple[FloatArray, float]:
        options = {"maxiter": steps}
        minimum = minimize(
            objective, theta, jac=True, bounds=bounds, method="L-BFGS-B", options=options
        )
        return minimum.x, float(minimum.fun)

    model = GaussianProcessRegressor(kernel, alpha=noise, optimizer=search if steps else None)
    with warnings.catch_warnings():
        # Lengths at a bound are usual: a joint without a curve of its own has any.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(rows, values)
