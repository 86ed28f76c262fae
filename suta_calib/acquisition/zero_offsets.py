"""Encoder offsets from known poses of the tip: an arm's first configuration, before calibration.

The true joint angles of a known pose come from inverse kinematics; what the encoders read there is
known, and the difference is the offset. A pose can be reached in several ways, so there may be
several answers (branches); over several poses least squares leave those that fit all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.batched import Batched
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import vector_from_rotation, wrap
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.solver.identifiability import Combination, identify
from suta_calib.solver.information import Information
from suta_calib.solver.problem import DEFAULT_SIGMA
from suta_calib.units import deg, from_deg, mm
from suta_calib.words import listed

# Readings closer than this the same posture, rad or m.
_SAME_POSTURE: Final = 0.02


@dataclass(frozen=True, eq=False)
class Branch:
    """One set of offsets that explains the poses.

    Attributes:
        offsets: (n,) added to the readings, rad in (-π, π] (m for prismatic joints).
        std: (n,) their standard uncertainty; NaN where an offset is held.
        distances: (k,) how far the tip stays from each known position, m.
        angles: (k,) and from each known orientation, rad; None where none is known.
    """

    offsets: FloatArray
    std: FloatArray
    distances: FloatArray
    angles: FloatArray | None

    @property
    def rms(self) -> float:
        """Root mean square of the distances, m."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def rms_angle(self) -> float | None:
        """Root mean square of the angles, rad; None where no orientation is known."""
        return None if self.angles is None else float(np.sqrt(np.mean(self.angles**2)))


@dataclass(frozen=True)
class ContradictedZero:
    """A pose that all others contradict.

    Attributes:
        row: which one, as its file has it.
        distance: from where the other poses say that the tip was, m.
        rms: how far the tip stays from the other poses, once this one is left out, m.
    """

    row: str
    distance: float
    rms: float


@dataclass(frozen=True)
class ZeroOffsetOptions:
    """How to find zero offsets.

    Attributes:
        branch: which of the answers that fit is taken, from 1; the smallest offsets by default.
        tolerance: how far the tip may stay from where it is known to be (RMS), m.
        seed: of the postures from which inverse kinematics searches.
        plausible: an offset larger than this needs more than one posture to be believed, rad.
    """

    branch: int = 1
    tolerance: float = 0.02
    seed: int = 0
    plausible: float = from_deg(45.0)


DEFAULT: Final = ZeroOffsetOptions()
Status = Literal["found", "undetermined", "no_fit"]


