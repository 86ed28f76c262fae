"""Faults put into sound terms: what `Hypothesis.spoil` of several hypotheses has in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import End
from suta_calib.terms.poses import ArmPoses, MeasuredPoses
from suta_calib.terms.term import Term
from suta_calib.trust.hypothesis import SpoiltData


def arm_of(term: Term) -> ArmModel:
    """The arm of a term.

    Raises:
        SamplesError: it is over measured poses.
    """
    if not isinstance(term.poses, ArmPoses):
        raise SamplesError("poses that were measured", "readings of an arm", where=term.kind)
    return term.poses.arm


def chains_of(terms: Iterable[Term], end: End = "tip") -> dict[str, list[ArmModel]]:
    """The arms of terms by what is at one end of them; of a lone arm, by the empty name."""
    by_end = dict[str, list[ArmModel]]()
    for arm in dict.fromkeys(t.poses.arm for t in terms if isinstance(t.poses, ArmPoses)):
        by_end.setdefault(getattr(arm.bodies, end), []).append(arm)
    return by_end


def by_chain(terms: Sequence[Term]) -> Iterator[tuple[str, Sequence[Term]]]:
    """The terms in which one fault may be, and what follows its description.

    All of them; and of several chains those of each.
    """
    yield "", terms
    chains = chains_of(terms)
    for name, arms in chains.items() if len(chains) > 1 else ():
        of_these = [t for t in terms if arm_of(t) in arms]
        yield f", in the rows of {of_these[0].poses.sort_of_chain} {name}", of_these


def with_columns(term: Term, **columns: Any) -> Term:
    """The term with other columns of its samples, such as ``q``, and all else as it was."""
    return term.over_poses(term.poses.with_samples(replace(term.poses.samples, **columns)))


def middle_joint_changed(
    term: Term, change: Callable[[FloatArray], FloatArray], effect: str, *size: float
) -> SpoiltData:
    """The term whose middle joint was read differently; in ``effect`` ``{}`` is its name."""
    q, own = term.poses.samples.q.copy(), arm_of(term).own_joints
    name = own[len(own) // 2]
    joint = arm_of(term).joints.index(name)
    q[:, joint] = change(q[:, joint])
    return SpoiltData(with_columns(term, q=q), np.array(size), effect.format(name))


def random_shift(rng: np.random.Generator, length: float) -> FloatArray:
    """(3,) in any direction, m."""
    by = rng.standard_normal(3)
    return np.asarray(length * by / np.linalg.norm(by))


def displaced(term: Term, values: Mapping[str, float], twist: FloatArray) -> Term:
    """The term as it is observed when the tips are elsewhere; the noise stays as it is.

    Args:
        term: of a kind whose instrument or camera watches.
        values: the truth, with the term's own unknowns or without them.
        twist: (n, 6) displacement, m, and turn, rad, of every tip about itself, base axes.

    Raises:
        SamplesError: a kind that touches.
    """
    if term.medium == "touch":
        raise SamplesError(f"the kind {term.kind}", "a kind with an external instrument")
    truth = term.start_values(values) | dict(values)
    rotation, position = term.poses.at(values)
    samples, changed = term.poses.samples, dict[str, Any]()
    moved = rotation_from_vector(twist[:, 3:]) @ rotation, position + twist[:, :3]
    before, after = (
        term.observed(truth, MeasuredPoses(*pose, samples))
        for pose in ((rotation, position), moved)
    )
    if samples.position is not None:
        changed["position"] = samples.position + after.place - before.place
    if samples.rotation is not None and before.rotation is not None and after.rotation is not None:
        turn = np.swapaxes(before.rotation, 1, 2) @ after.rotation
        changed["rotation"] = samples.rotation @ turn
    changed["numbers"] = {
        name: value + after.numbers.get(name, 0.0) - before.numbers.get(name, 0.0)
        for name, value in samples.numbers.items()
    }
    return with_columns(term, **changed)


def seen_elsewhere(term: Term, by: FloatArray) -> Term:
    """The term of measured poses, with what they saw or touched elsewhere by ``by`` (n, 3), m.

    Of a tool on a point the post, of a hand and its eye the target (along its own axes), of two
    sets of points the second set.
    """
    poses = term.poses
    samples = poses.samples
    if isinstance(poses, MeasuredPoses) and samples.position is None:
        return term.over_poses(MeasuredPoses(poses.rotation, poses.position + by, samples))
    assert samples.position is not None
    turned = by if samples.rotation is None else np.einsum("nij,nj->ni", samples.rotation, by)
    return with_columns(term, position=samples.position + turned)
