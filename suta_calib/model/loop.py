"""Closed loops that hang on the tree: a parallelogram, a four-bar.

A URDF is a tree, and cannot say that two of its links are pinned together. A `Loop` says it: two
frames whose origins coincide, and the two joints without an encoder that give way. Their angles
φ solve, at every posture q and for every geometry θ,

    C(φ; q, θ) = [u v]ᵀ (p_a(φ, q, θ) - p_b(φ, q, θ)) = 0

with u and v across the axis of the first passive joint. Two circles meet in closed form; because
built axes are never quite parallel, two steps of Newton follow, and the error after them is below
rounding. By the implicit function theorem ∂φ/∂θ = -(∂C/∂φ)⁻¹ ∂C/∂θ (Featherstone 2008, *Rigid Body
Dynamics Algorithms*, chapter 8).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import UrdfError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.model.cell import within
from suta_calib.model.chain import Chain, ChainJoint, LoopJoints, chain_joint
from suta_calib.model.urdf_tree import TreeJoint, UrdfTree, quoted
from suta_calib.units import mm

# Before the frames of one, in messages.
LOOP: Final = "loop"

_Refuse = Callable[..., UrdfError]


@dataclass(frozen=True)
class Loop(Displayable):
    """Two links that a pin joins, which closes a loop.

    Attributes:
        frames: two links or frames of the URDF, whose origins coincide on the pin's axis.
        passive: the two joints of the loop that have no encoder, and follow the others.
        line: of the job's file, for messages.
    """

    frames: tuple[str, str]
    passive: tuple[str, str]
    line: int | None = None

    def within(self, robot: str) -> Loop:
        """The same in a cell, of the robot of this name."""
        first, second = (within(robot, name) for name in self.frames)
        left, right = (within(robot, name) for name in self.passive)
        return replace(self, frames=(first, second), passive=(left, right))


def loop_of(tree: UrdfTree, loop: Loop) -> LoopJoints:
    """The joints of a loop, between its two frames.

    Raises:
        UrdfError: no such frame or joint, joints that are not in the loop, or a loop that is not
            planar or does not close as it is drawn.
    """
    where = f"{LOOP} {loop.frames[0]} – {loop.frames[1]}"

    def refuse(found: str, expected: str, hint: str = "") -> UrdfError:
        return UrdfError(found, expected, file=tree.path, where=where, hint=hint)

    if len(set(loop.frames)) != 2 or len(set(loop.passive)) != 2:
        raise refuse(
            f"frames {', '.join(loop.frames)}; passive {', '.join(loop.passive)}",
            "two different frames that coincide, and two different joints that have no encoder",
        )
    ways = [tree.path_to_root(_link(tree, name, refuse)) for name in loop.frames]
    while ways[0] and ways[1] and ways[0][-1] is ways[1][-1]:
        ways[0].pop()
        ways[1].pop()
    inside = {joint.name: joint for way in ways for joint in way}
    for name in loop.passive:
        if name not in inside:
            hint = did_you_mean(name, inside)
            raise refuse(f"the passive joint {quoted(name)}", f"one of {', '.join(inside)}", hint)
    first, second = (
        tuple(_joint(tree, joint, loop.passive) for joint in reversed(way)) for way in ways
    )
    joints = LoopJoints(loop.passive, (first, second), np.zeros(3))
    axis = _common_axis(joints, refuse)
    gap = _drawn(first)[1] - _drawn(second)[1]
    across = gap - (gap @ axis) * axis
    # How far apart, over the size of the loop, two frames may be in the URDF that coincide: a
    # calibrated one has the zeros of encoders in it.
    allowed = 0.05 * max(float(np.linalg.norm(joint.xyz)) for joint in joints.joints)
    if np.linalg.norm(across) > allowed:
        raise refuse(
            f"two frames that are {mm(float(np.linalg.norm(across))):.3g} mm apart across the "
            "axis of the loop, with all joints at zero",
            f"frames that coincide within {mm(allowed):.2g} mm: a loop that closes as it is drawn",
            "put both frames on the pin, in the posture in which all joints read zero",
        )
    return LoopJoints(loop.passive, (first, second), axis)


def _link(tree: UrdfTree, name: str, refuse: _Refuse) -> str:
    if name in tree.links:
        return name
    if name in tree.joints:
        return tree.joints[name].child
    every = (*tree.links, *tree.joints)
    raise refuse(quoted(name), "a link or a joint of the URDF", did_you_mean(name, every))


def _joint(tree: UrdfTree, joint: TreeJoint, passive: Sequence[str]) -> ChainJoint:
    made = chain_joint(tree, joint)
    return _passive(made) if joint.name in passive else made


def _drawn(joints: Sequence[ChainJoint]) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and position (3,), m, of the last frame, with all joints at zero."""
    rotation, position = np.eye(3), np.zeros(3)
    for joint in joints:
        position = position + rotation @ joint.xyz
        rotation = rotation @ rotation_from_rpy(joint.rpy)
    return rotation, position


