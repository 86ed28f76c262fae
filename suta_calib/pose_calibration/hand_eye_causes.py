"""Why pairs of poses agree with no X: quaternions in another order, other units, rows shifted.

The angle by which hand and eye turn between two pairs is the same whatever X is, but it tells none
of these: a pose and its inverse turn by the same angle, and so do quaternions whose numbers are
exchanged in the same way everywhere. What tells them is whether an X closes all loops ``A X B``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.robot_noise import EYE
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.undetermined import axes_that_stand, undetermined_directions
from suta_calib.terms.hand_eye_start import Poses, inverse_poses, some_poses
from suta_calib.units import deg, from_deg, mm
from suta_calib.words import listed

# Scatter of the loops' ends, in units of the extent, of which instruments of use show less; and
# that, with turns (rad) of some degrees, or turns alone, of pairs that do not belong together.
SUSPICIOUS: Final = 0.01
STRANGERS: Final = 0.1
TURNED: Final = from_deg(1.0)
# Scatter of positions that the best X leaves, in the same units: 5 mm and 2° of noise, 0.3 m from
# the point that is measured, make 0.02 of it; exchanged columns 0.08.
UNRELATED: Final = 0.05
NO_AGREEMENT: Final = from_deg(10.0)
# Another reading of the poses is what they are if its loops close so many times better, and turns
# (rad) no worse than this.
FAR_BETTER: Final = 5.0
TURNS_AGREE: Final = from_deg(5.0)
# Pairs that are enough to tell one reading from another; rows by which they may be shifted; and
# pairs that must be left then, for of a few some shift may always seem to fit.
MOST_PAIRS: Final = 200
MOST_SHIFT: Final = 5
LEAST_PAIRS: Final = 8
# Units that positions may be in where m is asked for, m.
UNITS: Final = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}
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
    found: Consensus, A: Poses, B: Poses, length: float, other_setup: str, start: Start
) -> None:
    """Refuse poses that fit together as soon as they are read in another way, which it names.

    Args:
        found: what `start` says of the poses as they are.
        A: poses of the hand, in units of the extent.
        B: the same of the target.
        length: the extent, m.
        other_setup: the one that was not asked for.
        start: how the loops of poses scatter, in units of the extent and rad.
    """
    if found.sigmas[0] < SUSPICIOUS:
        return
    rows = _some(np.arange(len(A[1])))
    hand, seen = some_poses(A, rows), some_poses(B, rows)
    readings = [
        *((1.0, *each) for each in _readings(hand, seen, other_setup)),
        *_in_other_units(hand, seen),
        *((1.0, *each) for each in _in_other_rows(A, B)),
    ]
    tried = [(start(hand, seen), unit, change) for unit, change, hand, seen in readings]
    best, unit, change = min(tried, key=lambda each: float(each[0].sigmas[0]))
    if FAR_BETTER * best.sigmas[0] < found.sigmas[0] and best.sigmas[1] < TURNS_AGREE:
        close = f"{mm(unit * length * best.sigmas[0]):.1f} mm and {deg(best.sigmas[1]):.2f}°"
        raise _disagreement(found, length, f"they agree with one to {close} {change}")


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
    apart = slid > STRANGERS or turned > NO_AGREEMENT
    unrelated = fit.sigmas[0] > UNRELATED or undetermined_directions(fit.solution, EYE, more)
    if not (apart and unrelated):
        return
    if turned > TURNED:
        raise _disagreement(start, length, CAUSES)
    # Along an axis that nothing turns X is open, and so is what a consensus makes of it.
    if not len(axes_that_stand(hand[fit.inliers], fit.sigmas[1])):
        raise _disagreement(start, length, OF_PLACES)


def _disagreement(found: Consensus, length: float, hint: str) -> SamplesError:
    return SamplesError(
        "pairs of poses that do not agree with any X: the ends of the loops A X B scatter by "
        f"{mm(length * found.sigmas[0]):.0f} mm and {deg(found.sigmas[1]):.1f}° per axis",
        "poses of a hand and of what its eye saw, pair by pair",
        hint=hint,
    )


def _readings(A: Poses, B: Poses, other_setup: str) -> Iterator[tuple[str, Poses, Poses]]:
    """What would have to be changed, and the poses then; all the other ways to read them.

    With both poses the other way round X and Z only change places.
    """
    turned = f"if setup is {other_setup}, or else if the hand's or the eye's poses are inverted"
    orders = {
        "": (A, B),
        "the hand's quaternions": (_reordered(A), B),
        "the eye's quaternions": (A, _reordered(B)),
        "all quaternions": (_reordered(A), _reordered(B)),
    }
    for whose, (hand, eye) in orders.items():
        order = f"if {whose} are in the order w x y z" if whose else ""
        if order:
            yield order, hand, eye
        yield " and ".join(filter(None, (order, turned))), inverse_poses(hand), eye
    for whose, hand, eye in (
        ("the hand's", (np.swapaxes(A[0], 1, 2), A[1]), B),
        ("the eye's", A, (np.swapaxes(B[0], 1, 2), B[1])),
    ):
        yield f"if {whose} rotations are transposed, its positions not", hand, eye
    for signs in product((1.0, -1.0), repeat=3):
        axes = [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0.0]
        # All three are what a left-handed frame makes of them, turned.
        if 0 < len(axes) < 3:
            told = f"if {listed(axes)} of the eye's positions {'have' if axes[1:] else 'has'}"
            yield f"{told} the wrong sign, its rotations not", A, (B[0], B[1] * np.array(signs))
    # That of the hand is the same, with X and Z mirrored.
    mirror = np.array([-1.0, 1.0, 1.0])
    seen = B[0] * np.outer(mirror, mirror), B[1] * mirror
    yield "if the hand's or the eye's frame is left-handed", A, seen


def _in_other_units(A: Poses, B: Poses) -> Iterator[tuple[float, str, Poses, Poses]]:
    """The same, behind the unit (m), for positions that are in another than those of the other.

    What is in the smaller unit is left as it is, so that loops are as large as before.
    """
    for name, unit in UNITS.items():
        told = f"if the {{}}'s positions are in {name}, the {{}}'s in m"
        yield unit, told.format("hand", "eye"), A, (B[0], B[1] / unit)
        yield unit, told.format("eye", "hand"), (A[0], A[1] / unit), B


def _in_other_rows(A: Poses, B: Poses) -> Iterator[tuple[str, Poses, Poses]]:
    """The same for pairs whose poses stand in other rows."""
    count = len(A[1])
    for rows in range(1, min(MOST_SHIFT, count - LEAST_PAIRS) + 1):
        first, last = _some(np.arange(count - rows)), _some(np.arange(rows, count))
        told = "a row" if rows == 1 else f"{rows} rows"
        yield f"if what the eye saw is {told} late", some_poses(A, first), some_poses(B, last)
        yield f"if what the eye saw is {told} early", some_poses(A, last), some_poses(B, first)
    some = _some(np.arange(count))
    backwards = some_poses(B, count - 1 - some)
    yield "if what the eye saw is in the opposite order", some_poses(A, some), backwards


def _some(rows: IntArray) -> IntArray:
    """`MOST_PAIRS` of the rows at most."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, MOST_PAIRS).astype(np.intp))]


def _reordered(poses: Poses) -> Poses:
    """Poses whose quaternions were read x y z w from w x y z."""
    quaternion = quaternion_from_rotation(poses[0])
    return rotation_from_quaternion(np.roll(quaternion, -1, axis=1)), poses[1]
