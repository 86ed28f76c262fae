"""Charts as SVG that can stand inside an HTML page among others, or alone.

What is about a panel is laid out by how many letters it has: who reads the page has a font that
nobody here knows, and to measure text in one takes longer than all else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element, tostring

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.plotting.chart import Axis, Boxes, Chart, Labelled, Lines, Mark, Points, Steps
from suta_calib.plotting.look import BLACK, LINE, WHITE, WIDTH

# Pixels on a page per point of the figure, at most and at least. One as wide as `WIDTH` fills the
# text and fits a page of 500, where what is written in it is enlarged; one of several panels that
# is wider, or either on a telephone, can be read, and moved aside.
_ENLARGED: Final = 1.8
_REDUCED: Final = 1.1
_FITTED: Final = 0.87
# Width from which on a figure does not fit such a page anyway, points.
_WIDE: Final = 400.0
# Width of a letter on average, as a part of its height, and how far its foot is below its middle.
_LETTER: Final = 0.6
_FOOT: Final = 0.36
_FONT: Final = "font-family: 'DejaVu Sans', Verdana, Arial, sans-serif"
# Points: of axis labels and legends; a mark on an axis, and on a log axis between decades; room
# between what stands about a panel; a row of a legend, and its sample.
_LABEL: Final = 9.0
_LEGEND: Final = 8.0
_TICK: Final = 3.5
_MINOR: Final = 2.0
_GAP: Final = 5.0
_ROW: Final = 12.5
_SAMPLE: Final = 18.0
# Points per number on an axis, at least, but so many numbers.
_PER_NUMBER: Final = 38.0, 22.0
_FEWEST: Final = 3
# Points from which on those that hide each other are not all drawn, and how close they are, as a
# part of their size.
_MANY: Final = 2000
_HIDDEN: Final = 0.35
# A cross, by its corners, as a part of half its size.
_CROSS: Final = (
    *((-0.5, -1.0), (0.0, -0.5), (0.5, -1.0), (1.0, -0.5), (0.5, 0.0), (1.0, 0.5)),
    *((0.5, 1.0), (0.0, 0.5), (-0.5, 1.0), (-1.0, 0.5), (-0.5, 0.0), (-1.0, -0.5)),
)
_HALO: Final = f";paint-order: stroke;stroke: {WHITE};stroke-width: 2.5"
# Between the lines of a hatched face, points.
_HATCH: Final = 2.6
_DASHES: Final = {
    "": "",
    "dashed": ";stroke-dasharray: 4.4,1.9",
    "dotted": ";stroke-dasharray: 1.2,2",
}


@dataclass(frozen=True)
class Row:
    """Charts side by side.

    Attributes:
        charts: at least one.
        height: of their panels, points.
        shares: of the width of the page, in any unit; alike by default.
        widths: of the panels, points, where they do not share the page's.
    """

    charts: Sequence[Chart]
    height: float
    shares: Sequence[float] = ()
    widths: Sequence[float] = ()

    def panels(self, name: str, top: float) -> list[_Panel]:
        """The panels of a row that begins so far below the figure's top, points."""
        charts, widths = list(self.charts), list(self.widths)
        shares = np.asarray(self.shares or [1.0] * len(charts), dtype=float)
        # What stands beside a panel depends on how far its axes go, which depends on its width.
        for _ in range(2):
            abouts = [_About.of(chart, self.height) for chart in charts]
            if not self.widths:
                room = 72.0 * WIDTH - sum(each.left + each.right for each in abouts)
                widths = (room * shares / shares.sum()).tolist()
            both = zip(self.charts, widths, strict=True)
            charts = [chart.fitted(width, self.height) for chart, width in both]
        top += max(each.top for each in abouts)
        found, at = list[_Panel](), 0.0
        for number, (chart, about, wide) in enumerate(zip(charts, abouts, widths, strict=True)):
            at += about.left
            found.append(_Panel(chart, about, f"{name}-{number}", at, top, wide, self.height))
            at += wide + about.right
        return found


def chart_svg(
    charts: Sequence[Chart],
    name: str,
    description: str,
    height: float,
    widths: Sequence[float] = (),
    note: str = "",
) -> str:
    """Charts side by side as one SVG element.

    Args:
        charts: at least one.
        name: of the plot, unique on the page.
        description: what a reader who cannot see it is told.
        height: of the panels, points.
        widths: of each; as wide as the page, alike, by default.
        note: below the charts.
    """
    return rows_svg([Row(charts, height, widths=widths)], name, description, note)