def _common_axis(loop: LoopJoints, refuse: _Refuse) -> FloatArray:
    axes = dict[str, FloatArray]()
    for branch in loop.branches:
        for k, joint in enumerate(branch):
            if joint.type == "prismatic":
                raise refuse(
                    f"the prismatic joint {quoted(joint.name)}",
                    "revolute and fixed joints: a planar loop of links",
                )
            if joint.moving:
                axes[joint.name] = _drawn(branch[: k + 1])[0] @ joint.axis
    axis = axes[loop.passive[0]]
    for name, other in axes.items():
        # Joints whose axes are less parallel make no planar loop, rad: a calibrated URDF has the
        # tilts of built axes, some tenths of a degree each.
        if np.linalg.norm(np.cross(axis, other)) > 0.05:
            raise refuse(
                f"the axes of {quoted(loop.passive[0])} and {quoted(name)}, which are not parallel",
                "a planar loop: all its joints turn about parallel axes",
            )
    return axis


def _passive(joint: ChainJoint) -> ChainJoint:
    return replace(joint, mimic=None, passive=True)


def with_loops(tree: UrdfTree, chain: Chain, loops: Iterable[Loop]) -> Chain:
    """The chain with those of the loops that move its joints.

    Raises:
        UrdfError: as of `loop_of`, or loops that need one another.
    """
    every = [loop_of(tree, loop) for loop in loops]
    needed, used = list[LoopJoints](), {joint.name for joint in chain.joints}
    # A loop that moves a joint of another loop is solved before it.
    for loop in reversed(every):
        if used & set(loop.passive):
            needed.insert(0, loop)
            used |= {joint.name for joint in loop.joints}
    if not needed:
        return chain
    passive = {name for loop in needed for name in loop.passive}
    joints = tuple(_passive(joint) if joint.name in passive else joint for joint in chain.joints)
    loops_of_chain = tuple(_after(needed, k, passive) for k in range(len(needed)))
    moved = replace(chain, joints=joints, loops=loops_of_chain)
    by_name = {j.name: j for j in (*chain.moving, *moved.beside, *joints)}
    read = dict.fromkeys(
        joint.mimic.joint if joint.mimic else joint.name
        for joint in (*joints, *moved.beside)
        if joint.moving and not joint.passive
    )
    readings = (by_name.get(n) or chain_joint(tree, tree.joints[n]) for n in read)
    return replace(moved, moving=tuple(readings))


def _after(loops: Sequence[LoopJoints], k: int, passive: set[str]) -> LoopJoints:
    """One of several loops, in which joints that earlier ones have solved are passive too."""
    later = {name for loop in loops[k + 1 :] for name in loop.passive}
    for joint in loops[k].joints:
        if joint.name in later - set(loops[k].passive):
            raise UrdfError(
                f"a loop with the joint {quoted(joint.name)}, which a later loop moves",
                "loops in the order in which they can be solved",
                where=LOOP,
            )
    first, second = (
        tuple(_passive(j) if j.name in passive else j for j in branch)
        for branch in loops[k].branches
    )
    return replace(loops[k], branches=(first, second))
