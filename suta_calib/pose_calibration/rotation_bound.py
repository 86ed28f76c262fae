"""Least squares that are linear in rotations, with a proof that no other rotations fit better.

A sum of squares ``f = |J y|²`` of ``y = (R_1, …, R_k, 1)``, every rotation row by row, is
quadratic, and that rotations are rotations is a set of quadratic equations ``yᵀ A y = 0``: columns
and rows are orthonormal, and right-handed. For any multipliers λ and γ

    f(y) = γ + yᵀ M y   for every y of rotations,   M = JᵀJ - Σ λ A - γ e eᵀ

where e picks the 1. Where M has no negative eigenvalue, γ is a lower bound of f over all rotations.
At a stationary point the multipliers of the orthonormal columns follow in closed form (Rosen,
Carlone, Bandeira, Leonard 2019, SE-Sync, doi:10.1177/0278364918784361; Carlone, Rosen, Calafiore,
Leonard, Dellaert 2015, Lagrangian duality in 3D SLAM, doi:10.1109/IROS.2015.7353364). Where these
prove nothing, the multipliers of all equations are those of a semidefinite program: the equations
that say nothing new of rotations make it tight (Briales, Gonzalez-Jimenez 2017,
doi:10.1109/CVPR.2017.595; Wise, Giamou, Khoubyarian, Grover, Kelly 2020 for hand-eye calibration,
doi:10.1109/MFI49285.2020.9235219).

Whoever found the multipliers, the bound is computed from them here, with what rounding may have
done to it: no solver is believed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.sparse import csc_matrix

from suta_calib.arrays import FloatArray
from suta_calib.errors import MissingExtraError
from suta_calib.geometry.numbers import nearest_rotation, rotation_from_vector, skew
from suta_calib.optional_packages import load

# Relative to the cost; beyond it a minimum is not proven. A hundredth of what weights are known to
# would be far more: the cost of a hundred numbers is known to a tenth.
PROVEN: Final = 1e-6
# Relative singular value below which the rows do not tell a position.
ROUNDING: Final = 1e-12


@dataclass(frozen=True, eq=False)
class PoseSquares:
    """A sum of squares that is linear in poses, compressed to as many rows as it has columns.

    Attributes:
        triangle: (c, c) or fewer rows, whose columns are 3 for every position, 9 for every rotation
            (row by row), and the constant; it has the cost of all rows.
        positions: how many there are.
        rows: how many numbers were squared.
    """

    triangle: FloatArray
    positions: int
    rows: int

    @classmethod
    def of(cls, jacobians: Iterable[FloatArray], positions: int) -> PoseSquares:
        """From rows in portions, so that not all of them are held at once."""
        triangle: FloatArray = np.zeros((0, 0))
        count = 0
        for jacobian in jacobians:
            count += len(jacobian)
            stacked = np.vstack([triangle, jacobian]) if len(triangle) else jacobian
            triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
        return cls(triangle, positions, count)

    @property
    def turning(self) -> FloatArray:
        """J, for which every position is where it fits best."""
        first = 3 * self.positions
        moving, turning = self.triangle[:, :first], self.triangle[:, first:]
        if not first:
            return turning
        axes, values, _ = np.linalg.svd(moving, full_matrices=False)
        determined = axes[:, values > ROUNDING * values[0]]
        return np.asarray(turning - determined @ (determined.T @ turning))

    def placed(self, rotations: FloatArray) -> FloatArray:
        """Positions (p, 3) that fit rotations (k, 3, 3) best."""
        first = 3 * self.positions
        moving, rest = self.triangle[:, :first], self.triangle[:, first:] @ stacked_turns(rotations)
        return np.asarray(-np.linalg.lstsq(moving, rest, ROUNDING)[0].reshape(-1, 3))

    def cost(self, rotations: FloatArray, positions: FloatArray) -> float:
        """The sum of squares at poses."""
        y = np.concatenate([positions.reshape(-1), stacked_turns(rotations)])
        return float(np.sum((self.triangle @ y) ** 2))


@dataclass(frozen=True, eq=False)
class Bound:
    """Rotations, and how much lower f may be anywhere else.

    Attributes:
        rotations: (k, 3, 3).
        cost: f there.
        below: f is nowhere lower than ``cost - below``; infinite where nothing is known.
        trouble: why nothing better is known; empty where that is no trouble.
        program: whether the multipliers are a semidefinite program's.
    """

    rotations: FloatArray
    cost: float
    below: float
    trouble: str = ""
    program: bool = False

    def proven(self, least: float, most: float = PROVEN) -> bool:
        """Whether they are the best but for ``most``; ``least`` is a cost that counts as none."""
        return self.below <= most * max(self.cost, least)


def stacked_turns(rotations: FloatArray) -> FloatArray:
    """``y`` (9k + 1,) of rotations (k, 3, 3)."""
    return np.concatenate([rotations.reshape(-1), [1.0]])


def best_rotations(jacobian: FloatArray, start: FloatArray, least: float = 0.0) -> Bound:
    """The rotations with the least ``f = |J y|²``, and the proof.

    The minimum beside the start first, with multipliers in closed form; where they prove nothing, a
    semidefinite program, whose solution is a new start.

    Args:
        jacobian: (m, 9k + 1), J.
        start: (k, 3, 3) rotations.
        least: cost that counts as none.
    """
    bound = bounded(jacobian, descended(jacobian, start))
    # Relative to the cost; what closed forms prove as well as this, a program need not prove
    # better.
    if bound.proven(least, 1e-9):
        return bound
    solved, trouble = (
        bound,
        (
            f"{len(start)} rotations are too many for the semidefinite program, and multipliers in "
            "closed form do not suffice here"
        ),
    )
    # Rotations of which a semidefinite program takes six seconds; it grows with their sixth power.
    if len(start) <= 8:
        try:
            rotations, multipliers = _program(jacobian)
        except (MissingExtraError, ArithmeticError) as error:
            trouble = str(error)
        else:
            candidates = [bound.rotations, descended(jacobian, rotations)]
            bounds = [bound, *(bounded(jacobian, c, multipliers) for c in candidates)]
            lowest = max(b.cost - b.below for b in bounds)
            best = min(bounds, key=lambda b: b.cost)
            below = max(best.cost - lowest, 0.0)
            solved = Bound(best.rotations, best.cost, below, program=True)
            trouble = "the convex relaxation has a lower minimum than any rotations that were found"
    return solved if solved.proven(least) else replace(solved, trouble=trouble)


def descended(jacobian: FloatArray, start: FloatArray) -> FloatArray:
    """The minimum (k, 3, 3) beside a start, by Newton's steps on the rotations."""
    rotations = start
    cost = _cost(jacobian, rotations)
    damping = 0.0
    for _ in range(100):
        tangent = _tangent(rotations)
        along, residual = jacobian @ tangent, jacobian @ stacked_turns(rotations)
        gradient, plain = along.T @ residual, along.T @ along
        curvature = tangent.T @ _lagrangian(jacobian, _closed_form(jacobian, rotations)) @ tangent
        size = max(float(np.trace(plain)) / len(plain), 1e-300)
        if damping or np.linalg.eigvalsh(curvature)[0] < 1e-9 * size:
            curvature = plain + max(damping, 1e-12) * size * np.eye(len(plain))
        step = -np.linalg.lstsq(curvature, gradient, 1e-14)[0].reshape(-1, 3)
        again = rotations @ rotation_from_vector(step)
        lower = _cost(jacobian, again)
        if lower <= cost:
            settled = float(np.abs(step).max()) < 1e-12 or lower == cost
            rotations, cost, damping = again, lower, damping / 10.0 if damping > 1e-8 else 0.0
            if settled:
                break
        elif float(np.abs(step).max()) < 1e-9 or damping > 1e8:
            break
        else:
            damping = max(10.0 * damping, 1e-6)
    return nearest_rotation(rotations)


