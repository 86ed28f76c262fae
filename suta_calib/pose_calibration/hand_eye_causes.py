"""Why pairs of poses give no X: one side is constant, misread, or does not belong to the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length, vector_from_rotation
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.robot_noise import EYE
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.undetermined import axes_that_stand, undetermined_directions
from suta_calib.terms.hand_eye_start import Poses, chordal_mean
from suta_calib.terms.poses import WANDER, together
from suta_calib.trust.misreadings import Pairs, agreeing_reading
from suta_calib.trust.rule import Rule
from suta_calib.units import deg, from_deg, mm

# Scatter of the loops' ends, in units of the extent, of which instruments of use show less; and
# that of turns, rad, of pairs that do not belong together.
SUSPICIOUS: Final = 0.01
TURNED: Final = from_deg(1.0)
NO_AGREEMENT: Final = from_deg(10.0)
PAIRS: Final = "poses of a hand and of the target that its camera saw, pair by pair"
CAUSES: Final = (
    "do the rows belong together, is the quaternion's order x y z w, is the setup right, and do "
    "both poses map in the documented direction?"
)
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
    more: Sequence[FloatArray] = (),
) -> None:
    """Refuse pairs of which nothing fits: what they leave open is not the trouble then.

    Args:
        fit: of the pairs.
        start: how their loops scatter before it, in units of ``length``.
        hand: (n, 3, 3) orientations of the hand.
        length: the extent, m.
        more: directions of X that are undetermined beside what the solution holds.
    """
    if fit.sigmas[1] > NO_AGREEMENT:
        loops = f"loops A X B that differ by {deg(fit.sigmas[1]):.0f}° about every axis"
        raise SamplesError(loops, PAIRS, hint=CAUSES)
    slid, turned = start.sigmas
    # Of the positions that the best X leaves: 5 mm and 2° of noise, 0.3 m from the point that is
    # measured, make 0.02 of the extent; exchanged columns 0.08.
    unrelated = fit.sigmas[0] > 0.05 or undetermined_directions(fit.solution, EYE, more)
    if not ((slid > 0.1 or turned > NO_AGREEMENT) and unrelated):
        return
    if turned > TURNED:
        raise _disagreement(start, length, CAUSES)
    # Along an axis that nothing turns X is open, and so is what a consensus makes of it.
    if not len(axes_that_stand(hand[fit.inliers], fit.sigmas[1])):
        places = (
            "the rotations agree, but the positions do not: are both in the same unit, and their "
            "columns in the order x y z?"
        )
        raise _disagreement(start, length, places)


def _disagreement(consensus: Consensus, length: float, hint: str) -> SamplesError:
    return SamplesError(
        "pairs of poses that do not agree with any X: the ends of the loops A X B scatter by "
        f"{mm(length * consensus.sigmas[0]):.0f} mm and {deg(consensus.sigmas[1]):.1f}° per axis",
        PAIRS,
        hint=hint,
    )
