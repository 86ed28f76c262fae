"""Why pairs of poses give no X: one side is constant, misread, or does not belong to the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length, vector_from_rotation
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.loop_start import first_consensus, poses_by
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.sight import Sight
from suta_calib.pose_calibration.undetermined import (
    Role,
    axes_that_stand,
    undetermined_directions,
)
from suta_calib.terms.hand_eye_start import Poses, chordal_mean
from suta_calib.terms.many_eyes_start import SeenTogether, loop_errors
from suta_calib.terms.poses import WANDER, together
from suta_calib.trust.misreadings import Pairs, agreeing_reading
from suta_calib.trust.rule import Rule
from suta_calib.units import deg, from_deg, mm

# Scatter of the loops' ends, in units of the extent, of which instruments of use show less; and
# that of turns, rad, of pairs that do not belong together.
SUSPICIOUS: Final = 0.01
TURNED: Final = from_deg(1.0)
PAIRS: Final = "poses of a hand and of the target that its camera saw, pair by pair"
CAUSES: Final = (
    "do the rows belong together, is the quaternion's order x y z w, is the setup right, and do "
    "both poses map in the documented direction?"
)
# Poses of the targets (n,) with the labels of two eyes, or of two targets, exchanged in all rows.
SeenExchanged = Callable[[Role, int, int], Poses]
WHOSE: Final = ("a pose of the hand (a_)", "a pose of the target (b_)")


def refuse_constant(hand: Poses, eye: Poses) -> None:
    """Refuse pairs of which one side is constant while the other moves, and name it.

    A logger that repeats itself writes such pairs.
    """
    sides = hand, eye
    for whose, side, other, other_name in zip(WHOSE, sides, sides[::-1], WHOSE[::-1], strict=True):
        same = _largest_group(side)
        count, rows = len(same), int(same.sum())
        # Part of the rows that have one pose, from which on it is no point that was visited often;
        # and rows that are left then, of which no X can be found.
        if rows < max(0.8 * count, 3) or not _moves_on(other, same):
            continue
        slid, turned = (float(np.ptp(v, axis=0).max()) for v in _spread(other, same))
        which = f"all {count} rows" if rows == count else f"{rows} of {count} rows"
        raise SamplesError(
            f"{whose} that is the same in {which}, while {other_name} changes by "
            f"{mm(slid):.0f} mm and {deg(turned):.0f}° in them",
            "a new pose in every row",
            hint="did the program that wrote them read this pose only once? Record again",
        )


def _largest_group(poses: Poses) -> BoolArray:
    """(n,) rows of the pose that most rows have, but for the last digits."""
    group = together(np.hstack([poses[1], poses[0].reshape(-1, 9)]), WANDER)
    return np.asarray(group == np.bincount(group).argmax())


def _spread(poses: Poses, rows: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Displacements (k, 3), m, and turns (k, 3), rad, of some rows from their mean."""
    R, p = poses[0][rows], poses[1][rows]
    return p - p.mean(axis=0), vector_from_rotation(chordal_mean(R).T @ R)


def _moves_on(other: Poses, same: BoolArray) -> bool:
    """Whether the other side moves in these rows nearly as much as in all."""
    if _largest_group(other)[same].all():
        return False
    parts = zip(_spread(other, same), _spread(other, np.ones_like(same)), strict=True)
    # A target that is only seen again there has its noise: 5 mm of 200 mm.
    return any(rms_length(part) > 0.3 * rms_length(of_all) for part, of_all in parts)


def refuse_misread(
    consensus: Consensus,
    A: Poses,
    B: Poses,
    length: float,
    other_setup: str,
    start: Callable[[Poses, Poses], Consensus],
    rule: Rule,
) -> None:
    """Refuse poses that agree if they are read in another way, and name this way.

    Args:
        consensus: what `start` says of the poses as they are.
        A: poses of the hand, in units of the extent.
        B: the same of the target.
        length: the extent, m.
        other_setup: the one that was not asked for.
        start: how the loops of poses scatter, in units of the extent and rad.
        rule: how much better is far better.
    """
    if consensus.sigmas[0] < SUSPICIOUS:
        return
    scatter = float(consensus.sigmas[0])
    reading = agreeing_reading(
        Pairs(A, B), scatter, lambda pairs: start(pairs.hand, pairs.seen).sigmas, rule
    )
    if reading is not None:
        description, slid, turned = reading
        close = f"{mm(length * slid):.1f} mm and {deg(turned):.2f}°"
        cause = description.format(other=other_setup)
        raise _disagreement(consensus, length, f"they agree to {close} {cause}")


