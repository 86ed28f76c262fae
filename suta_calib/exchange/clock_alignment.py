"""The shift and the drift between the clocks of two recordings of one motion.

Two bodies that are rigidly connected, each followed in a frame of its own, turn by the same angle
and travel equally far along the axis of their screw, whatever the frames are (Chen, "A screw motion
approach to uniqueness analysis of head-eye geometry", 1991). The recordings are compared by these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.acquisition.averaging import NORMAL, row_noise
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.clock import Between, Clock
from suta_calib.exchange.moving_rows import poses_between
from suta_calib.exchange.tracked_bodies import Body
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.geometry.screws import screw_invariants
from suta_calib.units import deg, from_deg, from_mm, ms

# Largest drift looked for. Two quartzes differ by 0.01 %; frames that are counted and taken for 30
# in a second, where there are 29.97, by 0.1 %.
_MOST_DRIFT: Final = 0.003
# Lengths of the motions that are compared, s.
_SPANS: Final = (0.1, 0.4, 1.6)
_MIDDLE: Final = 1
# Rows that both recordings must cover, and their share of the shorter recording.
_LEAST_ROWS: Final = 60
_LEAST_SHARE: Final = 0.2
# Below this correlation of the angles, two recordings show different motions.
_SAME_MOTION: Final = 0.7
# Above it they show the same one; between the two a shift that is badly known may be a chance.
_SURE: Final = 0.9
# Blocks of consecutive rows that are taken for independent, and those that a step is looked for in.
_BLOCKS: Final = 24
# Residuals of more standard deviations pull no harder (Huber).
_HUBER: Final = 2.5
_EPSILON: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Recorded:
    """A body that was followed: its poses, and when."""

    path: Path
    clock: Clock
    body: Body

    def without_wild_poses(self) -> Recorded:
        """The same without poses from which both neighbours are far, and these are near."""
        wild = np.zeros(len(self.clock.time), dtype=bool)
        # A pose so far, rad and m, from both its neighbours is a wrong one: a tag that flipped.
        for distances, least in zip(self._apart(), (from_deg(5.0), from_mm(10.0)), strict=True):
            near, around = distances
            away = np.minimum(near[:-1], near[1:])
            wild[1:-1] |= away > 4.0 * around + np.maximum(10.0 * np.median(near), least)
        rows = np.flatnonzero(~wild)
        if len(rows) == len(wild):
            return self
        note = (
            f"{int(wild.sum())} poses in {self.path.name} are far from the one before and from the "
            "one after: left out."
        )
        clock = replace(
            self.clock,
            time=self.clock.time[rows],
            rows=self.clock.rows[rows],
            notes=(*self.clock.notes, note),
        )
        return replace(self, clock=clock, body=self.body.take(rows))

    def reversed(self) -> Recorded:
        """The same motion, run backwards."""
        time = self.clock.time
        rows = np.arange(len(time))[::-1]
        return replace(
            self,
            clock=replace(self.clock, time=time[0] + time[-1] - time[rows]),
            body=self.body.take(rows),
        )

    def _apart(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Angles, rad, and ways, m, from pose to pose (n - 1,), and past one pose (n - 2,)."""
        rows, body = np.arange(len(self.clock.time)), self.body
        steps = [body.take(rows[k:]).relative_to(body.take(rows[: len(rows) - k])) for k in (1, 2)]
        near, around = (
            (
                np.linalg.norm(vector_from_rotation(step.rotation), axis=1),
                np.linalg.norm(step.position, axis=1),
            )
            for step in steps
            if step.rotation is not None
        )
        return (near[0], around[0]), (near[1], around[1])


