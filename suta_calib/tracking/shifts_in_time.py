"""A record that is elsewhere, or later, than it was: something knocked, a clock that runs wrong.

* A jump is a change from row to row that dwarfs every other one of this record, and is there at
  once: a level that is another from a row on is no proof, for order in time is mostly order in
  space, and where a joint turns back its play is taken up.
* A clock's rate, and a step of its time, are errors along the velocity that grow with time, or
  begin at some time. They must explain most of what is left beyond the scatter of neighbouring
  rows, and more than chance does where rows count for as few as their correlation leaves.
"""

from __future__ import annotations

from operator import itemgetter
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.acquisition.averaging import NORMAL, row_noise
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.tracking.errors_in_time import (
    NOTHING,
    SAME,
    ErrorsInTime,
    FaultEstimate,
    Kind,
    fitted,
    per_axis,
)
from suta_calib.trust.serial_correlation import correlation_length

# Of a shape's squares, what no honest cause must be able to explain for it to be told.
FREE: Final = 0.03
# Rounds in which a fault is estimated anew where the last estimate has led to.
ROUNDS: Final = 4


class ShiftsInTime:
    """A jump, a rate or a step of time, in the rows (n,) that are neither stuck nor wild."""

    def __init__(self, record: ErrorsInTime, used: BoolArray) -> None:
        self.record, self.at = record, np.flatnonzero(used)
        self.n = len(self.at)
        self.time, self.error = record.time[used], record.error[used]
        self.columns, self.velocity = record.columns[used], record.velocity[used]
        # Rows are taken together to so many at most.
        self.first = np.unique(np.linspace(0, self.n, min(self.n, 1000) + 1).astype(np.intp))[:-1]
        self.counts = np.diff(np.append(self.first, self.n))
        self.b_error, self.b_columns = self.mean(self.error), self.mean(self.columns)
        flat = self.b_columns.reshape(-1, self.b_columns.shape[2])
        flat = flat / np.maximum(np.sqrt(np.mean(flat**2, axis=0)), 1e-300)
        u, s, _ = np.linalg.svd(flat, full_matrices=False)
        self.q = u[:, s > SAME * s[0]]
        self.left = self.free(self.b_error)
        noise = row_noise(self.error, axis=0)
        self.white = float(np.sum(noise**2) * np.sum(1.0 / self.counts))

    def mean(self, rows: FloatArray) -> FloatArray:
        """Means of rows (n, …) by bins (m, …)."""
        sums = np.add.reduceat(rows, self.first, axis=0)
        return np.asarray(sums / self.counts.reshape(-1, *[1] * (rows.ndim - 1)))

    def free(self, rows: FloatArray) -> FloatArray:
        """What no column explains of bins (m, 3)."""
        flat = rows.ravel()
        return np.asarray((flat - self.q @ (self.q.T @ flat)).reshape(-1, 3))

    def most_telling(self) -> FaultEstimate | None:
        """The one that leaves least, where there is one."""
        candidates = [fault for fault in (self.jump(), self.rate(), self.step()) if fault]
        return min(candidates, key=itemgetter(0))[1] if candidates else None

    def spread(self, shape: FloatArray) -> FloatArray:
        """(n, 3) of all rows, from those that are used."""
        full = np.zeros_like(self.record.error)
        full[self.at] = shape
        return full

    def judged(self, column: FloatArray, looks: int) -> tuple[float, float, float] | None:
        """Squares that a column (m, 3) leaves, its size and std; None where it is chance.

        It is the best of so many columns that were looked at.
        """
        free = self.free(column)
        information = float(np.sum(free**2))
        if information <= FREE * float(np.sum(column**2)):
            return None
        size = float(np.sum(free * self.left)) / information
        rest = self.left - size * free
        squares, every = float(np.sum(rest**2)), float(np.sum(self.left**2))
        freedom = (rest.size - self.q.shape[1] - 1) / correlation_length(rest)
        small = rms_length(size * column) < NOTHING
        # A clock's fault explains half of the squares beyond the scatter of neighbours.
        little = every - squares < 0.5 * max(every - self.white, 0.0)
        if freedom < 3.0 or small or little:  # fewer degrees of freedom tell no variance
            return None
        variance = max(squares, 1e-18 * rest.size) / freedom
        # Chance that the tests of one kind call an honest record's clock wrong.
        false_alarm = 1e-4
        if float(fdtrc(1.0, freedom, (every - squares) / variance)) * looks > false_alarm:
            return None
        return squares, size, float(np.sqrt(variance / information))

    def rate(self) -> tuple[float, FaultEstimate] | None:
        """An error along the velocity that grows with time."""
        since = self.time - self.time.mean()
        return self.delayed("rate", since, 1, 0)

    def step(self) -> tuple[float, FaultEstimate] | None:
        """An error along the velocity from a row on: the bin from which it explains most."""
        means = self.mean(-self.velocity)
        beside = np.einsum("mi,mik->mk", means, self.q.reshape(len(means), 3, -1))
        by_bin = np.sum(means**2, axis=1), beside, np.sum(means * self.left, axis=1)
        power, shared, pull = (np.cumsum(values[::-1], axis=0)[::-1] for values in by_bin)
        information = power - np.sum(shared**2, axis=1)
        usable = information > FREE * np.maximum(power, 1e-300)
        usable[:3] = usable[-3:] = False
        gain = np.where(usable, pull**2 / np.where(usable, information, 1.0), 0.0)
        if not gain.any():
            return None
        row = int(self.first[np.argmax(gain)])
        after = (np.arange(self.n) >= row).astype(float)
        candidate = self.delayed("step", after, len(means), row)
        if not candidate:
            return None
        jump = -candidate[1].size * self.velocity[row]
        return candidate if self.sharp(self.residual(), row, jump) else None

    def delayed(
        self, kind: Kind, basis: FloatArray, looks: int, first: int
    ) -> tuple[float, FaultEstimate] | None:
        """Delays in proportion to a basis (rows,), from a row on, and what squares they leave."""
        judged = self.judged(self.mean(-self.velocity * basis[:, None]), looks)
        if not judged:
            return None
        size, lateness, error = judged[1], 0.0, self.error
        delays, columns = np.zeros(len(self.record.time)), self.b_columns
        # Delays are not small beside what the motion changes in: again where they lead to.
        for _ in range(ROUNDS):
            delays[self.at] = lateness + size * basis
            position, velocity = (values[self.at] for values in self.record.late(delays))
            error = self.error + self.record.reference[self.at] - position
            late, delay_shape = (self.mean(-velocity * factor) for factor in (1.0, basis[:, None]))
            columns = np.concatenate([late[:, :, None], columns[:, :, 1:]], axis=2)
            every = np.concatenate([columns, delay_shape[:, :, None]], axis=2)
            change = fitted(every, self.mean(error))
            lateness, size = lateness + float(change[0]), size + float(change[-1])
        rest = self.mean(error) - every @ change
        std = judged[2] * rms_length(rest) / max(float(np.sqrt(judged[0] / len(rest))), 1e-300)
        shape = self.spread(self.error - error)
        ends = int(self.at[first]), int(self.at[-1])
        return float(np.sum(rest**2)), FaultEstimate(kind, size, std, shape, 1, *ends, lateness)

    def residual(self) -> FloatArray:
        """(rows, 3) what no column explains."""
        return np.asarray(self.error - self.columns @ fitted(self.b_columns, self.b_error))

    def sharp(self, left: FloatArray, row: int, jump: FloatArray) -> bool:
        """Whether most of a jump (3,) is there at once, as far as the noise lets it be seen."""
        size = float(np.linalg.norm(jump))
        # Play takes longer to be taken up than 5 ms, or two rows, in which 85 % of a jump happens.
        w = max(2, round(0.005 / float(np.median(np.diff(self.time)))))
        change = _changes(left, w) @ (jump / max(size, 1e-300))
        noise = NORMAL * float(np.median(np.abs(change)))
        near = change[max(row - w - w // 2, 0) : row - w + w // 2 + 1]
        return len(near) > 0 and float(near.max()) > 0.85 * size - 3.0 * noise

    def jump(self) -> tuple[float, FaultEstimate] | None:
        """A place that is another from a row on, or between two."""
        step = float(np.median(np.diff(self.time)))
        # Rows of which means are taken before and after: 24 means in all, 0.25 s at the longest.
        widths = [w for w in (2, 4, 8, 16, 32, 64, 128) if w * 24 <= self.n and w * step <= 0.25]
        left = self.residual()
        if not widths:
            return None
        # What the jump made of all that was fitted hides it: again with it in its place.
        for _ in range(ROUNDS):
            ratio, w, first, end = max(_dwarfing(left, w) for w in widths)
            inside = np.zeros(self.n)
            inside[first:end] = 1.0
            columns = [self.b_columns, per_axis(self.mean(inside)[:, None])]
            beta = fitted(np.concatenate(columns, axis=2), self.b_error)
            left = self.error - self.columns @ beta[:-3]
        if ratio < 2.5:
            return None
        change = _changes(left, w)
        jump = change[first - w]
        size = float(np.linalg.norm(jump))
        column = self.mean(inside[:, None] * jump)
        identifiable = float(np.sum(self.free(column) ** 2)) > FREE * float(np.sum(column**2))
        if size < NOTHING or not identifiable or not self.sharp(left, first, jump):
            return None
        rows = np.arange(len(change)) + w
        elsewhere = (np.abs(rows - first) > w) & ((np.abs(rows - end) > w) | (end == self.n))
        std = float(np.sqrt(np.mean((change[elsewhere] @ (jump / size)) ** 2)))
        offset = inside[:, None] * beta[-3:]
        squares, shape = float(np.sum(self.mean(left - offset) ** 2)), self.spread(offset)
        ends = int(self.at[first]), int(self.at[end - 1])
        return squares, FaultEstimate("jump", size, std, shape, 1, *ends)


def _changes(left: FloatArray, w: int) -> FloatArray:
    """(n - 2 w + 1, 3) mean of w rows after minus mean of w rows before rows w … n - w."""
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(left, axis=0)])
    means = (sums[w:] - sums[:-w]) / w
    return np.asarray(means[w:] - means[:-w])


def _dwarfing(left: FloatArray, w: int) -> tuple[float, int, int, int]:
    """How far the largest change dwarfs the others, the width, where it is, and where it ends.

    Or the two largest, where the second takes back what the first did.
    """
    tiny = 1e-9  # m; changes that are none
    change = _changes(left, w)
    size = np.linalg.norm(change, axis=1)
    at = np.arange(len(size))
    one = int(np.argmax(size))
    beyond = np.where(np.abs(at - one) > w, size, 0.0)
    two = int(np.argmax(beyond))
    third = np.where(np.abs(at - two) > w, beyond, 0.0)
    changes = [(float(size[one] / max(beyond[two], tiny)), w, one + w, len(left))]
    if np.linalg.norm(change[one] + change[two]) < 0.5 * size[one]:
        double = size[two] / max(float(third.max()), tiny)
        first, end = sorted((one, two))
        changes.append((float(double), w, first + w, end + w))
    return max(changes)