def bounded(
    jacobian: FloatArray, rotations: FloatArray, multipliers: FloatArray | None = None
) -> Bound:
    """How much lower f may be than at rotations, by multipliers (k, 21) or those in closed form.

    With y₀ the given rotations and z across it, ``f(y) - f(y₀) = 2 c gᵀz + zᵀMz`` for g = M y₀ and
    some c from -1 to 1: no less than ``-gᵀM⁻¹g`` where M is positive across y₀, and less by at most
    yᵀy = 3k + 1 times what it lacks of that. Rounding of M leaves y₀ out: it does not matter that f
    is small against JᵀJ.
    """
    y = stacked_turns(rotations)
    residual = jacobian @ y
    cost = float(residual @ residual)
    if multipliers is None:
        multipliers = _closed_form(jacobian, rotations)
    else:
        multipliers = _made_stationary(jacobian, rotations, multipliers)
    lagrangian = _lagrangian(jacobian, multipliers)
    slope = jacobian.T @ residual - _pulled(multipliers, y)
    slope[-1] -= cost
    lagrangian[-1, -1] -= cost
    across = np.linalg.svd(y[None])[2][1:].T
    M, g = across.T @ lagrangian @ across, across.T @ slope
    values, axes = np.linalg.eigh((M + M.T) / 2.0)
    size = float(np.abs(values).max(initial=0.0))
    # A few times what the eigenvalues are computed to.
    eps = 8.0 * float(np.finfo(float).eps)
    rounding = eps * len(values) * size
    lacking = max(rounding - float(values[0]), 0.0)
    lacking = 0.0 if lacking == 0.0 else lacking + rounding
    by_slope = float(np.sum((axes.T @ g) ** 2 / np.maximum(values + lacking, 1e-300)))
    # What squares are computed to: residuals are small differences of J's large columns.
    squares = eps * float(np.linalg.norm(jacobian)) * float(np.linalg.norm(y)) * np.sqrt(cost)
    below = by_slope + lacking * float(y @ y) + float(squares)
    # No sum of squares is below zero.
    return Bound(rotations, cost, min(below, cost))


