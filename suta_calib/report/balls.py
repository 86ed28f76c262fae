"""Report of balls in clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from suta_calib.report.document import Document
from suta_calib.report.listing import Column, Json, Listing, components

if TYPE_CHECKING:
    from suta_calib.vision.balls import BallSearch, SearchedCloud

NAME: Final = "balls"


def _of(row: SearchedCloud, what: str, part: int | None = None) -> Any:
    """A figure of a ball that was found, or one of its parts."""
    value = None if row.ball is None else getattr(row.ball, what)
    return value if part is None or value is None else float(value[part])


BALLS: Final = Listing["SearchedCloud"](
    "Balls",
    Column("image", "cloud"),
    Column("name", "ball"),
    *components(("x, mm", "y, mm", "z, mm"), lambda row: _of(row, "centre"), "m"),
    *components(("± x, mm", "± y, mm", "± z, mm"), lambda row: _of(row, "sigma"), "m"),
    Column("position", None, lambda row: _of(row, "centre"), "m"),
    Column("std", None, lambda row: _of(row, "sigma"), "m"),
    Column("radius", None, lambda row: _of(row, "radius", 0), "m"),
    Column("points", "points", lambda row: _of(row, "points")),
    Column("rms", "RMS, mm", lambda row: _of(row, "rms"), unit="m"),
    Column("left_out", "left out because", lambda row: row.reason),
    key="balls",
)


def balls_document(search: BallSearch) -> Document:
    """Where the balls are in each cloud."""
    data: Json = {
        "clouds": search.clouds,
        "found": len(search.points),
    }
    return Document(NAME, "Balls in clouds", search.assessment, [BALLS.of(search.searched)], data)
