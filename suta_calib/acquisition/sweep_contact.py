"""Whether the tip stayed where it was while the arm was swept: lift-off, and a place that slipped.

The nominal arm puts a tip that rests in one socket to many places, millimetres apart. So the arm
is fitted first: all of its geometry, within what is plausible, by Geman and McClure's loss, which
forgets what is far off, with a scale that shrinks from all of the residuals to their noise
(graduated non-convexity: Black, Rangarajan 1996, doi:10.1007/BF00131148). What is left of a moment
is how far the tip was off its place then.

A slip is a place that is another one from a moment on. Each moment is tried; the best is fitted
with all that the arm may be, and believed if Hotelling's T² over strokes says that it is no chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.acquisition.sweep import Moment
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import OFFSET, POSITION, ParameterSet
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.solver.information import scaled_inverse, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import identify_at
from suta_calib.terms.block import summed
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.setup import Setup
from suta_calib.terms.term import Term

# Residuals are in mm here.
_MM: Final = 1e-3
# Standard deviations of a component: beyond the first the tip is off, and it is off until it is
# within the second. No hand lifts a tip by less than some tenths of a mm; a fit of many unknowns to
# few strokes seems to be off by them.
_OFF: Final = 8.0
_ON: Final = 4.0
LEAST_LIFT: Final = 0.5
# A lift-off begins and ends so much earlier and later than it is seen, s; two within so little are
# one.
_MARGIN: Final = 0.06
_JOINED: Final = 0.3
# Moments that are tried for each slip.
_TRIED: Final = 80


@dataclass(frozen=True)
class LiftOff:
    """A time in which the tip was off its place: s since the first reading, and the farthest, m."""

    begin: float
    end: float
    distance: float


@dataclass(frozen=True)
class Slip:
    """A place that is another one from a moment on: s since the first reading, m, and its ±."""

    time: float
    distance: float
    std: float


@dataclass(frozen=True, eq=False)
class TipContact:
    """What became of the contact.

    Attributes:
        touching: (n,) whether the tip was on its place, of each moment.
        lift_offs, slips: in order.
        scatter: of the tip about its place while it was there, per component, m; what the fitted
            arm lacks is in it.
    """

    touching: BoolArray
    lift_offs: tuple[LiftOff, ...]
    slips: tuple[Slip, ...]
    scatter: float

    def place(self, times: FloatArray) -> IntArray:
        """(n,) number of the place at these times: 0 up to the first slip."""
        starts = [slip.time for slip in self.slips]
        return np.searchsorted(starts, times, side="right").astype(np.intp)


class Surface:
    """What a sweep touches: a place of some kind of observation.

    Args:
        arm: at nominal.
        kind: touches one place without an artefact.
        settings: values of the kind's own keys.
    """

    def __init__(self, arm: ArmModel, kind: type[Term], settings: Mapping[str, Any]) -> None:
        self.arm, self._kind, self._setup = arm, kind, Setup(settings=settings)

    @staticmethod
    def testable(kind: type[Term]) -> bool:
        """Whether readings alone tell whether the tip is on such a place."""
        only_touched = kind.medium == "touch" and bool(kind.place) and not kind.needs_artefact
        measured = bool(kind.columns.numbers) or kind.columns.position
        return only_touched and not measured and not kind.between_chains

    def term(self, q: FloatArray, place: Sequence[str]) -> Term:
        """Touches at readings (n, joints), of places (n,) by label."""
        samples = Samples.from_arrays(self.arm.joints, q, labels={self._kind.place: list(place)})
        return self._kind.over(ArmPoses(self.arm, samples), self._setup)

    def parameters(self) -> ParameterSet:
        """All of the arm's geometry and its offsets."""
        return self.arm.select("geometric", f"*.{OFFSET}")


