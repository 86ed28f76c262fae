"""Distances from fixed points: a draw-wire sensor, a telescoping or a fixed ball bar, ranging."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import extent
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import NumberColumn, SampleColumns, YamlSection
from suta_calib.measurements.fields import Field, Value
from suta_calib.model.parameters import POSITION, Parameter
from suta_calib.terms.block import Block, Pose, norm
from suta_calib.terms.checks import OTHER_UNIT
from suta_calib.terms.external_frame import PLAUSIBLE_POSITION
from suta_calib.terms.observed import Observed
from suta_calib.terms.places import PlaceTerm
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.units import from_mm, mm

# Second over first singular value of tips on a line.
_LINE: Final = 1e-3


def _excess(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """A distance alone, so that motions of the whole arm leave it as it is."""
    return norm(poses[0].p - unknowns[:3]) - (unknowns[3] if unknowns.numel() > 3 else data[0])


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredRange(PlaceTerm):
    """``‖p_i - a‖ - l_i`` for the distance of the tip from an anchor a that stands somewhere.

    With the column ``length`` every l_i was measured: by a draw-wire sensor, a telescoping ball
    bar. Without, all distances from one anchor are one unknown ``radius[A]``: a ball bar whose
    length nobody certified. Lengths fix the overall scale, an unknown radius does not; neither sees
    the tip's orientation but through where the tip is.

    Attributes:
        poses: samples with the label anchor, and perhaps a length.
    """

    kind = "range"
    order = 6
    about = (
        "distance of the tip from a fixed point of unknown place (draw-wire sensor, ball bar): "
        "column length in m, or length_mm; without the column, all distances from one anchor are "
        "one unknown radius"
    )
    columns = SampleColumns(
        labels=("anchor",),
        numbers=(NumberColumn("length", "m", required=False, positive=True),),
        about={
            "anchor": "Label of the point from which the distance was measured.",
            "length": "The distance; without it, all distances from one anchor are one unknown.",
        },
    )
    place = "anchor"
    place_unknown = "anchor"
    place_keys = POSITION
    place_more = ("radius",)
    place_turns = False
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"anchor": ("anchor",), "row": ()}
    simulation_keys = (
        Field(
            "length_mm",
            Value("mm, or from, to in mm"),
            "Range of the measured lengths; or the one length that was not measured.",
        ),
    )

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """``length_mm``: lengths measured from … to, or the one length that nobody measured."""
        if "length_mm" not in row:
            return {}
        if not isinstance(row.data["length_mm"], list):
            length = from_mm(row.number("length_mm", "positive"))
            return {"lengths": (length, length), "measured": False}
        low, high = row.numbers("length_mm", 2)
        if not 0.0 < low <= high:
            raise row.refuse(
                f"[{low:g}, {high:g}]", "[shortest, longest] length", at=("length_mm",)
            )
        return {"lengths": (from_mm(low), from_mm(high)), "measured": True}

    @classmethod
    def touches(
        cls,
        rotation: FloatArray,
        position: FloatArray,
        where: FloatArray,
        settings: Mapping[str, Any],
    ) -> FloatArray:
        """All over a cap about the z axis of the anchor, at any of the lengths."""
        # Lengths between which simulated ones are where the file does not say, m.
        lengths = (0.2, 0.5)
        shortest, longest = settings.get("lengths", lengths)
        # A third number that goes its own way, of two that fill a square.
        between = np.mod(where @ [7.0, 11.0], 1.0)
        # Half the angle of the cap, about the z axis of an anchor, that simulated tips fill, as a
        # cosine.
        cap = 0.5
        height, around = 1.0 - (1.0 - cap) * where[:, 0], 2.0 * np.pi * where[:, 1]
        aside = np.sqrt(1.0 - height**2)
        away = np.column_stack([aside * np.cos(around), aside * np.sin(around), height])
        length = shortest + (longest - shortest) * between
        return np.asarray(position + length[:, None] * away @ rotation.T)

    @classmethod
    def measured(
        cls, place: FloatArray, tips: FloatArray, settings: Mapping[str, Any]
    ) -> dict[str, FloatArray]:
        """The distances from the anchor, unless nobody measures them."""
        if not settings.get("measured", True):
            return {}
        return {"length": np.linalg.norm(tips - place, axis=1)}

    @property
    def settings(self) -> Mapping[str, Any]:
        """Whether the lengths were measured, and between which they are."""
        rotation, position = self.poses.at({})
        starts = self.start(rotation, position).reshape(len(self.places[0]), -1)
        away = np.linalg.norm(position - starts[self.places[1], :3], axis=1)
        bounds = (float(away.min()), float(away.max()))
        if self._lengths is None:
            bounds = (float(away.mean()),) * 2
        return {"measured": self._lengths is not None, "lengths": bounds}

    @property
    def _lengths(self) -> FloatArray | None:
        return self.poses.samples.numbers.get("length")

    def _of_place(self, name: str) -> list[Parameter]:
        """The anchor, followed by its radius where no length was measured."""
        radius = Parameter(f"radius[{name}]", "", "m", plausible=PLAUSIBLE_POSITION)
        return [*super()._of_place(name), *([radius] if self._lengths is None else [])]

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The distances."""
        data = None if self._lengths is None else self._lengths[:, None]
        return self._blocks("distance", 1, _excess, data)

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tips as they are, shifted along the line to the anchor."""
        anchor, length = self._there(values, poses), poses.samples.numbers.get("length")
        if length is None:
            names = poses.samples.labels["anchor"].tolist()
            length = np.array([values[f"radius[{name}]"] for name in names])
        away = poses.at(values)[1] - anchor
        distance = np.linalg.norm(away, axis=1)
        return Observed(anchor + away * (length / np.maximum(distance, 1e-12))[:, None])

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Every anchor by `anchor_of`."""
        del rotation
        rows = [rows for _, rows in self._by_place()]
        if self._lengths is None:
            return np.concatenate([np.append(*anchor_of(position[row])) for row in rows])
        return np.concatenate([anchor_of(position[row], self._lengths[row])[0] for row in rows])

    def check_enough(self) -> None:
        """One distance more than an anchor has unknowns, from tips off one line; in one unit."""
        _, position = self.poses.at({})
        unknowns = len(self.own_parameters) // len(self.places[0])
        for name, rows in self._by_place():
            tips = position[rows]
            if len(tips) <= unknowns:
                raise self.refuse(
                    f"anchor {name} ranged {len(tips)} times",
                    f"every anchor ranged at least {unknowns + 1} times, because each has "
                    f"{unknowns} unknowns",
                    hint="" if len(tips) > 1 else "is its label misspelt?",
                )
            singular = np.linalg.svd(tips - tips.mean(axis=0), compute_uv=False)
            if singular[1] < _LINE * singular[0]:
                raise self.refuse(
                    f"all tips on one line where anchor {name} was ranged",
                    "tips on several sides of it",
                    hint="distances from points on a line do not determine where the anchor is "
                    "around it",
                )
            if self._lengths is not None and isinstance(self.poses, ArmPoses):
                self._check_unit(name, self._lengths[rows], extent(tips))

    def _check_unit(self, name: str, lengths: FloatArray, moved: float) -> None:
        """Lengths vary by no more than the tip moved, which is within reach of each of them."""
        if lengths.std() > OTHER_UNIT * moved or lengths.max() < moved / OTHER_UNIT:
            raise self.refuse(
                f"lengths from {mm(lengths.min()):.4g} to {mm(lengths.max()):.4g} mm at anchor "
                f"{name}, where the arm's readings move the tip by {mm(moved):.4g} mm",
                "distances of the tip from the anchor",
                hint="column length is in m, and length_mm in mm: is the unit right, and the arm?",
            )


