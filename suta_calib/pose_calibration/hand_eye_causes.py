"""Why pairs of poses agree with no X: they are read wrongly, or do not belong together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.robot_noise import EYE
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.undetermined import axes_that_stand, undetermined_directions
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.pair_readings import Pairs, agreeing_reading
from suta_calib.trust.rule import Rule
from suta_calib.units import deg, from_deg, mm

# Scatter of the loops' ends, in units of the extent, of which instruments of use show less; and
# that, with turns (rad) of some degrees, or turns alone, of pairs that do not belong together.
SUSPICIOUS: Final = 0.01
STRANGERS: Final = 0.1
TURNED: Final = from_deg(1.0)
# Scatter of positions that the best X leaves, in the same units: 5 mm and 2° of noise, 0.3 m from
# the point that is measured, make 0.02 of it; exchanged columns 0.08.
UNRELATED: Final = 0.05
NO_AGREEMENT: Final = from_deg(10.0)
CAUSES: Final = (
    "do the rows belong together, is the quaternion's order x y z w, is it the right setup, and do "
    "both poses map in the direction asked for?"
)

OF_PLACES: Final = (
    "the turns of both agree, the positions do not: are both in the same unit, and their columns "
    "in the order x y z?"
)

# The consensus of pairs of poses, hand and target.
Start = Callable[[Poses, Poses], Consensus]


def refuse_misread(
    consensus: Consensus,
    A: Poses,
    B: Poses,
    length: float,
    other_setup: str,
    start: Start,
    rule: Rule,
) -> None:
    """Refuse poses that fit together as soon as they are read in another way, which it names.

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
        slid, turned = reading.scatter
        close = f"{mm(length * slid):.1f} mm and {deg(turned):.2f}°"
        cause = reading.description.format(other=other_setup)
        raise _disagreement(consensus, length, f"they agree with one to {close} {cause}")


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
        raise SamplesError(
            f"loops A X B that differ by {deg(fit.sigmas[1]):.0f}° about every axis",
            "poses of a hand and of what its eye saw, pair by pair",
            hint=CAUSES,
        )
    slid, turned = start.sigmas
    disagree = slid > STRANGERS or turned > NO_AGREEMENT
    unrelated = fit.sigmas[0] > UNRELATED or undetermined_directions(fit.solution, EYE, more)
    if not (disagree and unrelated):
        return
    if turned > TURNED:
        raise _disagreement(start, length, CAUSES)
    # Along an axis that nothing turns X is open, and so is what a consensus makes of it.
    if not len(axes_that_stand(hand[fit.inliers], fit.sigmas[1])):
        raise _disagreement(start, length, OF_PLACES)


def _disagreement(consensus: Consensus, length: float, hint: str) -> SamplesError:
    return SamplesError(
        "pairs of poses that do not agree with any X: the ends of the loops A X B scatter by "
        f"{mm(length * consensus.sigmas[0]):.0f} mm and {deg(consensus.sigmas[1]):.1f}° per axis",
        "poses of a hand and of what its eye saw, pair by pair",
        hint=hint,
    )