@dataclass(frozen=True, eq=False)
class _ContactFit:
    """A robust fit: rows of q and their places, parameters x, (n,) weights, and the scatter, mm."""

    problem: Problem
    x: FloatArray
    jacobian: FloatArray
    residual: FloatArray
    weight: FloatArray
    scatter: float

    @property
    def distance(self) -> FloatArray:
        """(n,) of each row from its place, mm."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


def contact(
    surface: Surface, moments: Sequence[Moment], rows: IntArray, strokes: IntArray
) -> TipContact:
    """Whether the tip was on its place at each moment.

    Args:
        surface: what was touched.
        moments: all of the sweep, in order.
        rows: the moments with postures of their own, in order.
        strokes: (rows,) the stroke of each.

    Raises:
        SamplesError: too few postures to tell, or a tip that did not stay on any place.
    """
    # Rows that are fitted at least.
    fewest = 40
    if len(rows) < fewest:
        raise SamplesError(
            f"{len(rows)} postures", f"{fewest}, to tell a lift-off from an error of the arm"
        )
    # So many rows are fitted at most, evenly spaced.
    thinned = np.unique(np.linspace(0, len(rows) - 1, min(1200, len(rows))).astype(np.intp))
    rows, strokes = rows[thinned], strokes[thinned]
    q = np.array([moments[k].angles for k in rows])
    times = np.array([moments[k].time for k in rows])
    starts, fit = _places(surface, q, strokes)
    # Scatter beyond which the tip was in no socket, whatever the arm is, mm.
    if fit.scatter > 3.0:
        raise SamplesError(
            f"a tip that scatters by {fit.scatter:.1f} mm about its place",
            "a tip that stays on it",
            hint="is the tip in its socket, and are the joints' zeros and signs right?",
        )
    all_times = np.array([moment.time for moment in moments])
    # The first posture at the new place is the first that is known to be there.
    began = tuple(Slip(float(times[k]), d * _MM, std * _MM) for k, (d, std) in starts.items())
    contact = TipContact(np.ones(0, dtype=np.bool_), (), began, fit.scatter * _MM)
    off = _distances(surface, fit, moments, contact.place(all_times))
    lifted = [*_lift_offs(all_times, off, max(fit.scatter, LEAST_LIFT / _OFF))]
    touching = np.ones(len(moments), dtype=np.bool_)
    for first, last in lifted:
        touching[first : last + 1] = False
    # What is shorter is a wrong reading and no motion of a hand.
    lift_offs = tuple(
        LiftOff(float(all_times[a]), float(all_times[b]), float(off[a : b + 1].max()) * _MM)
        for a, b in lifted
        if all_times[b] - all_times[a] - 2 * _MARGIN > 0.03
        and not any(_is_slip(slip, all_times[a], all_times[b], off[a : b + 1]) for slip in began)
    )
    return TipContact(touching, lift_offs, began, fit.scatter * _MM)


def _is_slip(slip: Slip, begin: float, end: float, off: FloatArray) -> bool:
    """Whether a tip that is off from ``begin`` to ``end`` is on its way to the other place."""
    near = begin - _JOINED < slip.time < end + _JOINED
    return bool(near and off.max() * _MM < 1.5 * slip.distance)


class Telling:
    """What postures on a place tell of an arm.

    Args:
        surface: the place.
        unknowns: of the arm.
    """

    def __init__(self, surface: Surface, unknowns: ParameterSet) -> None:
        self._surface, self._unknowns = surface, unknowns
        self._kinematics = InverseKinematics(surface.arm, {})
        self._never: set[str] | None = None

    def untold(self, q: FloatArray) -> tuple[str, ...]:
        """Unknowns that postures (n, joints) leave open, though others on this place tell them."""
        # Postures that are enough to see what they tell.
        thinned = q[np.unique(np.linspace(0, len(q) - 1, min(120, len(q))).astype(np.intp))]
        if self._never is None:
            self._never = self._open(thinned, starts=20)
        still = self._open(thinned, starts=0)
        return tuple(n for n in self._unknowns.names if n in still and n not in self._never)

    def _open(self, q: FloatArray, starts: int) -> set[str]:
        """What is left open by an arm as nominal that is near these postures, or anywhere else."""
        term = self._surface.term(q, _names(np.zeros(len(q), dtype=np.intp)))
        values = {p.name: p.nominal for p in self._surface.arm.parameters.values()}
        there = term.observed(values | term.start_values({}), term.poses).place
        rng = np.random.default_rng(0)
        begin = self._kinematics.random_readings(rng, len(q)) if starts else q
        targets = Targets(there, np.tile(np.eye(3), (len(q), 1, 1)), "position")
        solved = self._kinematics.solve(targets, begin, rng, max(starts, 1))
        on = solved.q[solved.reached]
        if len(on) < len(q) / 2:
            return set()
        touching = self._surface.term(on, _names(np.zeros(len(on), dtype=np.intp)))
        problem = Problem([touching], self._unknowns)
        open_ = identify_at(problem, problem.start(), problem.assumed_sigmas()).fixed
        return {problem.names[k] for k in open_}


def _names(place: IntArray) -> list[str]:
    return [f"place {k}" for k in place]


def _fitted(
    surface: Surface,
    q: FloatArray,
    place: IntArray,
    strokes: IntArray,
    like: _ContactFit | None = None,
) -> _ContactFit:
    """The arm and the places, with moments that are far off forgotten."""
    # Rows of one stroke err together: against what is known beforehand they count once.
    shared = len(q) / len(np.unique(strokes))
    problem = Problem([surface.term(q, _names(place))], surface.parameters())
    precision, nominal = _precision(problem), problem.start()
    unit = np.array([_plausible(p.key, p.plausible) for p in problem.parameters.values()])
    x = nominal.copy()
    if like is not None:
        x = problem.start(like.problem.values(like.x))
    limit = np.inf
    scatter = np.inf
    for _ in range(40):
        ((rows),) = whitened_rows(problem, x, [_MM])
        residual, jacobian = rows.line.residual / _MM, rows.jacobian
        size = residual.shape[1]
        distance = np.linalg.norm(residual, axis=1)
        before, scatter = scatter, _scatter(distance, size)
        # As wide as all residuals first, then narrower by a third each time, down to their noise.
        widest = float(distance.max(initial=0.0))
        limit = max(min(limit, 2.0 * widest) / 1.5, _ON * max(scatter, 1e-4))
        weight = (1.0 + (distance / limit) ** 2) ** -2.0
        weighted = jacobian * np.repeat(weight, size)[:, None]
        information = weighted.T @ jacobian / (shared * scatter**2) + precision
        slope = weighted.T @ residual.ravel() / (shared * scatter**2) + precision @ (x - nominal)
        step = -scaled_inverse(information) @ slope
        x = x + step
        narrowest = limit <= 1.01 * _ON * max(scatter, 1e-4)
        if (
            narrowest
            and abs(before - scatter) < 1e-3 * scatter
            and np.all(np.abs(step) < 1e-2 * unit)
        ):
            break
    ((rows),) = whitened_rows(problem, x, [_MM])
    residual = rows.line.residual / _MM
    distance = np.linalg.norm(residual, axis=1)
    weight = (1.0 + (distance / limit) ** 2) ** -2.0
    return _ContactFit(
        problem, x, rows.jacobian, residual, weight, _scatter(distance, residual.shape[1])
    )


def _precision(problem: Problem) -> FloatArray:
    """(n, n) what is known of the arm's parameters beforehand; nothing is of the places.

    Places tell no scale, and a smaller arm is nearer to all of them: its size stays nominal.
    """
    parameters = list(problem.parameters.values())
    variance = np.array([_plausible(p.key, p.plausible) for p in parameters]) ** 2
    weight = 1.0 / variance
    weight[problem.arm_count :] = 0.0
    lengths = np.array([p.nominal if p.key in POSITION else 0.0 for p in parameters])
    lengths[problem.arm_count :] = 0.0
    # Standard deviation of the arm's size about nominal, of 1.
    of_size = lengths / max(float(lengths @ lengths), 1e-12) / 1e-3
    return np.asarray(np.diag(weight) + np.outer(of_size, of_size))


def _plausible(key: str, plausible: float) -> float:
    """Standard deviation of what is left open of a parameter, m or rad.

    Encoders are set by eye; links are made to a tenth of what a search may look for.
    """
    return plausible if key == OFFSET else plausible / 10.0


def _scatter(distance: FloatArray, size: int) -> float:
    """Standard deviation of one component by the median of the distances (n,), mm."""
    # Medians of the chi distribution with 1, 2 and 3 degrees of freedom.
    median = {1: 0.6745, 2: 1.1774, 3: 1.5382}
    return max(float(np.median(distance)) / median[size], 1e-6)


def _places(
    surface: Surface, q: FloatArray, strokes: IntArray
) -> tuple[dict[int, tuple[float, float]], _ContactFit]:
    """The rows at which a place became another one, with its shift and its ±, mm; and the fit."""
    starts = list[int]()
    fit = _fitted(surface, q, _numbers(starts, len(q)), strokes)
    # Slips that are looked for at most.
    while len(starts) < 4:
        start, after = _slipped(surface, fit, q, starts, strokes)
        if start is None:
            break
        starts, fit = sorted([*starts, start]), after
    # What seemed to be a slip need not be one any more where another one is known.
    while True:
        shifts = [_moved(fit, k, _numbers(starts, len(q)), strokes) for k in range(len(starts))]
        if None not in shifts:
            break
        del starts[shifts.index(None)]
        fit = _fitted(surface, q, _numbers(starts, len(q)), strokes, fit)
    return {k: shift for k, shift in zip(starts, shifts, strict=True) if shift is not None}, fit


def _numbers(starts: Sequence[int], count: int) -> IntArray:
    """(count,) number of the place that each row is at."""
    return np.searchsorted(starts, np.arange(count), side="right").astype(np.intp)


def _slipped(
    surface: Surface, fit: _ContactFit, q: FloatArray, starts: Sequence[int], strokes: IntArray
) -> tuple[int | None, _ContactFit]:
    """The likeliest row from which on a place is another one, if one is likely, and the refit."""
    place, row = _numbers(starts, len(q)), np.arange(len(q))

    def gain(start: int) -> float:
        return _gain(fit, (row >= start) & (place == place[start]))

    # Rows before and after a slip.
    side = 8
    tries = np.unique(np.linspace(side, len(q) - side, _TRIED).astype(np.intp))
    gains = [gain(int(start)) for start in tries]
    coarse, step = int(tries[int(np.argmax(gains))]), int(np.diff(tries).max(initial=1))
    near = range(max(side, coarse - step), min(len(q) - side, coarse + step) + 1)
    start = max(near, key=gain)
    if gain(start) <= 0.0:
        return None, fit
    # With both places known it is known better when the one became the other.
    for _ in range(2):
        new = _numbers(sorted([*starts, start]), len(q))
        number = int(new[start]) - 1
        if min(np.sum(new == number), np.sum(new == number + 1)) < side:
            return None, fit
        refit = _fitted(surface, q, new, strokes, fit)
        before, start = start, _boundary(refit, number, new)
        if start == before:
            break
    moved = _moved(refit, number, new, strokes)
    return (None, fit) if moved is None else (before, refit)


def _moved(
    fit: _ContactFit, number: int, place: IntArray, strokes: IntArray
) -> tuple[float, float] | None:
    """How far the place after one is from it, and its ±, mm; None if that may be chance."""
    sides = [place == number, place == number + 1]
    distance, t2, k = _shift(fit, number, sides[0] | sides[1], strokes)
    # The slip must be this many times the scatter of the tip: the arm that is fitted lacks
    # something, and seems to change where a sweep goes on elsewhere.
    if distance < 3.0 * fit.scatter:
        return None
    there = all(np.mean(fit.distance[side] < _OFF * fit.scatter) > 0.5 for side in sides)
    # Where few strokes tell, their scatter is not known: then it must be seen with the naked eye.
    plain = distance > max(2.0 * _OFF * fit.scatter, LEAST_LIFT)
    count = 2 * min(len(np.unique(strokes[side])) for side in sides)
    chance = 1.0
    if count > k + 1:
        chance = float(fdtrc(k, count - k, t2 * (count - k) / (k * (count - 1.0))))
    # One sound sweep of a thousand seems to have slipped.
    if not there or (chance * _TRIED > 1e-3 and not plain):
        return None
    return distance, distance / float(np.sqrt(t2))


def _boundary(fit: _ContactFit, number: int, place: IntArray) -> int:
    """The row from which on rows are rather at the second of two places."""
    sides = [place == number, place == number + 1]
    at = [_own(fit, number), _own(fit, number + 1)]
    jacobian = fit.jacobian.reshape(len(fit.residual), fit.residual.shape[1], -1)
    shift = fit.x[at[1]] - fit.x[at[0]]
    here = [fit.residual.copy(), fit.residual.copy()]
    here[0][sides[1]] -= jacobian[sides[1]][:, :, at[1]] @ shift
    here[1][sides[0]] += jacobian[sides[0]][:, :, at[0]] @ shift
    rows = np.flatnonzero(sides[0] | sides[1])
    cost = [_cost(residual[rows], fit.scatter) for residual in here]
    both = np.append(0.0, np.cumsum(cost[0])) + np.append(np.cumsum(cost[1][::-1])[::-1], 0.0)
    return int(rows[min(int(np.argmin(both)), len(rows) - 1)])


def _cost(residual: FloatArray, scatter: float) -> FloatArray:
    """(n,) of residuals (n, d), in mm; as far as a tip is off, it is off."""
    return np.asarray(np.minimum(np.sum(residual**2, axis=1) / scatter**2, _OFF**2))


def _own(fit: _ContactFit, number: int) -> list[int]:
    """Where the unknowns of one place are."""
    return [
        k
        for k, name in enumerate(fit.problem.names)
        if name.partition("]")[0].endswith(f"place {number}")
    ]


def _gain(fit: _ContactFit, later: BoolArray) -> float:
    """By how much the cost falls if later rows are at a new place; each row's cost is cut off."""
    size = fit.residual.shape[1]
    residual = fit.residual[later]
    if len(residual) < 6:
        return 0.0
    jacobian = fit.jacobian.reshape(len(fit.residual), size, -1)[later]
    columns = np.flatnonzero(np.any(jacobian[:, :, fit.problem.arm_count :], axis=(0, 1)))
    slopes = jacobian[:, :, fit.problem.arm_count + columns]
    limit = 2.0 * float(np.linalg.norm(residual, axis=1).max())
    shift = np.zeros(slopes.shape[2])
    for _ in range(15):
        left = residual + slopes @ shift
        limit = max(limit / 1.8, _ON * fit.scatter)
        weight = (1.0 + np.sum(left**2, axis=1) / limit**2) ** -2.0
        normal = np.einsum("n,nij,nik->jk", weight, slopes, slopes)
        shift = shift - scaled_inverse(normal) @ np.einsum("n,nij,ni->j", weight, slopes, left)
    fallen = _cost(residual, fit.scatter) - _cost(residual + slopes @ shift, fit.scatter)
    return float(np.sum(fallen))


