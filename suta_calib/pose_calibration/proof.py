"""Whether an answer is the best one: a lower bound that is proven, beside the answer's own cost.

Pivot, registration and hand-eye calibration end in a robust minimum. With the weights held that
it gave to rows and directions, each is a sum of squares that is linear in positions and rotations;
a rotation's error is a chord. Of these `rotation_bound` proves the lowest minimum. The answer's own
cost, descended from there, must come to the answer. What is proven is the first; the second makes
it a statement about the answer.

Hand-eye calibration of many eyes and targets, ``A_i X_e B_i = Z_t``, is one problem of this kind
(Wise et al. 2025, A certifiably correct algorithm for generalized robot-world and hand-eye
calibration, arXiv:2507.23045). Translations are eliminated; covariances of displacements with turns
are held as well as weights, which that paper leaves out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import attempt
from suta_calib.geometry.numbers import rotation_from_vector, skew, vector_from_rotation
from suta_calib.pose_calibration.many_eyes import ManyEyesCalibration
from suta_calib.pose_calibration.optimality import Optimality
from suta_calib.pose_calibration.robot_noise import PairedHandEye
from suta_calib.pose_calibration.robust_answer import RobustAnswer
from suta_calib.pose_calibration.rotation_bound import (
    ROUNDING,
    PoseSquares,
    best_rotations,
    stacked_turns,
)
from suta_calib.pose_calibration.stated_noise import WeighedPoint
from suta_calib.solver.nlp import SAME_COST, RobustNlp
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.solution import Solution
from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.term import Term
from suta_calib.terms.tracked_point import TrackedPoint

# Errors, in units of the problem's extent or rad, that are rounding: a cost of these is none.
NO_ERROR: Final = 1e-9


A = TypeVar("A", bound=RobustAnswer)


def with_proof(answer: A) -> A:
    """The same answer with what is proven of it; that nothing is where the proof fails."""
    failed = list[str]()
    optimality = attempt(
        "proven: that the answer is the best", lambda: _proof(answer), None, failed
    )
    if optimality is None:
        return replace(answer, unjudged=(*answer.unjudged, *failed))
    notes = () if optimality.certified else (optimality.sentence,)
    return replace(answer, optimality=optimality, unjudged=(*answer.unjudged, *notes))


def _proof(answer: RobustAnswer) -> Optimality:
    """Of the term that the answer's solution fitted."""
    solution, length = answer.solution, answer.examination.length if answer.examination else 1.0
    (term,) = solution.problem.terms
    if isinstance(term, FixedPoint):
        return _of_pivot(solution, term, length)
    if isinstance(term, TrackedPoint):
        return _of_points(solution, term, length)
    assert isinstance(term, HandEye)
    vectors = len(term.poses) * len(term.blocks)
    minimum = _of_poses(solution, loop_rows(solution, term), length, vectors, "X and Z")
    shared = isinstance(answer, ManyEyesCalibration) and answer.noise is not None
    return replace(minimum, held="the weights and the hand's errors") if shared else minimum


def _of_poses(
    solution: Solution, rows: Iterable[FloatArray], length: float, vectors: int, what: str
) -> Optimality:
    """Of a problem whose unknowns are poses; of ``vectors`` residuals of three numbers each."""
    poses = solution.x.reshape(-1, 6)
    places, rotations = poses[:, :3], rotation_from_vector(poses[:, 3:])
    problem = PoseSquares.of(rows, len(poses))
    least = vectors * sum(3.0 * (NO_ERROR / s) ** 2 for s in solution.sigmas)
    least /= len(solution.sigmas)
    bound = best_rotations(problem.turning, rotations, least)
    best = problem.placed(bound.rotations)
    answer_cost = problem.cost(rotations, places)
    turned = vector_from_rotation(np.swapaxes(bound.rotations, 1, 2) @ rotations)
    start = np.hstack([best, vector_from_rotation(bound.rotations)]).reshape(-1)
    return Optimality(
        what=what,
        gap=bound.below / max(bound.cost, least),
        answer_gap=max(answer_cost - bound.cost + bound.below, 0.0) / max(answer_cost, least),
        moved=length * _farthest(best - places),
        turned=_farthest(turned),
        reached=leads_to(solution, start),
        method="program" if bound.program else "eigenvalues",
        trouble=bound.trouble,
    )