def rows_svg(rows: Sequence[Row], name: str, description: str, note: str = "") -> str:
    """Rows of charts as one SVG element.

    Args:
        rows: at least one, from the top.
        name: of the plot, unique on the page.
        description: what a reader who cannot see it is told.
        note: below the charts.
    """
    drawing = Element("g", style=f"{_FONT};stroke-linejoin: round")
    wide = high = 0.0
    for number, row in enumerate(rows):
        panels = row.panels(f"{name}-{number}" if number else name, high)
        for panel in panels:
            drawing.extend(panel.drawn())
        wide = max(wide, panels[-1].left + panels[-1].width + panels[-1].about.right)
        high = panels[0].top + row.height + max(panel.about.bottom for panel in panels)
    if note:
        high += _ROW + _GAP
        drawing.append(_text(2.0, high - _GAP, note, _LEGEND))
    said = {"id": name, "role": "img", "aria-label": description} | sized(wide)
    page = {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {wide:.1f} {high:.1f}"}
    figure = Element("svg", page | said)
    figure.append(drawing)
    return tostring(figure, "unicode")


def sized(width: float) -> dict[str, str]:
    """Attributes of a figure that say how large a page may show it.

    Args:
        width: of the figure, points.
    """
    fits = _WIDE < width < 72.0 * WIDTH + 1.0
    reduced = _FITTED if fits else _REDUCED
    most, least = (f"{width * pixels:.0f}px" for pixels in (_ENLARGED, reduced))
    size = {"style": f"max-width:{most};min-width:{least}"}
    return {"data-wide": ""} | size if fits else size


def width_of(texts: Iterable[str], size: float) -> float:
    """Room that the longest of some texts takes, points, in letters of so many points."""
    return _LETTER * size * max(map(len, texts), default=0)


@dataclass(frozen=True)
class _About:
    """Room about a panel, points: for what stands there, by how long it is."""

    left: float
    right: float
    bottom: float
    top: float

    @classmethod
    def of(cls, chart: Chart, height: float) -> _About:
        beside = width_of((text for _, text in chart.y.marks(_most(height, 1))), chart.y.size)
        names = chart.x.names or ()
        below = width_of((text for _, text in names), chart.x.size) if names else chart.x.size
        label = _LABEL + 2 * _GAP
        rows = -(-len(chart.legend) // chart.columns)
        titles = len(chart.title.splitlines())
        return cls(
            left=_TICK + _GAP + beside + (label if chart.y.label else 0.0),
            right=2 * _GAP,
            bottom=_TICK + _GAP + below + (label if chart.x.label else _GAP),
            top=_GAP + _ROW * (rows + titles) + (_GAP if titles and rows else 0.0),
        )


def _most(long: float, which: int) -> int:
    """How many numbers an axis has room for, that is so long and lies (0) or stands (1)."""
    return max(int(long / _PER_NUMBER[which]), _FEWEST)


@dataclass(frozen=True)
class _Panel:
    """A chart somewhere on its figure: the top left corner of its panel, and its size, points."""

    chart: Chart
    about: _About
    name: str
    left: float
    top: float
    width: float
    height: float

    def drawn(self) -> Iterator[Element]:
        """The elements, the hindmost first."""
        yield from self._grid()
        hatched = {
            mark.edge: f"{self.name}-hatch-{k}"
            for k, mark in enumerate(self.chart.marks)
            if isinstance(mark, Boxes | Steps) and mark.hatched
        }
        for colour, name in hatched.items():
            side = f"{_HATCH}"
            repeated = {"patternUnits": "userSpaceOnUse", "patternTransform": "rotate(45)"}
            pattern = Element("pattern", {"id": name, "width": side, "height": side} | repeated)
            pattern.append(_path(f"M0 0V{side}", f"stroke: {colour};stroke-width: 1.2"))
            yield pattern
        for mark in self.chart.marks:
            yield from self._mark(mark, hatched)
        yield from self._axes()
        yield from self._legend(hatched)
        yield from self._title()

    def _x(self, values: FloatArray) -> FloatArray:
        return self.left + self.width * self.chart.x.place(np.asarray(values, dtype=float))

    def _y(self, values: FloatArray) -> FloatArray:
        return self.top + self.height * (1.0 - self.chart.y.place(np.asarray(values, dtype=float)))

    def _mark(self, mark: Mark, hatched: dict[str, str]) -> Iterator[Element]:
        if isinstance(mark, Steps):
            x = np.repeat(self._x(mark.edges), 2)
            y = self._y(np.concatenate([[0.0], np.repeat(mark.heights, 2), [0.0]]))
            yield _path(_polyline(x, y), _face(mark, mark.fill, hatched, 1.0))
        elif isinstance(mark, Boxes):
            left, right = self._x(mark.left), self._x(mark.right)
            top, bottom = self._y(mark.top), self._y(mark.bottom)
            boxes = list(map(_box, left, right, top, bottom))
            if isinstance(mark.fill, str):
                yield _path("".join(boxes), _face(mark, mark.fill, hatched, 1.0))
            else:
                for box, fill in zip(boxes, mark.fill, strict=True):
                    yield _path(box, _face(mark, fill, hatched, 1.0))
        elif isinstance(mark, Lines):
            ends = zip(self._x(mark.x), self._y(mark.y), strict=True)
            yield _path("".join(_polyline(x, y) for x, y in ends), _stroke(mark))
        elif isinstance(mark, Points):
            shapes = _shapes(mark, self._x(mark.x), self._y(mark.y))
            # What is in one path has all its edges above all its faces.
            if isinstance(mark.size, float) and isinstance(mark.fill, str):
                shapes = {k: "".join(shapes.values()) for k in list(shapes)[:1]}
            for k, path in shapes.items():
                fill = mark.fill if isinstance(mark.fill, str) else mark.fill[k]
                yield _path(path, _points(mark, fill))
        else:
            for x, y, text, colour in zip(
                self._x(mark.x), self._y(mark.y), mark.texts, mark.colours, strict=True
            ):
                foot = y + _FOOT * mark.size
                yield _text(x, foot, text, mark.size, "middle", colour=colour, haloed=mark.haloed)

    def _grid(self) -> Iterator[Element]:
        x, y = self._marks(self.chart.x, 0), self._marks(self.chart.y, 1)
        right, bottom = self.left + self.width, self.top + self.height
        lines = [f"M{at:.1f} {self.top:.1f}V{bottom:.1f}" for at, _ in x if self.chart.x.grid]
        lines += [f"M{self.left:.1f} {at:.1f}H{right:.1f}" for at, _ in y if self.chart.y.grid]
        if lines:
            yield _path("".join(lines), f"fill: none;stroke: {LINE};stroke-width: 0.8")

    def _marks(self, axis: Axis, which: int) -> list[tuple[float, str]]:
        """Where marks stand along an axis, points, and what they say."""
        long, of = (self.width, self._x) if which == 0 else (self.height, self._y)
        marks = axis.marks(_most(long, which))
        places = of(np.array([value for value, _ in marks])).tolist()
        return [(at, text) for at, (_, text) in zip(places, marks, strict=True)]

    def _axes(self) -> Iterator[Element]:
        x, y = self.chart.x, self.chart.y
        right, bottom = self.left + self.width, self.top + self.height
        frame = f"M{self.left:.1f} {self.top:.1f}V{bottom:.1f}H{right:.1f}"
        lines = [] if self.chart.bare else [frame]
        minor_x, minor_y = self._x(np.array(x.minor())), self._y(np.array(y.minor()))
        lines += [f"M{at:.1f} {bottom:.1f}v{_MINOR}" for at in minor_x]
        lines += [f"M{self.left:.1f} {at:.1f}h-{_MINOR}" for at in minor_y]
        texts = list[Element]()
        for at, text in self._marks(x, 0):
            lines.append(f"M{at:.1f} {bottom:.1f}v{_TICK}")
            down = bottom + _TICK + _GAP
            # Names have no room beside each other.
            if x.names:
                texts.append(_text(at + _FOOT * x.size, down, text, x.size, "end", upright=True))
            else:
                texts.append(_text(at, down + 0.7 * x.size, text, x.size, "middle"))
        for at, text in self._marks(y, 1):
            lines.append(f"M{self.left:.1f} {at:.1f}h-{_TICK}")
            beside = self.left - _TICK - _GAP
            texts.append(_text(beside, at + _FOOT * y.size, text, y.size, "end"))
        if lines:
            yield _path("".join(lines), f"fill: none;stroke: {BLACK};stroke-width: 0.8")
        yield from texts
        if x.label:
            below = bottom + self.about.bottom - _GAP
            yield _text((self.left + right) / 2, below, x.label, _LABEL, "middle")
        if y.label:
            beside = self.left - self.about.left + _LABEL + 2.0
            middle = self.top + self.height / 2
            yield _text(beside, middle, y.label, _LABEL, "middle", upright=True)

    def _legend(self, hatched: dict[str, str]) -> Iterator[Element]:
        shown = self.chart.legend
        rows = -(-len(shown) // self.chart.columns)
        at = self.left
        for column in (shown[k : k + rows] for k in range(0, len(shown), max(rows, 1))):
            for row, mark in enumerate(column):
                up = self.top - _GAP - _ROW * (rows - row - 0.5)
                yield _sample(mark, at, up, hatched)
                text = at + _SAMPLE + _GAP
                yield _text(text, up + _FOOT * _LEGEND, mark.label, _LEGEND)
            at += _SAMPLE + 6 * _GAP + width_of((mark.label for mark in column), _LEGEND)

    def _title(self) -> Iterator[Element]:
        begin = self.top - self.about.top + _ROW
        for row, line in enumerate(self.chart.title.splitlines()):
            yield _text(self.left, begin + _ROW * row, line, _LABEL, bold=True)


def _sample(mark: Labelled, left: float, middle: float, hatched: dict[str, str]) -> Element:
    """What a mark looks like, for the legend."""
    if isinstance(mark, Lines):
        return _path(f"M{left:.1f} {middle:.1f}h{_SAMPLE}", _stroke(mark))
    fill = mark.fill if isinstance(mark.fill, str) else mark.fill[0]
    if isinstance(mark, Points):
        size = float(np.mean(mark.size)) if len(mark.x) else _LEGEND
        return _path(_shape(mark, size, left + _SAMPLE / 2, middle), _points(mark, fill))
    half = 0.35 * _LEGEND
    box = _box(left, left + _SAMPLE, middle - half, middle + half)
    return _path(box, _face(mark, fill, hatched, 1.0))


def _face(mark: Boxes | Steps, fill: str, hatched: dict[str, str], width: float) -> str:
    inside = f"url(#{hatched[mark.edge]})" if mark.hatched else fill or "none"
    return f"fill: {inside};stroke: {mark.edge or 'none'};stroke-width: {width:g}"


def _stroke(mark: Lines) -> str:
    return f"fill: none;stroke: {mark.colour};stroke-width: {mark.width:g}{_DASHES[mark.dash]}"


def _points(mark: Points, fill: str) -> str:
    return f"fill: {fill or 'none'};stroke: {mark.edge}"


def _shapes(mark: Points, x: FloatArray, y: FloatArray) -> dict[int, str]:
    """The outlines of points at places of the figure, by their number."""
    sizes = np.broadcast_to(mark.size, x.shape)
    chosen = np.arange(len(x))
    if len(x) > _MANY:
        # Of those that hide each other, one: the file would be many megabytes.
        cell = np.stack([x, y]) // (_HIDDEN * sizes)
        chosen = np.sort(np.unique(cell, axis=1, return_index=True)[1])
    places = zip(sizes[chosen].tolist(), x[chosen].tolist(), y[chosen].tolist(), strict=True)
    outlines = (_shape(mark, *each) for each in places)
    return dict(zip(chosen.tolist(), outlines, strict=True))


def _shape(mark: Points, size: float, x: float, y: float) -> str:
    half = size / 2
    if mark.shape == "circle":
        arc = f"a{half:g} {half:g} 0 1 0"
        return f"M{x - half:.1f} {y:.1f}{arc} {size:g} 0{arc} -{size:g} 0z"
    if mark.shape == "square":
        return _box(x - half, x + half, y - half, y + half)
    if mark.shape == "cross":
        at = (f"{x + half * a:.1f} {y + half * b:.1f}" for a, b in _CROSS)
        return f"M{'L'.join(at)}z"
    return f"M{x:.1f} {y - half:.1f}l{half:g} {size:g}h-{size:g}z"


def _box(left: float, right: float, top: float, bottom: float) -> str:
    return f"M{left:.1f} {top:.1f}H{right:.1f}V{bottom:.1f}H{left:.1f}z"


def _polyline(x: FloatArray, y: FloatArray) -> str:
    first, *others = (f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    return f"M{first}L{' '.join(others)}"


def _path(path: str, style: str) -> Element:
    return Element("path", d=path, style=style)


def _text(
    x: float,
    y: float,
    text: str,
    size: float,
    anchor: str = "start",
    *,
    upright: bool = False,
    colour: str = "",
    bold: bool = False,
    haloed: bool = False,
) -> Element:
    """A text whose foot begins, has its middle or ends (``anchor``) there."""
    style = f"font-size: {size:g}px;text-anchor: {anchor}" + (f";fill: {colour}" if colour else "")
    style += ";font-weight: bold" * bold + _HALO * haloed
    written = Element("text", x=f"{x:.1f}", y=f"{y:.1f}", style=style)
    if upright:
        written.set("transform", f"rotate(-90 {x:.1f} {y:.1f})")
    written.text = text
    return written
