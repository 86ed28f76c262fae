"""Why pairs of poses agree with no X: another order of a quaternion, poses the wrong way round.

The angle by which hand and eye turn between two pairs is the same whatever X is, but it tells none
of these: a pose and its inverse turn by the same angle, and so do quaternions whose numbers are
exchanged in the same way everywhere. What tells them is whether an X closes all loops ``A X B``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.robot_noise import EYE
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.undetermined import undetermined_directions
from suta_calib.terms.hand_eye_start import Poses, inverse_poses
from suta_calib.units import deg, from_deg, mm

# Scatter of the loops' ends, in units of the extent, of which instruments of use show less; and
# that, with turns (rad) of some degrees, or turns alone, of pairs that do not belong together.
SUSPICIOUS: Final = 0.01
STRANGERS: Final = 0.1
TURNED: Final = from_deg(1.0)
NO_AGREEMENT: Final = from_deg(10.0)
# Another reading of the poses is what they are if its loops close so many times better, and turns
# (rad) no worse than this.
FAR_BETTER: Final = 5.0
TURNS_AGREE: Final = from_deg(5.0)
# Pairs that are enough to tell one reading from another.
MOST_PAIRS: Final = 200
CAUSES: Final = (
    "do the rows belong together, is the quaternion's order x y z w, is it the right setup, and do "
    "both poses map in the direction asked for?"
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
    rows = np.unique(np.linspace(0, len(A[1]) - 1, MOST_PAIRS).astype(np.intp))
    A, B = (A[0][rows], A[1][rows]), (B[0][rows], B[1][rows])
    readings = _readings(A, B, other_setup)
    tried = [(start(hand, seen), change) for change, hand, seen in readings]
    best, change = min(tried, key=lambda pair: float(pair[0].sigmas[0]))
    if FAR_BETTER * best.sigmas[0] < found.sigmas[0] and best.sigmas[1] < TURNS_AGREE:
        close = f"{mm(length * best.sigmas[0]):.1f} mm and {deg(best.sigmas[1]):.2f}°"
        raise _disagreement(found, length, f"they agree with one to {close} {change}")


def refuse_strangers(fit: RobustFit, start: Consensus, length: float) -> None:
    """Refuse pairs of which nothing fits (``start`` before the fit, in units of ``length``).

    What they leave open is not the trouble then.
    """
    if fit.sigmas[1] > NO_AGREEMENT:
        raise SamplesError(
            f"loops A X B that differ by {deg(fit.sigmas[1]):.0f}° about every axis",
            "poses of a hand and of what its eye saw, pair by pair",
            hint=CAUSES,
        )
    slid, turned = start.sigmas
    apart = (slid > STRANGERS and turned > TURNED) or turned > NO_AGREEMENT
    if apart and undetermined_directions(fit.solution, EYE):
        raise _disagreement(start, length, CAUSES)


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


def _reordered(poses: Poses) -> Poses:
    """Poses whose quaternions were read x y z w from w x y z."""
    quaternion = quaternion_from_rotation(poses[0])
    return rotation_from_quaternion(np.roll(quaternion, -1, axis=1)), poses[1]
