"""What a new job gives to print: a sheet of crosses and a board, as SVG in their true size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.sax.saxutils import escape

from suta_calib.arrays import FloatArray
from suta_calib.measurements.board import Chessboard
from suta_calib.units import mm

# A4 on its side, mm.
_WIDTH, _HEIGHT = 297.0, 210.0
_SAY = "Print at 100 % (no fitting to the page). Measure with a steel ruler."


def crosses_svg(places: Mapping[str, FloatArray]) -> str:
    """An A4 page with a named cross at each place (3,), m; x points up the page, y to the left."""
    xs, ys = ([mm(at[axis]) for at in places.values()] for axis in (0, 1))
    # In the middle of the page.
    left, top = (_WIDTH + max(ys) + min(ys)) / 2, (_HEIGHT + max(xs) + min(xs)) / 2

    def drawn() -> Iterator[str]:
        for name, at in places.items():
            u, v = left - mm(at[1]), top - mm(at[0])
            yield f'<path d="M{u - 8:.3f} {v:.3f}h16M{u:.3f} {v - 8:.3f}v16"/>'
            yield f'<text x="{u + 1.5:.3f}" y="{v - 1.5:.3f}">{escape(name)}</text>'
        far = f"{max(xs) - min(xs):g} mm up the page, {max(ys) - min(ys):g} mm across"
        yield f'<text x="10" y="{_HEIGHT - 6:g}">{_SAY} The outer crosses: {far}.</text>'

    return _page(_WIDTH, _HEIGHT, drawn())


def chessboard_svg(board: Chessboard) -> str:
    """A page with a chessboard, A4 or as large as the board."""
    square = mm(board.square)
    columns, rows = board.columns + 1, board.rows + 1
    width = max(_WIDTH, columns * square + 20)
    height = max(_HEIGHT, rows * square + 30)
    left, top = (width - columns * square) / 2, (height - 10 - rows * square) / 2

    def drawn() -> Iterator[str]:
        for k in range(columns * rows):
            row, column = divmod(k, columns)
            if (row + column) % 2 == 0:
                x, y = left + column * square, top + row * square
                yield f'<rect x="{x:.3f}" y="{y:.3f}" width="{square:g}" height="{square:g}"/>'
        size = f"The squares together: {columns * square:g} x {rows * square:g} mm."
        yield f'<text x="10" y="{height - 4:g}">{_SAY} {size}</text>'

    return _page(width, height, drawn())


def _page(width: float, height: float, drawn: Iterator[str]) -> str:
    style = "path{stroke:#000;stroke-width:.2;fill:none}text{font:4px sans-serif}"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="0 0 {width:g} {height:g}">'
    )
    return "\n".join([head, f"<style>{style}</style>", *drawn, "</svg>", ""])
