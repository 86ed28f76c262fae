"""Common parts of kinds in which an instrument or a camera sees something."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import LEARNT, Noise
from suta_calib.terms.external_frame import labelled, pose_parameters
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.term import Term

# What says the unit of what is seen.
SEEN_UNIT: Final = (
    "columns x, y, z are in m, and x_mm, y_mm, z_mm in mm: is the unit right, and the arm?"
)


@dataclass(frozen=True, eq=False, repr=False)
class FramedTerm(Term):
    """What is seen from frames, or of frames, that stand somewhere unknown: its `frames`."""

    @property
    @abstractmethod
    def frame_names(self) -> list[str]:
        """Owners of the unknowns of its frames."""

    def prior_from_pose(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """The unknowns that a given pose tells of a frame by its key, or of a mark, in the tip.

        An empty label is of what sees in what carries it: an instrument in the base, a camera in
        the tip.
        """
        for frame, owner in zip(self.frames, self.frame_names, strict=True):
            if label == frame.key:
                return pose.of_pose(owner)
        if not label:
            seeing = pose.inverse if self.frames[0].seen_from else pose
            return seeing.of_pose(self.frame_names[0])
        marks = self.poses.samples.labels[self.mark] if self.marked else ()
        return pose.of_pose(f"{self.mark}[{label}]") if label in marks else {}

    def checked_known(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """What `prior_from_pose` makes of the pose of something there, known well enough."""
        where = f"{self.kind}: pose"
        partly = pose.rotation is None or (pose.position_std is None) != (pose.rotation_std is None)
        if not label and self.frames[0].seen_from and partly:
            raise SamplesError(
                f"a pose of the {self.medium} that is only partly known",
                "position_mm and rotation_rpy_deg, with both prior_mm and prior_deg or "
                "with neither",
                where=where,
                hint=f"or give {self.frames[0].key}, where each part may be left out",
            )
        priors = self.prior_from_pose(label, pose)
        if not set(priors) & {p.name for p in self.own_parameters}:
            noun = self.mark or "place"
            marks = sorted(
                set(self.poses.samples.labels[self.mark].tolist()) if self.marked else ()
            )
            raise SamplesError(
                f"a pose of {noun} '{label}'",
                f"one of {', '.join(marks)}" if marks else f"the pose of the {self.medium}",
                where=where,
                hint=did_you_mean(label, marks),
            )
        return priors


@dataclass(frozen=True, eq=False, repr=False)
class InstrumentTerm(FramedTerm):
    """What an instrument, or a camera, sees: positions and perhaps orientations.

    The own unknowns are the poses of its `frames`.

    Attributes:
        noise: scatter and robustness of a position, m per axis.
        angular_noise: the same for the orientation, rad per axis.
        label: tells several instruments of one kind apart.
    """

    noise: Noise = LEARNT
    angular_noise: Noise = LEARNT
    label: str = "default"

    @property
    def frame_names(self) -> list[str]:
        """Owners of the unknowns of its frames."""
        label = self.poses.label
        return [labelled(f.owner, label(self.label, f.end)) for f in self.frames]

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The poses of its frames."""
        return tuple(p for frame in self.frame_names for p in pose_parameters(frame))