def refuse_strangers(
    fit: RobustFit,
    start: Consensus,
    hand: FloatArray,
    length: float,
    more: Mapping[str, Sequence[FloatArray]],
    parts: Sequence[BoolArray],
) -> None:
    """Refuse pairs of which nothing fits: what they leave open is not the trouble then.

    Args:
        fit: of the pairs.
        start: how their loops scatter before it, in units of ``length``.
        hand: (n, 3, 3) orientations of the hand.
        length: the extent, m.
        more: by eye, directions of X that are undetermined beside what the solution holds.
        parts: (n,) rows of each part of the graph of eyes and targets.
    """
    # Scatter of turns from which on pairs do not agree at all.
    no_agreement = from_deg(10.0)
    if fit.sigmas[1] > no_agreement:
        loops = f"loops A X B that differ by {deg(fit.sigmas[1]):.0f}° about every axis"
        raise SamplesError(loops, PAIRS, hint=CAUSES)
    slid, turned = start.sigmas
    # Of the positions that the best X leaves: 5 mm and 2° of noise, 0.3 m from the point that is
    # measured, make 0.02 of the extent; exchanged columns 0.08.
    unrelated = fit.sigmas[0] > 0.05 or any(
        undetermined_directions(fit.solution, eye, directions) for eye, directions in more.items()
    )
    if not ((slid > 0.1 or turned > no_agreement) and unrelated):
        return
    if turned > TURNED:
        raise _disagreement(start, length, CAUSES)
    # Along an axis that nothing turns X is open, and so is what a consensus makes of it.
    parts = [fit.inliers & part for part in parts]
    if not any(len(axes_that_stand(hand[part], fit.sigmas[1])) for part in parts if part.any()):
        places = (
            "the rotations agree, but the positions do not: are both in the same unit, and their "
            "columns in the order x y z?"
        )
        raise _disagreement(start, length, places)


def refuse_apart(start: Consensus) -> None:
    """Refuse eyes and targets of which each two agree by themselves, but not all together."""
    agreeing, count = int(start.inliers.sum()), len(start.inliers)
    # Part of the rows that a few eyes or targets that moved leave.
    if agreeing >= max(0.3 * count, 3):
        return
    raise SamplesError(
        f"eyes and targets of which each two agree by themselves, but together only {agreeing} of "
        f"{count} rows",
        "one place for every eye and every target in all rows",
        hint="was an eye or a target moved while rows were measured, or has one label two "
        "meanings? Calibrate parts of the rows to find out",
    )


def refuse_exchanged(
    start: Consensus,
    A: Poses,
    B: Poses,
    sight: Sight,
    seed: int | None,
    numbers: IntArray | None = None,
    seen_exchanged: SeenExchanged | None = None,
    images: Sequence[str] = (),
) -> None:
    """Refuse rows that agree once two labels are exchanged from a row on, and name them.

    One half of the rows is before the exchange, or after it: its poses tell of every row of two
    eyes, or of two targets, whether its own label or the other's fits better. ``numbers``
    (n,) of the rows in their file are their order by default. ``seen_exchanged`` is for poses that
    depend on the label, as of pictures, which are read with the camera that it names; ``images``
    has the names of pictures by the number of their row.
    """
    count, together = len(A[1]), sight.together
    lost = 1.0 - float(start.inliers.mean())
    # Part of the rows that a few accidents may be; unless everything is off.
    if lost < 0.1 and start.sigmas[0] < SUSPICIOUS and start.sigmas[1] < TURNED:
        return
    everywhere = np.arange(count)
    exchanges = [
        (
            (role, a, b),
            B if seen_exchanged is None else seen_exchanged(role, a, b),
            _exchanged(together, role, a, b, everywhere),
        )
        for role, names, _ in sight.sides
        for a, b in combinations(range(len(names)), 2)
    ]
    best, which = (0.0, 0), -1
    for late, half in enumerate(np.array_split(np.arange(count), 2)):
        X, Z = poses_by(A, B, together, half)
        errors = loop_errors(A, B, X, Z, together)
        units = [max(float(np.median(np.linalg.norm(e[half], axis=1))), 1e-9) for e in errors]
        for k, (_, seen, swapped) in enumerate(exchanges):
            other = loop_errors(A, seen, X, Z, swapped)
            # What is gained by an exchange of all rows before, or from, each row on.
            sums = np.cumsum([0.0, *(_squared(errors, units) - _squared(other, units))])
            total = sums if late else sums[-1] - sums
            row = int(np.argmax(total))
            if total[row] > best[0]:
                best, which = (float(total[row]), row), k
    if which < 0:
        return
    (_, row), ((what, a, b), seen, _) = best, exchanges[which]
    read = _exchanged(together, what, a, b, np.arange(row, count))
    B_read = _from_row(B, seen, row)
    again = first_consensus(A, B_read, read, seed)
    agree = np.sum((again.sigmas / np.maximum(start.sigmas, 1e-300)) ** 2) < 2.0 * 1.5**2
    better = (
        1.0 - float(again.inliers.mean()) < 0.4 * lost or again.sigmas[0] < 0.2 * start.sigmas[0]
    )
    # Rows of the two before and after it, below which it is an accident.
    few = 3
    moved = _swapped(together, what, a, b)
    if agree and better and min(int(moved[:row].sum()), int(moved[row:].sum())) >= few:
        names = sight.eyes if what == "eye" else sight.targets
        rows = np.arange(count) if numbers is None else numbers
        since = _since(A, (B, seen, B_read), (together, read), again, (what, a, b), rows, images)
        counted = "" if images else " (rows from 0)"
        raise SamplesError(
            f"rows that agree only if {what}s {names[a]} and {names[b]} are exchanged "
            f"{since}{counted}: {int(start.inliers.sum())} of {count} rows agree within "
            f"{deg(start.sigmas[1]):.2f}° per axis as they are, and {int(again.inliers.sum())} "
            f"within {deg(again.sigmas[1]):.2f}° then",
            f"labels that mean the same {what} in all rows",
            hint=f"exchange the labels {names[a]} and {names[b]} {since}, or before it, "
            "and find out when cables, ports or names were exchanged",
        )