def anchor_of(tips: FloatArray, lengths: FloatArray | None = None) -> tuple[FloatArray, float]:
    """The point that has these distances from the tips, and the mean distance.

    ``|p|² - 2 pᵀa + |a|² = l²`` is linear in a and |a|²; then Gauss–Newton. Tips in one plane leave
    open on which side the point is: then it is the one below.

    Args:
        tips: (n, 3), m.
        lengths: (n,), m; one unknown length by default.
    """
    middle = tips.mean(axis=0)
    about = tips - middle
    squared = np.sum(about**2, axis=1)
    squared_lengths = np.zeros(len(tips)) if lengths is None else lengths**2
    _, singular, v = np.linalg.svd(about, full_matrices=False)
    # Third over first singular value of tips in a plane: a hundredth.
    directions = v[singular > 0.01 * max(singular[0], 1e-12)]
    columns = np.column_stack([-2.0 * about @ directions.T, np.ones(len(tips))])
    solved = np.linalg.lstsq(columns, squared_lengths - squared, rcond=None)[0]
    anchor = solved[:-1] @ directions
    if lengths is not None and len(v) == 3 and len(directions) == 2:
        off = np.sqrt(max(solved[-1] - anchor @ anchor, 0.0))
        anchor = anchor - off * v[2] * (1.0 if v[2, 2] >= 0 else -1.0)
    return _refined(about, anchor, lengths, middle)


def _refined(
    tips: FloatArray, anchor: FloatArray, lengths: FloatArray | None, middle: FloatArray
) -> tuple[FloatArray, float]:
    def left(a: FloatArray) -> tuple[FloatArray, FloatArray]:
        distance = np.linalg.norm(tips - a, axis=1)
        return distance - (distance.mean() if lengths is None else lengths), distance

    residual, distance = left(anchor)
    for _ in range(20):
        columns = (anchor - tips) / np.maximum(distance, 1e-12)[:, None]
        if lengths is None:
            columns = columns - columns.mean(axis=0)
        moved = anchor - np.linalg.lstsq(columns, residual, rcond=_LINE)[0]
        after, farther = left(moved)
        if not np.sum(after**2) < np.sum(residual**2):
            break
        anchor, residual, distance = moved, after, farther
    return middle + anchor, float(distance.mean())