def _cost(jacobian: FloatArray, rotations: FloatArray) -> float:
    residual = jacobian @ stacked_turns(rotations)
    return float(residual @ residual)


def _tangent(rotations: FloatArray) -> FloatArray:
    """(9k + 1, 3k) derivative of y by small turns about the rotations' own axes."""
    tangent = np.zeros((9 * len(rotations) + 1, 3 * len(rotations)))
    turns = skew(np.eye(3))
    for j, R in enumerate(rotations):
        tangent[9 * j : 9 * j + 9, 3 * j : 3 * j + 3] = (R @ turns).reshape(3, 9).T
    return tangent


@cache
def _equations() -> FloatArray:
    """(21, 10, 10) symmetric A with ``(r, 1)ᵀ A (r, 1) = 0`` for every rotation r, row by row.

    The first six say that columns are orthonormal, six that rows are, nine that each column is the
    cross product of the other two.
    """
    number = np.arange(9).reshape(3, 3)
    minima = []
    for entries in (number.T, number):
        for i in range(3):
            for j in range(i, 3):
                A = np.zeros((10, 10))
                A[entries[i], entries[j]] += 0.5
                A[entries[j], entries[i]] += 0.5
                A[9, 9] = -float(i == j)
                minima.append(A)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            # Component a of column i times column j is that of column k.
            A = np.zeros((10, 10))
            A[number[b, i], number[c, j]] = 1.0
            A[number[c, i], number[b, j]] = -1.0
            A[number[a, k], 9] = -1.0
            minima.append((A + A.T) / 2.0)
    return np.array(minima)


def _at(rotation: int, count: int) -> FloatArray:
    """Columns of one rotation and of the 1, in y of ``count`` rotations."""
    return np.append(np.arange(9 * rotation, 9 * rotation + 9), 9 * count)


def _lagrangian(jacobian: FloatArray, multipliers: FloatArray) -> FloatArray:
    """``JᵀJ - Σ λ_c A_c``."""
    matrix = jacobian.T @ jacobian
    for j, of_one in enumerate(multipliers):
        at = np.ix_(*[_at(j, len(multipliers))] * 2)
        matrix[at] -= np.tensordot(of_one, _equations(), 1)
    return matrix