@dataclass(frozen=True, eq=False)
class ZeroOffsets:
    """What the poses say about the offsets.

    Attributes:
        arm: whose offsets these are.
        names: of the offsets.
        branches: those that fit, the smallest offsets first; at least one.
        undetermined: offsets that these poses cannot tell, which are held at zero; or
            combinations of several, and then the only branch is one answer of infinitely many.
        redundancy: how many equations different postures give beyond one for each offset that is
            estimated: with none, whatever is read fits.
        beyond_limits: joints that with the chosen offsets would stand beyond their limits.
        contradicted: the pose that agrees with no other; None where there is none.
        options: how they were found.
    """

    arm: ArmModel
    names: tuple[str, ...]
    branches: tuple[Branch, ...]
    undetermined: tuple[Combination, ...]
    redundancy: int
    beyond_limits: tuple[str, ...] = ()
    contradicted: ContradictedZero | None = None
    options: ZeroOffsetOptions = DEFAULT

    @property
    def unique(self) -> bool:
        """Whether what is undetermined concerns no offset that is given a value."""
        return all(combination.alone for combination in self.undetermined)

    @property
    def chosen(self) -> Branch:
        """The branch that was asked for."""
        return self.branches[self.options.branch - 1]

    @property
    def status(self) -> Status:
        """Whether there are offsets to use, and why not."""
        if self.chosen.rms > self.options.tolerance:
            return "no_fit"
        return "found" if self.unique else "undetermined"

    @property
    @judged
    def assessment(self) -> Assessment:
        """Bad where no offsets fit, or the poses leave a choice between infinitely many."""
        chosen, count, options = self.chosen, len(self.branches), self.options
        poses = f"{len(chosen.distances)} pose{'s' * (len(chosen.distances) != 1)}"
        sentence = (
            f"{poses}; with these offsets the tip differs from the poses by {mm(chosen.rms):.3f} "
            f"mm (RMS), at most {mm(float(chosen.distances.max())):.3f} mm"
        )
        bad, care = list[str](), list[str]()
        status, contradicted = self.status, self.contradicted
        unchecked = self.redundancy <= 0 and status == "found"
        if unchecked:
            sentence = f"{poses}: no more equations than offsets, so any readings would fit"
            care.append(
                "These offsets are not checked by any other data: wrong poses or readings would "
                "fit as well. Give a second pose with its orientation, far from the first."
            )
        large = [
            f"{name} {deg(value):.0f}"
            for name, value in self.values().items()
            if self.arm.parameters[name].unit == "rad" and abs(value) > options.plausible
        ]
        # Who chose a branch by its number knows which one it is.
        if unchecked and large and options.branch == 1:
            bad.append(
                f"Not usable: offsets of {', '.join(large)} deg, and no second posture confirms "
                "them. Give more poses, or choose the right branch, if you know it, with "
                "--branch."
            )
        if self.beyond_limits:
            care.append(
                f"{', '.join(self.beyond_limits)} would be beyond the limits of the URDF. Check "
                "whether another branch is right, or whether a joint turns the other way."
            )
        if status == "undetermined":
            bad.append(
                "Not usable: the offsets are not determined. Give more poses, or their "
                "orientations."
            )
        if contradicted is not None:
            care.append(
                f"{contradicted.row} contradicts all other poses: without it the tip fits them "
                f"within {mm(contradicted.rms):.3f} mm (RMS), and is then "
                f"{mm(contradicted.distance):.3f} mm from this pose. Check its pose and its "
                "readings, or leave it out."
            )
        if status == "no_fit":
            what = ". Look for a wrong unit, a wrong frame, or a joint that turns the other way."
            if contradicted is not None and contradicted.rms <= options.tolerance:
                what = ", if all poses are used."
            bad.append(f"Not usable: no offsets make the URDF agree with the poses{what}")
        if count > 1:
            care.append(
                f"{count} branches fit; this is number {options.branch}. Choose another with "
                "--branch N"
            )
        for combination in self.undetermined:
            partners = [name for name in combination.direction if name != combination.fixed]
            what = (
                f"determined only together with {', '.join(partners)}" if partners else "held at 0"
            )
            care.append(f"undetermined: {combination.fixed}, {what}")
        return Assessment.of(sentence, bad=bad, care=care)

    def values(self, branch: Branch | None = None) -> dict[str, float]:
        """Offsets by name, rad or m: of the chosen branch by default."""
        return dict(zip(self.names, (branch or self.chosen).offsets.tolist(), strict=True))


def find_zero_offsets(
    arm: ArmModel, samples: Samples, options: ZeroOffsetOptions = DEFAULT
) -> ZeroOffsets:
    """Offsets with which the arm's URDF agrees with known poses.

    Args:
        arm: as its URDF has it.
        samples: raw readings, with the position of the tip in the arm's base frame for each row,
            and its orientation if that is known.
        options: which branch is taken, and how close it must come.

    Raises:
        InputError: no positions, no such branch, or a joint that moves the chain and is not on it.
    """
    if samples.position is None:
        raise InputError("no positions of the tip", "columns x, y, z, or --pose")
    if elsewhere := [j for j in arm.joints if f"{j}.offset" not in arm.parameters]:
        followers = [name for name, read in arm.read_from.items() if read in elsewhere]
        raise InputError(
            f"{listed(elsewhere)}, which {listed(followers)} follows by <mimic>, but which is "
            f"not in the chain to {arm.tip}",
            "a chain that contains every joint with an encoder",
            where="--tip",
            hint=f"the offset of {listed(elsewhere)} is not in this chain. Choose a --tip behind "
            f"{listed(elsewhere)}",
        )
    fit = _OffsetFit(arm, samples)
    every: IntArray = np.arange(len(arm.joints), dtype=np.intp)
    starts = _starts(arm, samples, np.random.default_rng(options.seed))
    answers = [fit.refined(start, every) for start in starts]
    best = min(answers, key=fit.cost)
    undetermined = fit.undetermined(best)
    branches, free = _distinct(fit, answers, every), every
    if not all(combination.alone for combination in undetermined):
        # A continuum of answers has no branches worth listing: the smallest stands for them.
        branches = branches[:1]
    elif undetermined:
        fixed = {combination.fixed for combination in undetermined}
        free = every[[name not in fixed for name in fit.names]]
        held = [np.where(np.isin(every, free), start, 0.0) for start in answers]
        branches = _distinct(fit, [fit.refined(start, free) for start in held], free)
    if not 1 <= options.branch <= len(branches):
        raise InputError(str(options.branch), f"1 to {len(branches)}", where="--branch")
    chosen = branches[options.branch - 1].offsets
    # One row of each posture: repeats bear out one another and not the offsets.
    postures = samples.take(_first_of_alike(arm, samples.q, _SAME_POSTURE))
    return ZeroOffsets(
        arm,
        fit.names,
        branches,
        undetermined,
        len(postures) * fit.equations - len(fit.names) + len(undetermined),
        _beyond_limits(arm, samples.q + chosen),
        _contradicted(arm, postures, chosen, free),
        options,
    )


