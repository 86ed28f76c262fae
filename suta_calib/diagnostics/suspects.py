"""What may have changed while rows were measured, and how much of their residuals it explains.

A change moves the tips of some rows in its own way: a column of derivatives times who suffers. Sums
over short stretches of rows make every stretch from one row to another, so that all times are
looked at for the price of one (Andrews 1993, doi:10.2307/2951764).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.diagnostics.following import Following, columns_of, whitened
from suta_calib.diagnostics.scores import TELLING
from suta_calib.geometry.numbers import skew

# What is plausible: a turn, rad; a share of a travel; a shift, m.
TURN: Final = 0.01
TRAVEL: Final = 2e-3
SHIFT: Final = 5e-3
# Errors of an encoder come so often in a turn, beside those that an eccentric one has.
WAVES: Final = 3, 4, 5, 6
# Times at which something may have changed within one term, at first.
TIMES: Final = 40


@dataclass(frozen=True, eq=False)
class Suspect:
    """One way in which tips may move.

    Attributes:
        kind, joint: as of a `Disturbance`; kind ``model`` where a model lacks something instead.
        motion: (6·samples, k) velocity of every tip, per unit.
        plausible: (k,) size.
        at_once: whether it is so in some rows and not in others.
    """

    kind: str
    joint: str
    motion: FloatArray
    plausible: FloatArray
    at_once: bool

    def within(self, first: int, end: int) -> FloatArray:
        """(6·samples, k) velocity of the tips if it is so in these samples alone."""
        some = np.zeros_like(self.motion)
        some[6 * first : 6 * end] = self.motion[6 * first : 6 * end]
        return some


@dataclass(frozen=True, eq=False)
class Telling:
    """A suspect, where it explains most.

    Attributes:
        suspect: what it is.
        term: number of the term in which it begins.
        first, end: samples of all terms from which on and until which it is so.
        p: chance that noise alone makes it explain so much there.
        lowered: squares that it explains, in units of the noise.
    """

    suspect: Suspect
    term: int
    first: int
    end: int
    p: float
    lowered: float


def stretches(fit: Following, fewest: int) -> list[tuple[int, int, int]]:
    """Term, first sample and end of all that may have been measured in another state.

    Whatever follows a row, in its term or altogether; a file by itself.

    Args:
        fit: of which terms.
        fewest: samples in each, and beside it in its term.
    """
    found = dict[tuple[int, int], int]()
    starts = fit.problem.evaluation.table.first.tolist()
    for k, term in enumerate(fit.problem.terms):
        a, b, last = starts[k], starts[k + 1], starts[-1]
        if b - a <= 2 * fewest:
            continue
        times = np.unique(np.linspace(a + fewest, b - fewest, TIMES).astype(np.intp)).tolist()
        ends = [(t, end) for t in times for end in {b, last}]
        number = np.array([file for file, _ in term.poses.samples.files()])
        edges = [a, *(a + 1 + np.flatnonzero(np.diff(number))).tolist(), b]
        files = [(x, y) for x, y in pairwise(edges) if y - x >= fewest]
        ends += [each for each in files if each != (a, b)]
        ends += [(a, last)] if k else []
        for each in ends:
            found.setdefault(each, k)
    return [(k, *each) for each, k in found.items()]


def suspects(fit: Following) -> Iterator[Suspect]:
    """All that may have changed, in any row, while each term was measured, or all along."""
    problem = fit.problem
    arm, table = problem.arm, problem.evaluation.table
    assert arm is not None
    # Along the axes of the base, and along the tip's own, which are the rows here.
    based = _rigid(table.position - table.position.mean(axis=0))
    axes = np.swapaxes(table.rotation.reshape(-1, 3, 3), 1, 2)
    held = np.zeros_like(based)
    held[:, :3, :3] = held[:, 3:, 3:] = axes
    of_movers = table.velocity[:, [problem.names.index(name) for name in arm.offsets]]
    # What the encoder reads too much, the arm is turned less.
    read = -(of_movers @ arm.gearing).reshape(-1, 6, len(arm.joints))
    turn, twist = np.array([TURN]), np.repeat([SHIFT, TURN], 3)
    q = np.vstack([t.poses.samples.q for t in problem.terms])
    about = q - q.mean(axis=0)
    shares = [*_so_far(table.first)]
    for k, joint in enumerate(arm.joints):
        motion = read[:, :, [k]]
        yield Suspect("slip", joint, _flat(motion), turn, True)
        for share in shares:
            yield Suspect("drift", joint, _flat(motion, share), turn, False)
        travel = _flat(motion, about[:, k])
        yield Suspect("travel", joint, travel, np.array([TRAVEL]), False)
    for kind, motion in {"base": based, "tip": held}.items():
        yield Suspect(kind, "", _flat(motion), twist, True)
        for share in shares:
            yield Suspect(f"{kind} creep", "", _flat(motion, share), twist, False)
    plausible = problem.parameters.array("plausible")
    for (joint, family), at in fit.lacking.items():
        name = f"{joint} {family}"
        yield Suspect("model", name, table.velocity[:, at], plausible[at], False)


def waves(fit: Following, suspect: Suspect) -> FloatArray:
    """(6·samples, m) velocity of the tips by other errors of the same encoder, per plausible one.

    Poses in the order of a joint's readings make them come and go in time.
    """
    slips = (each for each in suspects(fit) if each.kind == "slip")
    slip = next((each for each in slips if each.joint == suspect.joint), None)
    if slip is None:
        return np.zeros((len(suspect.motion), 0))
    arm = fit.problem.arm
    assert arm is not None
    joint = arm.joints.index(suspect.joint)
    q = np.concatenate([t.poses.samples.q[:, joint] for t in fit.problem.terms])
    turns = np.outer(q, WAVES)
    shapes = np.repeat(np.hstack([np.cos(turns), np.sin(turns)]), 6, axis=0)
    return np.asarray(TURN * slip.motion * shapes)


def _so_far(first: IntArray) -> Iterator[FloatArray]:
    """(samples,) which share of each term's rows has been measured, zero in all others."""
    for a, b in pairwise(first.tolist()):
        share = np.zeros(first[-1])
        share[a:b] = np.arange(b - a) / (b - a)
        yield share


