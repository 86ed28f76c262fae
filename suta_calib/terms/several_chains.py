"""Terms over several chains of one robot, with columns of readings and labels that all share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import End
from suta_calib.model.robot import AnyArm, joined, same_chain
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term


def over_one_mechanism(terms: Sequence[Term]) -> tuple[Term, ...]:
    """The terms over the chains of one robot; as they are, where they are over one arm.

    Raises:
        ParameterError: they are over arms that are no chains of one robot.
    """
    arms = tuple(term.poses.arm for term in terms if isinstance(term.poses, ArmPoses))
    if len(set(arms)) < 2:
        return tuple(terms)
    return over_chains_of(joined(arms), terms)


def over_chains_of(robot: AnyArm, terms: Sequence[Term]) -> tuple[Term, ...]:
    """The terms over the chains of a robot (`Robot.laid_out`), each by the ends of its own."""
    return tuple(
        over_chain(term, same_chain(term.poses.arm, robot))
        if isinstance(term.poses, ArmPoses)
        else term
        for term in terms
    )


def over_chain(term: Term, arm: ArmModel) -> Term:
    """A term over one arm as a term over the same chain of a robot (`Robot.laid_out`).

    What sits on its tip, or stands in its base, gets a label with the name of that body: two hands
    may each have a target A.
    """
    poses = term.poses
    assert isinstance(poses, ArmPoses)
    return term if poses.arm is arm else labelled(term, arm)


def labelled(term: Term, arm: ArmModel) -> Term:
    """The same of a term that may have the columns of all chains already, and labels of one."""
    poses = term.poses
    assert isinstance(poses, ArmPoses)
    ends: list[tuple[str, End]] = [(term.place, "base")]
    if not term.marks_on_body:
        ends.append((term.mark, term.mark_end))
    samples, labels, given = poses.samples, dict[str, Any](), dict(term.given)
    for column, end in ends:
        if column not in samples.labels:
            continue
        names, which = np.unique(samples.labels[column], return_inverse=True)
        new_names = [arm.bodies.label(str(name), end) for name in names]
        labels[column] = np.array(new_names, dtype=np.str_)[which]
        labels[column].setflags(write=False)
        new_name = dict(zip(map(str, names), new_names, strict=True))
        given = {new_name.get(name, name): pose for name, pose in given.items()}
    if any(arm.bodies.label("label", end) != "label" for _, end in ends):
        samples = replace(samples, labels={**samples.labels, **labels})
    return replace(term, poses=ArmPoses(arm, samples.over_joints(arm.joints)), given=given)
