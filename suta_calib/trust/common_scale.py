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
from scipy.special import ndtri, stdtr

from suta_calib.arrays import FloatArray
from suta_calib.measurements.scale import GRADES
from suta_calib.model.parameters import POSITION
from suta_calib.solver.held_geometry import TOLERANCES
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.length_scale import lengthened, scale_carrier, scale_carriers
from suta_calib.trust.linear_fit import LinearFit

# Step of the numerical derivative, relative.
STEP: Final = 1e-6
# Lengths of an arm shorter than that are no measure of its size, m.
SHORTEST: Final = 0.02
# Part of a factor by which lengths follow what they have their scale from: of less, drawings or
# priors have the larger part.
FOLLOWS: Final = 0.25


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
        """Its size in standard deviations."""
        return abs(self.value) / self.std


def common_scales(solution: Solution) -> Iterator[CommonScale]:
    """The estimate of every factor that the data determine."""
    # Standard deviation from which on the data do not tell a factor: were every length 0, there
    # would be no residuals, and that much information they pretend.
    if determined := [step for step in _steps(solution) if step.std < 0.01]:
        yield from determined
    else:
        yield from _grown(solution)


def relied_on(solution: Solution) -> list[tuple[object, ...]]:
    """The source of the scale of the arm's lengths, and its name.

    If all lengths of it were longer by one factor, the arm's would come out longer by `FOLLOWS` of
    that or more.
    """
    at, length, _ = _lengths(solution, SHORTEST)
    return [
        carrier
        for carrier, shift in solution.spread.by_scale.items()
        if length @ shift[at] > FOLLOWS * (length @ length)
    ]


def _steps(solution: Solution) -> Iterator[CommonScale]:
    """The factor of every kind of length, whether the data determine it or not."""
    fit = _fit(solution)
    carriers = [scale_carrier(term) for term in solution.problem.terms]
    for what in ("artefact", "instrument", "board"):
        if any(mine := [c is not None and c.what == what for c in carriers]):
            yield _step(solution, fit, what, mine)


def _noise(solution: Solution) -> list[float]:
    return [max(level, 1e-9) for level in solution.noise]


def _fit(solution: Solution) -> LinearFit:
    """The fit with priors as the job gives them: those that were learned have made room already."""
    problem, x, free = solution.problem, solution.x, solution.free
    rows = whitened_rows(problem, x, _noise(solution))
    # Distances share touches, and what stands or is read twice says it once.
    shares = [
        term.equations() / sum(len(b) * b.size for b in term.blocks)
        for term in problem.terms
        for _ in term.blocks
    ]
    repeated = [np.full(r.line.residual.size, s) for r, s in zip(rows, shares, strict=True)]
    prior = problem.as_given().prior_precision()
    fit = LinearFit.of_rows(rows, prior, x - problem.parameters.array("nominal"))
    return replace(fit.only(free), weight=np.concatenate(repeated) * fit.weights)


def _step(solution: Solution, fit: LinearFit, what: str, mine: Sequence[bool]) -> CommonScale:
    """The factor on the lengths of ``mine`` among the terms, everything else following."""
    problem, x, noise = solution.problem, solution.x, _noise(solution)
    longer = [
        lengthened(term, np.full(3, 1.0 + STEP)) if its_lengths else term
        for term, its_lengths in zip(problem.terms, mine, strict=True)
    ]
    moved = Problem(longer, problem.arm_parameters).linearise(x, noise)
    whitened = np.concatenate([(r.residual / r.sigma[:, None]).ravel() for r in moved])
    column = (whitened - fit.residual)[:, None] / STEP
    # Nothing determines a factor that the others imitate up to rounding.
    rounding = 1e-13 * float(fit.weights @ column[:, 0] ** 2)
    information = max(float(fit.curvature(column)[0, 0]), rounding, 1e-300)
    # What must be made longer is stated too short.
    value = float(np.sum(fit.scores(column, fit.settled))) / information
    step = fit.step - value * fit.moves(column)[:, 0]
    pulled, left = (float(fit.prior @ d**2) for d in (fit.away, fit.away + step))
    of_priors = (pulled - left) / max(pulled, 1.0)
    lowered = value**2 * information
    of_residuals = lowered / float(fit.weights @ fit.residual**2)
    gain, by_priors = max(of_priors, of_residuals), of_priors > of_residuals
    alone = _one_alone(fit)
    rival = None
    if by_priors and alone is not None and alone[1] > lowered:
        rival = problem.names[solution.free[alone[0]]], alone[2]
    std = 1.0 / math.sqrt(information)
    return CommonScale(what, value, std, gain, by_priors, rival)


def _one_alone(fit: LinearFit) -> tuple[int, float, float] | None:
    """The parameter that its prior holds back most (leave one prior out).

    Returns:
        Its number, by how much twice the cost falls without its prior, and how far off it is then;
        None without a prior.
    """
    if not np.any(fit.prior > 0):
        return None
    pulled = fit.away + fit.step
    free = np.maximum(1.0 - fit.prior * np.diag(fit.inverse), 1e-9)
    lowered = fit.prior * pulled**2 / free
    worst = int(np.argmax(lowered))
    return worst, float(lowered[worst]), float(pulled[worst] / free[worst])


def beyond_drawing(solution: Solution) -> CommonScale | None:
    """The factor by which the estimated arm is longer than the tolerance of its grade allows.

    Each length is off by the tolerance of the grade and by its own uncertainty. Where nobody states
    a grade, that of the worst.

    Returns:
        The factor; its standard deviation holds how far the grade, and what carries the scale, may
        be off by one factor. None where fewer than two lengths were estimated.
    """
    arm = solution.problem.arm
    at, length, change = _lengths(solution, SHORTEST)
    if arm is None or len(length) < 2:
        return None
    grade = arm.grade or max(GRADES, key=lambda name: GRADES[name])
    spread = solution.covariance_within_scale[np.ix_(at, at)]
    inverse = np.linalg.inv(spread + TOLERANCES[grade][0] ** 2 * np.eye(len(at)))
    precision = float(length @ inverse @ length)
    value = float(length @ inverse @ change) / precision
    left = change - value * length
    gain = 1.0 - float(left @ inverse @ left) / max(float(change @ inverse @ change), 1e-300)
    std = math.sqrt(1.0 / precision + GRADES[grade] ** 2 + _carried(solution) ** 2)
    return CommonScale("arm", value, std, gain)


def _lengths(solution: Solution, least: float) -> tuple[list[int], FloatArray, FloatArray]:
    """Numbers of the arm's lengths that were estimated, their nominal values, and their changes."""
    lengths = {
        name: e
        for name, e in solution.arm_estimates.items()
        if e.std and name.rpartition(".")[2] in POSITION and abs(e.nominal) > least
    }
    at = [solution.problem.names.index(name) for name in lengths]
    length = np.array([e.nominal for e in lengths.values()])
    return at, length, np.array([e.value - e.nominal for e in lengths.values()])


def _grown(solution: Solution) -> Iterator[CommonScale]:
    """The common factor of the arm's estimated lengths."""
    # Touches of points, lines and planes measure no length: there a held length of the drawing
    # carries the scale, and that the others grow with its error is no sign of another arm.
    if not list(scale_carriers(solution.problem.terms)):
        return
    at, length, change = _lengths(solution, -1.0)
    # One length alone has no evenness.
    if np.sum(np.abs(length) > SHORTEST) >= 2:
        grown = grown_together(length, change, solution.covariance_within_scale[np.ix_(at, at)])
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