def _flat(motion: FloatArray, share: FloatArray | float = 1.0) -> FloatArray:
    """(6·samples, k) velocities (samples, 6, k) times how much of them each sample has."""
    whole = motion * np.broadcast_to(share, len(motion))[:, None, None]
    return np.asarray(whole.reshape(-1, motion.shape[2]))


def _rigid(position: FloatArray) -> FloatArray:
    """(n, 6, 6) velocities of tips at points (n, 3) for a unit of every part of a twist."""
    found = np.zeros((len(position), 6, 6))
    found[:, :3, :3] = found[:, 3:, 3:] = np.eye(3)
    found[:, :3, 3:] = -skew(position)
    return found


def most_telling(
    fit: Following, of: Sequence[Suspect], where: Sequence[tuple[int, int, int]]
) -> tuple[list[Telling], int]:
    """Every suspect where it explains most, as one step of everything would have it.

    Args:
        fit: beside which.
        of: suspects.
        where: `stretches` in which those of them may be so that are not so all along.

    Returns:
        Those that the data would tell, least likely by chance first; and how many were tried.
    """
    everywhere = [(0, 0, int(fit.problem.evaluation.table.first[-1]))]
    found, tried = list[Telling](), 0
    for at_once, places in ((True, list(where)), (False, everywhere)):
        asked = [each for each in of if each.at_once == at_once]
        if not asked or not places:
            continue
        sums = _Sums(fit, np.hstack([each.motion for each in asked]), places)
        ends = np.cumsum([0, *(each.motion.shape[1] for each in asked)])
        for each, a, b in zip(asked, ends[:-1], ends[1:], strict=True):
            lowered, told = sums.explained(slice(a, b), each.plausible)
            tried += int(np.count_nonzero(told))
            best = sums.least_likely(lowered, told)
            if best is not None:
                k, p = best
                found.append(Telling(each, *places[k], p, float(lowered[k])))
    return sorted(found, key=lambda each: (each.p, -each.lowered)), tried