def _farthest(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


# ── pivot and registration ───────────────────────────────────────────────────────────────────
def _of_pivot(solution: Solution, term: FixedPoint, length: float) -> Optimality:
    """``R_iᵀ (c - p_i) - t`` is linear in all unknowns: the robust cost is convex."""
    R, p = term.poses.at(solution.values)
    names, point = term.places
    back, count = np.swapaxes(R, 1, 2), 1 + len(names)
    rows = np.zeros((len(p), 3, 3 * count + 1))
    rows[:, :, :3] = -np.eye(3)
    for k in range(len(names)):
        rows[point == k, :, 3 + 3 * k : 6 + 3 * k] = back[point == k]
    rows[:, :, -1] = -np.einsum("nij,nj->ni", back, p)
    weighed = _weighed([rows], np.append(solution.x, 1.0), solution, term)
    problem = PoseSquares.of([weighed], count)
    moving, residual = problem.triangle[:, :-1], problem.triangle @ np.append(solution.x, 1.0)
    step = np.linalg.lstsq(moving, residual, ROUNDING)[0]
    least = len(p) * 3.0 * (NO_ERROR / solution.sigmas[0]) ** 2
    lower = float(np.sum((moving @ step) ** 2)) / max(float(residual @ residual), least)
    moved = length * _farthest(step.reshape(-1, 3))
    what = "the tip and the posts"
    return Optimality(what, lower, lower, moved, None, reached=True, method="linear")


def _of_points(solution: Solution, term: TrackedPoint, length: float) -> Optimality:
    """``R a_i + p - b_i`` is linear in R and p; rows may weigh by direction."""
    _, a = term.poses.at(solution.values)
    b = term.poses.samples.position
    assert b is not None
    rows = np.zeros((len(a), 3, 13))
    rows[:, :, :3] = np.eye(3)
    rows[:, :, 3:12] = np.einsum("ij,nk->nijk", np.eye(3), a).reshape(-1, 3, 9)
    rows[:, :, 12] = -b
    if isinstance(term, WeighedPoint):
        rows = term.whitening @ rows
    y = np.concatenate([solution.x[:3], stacked_turns(rotation_from_vector(solution.x[None, 3:]))])
    weighed = _weighed([rows], y, solution, term)
    return _of_poses(solution, [weighed], length, len(a), "rotation and position")


# ── hand-eye ─────────────────────────────────────────────────────────────────────────────────
def loop_rows(solution: Solution, term: HandEye) -> Iterator[FloatArray]:
    """Weighted rows (12n, 12k + 1) of ``A X B - Z``, linear in positions, rotations and one.

    Of every pair three displacements, less what the turns in its residual move the target by, then
    the nine numbers of the rotation's chord. Levers, turns by which they move, and Huber's weights
    are those at the solution.

    Args:
        solution: of the term alone; poses of all eyes, then of all targets.
        term: over the pairs.
    """
    together = term.seen_together
    eye, target = together.eye, together.eyes + together.target
    poses = solution.x.reshape(-1, 6)
    R, p = rotation_from_vector(poses[:, 3:]), poses[:, :3]
    A, samples = term.poses.at(solution.values), term.poses.samples
    assert samples.rotation is not None
    assert samples.position is not None
    B = samples.rotation, samples.position
    lever = term.fractions[:, None] * (B[1] + np.einsum("nji,nj->ni", R[eye], p[eye]))
    lever += np.array(term.lever_in_eye) + B[0] @ term.lever_in_target
    y = np.concatenate([p.reshape(-1), stacked_turns(R)])
    # Rows whose squares are added up at once.
    portion = 1000
    for first in range(0, len(eye), portion):
        rows = slice(first, first + portion)
        pairs = (A[0][rows], A[1][rows]), (B[0][rows], B[1][rows])
        parts = _linear(*pairs, (R, p), eye[rows], target[rows], lever[rows])
        if isinstance(term, PairedHandEye) and term.relative is not None:
            relative = term.relative[rows].T[..., None, None]
            parts = [part / noise for part, noise in zip(parts, relative, strict=True)]
        yield _weighed(parts, y, solution, term)


def _linear(
    A: Poses, B: Poses, poses: Poses, eye: IntArray, target: IntArray, lever: FloatArray
) -> list[FloatArray]:
    """Displacements (n, 3, c), and turns as chords (n, 9, c), linear in y."""
    count, pairs = len(poses[0]), np.arange(len(eye))
    size = 12 * count + 1
    slides, chords = np.zeros((len(eye), 3, size)), np.zeros((len(eye), 9, size))

    def columns(pose: IntArray, first: int, size: int) -> IntArray:
        return first + size * pose[:, None] + np.arange(size)

    def put(rows: FloatArray, at: IntArray, values: FloatArray) -> None:
        rows[pairs[:, None, None], np.arange(rows.shape[1])[:, None], at[:, None, :]] = values

    put(slides, columns(eye, 0, 3), A[0])
    put(slides, columns(target, 0, 3), np.broadcast_to(-np.eye(3), (len(eye), 3, 3)))
    reach = np.einsum("nij,nk->nijk", A[0], B[1]).reshape(-1, 3, 9)
    put(slides, columns(eye, 3 * count, 9), reach)
    slides[:, :, -1] = A[1]
    turning = np.einsum("nij,nlk->nikjl", A[0], B[0]).reshape(-1, 9, 9)
    put(chords, columns(eye, 3 * count, 9), turning)
    put(chords, columns(target, 3 * count, 9), np.broadcast_to(-np.eye(9), (len(eye), 9, 9)))
    # Noise of the hand's turns moves the target, too: turn x lever, in the eye's axes.
    eye_axes, cross = A[0] @ poses[0][eye], -skew(np.eye(3))
    # The chord E in the eye's axes is skew to first order: half its two signs is the turn.
    turn = 0.5 * np.einsum("abc,nmb,ncl->naml", cross, eye_axes, B[0])
    by_turn = np.einsum("nij,jlk,nl,nkmo->nimo", eye_axes, cross, lever, turn).reshape(-1, 3, 9)
    slides -= by_turn @ chords
    return [slides, chords / np.sqrt(2.0)]


def _weighed(parts: list[FloatArray], y: FloatArray, solution: Solution, term: Term) -> FloatArray:
    """Rows of each block (n, d, c) in units of their noise, with Huber's weights at y."""
    minima = []
    for part, sigma, block in zip(parts, solution.sigmas, term.blocks, strict=True):
        size = np.linalg.norm(part @ y, axis=1)
        weight = np.sqrt(np.minimum(1.0, block.noise.huber / np.maximum(size, 1e-300)))
        minima.append((part * (weight / sigma)[:, None, None]).reshape(-1, len(y)))
    return np.vstack(minima)


def leads_to(solution: Solution, start: FloatArray) -> bool:
    """Whether the solution's own cost, descended from a start, ends where the solution is."""
    nlp = RobustNlp(solution.problem, solution.free, solution.sigmas)
    minimum = SolverOptions(confirm=False).build_solver().nearby(nlp, start)
    return minimum is not None and abs(minimum.cost - solution.minimum.cost) <= SAME_COST
