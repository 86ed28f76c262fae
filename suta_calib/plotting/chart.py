"""A flat picture, declared: marks between two axes.

Who draws it has no part in what it shows: Matplotlib does in a notebook (`on_axes`), and the
report writes it as SVG (`report.chart_svg`), in a fraction of the time that it takes to import
Matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.plotting.look import BLACK

Dash = Literal["", "dashed", "dotted"]
Shape = Literal["circle", "square", "triangle", "cross"]
# Room between the outermost marks and the end of an axis, as a part of what they span.
_ROOM: Final = 0.05
# Steps of marks along an axis, of which a power of ten makes all others.
_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)
# Numbers no larger than this are written with a power of ten.
_SMALL: Final = 1e-4


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles.

    Attributes:
        left, right, bottom, top: (n,) their edges; beyond an axis is its end.
        fill: a colour, or of each; empty for none.
        edge: a colour, empty for none.
        hatched: with lines in the colour of the edge, so that it is told apart without colours.
        label: in the legend; empty for none.
    """

    left: FloatArray
    right: FloatArray
    bottom: FloatArray
    top: FloatArray
    fill: str | Sequence[str] = ""
    edge: str = ""
    hatched: bool = False
    label: str = ""


@dataclass(frozen=True, eq=False)
class Steps:
    """The outline of a histogram, on zero.

    Attributes:
        edges: (n + 1,) of its bins.
        heights: (n,) of them.
        fill, edge, hatched, label: as of `Boxes`; one colour.
    """

    edges: FloatArray
    heights: FloatArray
    fill: str = ""
    edge: str = BLACK
    hatched: bool = False
    label: str = ""


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines, or what straight pieces make.

    Attributes:
        x, y: (n, k) where each begins, bends and ends; what is infinite, at the end of the axis.
        width: points.
        colour, dash, label: of all.
    """

    x: FloatArray
    y: FloatArray
    width: float = 1.0
    colour: str = BLACK
    dash: Dash = ""
    label: str = ""


@dataclass(frozen=True, eq=False)
class Points:
    """Marks of one look.

    Attributes:
        x, y: (n,) their middles.
        size: points across, or (n,) of each.
        fill: a colour, or of each; empty for none.
        shape, edge, label: of all.
    """

    x: FloatArray
    y: FloatArray
    size: float | FloatArray = 5.0
    shape: Shape = "circle"
    fill: str | Sequence[str] = ""
    edge: str = BLACK
    label: str = ""


@dataclass(frozen=True, eq=False)
class Words:
    """Short texts.

    Attributes:
        x, y: (n,) their middles.
        texts: each.
        colours: of each.
        size: of the letters, points.
        haloed: whether they stand out from marks below them.
    """

    x: FloatArray
    y: FloatArray
    texts: Sequence[str]
    colours: Sequence[str]
    size: float = 6.0
    haloed: bool = False


Labelled = Boxes | Steps | Lines | Points
Mark = Labelled | Words


@dataclass(frozen=True)
class Axis:
    """One direction.

    Attributes:
        label: what it says, with the unit.
        first, last: the values at its ends; the first may be the larger one.
        log: whether each decade takes the same room.
        names: what stands at some values; numbers where it is None.
        size: of these names, points.
        grid: whether a line goes on from each.
        whole: whether only whole numbers are values.
    """

    label: str
    first: float
    last: float
    log: bool = False
    names: Sequence[tuple[float, str]] | None = None
    size: float = 9.0
    grid: bool = False
    whole: bool = False

    def place(self, values: FloatArray) -> FloatArray:
        """Where values lie along it, from 0 to 1; beyond its ends, at them."""
        low, high = min(self.first, self.last), max(self.first, self.last)
        inside, ends = np.clip(values, low, high), np.array([self.first, self.last])
        if self.log:
            inside, ends = np.log10(inside), np.log10(ends)
        return np.asarray((inside - ends[0]) / (ends[1] - ends[0]))

    def marks(self, most: int) -> list[tuple[float, str]]:
        """Values with what stands there: at most so many numbers, or all its names."""
        if self.names is not None:
            return list(self.names)
        low, high = sorted((self.first, self.last))
        return _decades(low, high, most) if self.log else _numbers(low, high, most, self.whole)

    def minor(self) -> list[float]:
        """Values on a log axis where a shorter line stands: 2 and 5 of each decade, if few."""
        if not self.log:
            return []
        low, high = np.log10(self.first), np.log10(self.last)
        if high - low > 6:
            return []
        found = [s * 10.0**k for k in range(int(low) - 1, int(high) + 2) for s in (2, 5)]
        return [each for each in found if self.first <= each <= self.last]


@dataclass(frozen=True, eq=False)
class Chart:
    """Marks between two axes, the first below all others.

    Attributes:
        marks: what is seen.
        x, y: the axes.
        columns: of the legend, which stands above the panel and fills one after the other.
        told: what the legend tells of, in order; all that has a label by default.
        title: above the legend, in lines.
        equal: whether a length is as long along one axis as along the other (`fitted`).
        bare: whether there are no lines along the axes.
    """

    marks: Sequence[Mark]
    x: Axis
    y: Axis
    columns: int = 2
    told: Sequence[Labelled] = ()
    title: str = ""
    equal: bool = False
    bare: bool = False

    def fitted(self, width: float, height: float) -> Chart:
        """The chart on a panel of that shape: where it is `equal`, one axis goes on at both ends.

        Args:
            width: of the panel, in any unit.
            height: of it, in the same.
        """
        if not self.equal:
            return self
        (x, wide), (y, high) = (
            ((axis.first + axis.last) / 2.0, axis.last - axis.first) for axis in (self.x, self.y)
        )
        half = max(abs(wide) / width, abs(high) / height) / 2.0
        across, up = half * width * np.sign(wide), half * height * np.sign(high)
        return replace(
            self,
            x=replace(self.x, first=float(x - across), last=float(x + across)),
            y=replace(self.y, first=float(y - up), last=float(y + up)),
        )

    @property
    def legend(self) -> list[Labelled]:
        """What the legend tells of, in order."""
        every = (mark for mark in self.marks if not isinstance(mark, Words))
        return [mark for mark in self.told or every if mark.label]


def ends(
    values: FloatArray, *, log: bool = False, least: float | None = None
) -> tuple[float, float]:
    """Ends of an axis that some values, at least one, have room on.

    Args:
        values: positive on a log axis.
        log: whether it is one.
        least: where it begins instead.
    """
    span = np.log10(values) if log else values
    low, high = float(np.min(span)), float(np.max(span))
    if least is not None:
        low = float(np.log10(least)) if log else least
    room = _ROOM * (high - low) or _ROOM * (abs(high) or 1.0)
    low, high = low - room * (least is None), high + room
    return (10.0**low, 10.0**high) if log else (low, high)


def named_rows(names: Sequence[str], size: float = 9.0, label: str = "") -> Axis:
    """The axis of rows 0, 1, … from the top, a name each."""
    return Axis(label, len(names) - 0.4, -0.6, names=list(enumerate(names)), size=size)


def _numbers(low: float, high: float, most: int, whole: bool) -> list[tuple[float, str]]:
    """Round numbers between two."""
    rough = (high - low) / max(most, 1)
    decade = float(10.0 ** np.floor(np.log10(rough)))
    if whole:
        decade = max(decade, 1.0)
    steps = (each * decade for each in _STEPS)
    step = next(
        each for each in steps if each >= rough * (1 - 1e-9) and (not whole or each.is_integer())
    )
    # Of a step of 0.25 two digits, of one of 0.2 one.
    digits = next(k for k in range(20) if abs(round(step, k) - step) < 1e-6 * step)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    largest = max(abs(low), abs(high))
    # As many digits as tell a number from the next.
    form = f".{digits}f" if largest > _SMALL else f".{int(np.log10(largest / step)) + 3}g"
    return [(k * step, f"{k * step:{form}}".replace("-", "−")) for k in range(first, last + 1)]


def _decades(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Powers of ten between two numbers, not all of many; 2 and 5 times them of few."""
    first, last = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
    if last - first < 1:
        values = [s * 10.0**k for k in range(first - 1, last + 1) for s in (1, 2, 5)]
    else:
        every = -(-(last - first + 1) // max(most, 1))
        values = [10.0**k for k in range(first, last + 1, every)]
    return [(each, f"{each:g}") for each in values if low <= each * (1 + 1e-9) <= high * (1 + 1e-8)]
