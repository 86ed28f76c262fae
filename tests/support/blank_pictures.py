"""Pictures of reports that are composed, and not drawn: Matplotlib takes a fourth of their time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import BinaryIO

import pytest
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from suta_calib.report import svg


class Composed(Figure):
    """What a report composes, without a layout."""

    def __init__(self, figsize: tuple[float, float], **_: object) -> None:
        super().__init__(figsize=figsize)


class Blank:
    """A canvas that writes how large the picture is, and no more."""

    def __init__(self, figure: Figure) -> None:
        self.size = tuple(72 * figure.get_size_inches())

    def print_svg(self, file: BinaryIO, **_: object) -> None:
        size = 'width="{}pt" height="{}pt"'.format(*self.size)
        file.write(f'<svg xmlns="http://www.w3.org/2000/svg" {size}/>'.encode())


@contextmanager
def _drawn_by(figure: type[Figure], canvas: type) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(svg, "FigureCanvasSVG", canvas)
        patched.setattr(svg, "Figure", figure)
        yield


def composed_only() -> AbstractContextManager[None]:
    """Every picture is blank."""
    return _drawn_by(Composed, Blank)


def drawn_for_real() -> AbstractContextManager[None]:
    """Every picture is what a user sees."""
    return _drawn_by(Figure, FigureCanvasSVG)