@dataclass(frozen=True, eq=False)
class ClockAlignment(Displayable):
    """What makes the second recording's times those of the first.

    Attributes:
        shift: s, added to the second clock's times at its time ``at``.
        drift: added per second since then.
        at: s, the second clock, middle of the time that both cover.
        covariance: (2, 2) of shift and drift.
        overlap: s that both cover.
        agreement: correlation of the angles of the two.
        step: s by which the second clock seems to jump, and where on it, s; None where it does not.
        scale: lengths of the second recording over those of the first; NaN where the motion does
            not tell it.
        travel: correlation of the travel along the screws; NaN where nothing but noise is seen.
    """

    shift: float
    drift: float
    at: float
    covariance: FloatArray
    overlap: float
    agreement: float
    step: tuple[float, float] | None
    scale: float
    travel: float

    @property
    def shift_std(self) -> float:
        """Standard deviation of the shift in the middle of the overlap, s."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def drift_std(self) -> float:
        """Standard deviation of the drift."""
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def worst_std(self) -> float:
        """Largest standard deviation of a time in the overlap, s."""
        ends = np.array([[1.0, -0.5 * self.overlap], [1.0, 0.5 * self.overlap]])
        return float(np.sqrt(np.einsum("ki,ij,kj->k", ends, self.covariance, ends).max()))

    def first_times(self, second: FloatArray) -> FloatArray:
        """Times (n,) of the second clock on the first, s."""
        return np.asarray(second + self.shift + self.drift * (second - self.at))

    def second_times(self, first: FloatArray) -> FloatArray:
        """Times (n,) of the first clock on the second, s."""
        return np.asarray(self.at + (first - self.at - self.shift) / (1.0 + self.drift))


@dataclass(frozen=True, eq=False)
class _ClockFit:
    """One candidate: the fast clock's time is ``at + shift + (1 + drift) (time - at)``.

    Attributes:
        shift, drift: s, and a number.
        misfit: (k,) by how much the angles of motions differ, rad; NaN where they do not overlap.
        rows: (k,) where they do.
        agreement: correlation of the angles.
    """

    shift: float
    drift: float
    misfit: FloatArray
    rows: BoolArray
    agreement: float


def align_clocks(first: Recorded, second: Recorded) -> ClockAlignment:
    """How the clocks of two recordings belong together.

    Raises:
        ForeignFileError: too short a recording, one that does not turn, motions that differ, or
            repeat themselves, or tell no time.
    """
    coarser = second.clock.step > first.clock.step
    slow, fast = (second, first) if coarser else (first, second)
    for recorded in (slow, fast):
        _check_motion(recorded)
    search = _ShiftSearch(slow, fast)
    if search.most_agreement < _SAME_MOTION:
        _refuse_backwards(first, second)
    best = search.best()
    at, covariance, step = search.judged(best)
    # The slow clock's time t is the fast one's at + shift + (1 + drift) (t - at).
    middle_shift = best.shift + best.drift * (at - search.at)
    if coarser:
        shift, drift, where = middle_shift, best.drift, at
        jump = None if step is None else (-step[0], step[1])
    else:
        shift, drift, where = -middle_shift, 1.0 / (1.0 + best.drift) - 1.0, at + middle_shift
        jump = None if step is None else (step[0], step[1] + middle_shift)
    scale, travel = search.scale(best)
    share = np.ptp(slow.clock.time[search.clock_rows(best)])
    alignment = ClockAlignment(
        shift=shift,
        drift=drift,
        at=where,
        covariance=covariance,
        overlap=float(share),
        agreement=best.agreement,
        step=jump,
        scale=scale if coarser else 1.0 / scale,
        travel=travel,
    )
    # Standard deviation of the shift, s, beyond which the motion does not tell it.
    worst = 0.05
    if not alignment.worst_std < worst:
        _refuse_backwards(first, second)
        if best.agreement < _SURE:
            raise search.other_motion(best.agreement)
        raise ForeignFileError(
            f"a motion that tells the shift to ± {ms(alignment.worst_std):.3g} ms only",
            f"± {ms(worst):.3g} ms",
            file=second.path,
            hint="turn faster, and let the motion start and stop often",
        )
    return alignment


def _refuse_backwards(first: Recorded, second: Recorded) -> None:
    """Say so if the second recording, which fits at no shift, fits when it is run backwards."""
    coarser = second.clock.step > first.clock.step
    turned = second.reversed()
    search = _ShiftSearch(*((turned, first) if coarser else (first, turned)))
    if (agreement := search.most_agreement) > _SURE:
        raise ForeignFileError(
            f"the motion of {first.path}, but run backwards (only in the opposite order of its "
            f"rows do the angles agree: correlation {agreement:.2f})",
            "rows in the order in which they were recorded",
            file=second.path,
            hint="turn the order of its rows around, and keep the times increasing",
        )


def _check_motion(recorded: Recorded) -> None:
    time = recorded.clock.time
    if len(time) < _LEAST_ROWS:
        problem = f"{len(time)} rows"
        raise ForeignFileError(problem, f"at least {_LEAST_ROWS}", file=recorded.path)
    # s; over more, the steps of the search are longer than the motions that it compares.
    longest = 5.0 * 3600.0
    if np.ptp(time) > longest:
        found = f"a recording of {np.ptp(time) / 3600.0:.3g} h from its first to its last row"
        expected = f"at most {longest / 3600.0:g} h"
        hint = "cut it: minutes with many starts and stops tell more than hours"
        raise ForeignFileError(found, expected, file=recorded.path, hint=hint)
    pairs = _pairs(time, recorded.clock.step)[_MIDDLE]
    if len(pairs) < _LEAST_ROWS:
        found = f"{len(pairs)} motions of {_SPANS[_MIDDLE]:g} s without a gap in {len(time)} rows"
        raise ForeignFileError(found, f"at least {_LEAST_ROWS}", file=recorded.path)
    angle = _invariants(recorded.body, pairs)[:, 0]
    varies, noise = float(np.std(angle)), float(row_noise(angle))
    if varies > max(3.0 * noise, 1e-4):
        return
    raise ForeignFileError(
        f"a motion that turns by {deg(float(np.median(angle))):.3g}° ± {deg(varies):.2g}° in every "
        f"{_SPANS[_MIDDLE]:g} s, with noise of {deg(noise):.2g}°",
        "a motion whose speed of turning changes",
        file=recorded.path,
        hint="this does not tell the shift. Turn about several axes, and start and stop often",
    )


def _pairs(time: FloatArray, step: float) -> list[IntArray]:
    """(k, 2) first and last row of the motions of each span that no gap makes much longer."""
    pairs = list[IntArray]()
    for span in _SPANS:
        rows = max(1, round(span / step))
        first = np.arange(max(len(time) - rows, 0))
        lasts = time[first + rows] - time[first]
        first = first[lasts < 1.5 * rows * step]
        pairs.append(np.stack([first, first + rows], axis=1))
    return pairs


def _invariants(body: Body, pairs: IntArray) -> FloatArray:
    """(k, 2) of the motions between pairs of rows."""
    step = body.take(pairs[:, 1]).relative_to(body.take(pairs[:, 0]))
    assert step.rotation is not None
    return screw_invariants(step.rotation, step.position)


class _ShiftSearch:
    """The shift and drift that make the motions of two recordings agree.

    The slow one is taken at its rows, the fast one between its rows.
    """

    def __init__(self, slow: Recorded, fast: Recorded) -> None:
        self._slow, self._fast = slow, fast
        time = slow.clock.time
        self.at = float(0.5 * (time[0] + time[-1]))
        self._pairs = _pairs(time, slow.clock.step)
        self._measured = [_invariants(slow.body, pairs) for pairs in self._pairs]

    def clock_rows(self, fit: _ClockFit) -> BoolArray:
        """(n,) rows of the slow recording that the fast one covers."""
        return Between.of(self._fast.clock, self._other(fit.shift, fit.drift)).known

    def _other(self, shift: float, drift: float) -> FloatArray:
        away = self._slow.clock.time - self.at
        return np.asarray(self.at + shift + (1.0 + drift) * away)

    def _seen(self, shift: float, drift: float) -> list[FloatArray]:
        """The invariants (k, 2) of the fast recording, of each span; NaN where it has none."""
        between = Between.of(self._fast.clock, self._other(shift, drift))
        body = poses_between(self._fast.body, between)
        invariants = [_invariants(body, pairs) for pairs in self._pairs]
        for pairs, numbers in zip(self._pairs, invariants, strict=True):
            numbers[~between.known[pairs].all(axis=1)] = np.nan
        return invariants

    def best(self) -> _ClockFit:
        """The best candidate, which no other equals."""
        fits = self._fits
        if self.most_agreement < _SAME_MOTION:
            raise self.other_motion(self.most_agreement)
        best = fits[0]
        spacing = max(_SPANS[_MIDDLE], 2 * self._slow.clock.step)
        for other in fits[1:]:
            if abs(other.shift - best.shift) > spacing and _as_good(other, best):
                raise ForeignFileError(
                    "a motion that repeats itself: two shifts that are "
                    f"{abs(best.shift - other.shift):.4g} s apart fit equally well",
                    "a motion that fits at one shift only",
                    file=self._fast.path,
                    hint="record some turns that do not repeat, with pauses of different lengths",
                )
        return best

    @property
    def most_agreement(self) -> float:
        """How well the angles agree at the best shift."""
        return max((fit.agreement for fit in self._fits), default=0.0)

    def other_motion(self, agreement: float) -> ForeignFileError:
        """Error that no shift fits, to be raised by the caller."""
        return ForeignFileError(
            f"another motion than in {self._slow.path}, at every shift (angles correlate by "
            f"{agreement:.2f} at most)",
            f"two recordings of one motion that overlap for at least {_LEAST_SHARE:.0%} of the "
            f"shorter one, with clocks that drift by less than {_MOST_DRIFT:.1%}",
            file=self._fast.path,
            hint="do they overlap, and is the one body rigidly connected to the other?",
        )

    @cached_property
    def _fits(self) -> list[_ClockFit]:
        """The candidates, refined, those that agree best first."""
        fits = [fit for start in self._candidates() if (fit := self._refined(*start)) is not None]
        return sorted(fits, key=lambda fit: -fit.agreement)

    def _candidates(self) -> list[tuple[float, float]]:
        """Shifts, s, and drifts from which to refine: peaks of the correlation of angles."""
        slow, fast = self._slow.clock, self._fast.clock
        lengths = np.ptp(slow.time), np.ptp(fast.time)
        # So fine that a peak is not missed, so coarse that an hour takes a second.
        step = float(max(0.05, slow.step, max(lengths) / 100_000))
        measured = _on_grid(self._slow, 0.0, step)
        drifts = np.arange(0.0, _MOST_DRIFT, 0.5 * _SPANS[_MIDDLE] / max(min(lengths), 1.0))
        peaks = list[tuple[float, float, float]]()
        least = max(_LEAST_SHARE * min(lengths) / step, 4.0)
        for drift in np.concatenate([-drifts[:0:-1], drifts]).tolist():
            resampled = _on_grid(self._fast, drift, step)
            correlation = _correlation(measured, resampled, least)
            padded = np.concatenate([[-1.0], correlation, [-1.0]])
            high = (correlation >= padded[:-2]) & (correlation > padded[2:]) & (correlation > 0.3)
            for k in np.flatnonzero(high)[np.argsort(-correlation[high])][:12].tolist():
                # Where the fast one's beginning lies on the slow one's grid.
                lag = (k - (len(resampled) - 1)) * step
                begin = slow.time[0] + lag
                shift = fast.time[0] + (1.0 + drift) * (self.at - begin) - self.at
                peaks.append((float(correlation[k]), float(shift), drift))
        chosen = list[tuple[float, float, float]]()
        for peak in sorted(peaks, reverse=True):
            # One so much lower does not become the best by being refined.
            if len(chosen) == 5 or peak[0] < 0.75 * max(peaks)[0]:
                break
            if all(abs(peak[1] - other[1]) > _SPANS[_MIDDLE] for other in chosen):
                chosen.append(peak)
        return [(shift, drift) for _, shift, drift in chosen]

    def _refined(self, shift: float, drift: float) -> _ClockFit | None:
        """The least squares nearest to a start; None where too little is covered by both."""
        for _ in range(12):
            linear = self._linear(shift, drift)
            if linear is None:
                return None
            residual, jacobian, _ = linear
            matrix = jacobian.T @ jacobian
            if not np.linalg.cond(matrix) < 1e14:
                return None
            change = -np.linalg.solve(matrix, jacobian.T @ residual)
            # A step that is larger than the motions would jump over the minimum.
            change *= min(1.0, _SPANS[_MIDDLE] / max(abs(change[0]), _EPSILON))
            shift, drift = shift + float(change[0]), drift + float(change[1])
            if abs(drift) > 2 * _MOST_DRIFT:
                return None
            if abs(change[0]) < 1e-7:
                break
        return self._fit(shift, drift)

    def _fit(self, shift: float, drift: float) -> _ClockFit | None:
        turns = _tamed(self._seen(shift, drift)[_MIDDLE][:, 0])
        measured = _tamed(self._measured[_MIDDLE][:, 0])
        rows = np.isfinite(turns)
        if rows.sum() < _LEAST_ROWS:
            return None
        agreement = _correlated(turns[rows], measured[rows])
        return _ClockFit(shift, drift, np.abs(turns - measured), rows, agreement)

    def _linear(
        self, shift: float, drift: float
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Residuals (r,), each of a scatter of about one; derivatives (r, 2); times (r,), s.

        A size and an offset of each signal are free: noise adds to angles, scale to lengths.
        """
        # So far apart that no row is in both a signal and its rate: else noise would correlate with
        # itself, and the times would be drawn to where the interpolation averages most.
        half = 4.0 * self._fast.clock.step
        now = self._seen(shift, drift)
        later, earlier = (self._seen(shift + by, drift) for by in (half, -half))
        time = self._slow.clock.time
        parts = list[tuple[FloatArray, FloatArray, FloatArray]]()
        for span, pairs in enumerate(self._pairs):
            away = time[pairs].mean(axis=1) - self.at
            turned = self._measured[span][:, 0]
            for which in range(2):
                measured, computed = self._measured[span][:, which], now[span][:, which]
                rate = (later[span][:, which] - earlier[span][:, which]) / (2.0 * half)
                # Motions turned by more are left out: the axis of half a turn has two directions.
                rows = np.isfinite(computed) & np.isfinite(rate) & (turned < 2.6)
                if rows.sum() < _LEAST_ROWS:
                    if which == 0 and span == _MIDDLE:
                        return None
                    continue
                basis = np.column_stack([np.ones(int(rows.sum())), computed[rows]])
                fitted = np.linalg.lstsq(basis, measured[rows], rcond=None)[0]
                left = basis @ fitted - measured[rows]
                # Travel along the axis that does not agree tells nothing; in a plane it is noise.
                if which == 1 and np.var(left) > 0.5 * np.var(measured[rows]):
                    continue
                columns = (
                    fitted[1]
                    * rate[rows, None]
                    * np.column_stack([np.ones(int(rows.sum())), away[rows]])
                )
                columns -= basis @ np.linalg.lstsq(basis, columns, rcond=None)[0]
                # The scatter of those rows that tell the shift, not of those at rest.
                spread = max(NORMAL * _weighted_median(np.abs(left), columns[:, 0] ** 2), _EPSILON)
                weight = np.sqrt(1.0 / np.maximum(np.abs(left) / (_HUBER * spread), 1.0)) / spread
                parts.append((weight * left, weight[:, None] * columns, away[rows]))
        residual, jacobian, away = (np.concatenate(part) for part in zip(*parts, strict=True))
        return residual, jacobian, away

    def judged(self, fit: _ClockFit) -> tuple[float, FloatArray, tuple[float, float] | None]:
        """Middle of the overlap, the covariance there, and a step of the clock with its time."""
        linear = self._linear(fit.shift, fit.drift)
        assert linear is not None
        residual, jacobian, away = linear
        covered = self._slow.clock.time[self.clock_rows(fit)] - self.at
        edges = np.linspace(covered[0], covered[-1], _BLOCKS + 1)[1:-1]
        block = np.searchsorted(edges, away)
        # Beyond Huber's bound, where rows pull alike wherever they are, they tell no curvature.
        inside = np.abs(residual) < _HUBER
        inverse = np.linalg.inv(jacobian[inside].T @ jacobian[inside])
        scores = np.zeros((_BLOCKS, 2))
        np.add.at(scores, block, jacobian * residual[:, None])
        # A few blocks may hold most of what tells the shift: so many are worth as much as all.
        information = np.bincount(block, jacobian[:, 0] ** 2, _BLOCKS)
        worth = max(float(information.sum() ** 2 / np.sum(information**2)), 3.0)
        covariance = worth / (worth - 2.0) * inverse @ (scores.T @ scores) @ inverse
        middle = float(0.5 * (covered[0] + covered[-1]))
        to_middle = np.array([[1.0, middle], [0.0, 1.0]])
        return (
            self.at + middle,
            np.asarray(to_middle @ covariance @ to_middle.T),
            self._step(jacobian, residual, block, edges),
        )

    def _step(
        self, jacobian: FloatArray, residual: FloatArray, block: Any, edges: FloatArray
    ) -> tuple[float, float] | None:
        """By how much, s, the other clock jumps, and when on the slow one, s."""
        information, pull = np.zeros(_BLOCKS), np.zeros(_BLOCKS)
        np.add.at(information, block, jacobian[:, 0] ** 2)
        np.add.at(pull, block, -jacobian[:, 0] * residual)
        offset = pull / np.maximum(information, _EPSILON)
        weight = np.sqrt(information)
        centre = np.arange(_BLOCKS) - 0.5 * (_BLOCKS - 1)
        line = weight[:, None] * np.column_stack([np.ones(_BLOCKS), centre])
        jump, best = None, 0.0
        for k in range(2, _BLOCKS - 1):
            columns = np.column_stack([line, weight * (np.arange(_BLOCKS) >= k)])
            inverse = np.linalg.pinv(columns.T @ columns)
            size = inverse @ columns.T @ (weight * offset)
            left = weight * offset - columns @ size
            scatter = float(left @ left) / (_BLOCKS - 3)
            sigmas = abs(size[2]) / np.sqrt(max(scatter * inverse[2, 2], 1e-300))
            if sigmas > best:
                best, jump = sigmas, (float(size[2]), float(self.at + edges[k - 1]))
        # Of twenty places, by Student's t of 21 degrees of freedom: once in ten thousand times.
        return jump if best > 6.5 else None

    def scale(self, fit: _ClockFit) -> tuple[float, float]:
        """Lengths of the slow recording over those of the fast one, and how far they agree."""
        travels = self._seen(fit.shift, fit.drift)[_MIDDLE][:, 1]
        rows = np.isfinite(travels)
        both = np.stack([self._measured[_MIDDLE][rows, 1], travels[rows]], axis=1)
        if (np.std(both, axis=0) <= 3.0 * row_noise(both, 0)).any():
            return np.nan, np.nan
        travel = _correlated(both[:, 0], both[:, 1])
        ratio = float(np.std(both[:, 0]) / np.std(both[:, 1]))
        return (ratio if travel > 0.9 else np.nan), travel