def _shift(
    fit: _ContactFit, number: int, rows: BoolArray, strokes: IntArray
) -> tuple[float, float, int]:
    """From one place to the next: how far at the tip, mm, T² by strokes, and of how many unknowns.

    ``rows`` (n,) are at one of the two.
    """
    size = fit.residual.shape[1]
    weighted = fit.jacobian * np.repeat(fit.weight, size)[:, None]
    shared = len(rows) / len(np.unique(strokes))
    prior = shared * fit.scatter**2 * _precision(fit.problem)
    bread = scaled_inverse(weighted.T @ fit.jacobian + prior)
    cluster = np.unique(strokes, return_inverse=True)[1]
    count = int(cluster.max()) + 1
    scores = summed(weighted * fit.residual.reshape(-1, 1), np.repeat(cluster, size), count)
    covariance = count / max(count - 1, 1) * bread @ (scores.T @ scores) @ bread
    before, after = _own(fit, number), _own(fit, number + 1)
    shift = fit.x[after] - fit.x[before]
    of_shift = (
        sum(
            sign * covariance[np.ix_(a, b)]
            for sign, a, b in ((1, after, after), (1, before, before), (-1, after, before))
        )
        - covariance[np.ix_(before, after)]
    )
    by_row = fit.jacobian.reshape(len(rows), size, -1)[rows]
    # Of each row one of the two has derivatives.
    at_tip = (by_row[:, :, before] + by_row[:, :, after]) @ shift
    distance = float(np.sqrt(np.mean(np.sum(at_tip**2, axis=1))))
    return distance, float(shift @ scaled_inverse(of_shift) @ shift), len(shift)


