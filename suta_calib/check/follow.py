"""Rows one by one: after each of them it is decided whether something changed.

For everything that may have changed (`suspects`) with a size that is normal about zero, the ratio
of the likelihood of all rows so far to their likelihood without a change,

    E = |I + T N T|^-½ ((1 + S / ν) / (1 + (S - g) / ν))^((ν + m) / 2),
    g = sᵀ T (I + T N T)⁻¹ T s

is a martingale if nothing changed: Robbins' mixture (1970, doi:10.1214/aoms/1177696786). N and s
are curvature and score of `trust.evidence`, T the sizes, a few of them and averaged; S are the
squares of the m rows, whose noise has ν degrees of freedom, and the kinds of noise are mixed as
`error_model` has them. What the rows alone must tell is integrated out on both sides. The average
over all suspects is a martingale too, an e-value at any time (Ramdas et al. 2023,
doi:10.1214/23-STS894), and by Ville's inequality it ever reaches 1 / α with a probability of at
most α, however long rows come and whenever somebody looks.

Rows come in stretches of so many numbers, so that no row costs more than those before it. Stretch k
is a test by itself, of its rows alone and with the k (k + 1)-th part of α: these parts sum to α.

A row that is far off is held back until the next: if that one is off too, both count; else it was
a bad row. Nothing that is sound is hidden by it, and one bad row makes no change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.special import fdtrc, logsumexp

from suta_calib.arrays import FloatArray
from suta_calib.check.checking import FALSE_ALARM, Check, Checker, Checking, FoundChange
from suta_calib.check.suspects import Suspect, suspects_of
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.measurements import Samples
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.subsampled import ENOUGH_CORNERS, of_fewer_corners
from suta_calib.units import Unit

# Sizes of changes that are looked for: a millimetre, as much at half a metre, …
SIZE: Final[dict[Unit, float]] = {"m": 1e-3, "rad": 2e-3, "1": 1e-3, "px": 1.0}
# … and a third and five times that.
_TIMES: Final = 0.3, 1.0, 5.0


@dataclass(frozen=True)
class FollowStep(Displayable):
    """After a row.

    Attributes:
        rows: so far.
        evidence: E of the best stretch, times its part of α, for a change of any sort; changed
            where it has reached ``limit``.
        limit: 1 / α.
        held: whether the last row is far off and waits for the next one.
        bad_rows: rows that were far off while their neighbours were not.
    """

    rows: int
    evidence: float
    limit: float
    held: bool
    bad_rows: tuple[str, ...]

    @property
    def changed(self) -> bool:
        """Whether something changed."""
        return self.evidence >= self.limit


@dataclass(eq=False)
class Follow(Displayable):
    """A calibration that is held against rows as they come.

    ::

        follow = Follow(Checker(result.solution))
        for row in rows:                       # terms of one row or of several
            if follow.add(row).changed:
                print(follow.check().assessment)
                break

    Attributes:
        checker: the calibration.
        false_alarm: probability that sound rows, however many, are ever said to show a change.
    """

    checker: Checker
    false_alarm: float = FALSE_ALARM
    _term: Term | None = field(default=None, init=False)
    _rows: list[Samples] = field(default_factory=list, init=False)
    _held: list[Samples] = field(default_factory=list, init=False)
    _bad: list[str] = field(default_factory=list, init=False)
    _before: int = field(default=0, init=False)
    _stretch: int = field(default=1, init=False)
    _accepted: tuple[float, int] = field(default=(0.0, 0), init=False)
    _most: float = field(default=-math.inf, init=False)

    @single_threaded
    def add(self, term: Term, first: int = 0) -> FollowStep:
        """Take more rows, all of one kind, and decide.

        Args:
            term: over the same arm, of a kind that was calibrated; one row or several.
            first: of its rows, the one from which on they are new.
        """
        self._term = of_fewer_corners(term, ENOUGH_CORNERS)
        samples = self._term.poses.samples
        for k in range(first, len(samples)):
            if self.step.changed:
                break
            self._take(samples.take([k]))
        return self.step

    @property
    def step(self) -> FollowStep:
        """What is known after the rows so far."""
        return FollowStep(
            self._before + len(self._rows) + len(self._held) + len(self._bad),
            math.exp(min(self._most, 700.0)),
            1.0 / self.false_alarm,
            bool(self._held),
            tuple(self._bad),
        )

    def check(self) -> Check:
        """The rows of this stretch at once: what changed, if it was decided that something did.

        Raises:
            SamplesError: no rows yet.
        """
        checking = self._checking([*self._rows, *self._held])
        if checking is None:
            raise SamplesError("no rows", "at least one row", where="follow")
        p = math.exp(min(-self._most, 0.0))
        found = replace(checking.run(), p=p, rows=self.step.rows)
        found = replace(found, bad_rows=tuple(dict.fromkeys([*self._bad, *found.bad_rows])))
        if not self.step.changed:
            return replace(found, changed=())
        if found.changed:
            return found
        # What one test at a time shows need not be what all rows show at once.
        _, best = self._evidence(checking)
        change = FoundChange(best.what, {}, p, (), best.names)
        return replace(found, changed=(change,))

    def _take(self, row: Samples) -> None:
        """One row: it counts, waits, or was a bad one."""
        rows, checking = [*self._rows, row], self._checking([*self._rows, row])
        squares = (0.0, 0) if checking is None else _squares(checking)
        far = self._is_far(squares)
        if far and not self._held:
            self._held = [row]
            return
        if far and self._held:
            rows = [*self._rows, *self._held, row]
            checking = self._checking(rows)
            squares = (0.0, 0) if checking is None else _squares(checking)
        elif self._held:
            self._bad += [origin for held in self._held for origin in held.origin]
        self._rows, self._held, self._accepted = rows, [], squares
        if checking is None:
            return
        # Once reached, it stays: what is certain at a time that nobody chose is certain.
        part = math.log(self._stretch * (self._stretch + 1))
        self._most = max(self._most, self._evidence(checking)[0] - part)
        # So many numbers show what can be found at all, and weigh in a few hundredths of a second.
        if squares[1] >= 240 and not self.step.changed:
            self._before += len(self._rows)
            self._stretch += 1
            self._rows, self._accepted = [], (0.0, 0)

    def _checking(self, rows: list[Samples]) -> Checking | None:
        """A check of some rows; None where they are too few to be looked at."""
        if self._term is None or not rows:
            return None
        samples = Samples.concatenate(rows)
        try:
            term = self._term.over_poses(self._term.poses.with_samples(samples))
        except SamplesError:
            # Distances need two touches.
            return None
        return self.checker.checking(term, self.false_alarm)

    def _is_far(self, after: tuple[float, int]) -> bool:
        """Whether a row is far from where those before it have it: squares with it, and numbers."""
        squares, count = (now - before for now, before in zip(after, self._accepted, strict=True))
        if count < 1:
            return False
        freedom = self.checker.errors.freedom
        # Chance of a row so far off, from which on it waits for the next one.
        return float(fdtrc(count, freedom, max(squares, 0.0) / count)) < 1e-4

    def _evidence(self, checking: Checking) -> tuple[float, Suspect]:
        """Logarithm of the average e-value of all suspects, and the likeliest of them."""
        rows = checking.start
        suspects = suspects_of(rows, self.checker.values)
        weights, ratios = list[float](), list[FloatArray]()
        kinds = self.checker.errors.kinds
        for kind, noise in zip(kinds, checking.by_noise, strict=True):
            # The estimates' part in units of the same noise.
            alone = replace(checking, of_one_kind=noise + checking.by_estimates)
            fit = alone.fit(rows)
            weights.append(math.log(kind.weight) + _log_likelihood(fit, alone.root, kind.freedom))
            columns = [effect.columns for effect in alone.effects(suspects)]
            ratios.append(_log_ratios(fit, columns, suspects, kind.freedom))
        weight = np.array(weights) - logsumexp(weights)
        each = logsumexp(np.array(ratios) + weight[:, None], axis=0)
        most = max(self._most_suspects, len(suspects))
        # Those that these rows do not look at have an e-value of one.
        silent = math.log(most - len(suspects)) if most > len(suspects) else -math.inf
        total = float(logsumexp([*each, silent])) - math.log(most)
        return total, suspects[int(np.argmax(each))]

    @property
    def _most_suspects(self) -> int:
        """How many there may ever be: the weight of each must not depend on rows to come."""
        problem = self.checker.solution.problem
        frames = {frame.owner for term in problem.terms for frame in term.outside}
        arms = () if problem.arm is None else problem.arm.segments
        # Of each joint its zero and its link; base, tip, scale, all zeros, what a camera is.
        return 2 * len(arms) + len(frames) + 6


def _squares(checking: Checking) -> tuple[float, int]:
    """Of rows freed of their covariance, and how many numbers they are."""
    fit = checking.fit(checking.start)
    return fit.squares, round(len(fit.residual) - fit.spent)


def _log_likelihood(fit: LinearFit, root: FloatArray, freedom: float) -> float:
    """Of rows without a change, what they alone tell integrated out, but for a constant."""
    count = len(fit.residual) - fit.spent
    volume = 2.0 * float(np.sum(np.log(np.diag(root))))
    values = np.linalg.eigvalsh(fit.information) if fit.jacobian.shape[1] else np.ones(0)
    volume += float(np.sum(np.log(values[values > 1e-12])))
    return -0.5 * volume - 0.5 * (freedom + count) * math.log1p(fit.squares / freedom)


def _log_ratios(
    fit: LinearFit, columns: Sequence[FloatArray], suspects: Sequence[Suspect], freedom: float
) -> FloatArray:
    """(suspects,) logarithm of E for each, averaged over the sizes."""
    every = np.hstack([np.zeros((len(fit.residual), 0)), *columns])
    curvature, score = fit.curvature(every), every.T @ fit.settled
    widths = np.array([part.shape[1] for part in columns], dtype=np.intp)
    first = np.cumsum(widths) - widths
    times = np.array(_TIMES)[:, None]
    count = len(fit.residual) - fit.spent
    ratios = np.zeros(len(suspects))
    # Those with as many numbers at once: one at a time they take most of the time of a row.
    for width in np.unique(widths):
        alike = np.flatnonzero(widths == width)
        at = first[alike][:, None] + np.arange(width)
        size = np.array(
            [[SIZE.get(unit, 1.0) for unit in suspects[k].units] for k in alike.tolist()]
        )
        parts = size[:, :, None] * curvature[at[:, :, None], at[:, None, :]] * size[:, None, :]
        values, vectors = np.linalg.eigh(parts)
        squares = np.einsum("nji,nj->ni", vectors, size * score[at]) ** 2
        # (sizes, suspects, numbers) and (sizes, suspects).
        known = times[:, :, None] ** 2 * np.maximum(values, 0.0)
        gain = np.sum(times[:, :, None] ** 2 * squares / (1.0 + known), axis=2)
        left = fit.squares - np.minimum(gain, fit.squares)
        likelier = math.log1p(fit.squares / freedom) - np.log1p(left / freedom)
        each = -0.5 * np.sum(np.log1p(known), axis=2) + 0.5 * (freedom + count) * likelier
        ratios[alike] = logsumexp(each, axis=0) - math.log(len(_TIMES))
    return ratios