def _on_grid(recorded: Recorded, drift: float, step: float) -> FloatArray:
    """Angles of motions at even steps of the clock less its drift; NaN where there are none."""
    clock = recorded.clock
    count = int(np.ptp(clock.time) / (1.0 + drift) / step) + 1
    at = clock.time[0] + (1.0 + drift) * step * np.arange(count)
    angle, middle = _angles(recorded)
    on_grid = np.interp(at, middle, angle, left=np.nan, right=np.nan)
    on_grid[~Between.of(clock, at).known] = np.nan
    return np.asarray(on_grid)


def _angles(recorded: Recorded) -> tuple[FloatArray, FloatArray]:
    """Angles (k,) of the motions of a span, rad, and their middle times (k,), s."""
    pairs = _pairs(recorded.clock.time, recorded.clock.step)[_MIDDLE]
    angle = _invariants(recorded.body, pairs)[:, 0]
    return _tamed(angle), recorded.clock.time[pairs].mean(axis=1)


def _tamed(angles: FloatArray) -> FloatArray:
    """Angles (n,) of which a few wild ones do not decide; NaN stays."""
    most = np.nanquantile(angles, 0.95) if np.isfinite(angles).any() else np.nan
    return np.asarray(np.minimum(angles, 1.5 * most))


def _correlation(a: FloatArray, b: FloatArray, least: float) -> FloatArray:
    """Correlation at each shift of b along a, (len(a) + len(b) - 1,); -1 of too few values."""
    size = 1 << int(len(a) + len(b)).bit_length()

    def transforms(values: FloatArray) -> list[NDArray[Any]]:
        there = np.isfinite(values)
        centred = np.where(there, values - np.nanmean(values), 0.0)
        return [np.fft.rfft(part, size) for part in (there.astype(float), centred, centred**2)]

    of_a, of_b = transforms(a), [np.conj(part) for part in transforms(b)]

    def sums(i: int, j: int) -> FloatArray:
        circular = np.fft.irfft(of_a[i] * of_b[j], size)
        return np.concatenate([circular[size - len(b) + 1 :], circular[: len(a)]])

    count = np.maximum(sums(0, 0), 1.0)
    mean_a, mean_b = sums(1, 0) / count, sums(0, 1) / count
    shared = sums(1, 1) / count - mean_a * mean_b
    power = (sums(2, 0) / count - mean_a**2) * (sums(0, 2) / count - mean_b**2)
    correlation = shared / np.sqrt(np.maximum(power, 1e-300))
    usable = (count >= least) & (power > 1e-9 * np.nanvar(a) * np.nanvar(b))
    return np.asarray(np.where(usable, correlation, -1.0))


def _correlated(a: FloatArray, b: FloatArray) -> float:
    """Correlation of values (n,); 0 where either is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """The value (n,) below which half of the weights (n,) lie."""
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(share, 0.5 * share[-1])]])


def _as_good(other: _ClockFit, best: _ClockFit) -> bool:
    """Whether chance explains that another fit is worse where both are defined."""
    rows = other.rows & best.rows
    if rows.sum() < _LEAST_ROWS:
        return other.agreement > best.agreement - 0.02
    differences = other.misfit[rows] - best.misfit[rows]
    blocks = np.array([part.mean() for part in np.array_split(differences, _BLOCKS)])
    error = float(blocks.std(ddof=1)) / np.sqrt(len(blocks))
    return bool(blocks.mean() <= 3.0 * error)
