"""Known poses of a term's places, frames and marks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from suta_calib.arrays import IntArray
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.model.parameters import POSITION, Parameter
from suta_calib.terms.block import grouped
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.poses import PoseSource
from suta_calib.units import mm


class GivenPlaces(ABC):
    """Of which places a pose may be given. `Term` has the attributes."""

    kind: ClassVar[str]
    place: ClassVar[str]
    place_unknown: ClassVar[str]
    place_turns: ClassVar[bool]
    place_needs_turn: ClassVar[bool]
    given: Mapping[str, GivenPose]
    poses: PoseSource

    @cached_property
    def places(self) -> tuple[list[str], IntArray]:
        """Labels of the places that are touched, and which of them each sample has, (n,).

        None where the kind, or these samples, name no place.
        """
        labels = self.poses.samples.labels.get(self.place)
        return ([], np.zeros(len(self.poses), np.intp)) if labels is None else grouped(labels)

    @property
    @abstractmethod
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The term's own unknowns."""

    @property
    def of_clock(self) -> tuple[Parameter, ...]:
        """The unknown of the clock of what sees, where it has one."""
        return ()

    @abstractmethod
    def start_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Their closed-form values by name, at the poses that belong to parameter values."""

    @cached_property
    def unknowns(self) -> tuple[Parameter, ...]:
        """`own_parameters`, with what is given of them: fixed there, or with a prior about it."""
        unknowns = (*self.own_parameters, *self.of_clock)
        if not self.given:
            return unknowns

        by_name: dict[str, PriorValue] = {}
        for label, pose in self.given.items():
            by_name |= self.prior_from_pose(label, pose)
        return with_known(unknowns, by_name)

    def prior_from_pose(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """The own unknowns, by name, that a given pose tells of a place; empty for no such place.

        Args:
            label: of the place; empty for the only one there is.
            pose: of it in the base.
        """
        names = self.places[0]
        if not label and len(names) == 1:
            (label,) = names
        return self._known_place(f"{self.place_unknown}[{label}]", pose) if label in names else {}

    def _known_place(self, owner: str, pose: GivenPose) -> dict[str, PriorValue]:
        return pose.of_pose(owner) if self.place_turns else pose.of_point(owner)

    def check_given(self) -> None:
        """Refuse given poses of what is not there, or a thousand times nearer than the arm has it.

        Raises:
            SamplesError: says what there is, or how far away.
        """
        for label, pose in self.given.items():
            if self.place_needs_turn and pose.rotation is None:
                raise SamplesError(
                    f"a pose of {self.place} {label} without an orientation".replace("  ", " "),
                    "rotation_rpy_deg beside position_mm",
                    where=f"{self.kind}: pose",
                )
            _check_in_mm(self, label, self.checked_known(label, pose))

    def checked_known(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """What `prior_from_pose` makes of the pose of something that this kind looks at.

        Raises:
            SamplesError: it is of nothing that is there, or that nothing here depends on.
        """
        there, where = self.places[0], f"{self.kind}: pose"
        if not self.place_turns and pose.rotation is not None:
            raise SamplesError(
                f"rotation_rpy_deg of {self.place} {label}".strip(),
                "only position_mm, because it is a point",
                where=where,
            )
        by_name = self.prior_from_pose(label, pose)
        if not by_name:
            raise SamplesError(
                f"a pose of {self.place} '{label}'" if label else "one pose",
                f"poses by label, of {', '.join(there)}",
                where=where,
                hint=did_you_mean(label, there) if label else "",
            )
        if not set(by_name) <= {p.name for p in self.own_parameters}:
            raise SamplesError(
                f"a pose of {self.place} {label}".strip(),
                "none",
                where=where,
                hint=f"{self.kind} does not measure where it stands",
            )
        return by_name


def with_known(
    parameters: Sequence[Parameter], by_name: Mapping[str, PriorValue]
) -> tuple[Parameter, ...]:
    """Unknowns, of which some are known beforehand: fixed there, or with a prior about it."""
    return tuple(
        replace(
            p,
            nominal=by_name[p.name].value,
            prior=by_name[p.name].std,
            free=by_name[p.name].std is not None,
            prior_fixed=True,
        )
        if p.name in by_name
        else p
        for p in parameters
    )


def _check_in_mm(term: GivenPlaces, label: str, by_name: Mapping[str, PriorValue]) -> None:
    """Refuse a given position that the nominal arm finds a thousand times as far away."""
    start = term.start_values({})
    names = [p.name for p in term.own_parameters if p.name in by_name and p.key in POSITION]
    near, far = (
        math.hypot(*coordinates)
        for coordinates in ([by_name[n].value for n in names], [start[n] for n in names])
    )
    # Metres that stand where millimetres belong: how many times too near that is, nearly.
    in_metres = (700.0, 1400.0)
    if in_metres[0] * near < far < in_metres[1] * near:
        raise SamplesError(
            f"position_mm {label} of {mm(near):.4g} mm, which by the nominal arm is "
            f"{mm(far):.4g} mm away".replace("  ", " "),
            "a position in mm",
            where=f"{term.kind}: pose",
            hint="it looks like metres: convert it to mm",
        )
