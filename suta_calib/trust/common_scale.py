"""Are all lengths of an artefact, or of an instrument, too long by one factor?

A step of Gauss and Newton from the solution with one more unknown, the factor 1 + s on every
certified or measured length, in which the arm and all else may follow as far as their priors let
them. Where every length of the arm is free, the factor and the arm's size are one and the same to
the data: then the estimated lengths must not all have grown by one factor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri, stdtr

from suta_calib.arrays import FloatArray
from suta_calib.measurements.scale import GRADES
from suta_calib.model.parameters import POSITION
from suta_calib.solver.held_geometry import TOLERANCES
from suta_calib.solver.information import robust_jacobian, scaled_inverse, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Estimate, Solution
from suta_calib.terms.length_scale import lengthened, scale_carrier, scale_carriers

# Step of the numerical derivative, relative.
STEP: Final = 1e-6
# Lengths of an arm shorter than that are no measure of its size, m.
SHORTEST: Final = 0.02
# Part of a factor by which lengths follow what they have their scale from: of less, drawings or
# priors have the larger part.
FOLLOWS: Final = 0.25
# One length alone has no evenness.
FEWEST: Final = 2


@dataclass(frozen=True)
class CommonScale:
    """A factor on all lengths of one sort.

    Attributes:
        what: whose lengths they are: ``artefact``, ``instrument``, ``board``, ``arm``.
        value: s, by which they are too long (the arm's: by which it came out too long).
        std: standard deviation of it.
        gain: share that it explains: of the priors' squared pulls or of the squared residuals,
            whichever is more; or of the arm's squared changes.
        by_priors: whether it is the priors' pulls of which it explains more. They cannot tell an
            instrument that is too long from an arm that is.
        one_alone: the parameter of the arm that explains as much by being off alone, and by how
            much it then is, m or rad; None where there is none.
    """

    what: str
    value: float
    std: float
    gain: float
    by_priors: bool = False
    one_alone: tuple[str, float] | None = None

    @property
    def significance(self) -> float:
        """Standard deviations that it is off."""
        return abs(self.value) / self.std


def common_scales(solution: Solution) -> Iterator[CommonScale]:
    """What the data tell of every factor; nothing where they tell none.

    Args:
        solution: a converged one, of terms over an arm.
    """
    # Standard deviation from which on the data do not tell a factor: were every length 0, there
    # would be no residuals, and that much information they pretend.
    if determined := [step for step in _steps(solution) if step.std < 0.01]:
        yield from determined
    else:
        yield from _grown(solution)


def relied_on(solution: Solution) -> list[tuple[object, ...]]:
    """What the arm's lengths have their scale from, and its name.

    If all lengths of it were longer by one factor, the arm's would come out longer by `FOLLOWS` of
    that or more.

    Args:
        solution: as for `common_scales`.
    """
    names = solution.problem.names
    long = {n: e.nominal for n, e in _lengths(solution).items() if abs(e.nominal) > SHORTEST}
    at, length = [names.index(n) for n in long], np.array(list(long.values()))
    if not at:
        return []
    return [
        carrier
        for carrier, shift in solution.spread.by_scale.items()
        if length @ shift[at] > FOLLOWS * (length @ length)
    ]


def _steps(solution: Solution) -> tuple[CommonScale, ...]:
    """The factor of every sort of lengths that there is, told or not."""
    carriers = [scale_carrier(term) for term in solution.problem.terms]
    return tuple(
        scale_step(solution, what, mine)
        for what in ("artefact", "instrument", "board")
        if any(mine := [c is not None and c.what == what for c in carriers])
    )


def scale_step(
    solution: Solution, what: str, mine: Sequence[bool], axes: ArrayLike = (1.0, 1.0, 1.0)
) -> CommonScale:
    """The factor on the lengths of ``mine`` among the terms, everything else following.

    Args:
        solution: about which the step is taken, of terms over an arm.
        what: whose lengths they are.
        mine: which of the terms have them.
        axes: (3,) how much of the factor measured positions have along each of their axes.
    """
    problem, x = solution.problem, solution.x
    noise = [max(n, 1e-9) for n in solution.noise]
    factors = 1.0 + STEP * np.asarray(axes)
    longer = [lengthened(t, factors) if m else t for t, m in zip(problem.terms, mine, strict=True)]
    moved = [r.residual.copy() for r in Problem(longer, problem.arm_parameters).linearise(x, noise)]
    free = solution.free
    curvature = np.zeros((len(free) + 1,) * 2)
    gradient, squares = np.zeros(len(free) + 1), 0.0
    # Distances share touches, and what stands or is read twice says it once.
    shares = [
        term.equations() / sum(len(b) * b.size for b in term.blocks)
        for term in problem.terms
        for _ in term.blocks
    ]
    for rows, after, share in zip(whitened_rows(problem, x, noise), moved, shares, strict=True):
        line = rows.line
        by_scale = ((after - line.residual) / STEP / line.sigma[:, None]).reshape(-1, 1)
        wide = replace(rows, jacobian=np.hstack([rows.jacobian[:, free], by_scale]))
        believed = robust_jacobian(wide)
        curvature += share * believed.T @ believed
        score = (line.residual * (line.weight / line.sigma)[:, None]).reshape(-1)
        gradient += share * wide.jacobian.T @ score
        squared = line.weight[:, None] * (line.residual / line.sigma[:, None]) ** 2
        squares += share * float(np.sum(squared))
    # As the job gives them: priors that were learned have made room for the factor already.
    precision = problem.as_given().prior_precision()[free]
    off = (x - problem.parameters.array("nominal"))[free]
    curvature[:-1, :-1] += np.diag(precision)
    gradient[:-1] += precision * off
    scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    inverse = np.linalg.pinv(curvature / np.outer(scale, scale), 1e-13, True)
    inverse /= np.outer(scale, scale)
    step = -inverse @ gradient
    # What must be made longer is stated too short.
    value, variance = -float(step[-1]), float(inverse[-1, -1])
    pulled, left = (float(precision @ d**2) for d in (off, off + step[:-1]))
    of_priors = (pulled - left) / max(pulled, 1.0)
    of_residuals = value**2 / variance / squares
    gain, by_priors = max(of_priors, of_residuals), of_priors > of_residuals
    alone = _one_alone(curvature[:-1, :-1], gradient[:-1], precision, off)
    rival = None
    if by_priors and alone is not None and alone[1] > value**2 / variance:
        rival = problem.names[free[alone[0]]], alone[2]
    return CommonScale(what, value, math.sqrt(variance), gain, by_priors, rival)


def _one_alone(
    curvature: FloatArray, gradient: FloatArray, precision: FloatArray, off: FloatArray
) -> tuple[int, float, float] | None:
    """The parameter that its prior holds back most (leave one prior out).

    Args:
        curvature: (n, n) of half the cost with all priors.
        gradient: (n,) of it.
        precision: (n,) of the priors.
        off: (n,) how far the parameters are from their priors' means.

    Returns:
        Its number, by how much twice the cost falls without its prior, and how far off it is then;
        None without a prior.
    """
    if not np.any(precision > 0):
        return None
    inverse = scaled_inverse(curvature)
    pulled = off - inverse @ gradient
    free = np.maximum(1.0 - precision * np.diag(inverse), 1e-9)
    lowered = precision * pulled**2 / free
    worst = int(np.argmax(lowered))
    return worst, float(lowered[worst]), float(pulled[worst] / free[worst])


def beyond_drawing(solution: Solution) -> CommonScale | None:
    """The factor by which an arm came out longer than a drawing of its grade lets it be.

    Each length is off by the tolerance of the grade and by its own uncertainty. Where nobody states
    a grade, that of the worst.

    Args:
        solution: a converged one, of terms over an arm.

    Returns:
        The factor; its standard deviation holds how far the grade, and what carries the scale, may
        be off by one factor. None where fewer than two lengths were estimated.
    """
    problem, arm = solution.problem, solution.problem.arm
    long = {n: e for n, e in _lengths(solution).items() if abs(e.nominal) > SHORTEST}
    if arm is None or len(long) < FEWEST:
        return None
    grade = arm.grade or max(GRADES, key=lambda name: GRADES[name])
    at = [problem.names.index(name) for name in long]
    length = np.array([e.nominal for e in long.values()])
    change = np.array([e.value - e.nominal for e in long.values()])
    spread = solution.covariance_within_scale[np.ix_(at, at)]
    inverse = np.linalg.inv(spread + TOLERANCES[grade][0] ** 2 * np.eye(len(at)))
    precision = float(length @ inverse @ length)
    value = float(length @ inverse @ change) / precision
    left = change - value * length
    gain = 1.0 - float(left @ inverse @ left) / max(float(change @ inverse @ change), 1e-300)
    std = math.sqrt(1.0 / precision + GRADES[grade] ** 2 + _carried(solution) ** 2)
    return CommonScale("arm", value, std, gain)


def _lengths(solution: Solution) -> dict[str, Estimate]:
    """The arm's lengths that were estimated, by name."""
    estimates = solution.arm_estimates.items()
    return {n: e for n, e in estimates if e.std and n.rpartition(".")[2] in POSITION}


def _grown(solution: Solution) -> Iterator[CommonScale]:
    """How the arm's estimated lengths have grown together."""
    # Touches of points, lines and planes measure no length: there a held length of the drawing
    # carries the scale, and that the others grow with its error is no sign of another arm.
    if not list(scale_carriers(solution.problem.terms)):
        return
    lengths = _lengths(solution)
    length = np.array([e.nominal for e in lengths.values()])
    if np.sum(np.abs(length) > SHORTEST) >= FEWEST:
        at = [solution.problem.names.index(name) for name in lengths]
        change = np.array([e.value - e.nominal for e in lengths.values()])
        within = solution.covariance_within_scale[np.ix_(at, at)]
        grown = grown_together(length, change, within)
        # As far as what carries the scale may be off, that is no news.
        # Standard deviations of a stated scale by which it may be off.
        if abs(grown.value) > 3.0 * _carried(solution):
            yield grown


def _carried(solution: Solution) -> float:
    """Standard deviation of the worst scale that the observations have, a ratio."""
    return max((c.scale.std for c in scale_carriers(solution.problem.terms)), default=0.0)


def grown_together(length: FloatArray, change: FloatArray, covariance: FloatArray) -> CommonScale:
    """A factor on all lengths of an arm, judged by how unevenly they have changed.

    Changes scatter by their covariance, and by how far lengths are off by nature, of which those
    that are 0 in the drawing tell as much as long ones: random effects, with the scatter by
    restricted likelihood, and Student's t for its few degrees of freedom.

    Args:
        length: (n,) of the nominal arm, two or more of them, m.
        change: (n,) by which they came out longer, m.
        covariance: (n, n) of what came out, m².

    Returns:
        The factor, its standard deviation such that their ratio has the chance of Student's t.
    """
    # By how much lengths are off by nature: no less, m, and so many values are tried.
    finest = 1e-6
    scatters = 60
    spread, axes = np.linalg.eigh(covariance)
    along, changed = length @ axes, change @ axes
    # (scatters, n): what each may be off by beside its own covariance.
    scatter = np.geomspace(finest, float(np.linalg.norm(change)) + finest, scatters)
    variances = np.maximum(spread, 0.0) + scatter[:, None] ** 2
    sizes = np.sum(along**2 / variances, axis=1)
    values = np.sum(along * changed / variances, axis=1) / sizes
    lefts = np.sum((changed - values[:, None] * along) ** 2 / variances, axis=1)
    likeliest = int(np.argmin(np.sum(np.log(variances), axis=1) + np.log(sizes) + lefts))
    value, variance, left = (float(v[likeliest]) for v in (values, 1.0 / sizes, lefts))
    freedom = len(length) - 1
    ratio = abs(value) / math.sqrt(variance * max(left / freedom, 1.0))
    # As many standard deviations of normal noise have the same chance.
    chance = max(stdtr(freedom, -ratio), 1e-300)
    off = max(float(-ndtri(chance)), 1e-9)
    unexplained = float(np.sum((change - value * length) ** 2))
    unexplained /= max(float(change @ change), 1e-300)
    return CommonScale("arm", value, abs(value) / off, 1.0 - unexplained)
