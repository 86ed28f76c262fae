"""Where what stands outside the arm truly is: what a calibration should find of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.measurements import Artefact, Samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.schema import PoseSpec, SetSpec
from suta_calib.terms import ArmPoses, Setup, Term
from suta_calib.terms.external_frame import ExternalFrame, pose_parameters, pose_values
from suta_calib.terms.given_pose import GivenPose


@dataclass(frozen=True, eq=False)
class TruePose:
    """A frame, or a point, outside the arm."""

    frame: ExternalFrame  # which
    rotation: FloatArray | None  # (3, 3) of ``T_within_what``; None for a point
    position: FloatArray  # (3,) m


def true_poses(
    plan: SetSpec, arm: ArmModel, samples: Samples, artefact: Artefact | None = None
) -> tuple[TruePose, ...]:
    """Of all whose pose a calibration with the samples, of all files of a set, has to find."""
    setup = Setup(artefact=artefact, settings=plan.settings)
    term = plan.term.over(ArmPoses(arm, samples), setup)
    values = own_values(plan, term)
    return tuple(TruePose(frame, *frame.pose(values)) for frame in term.outside)


def own_values(plan: SetSpec, term: Term) -> dict[str, float]:
    """True values, m or rad, of the own unknowns; frames that are not stated coincide.

    An unknown that no key states is at its nominal value.
    """
    here = PoseSpec(np.eye(3), np.zeros(3))
    stated = {frame.owner: plan.frames.get(frame.key, here) for frame in term.frames}
    stated |= {f"{term.mark}[{label}]": pose for label, pose in plan.marks.items()}
    values = {p.name: p.nominal for p in term.own_parameters}
    for owner, pose in stated.items():
        six = pose_values(pose.rotation, pose.position).tolist()
        values |= {p.name: v for p, v in zip(pose_parameters(owner), six, strict=True)}
    if term.place_unknown:
        for label, pose in plan.places.items():
            rotation = pose.rotation if term.place_turns else None
            priors = term.prior_from_pose(label, GivenPose(pose.position, rotation))
            values |= {name: prior.value for name, prior in priors.items()}
    return values