def _since(
    A: Poses,
    seen: tuple[Poses, Poses, Poses],
    labels: tuple[SeenTogether, SeenTogether],
    again: Consensus,
    exchanged: tuple[Role, int, int],
    numbers: IntArray,
    images: Sequence[str],
) -> str:
    """From which row on labels are exchanged, or between which it happened, in words.

    Args:
        A: poses of the hand, or their inverses.
        seen: of the targets, by the labels as they were given, exchanged in all rows, and as read.
        labels: as they were given, and as they are read once they are exchanged.
        again: what agrees then: X and Z of those rows tell of every row which label fits.
        exchanged: the role, and the two whose labels were exchanged.
        numbers: (n,) of the rows in their file; those of one number are of one instant.
        images: names of pictures by these numbers; empty if rows have none.
    """
    given, read = labels
    count = len(A[1])
    B, B_exchanged, B_read = seen
    X, Z = poses_by(A, B_read, read, again.inliers)
    sizes = [np.linalg.norm(e, axis=1) for e in loop_errors(A, B_read, X, Z, read)]
    units = [max(float(np.median(size[again.inliers])), 1e-9) for size in sizes]
    other = _exchanged(given, *exchanged, np.arange(count))
    own = _squared(loop_errors(A, B, X, Z, given), units)
    swapped = _squared(loop_errors(A, B_exchanged, X, Z, other), units)
    # Twice the logarithm of the likelihood of a change before each row, but for a constant, in
    # units of the median error of a row.
    likely = np.cumsum([0.0, *(swapped - own)])[:-1]
    may_be = np.flatnonzero(_swapped(given, *exchanged))
    may_be = may_be[np.unique(numbers[may_be], return_index=True)[1]]
    # A change is ruled out that is e⁷ times less likely than the likeliest, about one in a
    # thousand: the median of three normal errors is 1.54 standard deviations.
    doubt = 2.0 * 7.0 / 1.54**2
    likely, may_be = likely[may_be], numbers[may_be]
    possible = np.flatnonzero(likely > likely.max() - doubt)
    first, last = int(possible[0]), int(possible[-1])
    before, latest = (may_be[k] for k in (max(first - 1, 0), last))
    what = "picture" if images else "row"
    names = [images[number] if images else number for number in (before, latest)]
    if first == last:
        return f"from {what} {names[1]} on"
    return f"from a {what} between {names[0]} and {names[1]} on"


def _swapped(together: SeenTogether, role: str, a: int, b: int) -> BoolArray:
    """(n,) rows that look at one of two eyes, or of two targets."""
    which = together.eye if role == "eye" else together.target
    return np.asarray((which == a) | (which == b))


def _exchanged(together: SeenTogether, role: str, a: int, b: int, rows: IntArray) -> SeenTogether:
    """The same with the labels of two eyes, or of two targets, exchanged in some rows."""
    eye, target = together.eye.copy(), together.target.copy()
    which = eye if role == "eye" else target
    part = which[rows]
    which[rows] = np.where(part == a, b, np.where(part == b, a, part))
    return SeenTogether(eye, target, together.eyes, together.targets)


def _from_row(before: Poses, after: Poses, row: int) -> Poses:
    """The poses of one set up to a row, and of another from it on."""
    R, p = (np.concatenate([x[:row], y[row:]]) for x, y in zip(before, after, strict=True))
    return R, p


def _squared(errors: Sequence[FloatArray], units: Sequence[float]) -> FloatArray:
    """(n,) squared errors of rows in these units; no row counts for more than a wrong one."""
    # Units beyond which a row is simply wrong.
    most = 5.0
    sizes = (np.linalg.norm(e, axis=1) / unit for e, unit in zip(errors, units, strict=True))
    return np.asarray(sum(np.minimum(size, most) ** 2 for size in sizes))


def _disagreement(consensus: Consensus, length: float, hint: str) -> SamplesError:
    return SamplesError(
        "pairs of poses that do not agree with any X: the ends of the loops A X B scatter by "
        f"{mm(length * consensus.sigmas[0]):.0f} mm and {deg(consensus.sigmas[1]):.1f}° per axis",
        PAIRS,
        hint=hint,
    )