def _pulled(multipliers: FloatArray, y: FloatArray) -> FloatArray:
    """``Σ λ_c A_c y``."""
    pulled = np.zeros_like(y)
    for j, of_one in enumerate(multipliers):
        at = _at(j, len(multipliers))
        pulled[at] += np.tensordot(of_one, _equations(), 1) @ y[at]
    return pulled


def _closed_form(jacobian: FloatArray, rotations: FloatArray) -> FloatArray:
    """(k, 21) of the orthonormal columns alone: unique at a stationary point.

    Of the gradient G by a rotation R, ``RᵀG`` is symmetric there, and is what they are.
    """
    gradient = jacobian.T @ (jacobian @ stacked_turns(rotations))
    product = np.swapaxes(rotations, 1, 2) @ gradient[:-1].reshape(-1, 3, 3)
    product = (product + np.swapaxes(product, 1, 2)) / 2.0
    upper = np.triu_indices(3)
    multipliers = np.zeros((len(rotations), len(_equations())))
    multipliers[:, :6] = product[:, *upper] * np.where(upper[0] == upper[1], 1.0, 2.0)
    return multipliers


def _made_stationary(
    jacobian: FloatArray, rotations: FloatArray, multipliers: FloatArray
) -> FloatArray:
    """Multipliers nearest to given ones with which M y vanishes, as far as it can."""
    y = stacked_turns(rotations)
    left = jacobian.T @ (jacobian @ y) - _pulled(multipliers, y)
    improved = multipliers.copy()
    for j in range(len(rotations)):
        at = _at(j, len(rotations))
        pulls = (_equations() @ y[at])[:, :9]
        improved[j] += np.linalg.lstsq(pulls.T, left[at[:9]], 1e-9)[0]
    return improved


def _program(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (k, 3, 3) next to the relaxation's minimum, and its multipliers (k, 21).

    The largest γ for which M is positive semidefinite; its dual is the relaxation, which has a
    matrix in place of y yᵀ.

    Raises:
        MissingExtraError: there is no solver.
        ArithmeticError: it came to no end.
    """
    clarabel = load("clarabel", "certify")

    scale = float(np.sum(jacobian**2)) or 1.0
    size = jacobian.shape[1]
    count = size // 9
    matrix = jacobian.T @ jacobian / scale
    upper = np.triu_indices(size)
    order = np.lexsort(upper)
    rows, columns = upper[0][order], upper[1][order]
    weight = np.where(rows == columns, 1.0, np.sqrt(2.0))
    equations = np.zeros((21 * count + 1, len(rows)))
    for j in range(count):
        for c, equation in enumerate(_equations()):
            full = np.zeros((size, size))
            full[np.ix_(*[_at(j, count)] * 2)] = equation
            equations[21 * j + c] = full[rows, columns] * weight
    equations[-1, -1] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    settings.max_iter = 100
    unknowns = len(equations)
    objective = np.zeros(unknowns)
    objective[-1] = -1.0
    solution = clarabel.DefaultSolver(
        csc_matrix((unknowns, unknowns)),
        objective,
        csc_matrix(equations.T),
        matrix[rows, columns] * weight,
        [clarabel.PSDTriangleConeT(size)],
        settings,
    ).solve()
    if not np.all(np.isfinite(solution.x)) or not np.all(np.isfinite(solution.z)):
        raise ArithmeticError(f"the semidefinite program came to no end ({solution.status})")
    relaxed = np.zeros((size, size))
    relaxed[rows, columns] = relaxed[columns, rows] = np.array(solution.z) / weight
    leading = np.linalg.eigh(relaxed)[1][:, -1]
    leading = leading * (np.sign(leading[-1]) or 1.0)
    rotations = nearest_rotation(leading[:-1].reshape(-1, 3, 3))
    return rotations, scale * np.array(solution.x)[:-1].reshape(count, 21)
