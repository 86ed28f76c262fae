"""``A_i X B_i = Z`` solved robustly, of one eye and one target or of several, and judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.geometry.numbers import (
    extent,
    rms_length,
    rotation_from_vector,
    tangent_of_poses,
    vector_from_rotation,
)
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.hand_eye_causes import (
    SeenExchanged,
    refuse_apart,
    refuse_constant,
    refuse_exchanged,
    refuse_misread,
    refuse_strangers,
)
from suta_calib.pose_calibration.inputs import checked_poses, error_context
from suta_calib.pose_calibration.loop_start import FEW_PAIRS, NEEDED, first_consensus
from suta_calib.pose_calibration.robot_noise import RobotNoise, noise_made_directions
from suta_calib.pose_calibration.robust_fit import MOST_ROWS, ROUNDING, RobustFit, robust_fit
from suta_calib.pose_calibration.shared_hand import share_hand
from suta_calib.pose_calibration.sight import Sight
from suta_calib.pose_calibration.undetermined import (
    NotFound,
    Role,
    axes_that_stand,
    refuse_undetermined,
    undetermined_directions,
)
from suta_calib.solver.solution import Solution
from suta_calib.terms.hand_eye_start import EyeSetup, Poses, as_eye_in_hand, some_poses
from suta_calib.terms.many_eyes_start import SeenTogether, loop_errors
from suta_calib.terms.poses import together
from suta_calib.trust.examination import Examination
from suta_calib.trust.hypotheses.depth_scale import DepthScale
from suta_calib.trust.hypothesis import Finding, weigh
from suta_calib.trust.rule import Rule
from suta_calib.units import from_deg

# What makes X known.
ADVICE: Final = "turn the hand about at least two axes that are not parallel"


def checked_pairs(
    hand: tuple[ArrayLike, ArrayLike], seen: tuple[ArrayLike, ArrayLike], setup: EyeSetup
) -> tuple[Poses, Poses]:
    """Pairs of poses that may be calibrated with; `SamplesError` or `ParameterError` else."""
    A, B = checked_poses(*hand, "hand"), checked_poses(*seen, "seen")
    if setup not in get_args(EyeSetup):
        raise ParameterError(f"setup {setup!r}", f"one of {', '.join(get_args(EyeSetup))}")
    if len(A[1]) != len(B[1]):
        raise SamplesError(
            f"{len(A[1])} poses of the hand and {len(B[1])} of the target",
            "the same number of both",
        )
    if len(A[1]) < NEEDED:
        raise SamplesError(
            f"{len(A[1])} pairs of poses", f"at least {NEEDED}, turned about different axes"
        )
    return A, B


@dataclass(frozen=True, eq=False)
class LoopFit:
    """All X and Z, with what is known of them.

    Attributes:
        fit: in units of `length`.
        solution: the same; where eyes share the hand's errors, of its poses less these.
        length: m per unit.
        X, Z: of every eye and of every target, m.
        covariance: of displacements (m, outer axes) and small turns (rad, own axes) of all X, then
            of all Z.
        slid, turned: (n, 3) of every loop against its Z: m, outer axes, and rad, target's axes.
        axes: (n - 1, 3) rotation vectors of the hand's consecutive motions, rad.
        robot_noise_fraction: part of the rotational noise that seems to be the hand's, 0 to 1.
        copies: how many of the pairs that were fitted repeat another.
        examination: prepared for the hypotheses about wrong data.
        weighed: the evidence on them.
        failed: what of judging failed, one sentence each.
        sight: which eye saw which target, of those that were found.
        numbers: (n,) of the pairs in their file, from 0: those of what was found.
        not_found: eyes and targets whose pose the pairs do not give.
        noise: (1 + eyes, 2) of the hand and of each eye, m and rad; None where it is not known.
    """

    fit: RobustFit
    solution: Solution
    length: float
    X: Poses
    Z: Poses
    covariance: FloatArray
    slid: FloatArray
    turned: FloatArray
    axes: FloatArray
    robot_noise_fraction: float
    copies: int
    examination: Examination
    weighed: tuple[Finding, ...]
    failed: tuple[str, ...]
    sight: Sight
    numbers: IntArray
    not_found: tuple[NotFound, ...] = ()
    noise: FloatArray | None = None

    @property
    def attributes(self) -> dict[str, Any]:
        """Those that a `LoopAnswer` has of it."""
        return {
            "covariance": self.covariance,
            "residuals": self.slid,
            "rotation_residuals": self.turned,
            "inliers": self.fit.inliers,
            "suspects": self.fit.suspects,
            "axes": self.axes,
            "robot_noise_fraction": self.robot_noise_fraction,
            "copies": self.copies,
            "solution": self.solution,
            "length": self.length,
            "unjudged": self.failed,
            "examination": self.examination,
            "weighed": self.weighed,
            "numbers": self.numbers,
            "scatter": self.fit.scatter,
        }


def fit_loops(
    hand: Poses,
    seen: Poses,
    sight: Sight,
    setup: EyeSetup,
    *,
    robust: bool,
    seed: int,
    rule: Rule,
    numbers: IntArray | None = None,
) -> LoopFit:
    """Closed form, from a consensus of the pairs, then robustly on SE(3).

    Args:
        hand: ``T_base_hand``.
        seen: ``T_eye_target``.
        sight: which eye saw which target.
        setup: where the eyes are; the targets are on the other.
        robust: False for least squares over all pairs.
        seed: of the minimal samples.
        rule: when a hypothesis about wrong data is reported.
        numbers: (n,) of the pairs in their file, if they are not all of it.

    Raises:
        SamplesError: pairs that agree with no X, with what would make them agree; or motions that
            leave every X open, with the directions.
    """
    numbers = np.arange(len(hand[1]), dtype=np.intp) if numbers is None else numbers
    _refuse_constant(hand, seen, sight)
    A, B = as_eye_in_hand(hand, setup), seen
    length, centre, scaled, target = _in_units(A, B)
    few = len(A[1]) < FEW_PAIRS
    chosen = seed if robust and not few else None
    _refuse_misread(A, B, sight, setup, chosen, rule)
    start = first_consensus(scaled, target, sight.together, chosen)
    if not sight.one:
        refuse_exchanged(start, scaled, target, sight, chosen, numbers)
        refuse_apart(start)
    # No hand and no eye is believed to turn more exactly than this when turns are weighed against
    # displacements: what is smaller repeats well, but is an error of the instruments all the same.
    finest_turn = from_deg(0.1)
    noise = RobotNoise(scaled, target, finest_turn, sight.labels)
    # In units of the extent few positions are taken to scatter by this at least.
    floors = (5e-4 if few else 0.0, finest_turn)
    fit = robust_fit(noise.make, start, floors, robust=robust, revise=noise.revise)
    if noise.moves_targets and not noise.explains(fit):
        noise.forget()
        fit = robust_fit(noise.make, start, floors, robust=robust)
    eyes = len(sight.eyes)
    made_by_noise = [noise_made_directions(fit, noise, k) for k in range(eyes)]
    more = dict(zip(sight.owners()[0], made_by_noise, strict=True))
    refuse_strangers(fit, start, A[0], length, more, sight.parts)
    lost = _not_found(fit, A[0], sight, made_by_noise)
    if lost:
        rows = np.flatnonzero(~_looking_at(lost, sight))
        if not len(rows):
            raise SamplesError(
                f"poses that determine no eye. {lost[0].sentence}",
                "poses turned by tens of degrees about at least two different axes",
            )
        rest = sight.of_rows(rows)
        lost += _without_partners(sight, rest, lost)
        pairs = some_poses(hand, rows), some_poses(seen, rows)
        again = fit_loops(
            *pairs, rest, setup, robust=robust, seed=seed, rule=rule, numbers=numbers[rows]
        )
        return replace(again, not_found=(*lost, *again.not_found))
    failed = list[str]()
    shared = share_hand(fit, noise, -centre / length, floors) if eyes > 1 else None
    rows_alike = 1.0 if shared is None else shared.rows_alike
    answer = fit.examined(length, "pairs", sight.called(setup), numbers, sight.seen_by, rows_alike)
    weighed = weigh(answer, failed)
    far = next((f for f in weighed if f.hypothesis.name == DepthScale.name), None)
    explained: tuple[FloatArray, ...] = ()
    followed = np.zeros_like(fit.covariance)
    if far is not None and far.supported(rule):
        change = far.evidence.explained(answer.plain_fit).reshape(len(fit.sigmas), -1, 3)
        explained = tuple(-s * part for s, part in zip(fit.sigmas, change, strict=True))
        followed = fit.followed(far.evidence)
    if shared is not None and explained:
        explained_rows = zip(explained, noise.relative[fit.inliers].T[..., None], strict=True)
        measured = [part * relative for part, relative in explained_rows]
        shared = share_hand(fit, noise, -centre / length, floors, measured)
    solution = fit.solution if shared is None else shared.solution
    spread = fit.spread(explained) if shared is None else shared.covariance
    poses = solution.x.reshape(-1, 6)
    rotations, places = rotation_from_vector(poses[:, 3:]), poses[:, :3] * length
    X = rotations[:eyes], places[:eyes]
    Z = rotations[eyes:], places[eyes:] + centre
    slid, turned = loop_errors(A, B, X, Z, sight.together)
    jacobian = tangent_of_poses(solution.x, length)
    return LoopFit(
        fit=fit,
        solution=solution,
        length=length,
        X=X,
        Z=Z,
        covariance=jacobian @ (spread + followed) @ jacobian.T,
        slid=slid,
        turned=turned,
        axes=vector_from_rotation(np.swapaxes(A[0][1:], 1, 2) @ A[0][:-1]),
        robot_noise_fraction=noise.lever.fraction,
        copies=_copies(scaled, target, sight.together, fit),
        examination=answer,
        weighed=tuple(weighed),
        failed=tuple(failed),
        sight=sight,
        numbers=numbers,
        noise=None if shared is None else shared.noise * [length, 1.0],
    )


def _in_units(A: Poses, B: Poses) -> tuple[float, FloatArray, Poses, Poses]:
    """How large all this is, m, the middle of the hand, and both in units and from there.

    Lengths are solved in units of the extent, so that none counts.
    """
    length = extent(A[1]) + rms_length(B[1]) or 1.0
    centre = A[1].mean(axis=0)
    return length, centre, (A[0], (A[1] - centre) / length), (B[0], B[1] / length)


def refuse_exchanged_labels(
    hand: Poses,
    seen: Poses,
    sight: Sight,
    setup: EyeSetup,
    seed: int | None,
    numbers: IntArray,
    seen_exchanged: SeenExchanged,
    images: Sequence[str],
) -> None:
    """`refuse_exchanged` of pairs of poses (n,) in order, whose rows have these numbers (n,)."""
    length, _, scaled, target = _in_units(as_eye_in_hand(hand, setup), seen)

    def in_units(role: Role, a: int, b: int) -> Poses:
        R, p = seen_exchanged(role, a, b)
        return R, p / length

    start = first_consensus(scaled, target, sight.together, seed)
    refuse_exchanged(start, scaled, target, sight, seed, numbers, in_units, images)


def _refuse_constant(hand: Poses, seen: Poses, sight: Sight) -> None:
    """`refuse_constant` of every eye and target that were seen together."""
    if sight.one:
        refuse_constant(hand, seen)
        return
    for eye, target, rows in sight.together.edges:
        if len(rows) >= NEEDED:
            with error_context(where=f"eye {sight.eyes[eye]}, target {sight.targets[target]}"):
                refuse_constant(some_poses(hand, rows), some_poses(seen, rows))


def _refuse_misread(
    hand: Poses, seen: Poses, sight: Sight, setup: EyeSetup, seed: int | None, rule: Rule
) -> None:
    """`refuse_misread` of every eye, by the target that it saw most often."""

    def start(A: Poses, B: Poses) -> Consensus:
        none = np.zeros(len(A[1]), dtype=np.intp)
        return first_consensus(A, B, SeenTogether(none, none, 1, 1), seed)

    other = next(name for name in get_args(EyeSetup) if name != setup)
    asked = set[int]()
    for eye, _, rows in sight.together.edges:
        if eye in asked or len(rows) < NEEDED:
            continue
        asked.add(eye)
        length, _, A, B = _in_units(some_poses(hand, rows), some_poses(seen, rows))
        with error_context(where="" if len(sight.eyes) == 1 else f"eye {sight.eyes[eye]}"):
            refuse_misread(start(A, B), A, B, length, other, start, rule)


def _not_found(
    fit: RobustFit, hand: FloatArray, sight: Sight, made_by_noise: Sequence[Sequence[FloatArray]]
) -> list[NotFound]:
    """Eyes whose X the motions leave open, and eyes and targets of which no row agrees.

    Raises:
        SamplesError: there is only one eye, and it is open.
    """
    missing = list[NotFound]()
    for role, names, which in sight.sides:
        agreeing = np.bincount(which, fit.inliers, len(names))
        unseen = np.flatnonzero(agreeing == 0)
        missing += [NotFound(role, names[k], int(np.sum(which == k))) for k in unseen]
    for k, (name, owner) in enumerate(zip(sight.eyes, sight.owners()[0], strict=True)):
        sees = sight.together.eye == k
        part = next(part for part in sight.parts if (part & sees).any())
        still = axes_that_stand(hand[fit.inliers & part], fit.sigmas[1])
        axis = still if len(still) == 1 else None
        if sight.one:
            refuse_undetermined(fit.solution, owner, "X", ADVICE, axis, made_by_noise[k])
        elif directions := undetermined_directions(fit.solution, owner, made_by_noise[k], axis):
            missing.append(NotFound("eye", name, int(sees.sum()), tuple(directions)))
    return missing


def _looking_at(lost: Sequence[NotFound], sight: Sight) -> BoolArray:
    """(n,) rows of eyes or targets that were not found."""
    gone = np.zeros(len(sight.together.eye), dtype=np.bool_)
    for role, names, which in sight.sides:
        gone |= np.isin(names, [one.name for one in lost if one.role == role])[which]
    return gone


def _without_partners(sight: Sight, rest: Sight, lost: Sequence[NotFound]) -> list[NotFound]:
    """Eyes and targets that vanish with those that were not found."""
    named = {(role, name) for role, names, _ in rest.sides for name in names}
    named |= {(one.role, one.name) for one in lost}
    vanished, sides = list[NotFound](), sight.sides
    for (role, names, which), (_, other_names, partner) in zip(sides, sides[::-1], strict=True):
        for k, name in enumerate(names):
            if (role, name) in named:
                continue
            rows = which == k
            partners = tuple(other_names[p] for p in np.unique(partner[rows]).tolist())
            vanished.append(NotFound(role, name, int(rows.sum()), (), partners))
    return vanished


def _copies(A: Poses, B: Poses, sight: SeenTogether, fit: RobustFit) -> int:
    """How many fitted pairs repeat another, as far as noise could ever let them."""
    rows = np.flatnonzero(fit.inliers)
    if len(rows) > MOST_ROWS:
        return 0
    # Part of the noise within which hand and eye are read alike only where they were not read
    # again.
    near = 0.05 * np.maximum(fit.sigmas, ROUNDING)
    numbers = [
        row_numbers for R, p in (A, B) for row_numbers in (p / near[0], R.reshape(-1, 9) / near[1])
    ]
    # What another eye or target is, is no repetition.
    numbers.append(2.0 * np.column_stack([sight.eye, sight.target]))
    return len(rows) - len(np.unique(together(np.hstack(numbers)[rows], 1.0)))