def _contradicted(
    arm: ArmModel, samples: Samples, offsets: FloatArray, free: IntArray
) -> ContradictedZero | None:
    """The pose without which the others agree far better than chance would have it, by an F test.

    Each is left out in turn, as linearised about the answer; the one that stands out by refitting.
    """
    fit, count = _OffsetFit(arm, samples), len(samples)
    size = fit.equations
    freedom = (count - 1) * size - len(free)
    if freedom <= 0:
        return None
    offsets = fit.refined(offsets, free)
    residual, slopes = fit.by_pose(offsets)
    slope = slopes[:, :, free]
    spread = np.linalg.pinv(np.einsum("kdp,kdq->pq", slope, slope), hermitian=True)
    left = np.eye(size) - slope @ spread @ np.swapaxes(slope, 1, 2)
    gain = np.einsum("kd,kde,ke->k", residual, np.linalg.pinv(left, hermitian=True), residual)
    worst = int(np.argmax(gain))
    fit_without = _OffsetFit(arm, samples.take(np.delete(np.arange(count), worst)))
    without = fit_without.refined(offsets, free)
    cost = fit_without.cost(without)
    ratio = (fit.cost(offsets) - cost) / size / max(cost / freedom, np.finfo(float).tiny)
    # Chance of naming a pose where all are as good.
    if count * float(fdtrc(size, freedom, ratio)) > 1e-3:
        return None
    distance = fit.branch(without, free).distances[worst]
    rms = fit_without.branch(without, free).rms
    return ContradictedZero(samples.origin[worst], float(distance), rms)


def _starts(arm: ArmModel, samples: Samples, rng: np.random.Generator) -> list[FloatArray]:
    """Offsets to begin from: those that explain the first row, in whichever posture."""
    # Starts of the inverse kinematics; of what they reach, 80 are tried on all poses.
    starts = 240
    assert samples.position is not None
    inverse = InverseKinematics(arm, {})
    postures = np.vstack([samples.q[0], inverse.random_readings(rng, starts - 1)])
    rotation = np.eye(3) if samples.rotation is None else samples.rotation[0]
    targets = Targets(
        np.tile(samples.position[0], (starts, 1)),
        np.tile(rotation, (starts, 1, 1)),
        "position" if samples.rotation is None else "pose",
    )
    answer = inverse.solve(targets, postures, rng, starts=1)
    order = np.argsort(~answer.reached, kind="stable")
    offsets = wrapped_offsets(arm, answer.q[order] - samples.q[0])
    return [np.zeros(len(arm.joints)), *offsets[_first_of_alike(arm, offsets)]][:80]


def _beyond_limits(arm: ArmModel, angles: FloatArray) -> tuple[str, ...]:
    """Joints that stand beyond their limits, whatever turns are added, in angles (k, n)."""
    names = []
    for joint, column in zip(arm.readings, angles.T, strict=True):
        middle, half = (joint.lower + joint.upper) / 2, (joint.upper - joint.lower) / 2
        if math.isfinite(half):
            away = column - middle if joint.type == "prismatic" else wrap(column - middle)
            if np.max(np.abs(away)) > half + _SAME_POSTURE:
                names.append(joint.name)
    return tuple(names)


def _first_of_alike(
    arm: ArmModel, offsets: Sequence[FloatArray] | FloatArray, same: float = 1e-3
) -> list[int]:
    """The first of each that are the same, within so many rad or m, in the order given."""
    firsts: list[int] = []
    for k, candidate in enumerate(offsets):
        accepted = np.array([offsets[first] for first in firsts]).reshape(-1, len(candidate))
        if not np.any(np.all(np.abs(wrapped_offsets(arm, accepted - candidate)) < same, axis=1)):
            firsts.append(k)
    return firsts


