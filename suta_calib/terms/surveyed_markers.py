"""A board of markers whose places are unknowns: where a fit begins, and what of it is estimated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.measurements import Board
from suta_calib.measurements.board import CORNERS, Marker, Markers
from suta_calib.measurements.scale import LengthScale
from suta_calib.model.parameters import PLACEMENT, Parameter
from suta_calib.terms.external_frame import labelled, pose_named, pose_parameters, pose_values


@dataclass(frozen=True, eq=False)
class SurveyedMarkers(Markers):
    """Markers whose places follow from pictures, where a fit begins.

    Attributes:
        sought: as their file has them.
        anchor: the marker whose place is the frame; None where the file places some.
        stated: sizes that their file states and nothing denies, m.
        reference: the marker whose stated size carries the scale; None where the arm does.
        notes: what was found about them, one sentence each.
    """

    sought: Markers = field(kw_only=True)
    anchor: int | None = field(default=None, kw_only=True)
    stated: Mapping[int, float] = field(default_factory=dict, kw_only=True)
    reference: int | None = field(default=None, kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def estimated(self) -> tuple[int, ...]:
        """Numbers of the markers that the file does not place."""
        return tuple(n for n in self.markers if not self.sought.markers[n].placed)

    @property
    def sized(self) -> tuple[int, ...]:
        """Numbers of the markers whose size is estimated."""
        return tuple(n for n in self.estimated if n != self.reference)

    def with_reference(self) -> Self:
        """The same with the first stated size held: it carries the scale of an arm."""
        if self.anchor is None or not self.stated:
            return self
        number, size = next(iter(self.stated.items()))
        markers = {**self.markers, number: replace(self.markers[number], size=size)}
        return replace(self, markers=markers, reference=number)

    def scaled(self, factor: float) -> Self:
        """Larger markers, farther apart."""
        stated = {number: factor * size for number, size in self.stated.items()}
        return replace(super().scaled(factor), stated=stated)

    @property
    def length_scale(self) -> LengthScale:
        """Of what carries the scale; the sizes that are stated are priors instead."""
        return self.sought.length_scale

    @property
    def carries_scale(self) -> bool:
        """Whether places that the file states do."""
        return self.anchor is None or self.reference is not None

    def row(self) -> dict[str, object]:
        """As its file has it."""
        return self.sought.row()

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the markers whose place is estimated."""
        return tuple(n for n in self.estimated if n != self.anchor)

    def size_prior(self, number: int) -> float | None:
        """Standard deviation of the size that is stated of a marker, m; None of no such one.

        What all sizes have in common stays as uncertain as that of one print.
        """
        if number not in self.stated:
            return None
        return self.length_scale.std * float(np.sqrt(len(self.stated))) * self.stated[number]

    def parameters(self, label: str) -> tuple[Parameter, ...]:
        """The unknowns ``marker[N].x … rz`` and ``marker[N].size``, about where a fit begins."""
        listed_parameters: list[Parameter] = []
        for number in self.estimated:
            owner, marker = marker_owner(number, label), self.markers[number]
            if number != self.anchor:
                start = pose_values(marker.rotation, marker.position)
                listed_parameters += [
                    replace(p, nominal=float(value))
                    for p, value in zip(pose_parameters(owner), start, strict=True)
                ]
            if number == self.reference:
                continue
            prior = self.size_prior(number)
            nominal = marker.size if prior is None else self.stated[number]
            listed_parameters.append(
                Parameter(
                    owner,
                    "size",
                    "m",
                    nominal,
                    lower=0.0,
                    prior=prior,
                    plausible=nominal,
                    prior_fixed=True,
                )
            )
        return tuple(listed_parameters)

    def at(self, label: str, values: Mapping[str, float]) -> Self:
        """The board as these values of its unknowns have it."""
        markers = dict(self.markers)
        for number in self.estimated:
            owner = marker_owner(number, label)
            size = values.get(f"{owner}.size", markers[number].size)
            markers[number] = replace(markers[number], size=size)
            if f"{owner}.x" in values:
                R, p = pose_named(values, owner)
                markers[number] = replace(markers[number], position=p, rotation=R)
        return replace(self, markers=markers)

    def rows(
        self, numbers: IntArray, columns: Mapping[str, int], label: str
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Of points (n,) by number, what the residual needs of markers.

        Points (n, 3) that are fixed; corners and two flags (n, 4); and columns (n, 7) of the own
        unknowns, by name, that pose and size of the marker have.
        """
        fixed, corner = np.zeros((len(numbers), 3)), np.zeros((len(numbers), 4))
        of_marker = np.tile(np.array([*range(6, 12), 6], dtype=np.intp), (len(numbers), 1))
        which, k = np.divmod(numbers, CORNERS)
        unit = Marker(np.zeros(3), 1.0).corners
        for number in np.unique(which).tolist():
            mine = which == number
            if number not in self.estimated:
                fixed[mine] = self.markers[number].corners[k[mine]]
                continue
            owner, moves = marker_owner(number, label), number != self.anchor
            corner[mine, :2] = unit[k[mine], :2]
            corner[mine, 2:] = [float(moves), float(number in self.sized)]
            if number in self.sized:
                of_marker[mine, 6] = columns[f"{owner}.size"]
            else:
                corner[mine, :2] *= self.markers[number].size
            if moves:
                of_marker[mine, :6] = [columns[f"{owner}.{key}"] for key in PLACEMENT]
        return fixed, corner, of_marker

    def with_markers(self, factor: float) -> Board | None:
        """None: their sizes are estimated."""
        del factor
        return None


def marker_owner(number: int, label: str) -> str:
    """What a marker's unknowns are called, on a board with a label."""
    return labelled("marker", str(number) if label == "default" else f"{label}/{number}")