@dataclass(frozen=True, eq=False)
class _Sums:
    """Normal equations of columns, reduced by what follows, over each of many stretches.

    Rows count as in `Following.reduction`.

    Attributes:
        fit: beside which.
        motion: (6·samples, c) velocities of the tips.
        places: `stretches`.
    """

    fit: Following
    motion: FloatArray
    places: Sequence[tuple[int, int, int]]

    @cached_property
    def _reduced(self) -> tuple[FloatArray, FloatArray]:
        """Curvature (stretches, c, c) and score (stretches, c) of the columns."""
        fit, count = self.fit, self.motion.shape[1]
        edges = np.unique([edge for _, *ends in self.places for edge in ends])
        width = len(fit.problem.names)
        binned = np.zeros((len(edges) + 1, count, count + width + 1))
        for r in fit.rows:
            n, size = r.line.residual.shape
            own = columns_of(r, self.motion).reshape(n, size, count)
            believed = own * r.line.weight[:, None, None]
            beside = (own, r.jacobian.reshape(n, size, width), -whitened(r)[:, :, None])
            sample = r.line.view.block.samples[:, 0] + r.line.view.first_sample
            number = np.searchsorted(edges, sample, side="right")
            order = np.argsort(number, kind="stable")
            for part in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
                # Rows in the order of their samples, as nearly all are, need no copy.
                a, b = part[[0, -1]]
                rows = slice(a, b + 1) if b - a == len(part) - 1 else part
                some = believed[rows].reshape(-1, count).T
                binned[number[a]] += np.hstack(
                    [some @ each[rows].reshape(-1, each.shape[2]) for each in beside]
                )
        before = np.cumsum(binned, axis=0)
        ends = np.searchsorted(edges, [each[1:] for each in self.places])
        total = before[ends[:, 1]] - before[ends[:, 0]]
        own, cross, score = np.split(total, [count, count + width], axis=2)
        inverse, pull = fit.reduction
        cross = cross[:, :, fit.free]
        follow = cross @ inverse
        curvature = own - follow @ np.swapaxes(cross, 1, 2)
        return curvature, score[:, :, 0] - follow @ pull

    def explained(self, columns: slice, plausible: FloatArray) -> tuple[FloatArray, IntArray]:
        """Squares (stretches,) that columns explain, and how many of them the data would tell."""
        curvature, score = (part[:, columns] for part in self._reduced)
        curvature = curvature[:, :, columns]
        told = np.einsum("nii->ni", curvature) * (TELLING * plausible) ** 2 > 1.0
        scale = np.where(told, plausible, 0.0)
        scaled = curvature * scale[:, :, None] * scale[:, None, :]
        scaled += np.eye(len(plausible))  # What is told is so beyond what is plausible.
        score = score * scale
        step = np.linalg.solve(scaled, score[:, :, None])[:, :, 0]
        return np.einsum("ni,ni->n", score, step), np.sum(told, axis=1)

    @cached_property
    def _squares(self) -> float:
        return sum(float(np.sum(whitened(r) ** 2 * r.line.weight[:, None])) for r in self.fit.rows)

    def least_likely(self, lowered: FloatArray, told: IntArray) -> tuple[int, float] | None:
        """The stretch where so much is explained least likely by chance, and that chance."""
        best: tuple[int, float] | None = None
        for k in np.unique(told[told > 0]).tolist():
            at = int(np.argmax(np.where(told == k, lowered, -np.inf)))
            freedom = self.fit.equations - self.fit.spent - k
            if freedom < 1:
                continue
            # A step of a robust fit may promise more than there is.
            left = max(self._squares - float(lowered[at]), 1e-3 * self._squares)
            p = float(fdtrc(k, freedom, max(float(lowered[at]), 0.0) / k / (left / freedom)))
            if best is None or p < best[1]:
                best = at, p
        return best