def _distances(
    surface: Surface, fit: _ContactFit, moments: Sequence[Moment], place: IntArray
) -> FloatArray:
    """(moments,) of the tip from its place, mm."""
    off = np.empty(len(moments))
    values = fit.problem.values(fit.x)
    at_once = 4000
    for first in range(0, len(moments), at_once):
        part = slice(first, first + at_once)
        q = np.array([moment.angles for moment in moments[part]])
        problem = Problem([surface.term(q, _names(place[part]))], fit.problem.arm_parameters)
        x = np.array([values[name] for name in problem.names])
        ((line),) = problem.linearise(x, [_MM])
        off[part] = np.linalg.norm(line.residual, axis=1) / _MM
    return off


def _lift_offs(times: FloatArray, off: FloatArray, scatter: float) -> Iterator[tuple[int, int]]:
    """First and last moment of each time in which the tip was off, with the margin."""
    beyond, within = off > _OFF * scatter, off < _ON * scatter
    ends = list[tuple[int, int]]()
    k = 0
    while k < len(off):
        if not beyond[k]:
            k += 1
            continue
        first = last = k
        while first > 0 and not within[first - 1]:
            first -= 1
        while last + 1 < len(off) and not within[last + 1]:
            last += 1
        first = int(np.searchsorted(times, times[first] - _MARGIN))
        last = int(np.searchsorted(times, times[last] + _MARGIN, side="right")) - 1
        if ends and times[first] - times[ends[-1][1]] < _JOINED:
            ends[-1] = ends[-1][0], last
        else:
            ends.append((first, last))
        k = last + 1
    yield from ends
