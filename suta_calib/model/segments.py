"""One joint of a chain as Pinocchio understood it, and the parameters that it offers."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import product
from typing import Literal, cast

import numpy as np
import pinocchio as pin

from suta_calib.model.chain import ChainJoint, Mimic
from suta_calib.model.kinematics import Motion, Segment
from suta_calib.model.parameters import (
    BACKLASH,
    BENDING,
    CABLE,
    COMPLIANCE,
    DECAY,
    ECCENTRICITY,
    EXPANSION,
    GAIN,
    GEAR_RATIO,
    HYSTERESIS,
    MASS,
    NOMINAL_DECAY,
    OFFSET,
    PLAUSIBLE,
    PLAUSIBLE_BASE,
    PLAUSIBLE_ECCENTRICITY,
    PLAUSIBLE_LAG,
    PLAUSIBLE_MASS,
    POSITION,
    RIPPLE,
    ROTATION,
    Parameter,
    coupling_key,
    is_base,
)


def segment_of(
    model: pin.Model,
    data: pin.Data,
    joint: ChainJoint,
    owner: str,
    columns: Mapping[str, int],
    sliding: Collection[str],
) -> Segment:
    """A joint's own origin, relative to its parent link, its axis, and what may move it."""
    parent = model.frames[model.getFrameId(joint.parent, pin.FrameType.BODY)]
    axis = np.zeros(3)
    if joint.moving:
        index = model.getJointId(joint.name)
        placement = model.jointPlacements[index]
        jacobian = pin.computeJointJacobian(model, data, pin.neutral(model), index)
        subspace = jacobian.reshape(6, model.nv)[:, model.joints[index].idx_v]
        axis = subspace[:3] + subspace[3:]
    else:
        kinds = pin.FrameType.FIXED_JOINT
        placement = model.frames[model.getFrameId(joint.name, kinds)].placement
    origin = parent.placement.actInv(placement)
    motion = cast(Motion, "revolute" if joint.type == "continuous" else joint.type)
    followed = joint.mimic or Mimic(joint.name, 1.0, 0.0)
    slides = joint.type == "prismatic"
    couplings = {
        n: k for n, k in columns.items() if n != followed.joint and (n in sliding) == slides
    }
    # Cables of a joint run about the axis of the next one.
    place = columns.get(followed.joint, -2)
    beside = tuple(n for n, k in couplings.items() if abs(k - place) == 1 and not slides)
    moves = joint.moving and not joint.passive
    return Segment(
        *(owner, motion, origin.rotation, joint.xyz, axis),
        columns.get(followed.joint, 0),
        followed.multiplier,
        followed.offset,
        joint.climbed,
        couplings if moves else {},
        joint.passive,
        beside if moves else (),
    )


def geometric_parameters(segment: Segment) -> Iterator[Parameter]:
    """Its placement relative to its parent link, and the offset of its encoder."""
    plausible = PLAUSIBLE_BASE if is_base(segment.owner) else PLAUSIBLE
    for key, nominal in zip(POSITION, segment.position, strict=True):
        yield Parameter(segment.owner, key, "m", float(nominal), plausible=plausible["m"])
    for key in ROTATION:
        yield Parameter(segment.owner, key, "rad", plausible=plausible["rad"])
    if segment.read:
        yield Parameter(segment.owner, OFFSET, "m" if segment.motion == "prismatic" else "rad")


def nongeometric_parameters(segment: Segment, mass: float = 0.0) -> Iterator[Parameter]:
    """What a joint of its kind may do beside its geometry: zero unless found otherwise.

    And the mass that it carries before the next one, kg, where the URDF states one.
    """
    if segment.position.any():
        yield Parameter(segment.owner, EXPANSION, "1/K")
    if segment.read:
        yield Parameter(segment.owner, GAIN, "1")
        for joint in segment.others:
            yield Parameter(segment.owner, coupling_key(joint), "1")
        unit: Literal["m", "rad"] = "m" if segment.motion == "prismatic" else "rad"
        play = {"rad": PLAUSIBLE_ECCENTRICITY, "m": PLAUSIBLE_LAG["m"]}[unit]
        yield Parameter(segment.owner, BACKLASH, unit, plausible=play)
        yield Parameter(segment.owner, HYSTERESIS, unit, plausible=PLAUSIBLE_LAG[unit])
        decay = NOMINAL_DECAY[unit]
        yield Parameter(segment.owner, DECAY, unit, decay, plausible=6.0 * decay)
    if segment.read and segment.motion == "revolute":
        for key in ECCENTRICITY:
            yield Parameter(segment.owner, key, "rad", plausible=PLAUSIBLE_ECCENTRICITY)
        yield Parameter(segment.owner, COMPLIANCE, "rad/Nm")
        for key in RIPPLE:
            yield Parameter(segment.owner, key, "rad", plausible=PLAUSIBLE_ECCENTRICITY)
        yield Parameter(segment.owner, GEAR_RATIO, "1")
        for joint, key in product(segment.neighbours, CABLE):
            name = coupling_key(joint, key)
            yield Parameter(segment.owner, name, "rad", plausible=PLAUSIBLE_LAG["rad"])
    if segment.read:
        for key in BENDING:
            yield Parameter(segment.owner, key, "rad/Nm")
        if mass > 0:
            width = PLAUSIBLE_MASS * mass
            yield Parameter(segment.owner, MASS, "kg", mass, lower=0.0, plausible=width)
