"""How far a change of the parameters is, in units of what noise does to them.

Only combinations that the data determine count: a priori knowledge keeps the others in place, and
what leaving samples out does to them is no influence of the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray

# Share of a combination's information that must come from the data.
IDENTIFIED: Final = 0.9
ROUNDING: Final = 1e-10


@dataclass(frozen=True, eq=False)
class Influence:
    """The quadratic form of Cook's distance.

    Attributes:
        form: (p, p) inverse covariance of the identified combinations, over all parameters.
        directions: how many of them there are.
    """

    form: FloatArray
    directions: int

    @classmethod
    def of(
        cls,
        curvature: FloatArray,
        variance: FloatArray,
        prior: FloatArray,
        arm: Sequence[int],
        own: Sequence[int],
    ) -> Influence:
        """From the curvature of the cost and the variance of its gradient.

        Args:
            curvature: (n, n) over all parameters, priors excluded.
            variance: (n, n), of the gradient.
            prior: (p,) precision of the priors on the arm's.
            arm: the p parameters that are looked at.
            own: others that are estimated with them, and count for nothing themselves.
        """
        passed_on = np.hstack(
            [np.eye(len(arm)), -curvature[np.ix_(arm, own)] @ inverse(curvature[np.ix_(own, own)])]
        )
        both = np.ix_([*arm, *own], [*arm, *own])
        data = passed_on @ curvature[both] @ passed_on.T
        score = passed_on @ variance[both] @ passed_on.T
        total = data + np.diag(prior)
        root = _inverse_root(total)
        share, turn = np.linalg.eigh(root.T @ data @ root)
        basis = root @ turn[:, share > IDENTIFIED]
        weigh = total @ basis
        return cls(weigh @ inverse(basis.T @ score @ basis) @ weigh.T, basis.shape[1])

    def distance(self, change: FloatArray) -> FloatArray:
        """(k,) squared distances per direction of changes (k, p)."""
        squared = np.einsum("kp,pq,kq->k", change, self.form, change)
        return np.asarray(squared / max(self.directions, 1))


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a symmetric matrix in units of its diagonal; zero where nothing is known."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    outer = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(matrix / outer, ROUNDING, True) / outer)


def _inverse_root(matrix: FloatArray) -> FloatArray:
    """(p, r) R with Rᵀ M R = 1, of the r directions that are more than rounding."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    kept = values > ROUNDING * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None])