def _distinct(fit: _OffsetFit, answers: Sequence[FloatArray], free: IntArray) -> tuple[Branch, ...]:
    """The answers that fit, each once, the smallest offsets first."""
    costs = np.array([fit.cost(answer) for answer in answers])
    # A branch fits if its residuals are within the assumed noise, or not much worse than the best.
    limit = max(len(fit.rows(answers[0])[0]), 3.0**2 * float(costs.min()))
    good = [answers[k] for k in np.argsort(costs, kind="stable") if costs[k] <= limit]
    different = sorted((good[k] for k in _first_of_alike(fit.arm, good)), key=np.linalg.norm)
    return tuple(fit.branch(offsets, free) for offsets in different)


class _OffsetFit:
    """Least squares of the offsets over all poses, in units of the assumed noise."""

    def __init__(self, arm: ArmModel, samples: Samples) -> None:
        assert samples.position is not None
        self.arm = arm
        self.names = tuple(f"{joint}.offset" for joint in arm.joints)
        self._position, self._rotation = samples.position, samples.rotation
        self._batch = Batched(arm.function(list(self.names)), len(samples), shared=[0])
        self._batch.inputs[1][:] = samples.q

    def _poses(self, offsets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        self._batch.inputs[0][:] = offsets
        flat, position, jacobian = self._batch()
        rotation = np.swapaxes(flat.reshape(-1, 3, 3), 1, 2)
        return rotation, position.copy(), jacobian.reshape(len(position), 6, -1).copy()

    @property
    def equations(self) -> int:
        """Of one pose."""
        return 3 if self._rotation is None else 6

    def by_pose(self, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (k, d) of the poses and their derivatives (k, d, n), by the noise assumed."""
        rotation, position, slope = self._poses(offsets)
        residual = position - self._position
        noise = np.full(self.equations, DEFAULT_SIGMA["m"])
        if self._rotation is not None:
            turn = vector_from_rotation(rotation @ np.swapaxes(self._rotation, 1, 2))
            residual = np.hstack([residual, turn])
            noise[3:] = DEFAULT_SIGMA["rad"]
        return residual / noise, slope[:, : self.equations] / noise[:, None]

    def rows(self, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, of all poses one after the other."""
        residual, slope = self.by_pose(offsets)
        return residual.ravel(), slope.reshape(residual.size, -1)

    def cost(self, offsets: FloatArray) -> float:
        """Sum of squares."""
        residual, _ = self.rows(offsets)
        return float(residual @ residual)

    def refined(self, start: FloatArray, free: IntArray) -> FloatArray:
        """The nearest minimum over the free offsets; the others stay."""

        def with_held(x: FloatArray) -> FloatArray:
            offsets = start.copy()
            offsets[free] = x
            return offsets

        minimum = least_squares(
            lambda x: self.rows(with_held(x))[0],
            start[free],
            lambda x: self.rows(with_held(x))[1][:, free],
            # MINPACK's is the quicker, and wants no fewer equations than unknowns.
            method="lm" if self.equations * len(self._position) >= len(free) else "trf",
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=60,
        )
        return wrapped_offsets(self.arm, with_held(minimum.x))

    def undetermined(self, offsets: FloatArray) -> tuple[Combination, ...]:
        """What changes nothing that is known."""
        _, slope = self.rows(offsets)
        curvature = slope.T @ slope
        unknown = self.arm.select(*self.names)
        information = Information(curvature, curvature, np.zeros_like(curvature))
        return identify(unknown, len(unknown), information, np.zeros(len(unknown))).combinations

    def branch(self, offsets: FloatArray, free: IntArray) -> Branch:
        """Offsets, how sure those are that are free, and their residuals."""
        rotation, position, _ = self._poses(offsets)
        residual, slope = self.rows(offsets)
        std = np.full(len(offsets), np.nan)
        covariance = np.linalg.pinv(slope[:, free].T @ slope[:, free], hermitian=True)
        std[free] = np.sqrt(np.diag(covariance))
        # Noise is taken to be what is assumed where too few poses tell otherwise.
        beyond = len(residual) - len(free)
        factor = float(residual @ residual) / max(beyond, 1)
        std *= np.sqrt(factor if beyond >= len(offsets) else max(factor, 1.0))
        distances, angles = np.linalg.norm(position - self._position, axis=1), None
        if self._rotation is not None:
            turn = vector_from_rotation(np.swapaxes(self._rotation, 1, 2) @ rotation)
            angles = np.linalg.norm(turn, axis=1)
        return Branch(offsets, std, distances, angles)


def wrapped_offsets(arm: ArmModel, offsets: FloatArray) -> FloatArray:
    """Offsets of joints that turn, wrapped to (-π, π]; (n,) or (k, n)."""
    turning = np.array([joint.type != "prismatic" for joint in arm.readings])
    return np.where(turning, wrap(offsets), offsets)
