"""The measurement repeated in simulation, as if a solution were the truth.

Samples that touched something get readings that bring the calibrated tip to where it should have
been, plus noise: the nearest posture to the measured one. Samples that were seen from afar get what
the instrument would have seen, plus noise. Noise is normal, of the size the residuals showed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.geometry import FloatArray, register_points, rotation_from_vector
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.simulation.noise import scattered_rotations
from suta_calib.terms import FixedPoint, HandEye, Landmark, PairwiseDistance, Term, TrackedPoint
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import grouped

# A distance scatters by the noise of both its ends.
ENDS: Final = np.sqrt(2.0)
Values = Mapping[str, float]
Pair = tuple[FloatArray, FloatArray]


def simulated_again(
    terms: Sequence[Term],
    values: Values,
    noise: Sequence[float],
    random: np.random.Generator,
) -> tuple[Term, ...]:
    """The terms over simulated samples, as many as there were and in nearly the same postures.

    Args:
        terms: over an arm's samples.
        values: what is taken for the truth: of the arm and of the terms' own unknowns, m or rad.
        noise: of each block of each term, in order, m or rad per component of its residual.
        random: source of the noise.

    Raises:
        SamplesError: a kind that is not simulated here, or readings that would touch a target
            cannot be found.
    """
    levels = iter(noise)
    found = []
    for term in terms:
        again = _AGAIN.get(type(term))
        if again is None:
            raise SamplesError(
                f"the kind {term.kind}",
                f"one of {', '.join(kind.kind for kind in _AGAIN)}, which can be simulated again",
                where="observations",
            )
        found.append(again(term, values, levels, random))
    return tuple(found)


def _distances(
    term: Term, values: Values, levels: Iterator[float], random: np.random.Generator
) -> Term:
    assert isinstance(term, PairwiseDistance)
    labels = term.poses.samples.labels
    _, position = term.poses.at(values)
    target = position.copy()
    certified = term.artefact.position_of(labels["landmark"])
    _, member = grouped(np.char.add(np.char.add(labels["placement"], "/"), labels["repeat"]))
    for k in range(member.max() + 1):
        rows = member == k
        R, p = register_points(certified[rows], position[rows])
        target[rows] = certified[rows] @ R.T + p
    return _touched(term, values, target, next(levels) / ENDS, random)


def _points(
    term: Term, values: Values, levels: Iterator[float], random: np.random.Generator
) -> Term:
    names = term.poses.samples.labels["point"]
    target = np.array([[values[f"fixed_point[{n}].{k}"] for k in "xyz"] for n in names])
    return _touched(term, values, target, next(levels), random)


def _landmarks(
    term: Term, values: Values, levels: Iterator[float], random: np.random.Generator
) -> Term:
    assert isinstance(term, Landmark)
    labels = term.poses.samples.labels
    certified = term.artefact.position_of(labels["landmark"])
    pairs = [_pose(values, f"placement[{name}]") for name in labels["placement"]]
    R, p = (np.array(column) for column in zip(*pairs, strict=True))
    target = np.einsum("nij,nj->ni", R, certified) + p
    again = _touched(term, values, target, next(levels), random)
    if len(again.blocks) == 1:
        return again
    # Which orientation a seat would have had, rather than readings that give both: an arm of few
    # joints cannot reach any orientation.
    block = again.blocks[1]
    rows = block.samples[:, 0]
    rotation, _ = again.poses.at(values)
    scatter = scattered_rotations(random, next(levels), len(rows))
    seated = np.swapaxes(R[rows], 1, 2) @ rotation[rows] @ scatter
    data = np.swapaxes(seated, 1, 2).reshape(len(rows), 9)
    again.blocks = (again.blocks[0], replace(block, data=data))
    return again


def _tracked(
    term: Term, values: Values, levels: Iterator[float], random: np.random.Generator
) -> Term:
    R, p = _pose(values, term.own[0].name.removesuffix(".x"))
    rotation, position = term.poses.at(values)
    return _seen(term, (R @ rotation, position @ R.T + p), levels, random)


def _target_seen(
    term: Term, values: Values, levels: Iterator[float], random: np.random.Generator
) -> Term:
    X = _pose(values, term.own[0].name.removesuffix(".x"))
    Z = _pose(values, term.own[6].name.removesuffix(".x"))
    rotation, position = term.poses.at(values)
    back = np.swapaxes(rotation @ X[0], 1, 2)
    eye = position + rotation @ X[1]
    return _seen(term, (back @ Z[0], np.einsum("nij,nj->ni", back, Z[1] - eye)), levels, random)


Again = Callable[[Term, Values, Iterator[float], np.random.Generator], Term]
_AGAIN: Final[dict[type[Term], Again]] = {
    PairwiseDistance: _distances,
    Landmark: _landmarks,
    FixedPoint: _points,
    TrackedPoint: _tracked,
    HandEye: _target_seen,
}


def _touched(
    term: Term, values: Values, target: FloatArray, sigma: float, random: np.random.Generator
) -> Term:
    """The term over readings that bring the tip to the targets (n, 3), m, plus noise."""
    poses = term.poses
    assert isinstance(poses, ArmPoses)
    rotation, _ = poses.at(values)
    reached = target + sigma * random.standard_normal(target.shape)
    kinematics = InverseKinematics(poses.arm, values)
    wanted = Targets(reached, rotation, "position")
    found = kinematics.solve(wanted, poses.samples.q, random, starts=1)
    for row in np.flatnonzero(found.distance > max(sigma, 1e-6) / 10):
        raise SamplesError(
            "a sample whose touch cannot be simulated: no posture nearby reaches it",
            "an arm that can move its tip in all three directions there",
            where=poses.samples.origin[row],
        )
    return term.over_poses(ArmPoses(poses.arm, replace(poses.samples, q=found.q)))


def _seen(term: Term, seen: Pair, levels: Iterator[float], random: np.random.Generator) -> Term:
    """The term over what an instrument sees: rotations (n, 3, 3), positions (n, 3), plus noise."""
    poses = term.poses
    assert isinstance(poses, ArmPoses)
    rotation, position = seen
    position = position + next(levels) * random.standard_normal(position.shape)
    samples = replace(poses.samples, position=position)
    if len(term.blocks) > 1:
        scatter = scattered_rotations(random, next(levels), len(rotation))
        samples = replace(samples, rotation=rotation @ scatter)
    return term.over_poses(ArmPoses(poses.arm, samples))


def _pose(values: Values, label: str) -> Pair:
    six = np.array([values[f"{label}.{key}"] for key in ("x", "y", "z", "rx", "ry", "rz")])
    return rotation_from_vector(six[3:]), six[:3]
