"""Report of planes in clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from suta_calib.report.document import Document
from suta_calib.report.listing import Column, Json, Listing, plain

if TYPE_CHECKING:
    from suta_calib.vision.planes import CloudWithPlane, PlaneSearch

NAME: Final = "planes"


def _of(row: CloudWithPlane, what: str) -> Any:
    """A figure of a plane that was found."""
    return None if row.plane is None else getattr(row.plane, what)


def _largest_tilt(row: CloudWithPlane) -> float | None:
    return None if row.plane is None else float(row.plane.tilt.max())


def _normal(row: CloudWithPlane) -> str:
    return "" if row.plane is None else " ".join(f"{part:.3f}" for part in row.plane.normal)


PLANES: Final = Listing["CloudWithPlane"](
    "Planes",
    Column("image", "cloud"),
    Column("normal", "normal", lambda row: _of(row, "normal"), cell=_normal),
    Column("distance", "distance, mm", lambda row: _of(row, "distance"), "m"),
    Column("std", "±, mm", lambda row: _of(row, "height_std"), "m"),
    Column("tilt_std", "± tilt, deg", _largest_tilt, "rad"),
    Column("middle", None, lambda row: _of(row, "middle"), "m"),
    Column("points", "points", lambda row: _of(row, "points")),
    Column("dropped", None, lambda row: row.dropped),
    Column("rms", "RMS, mm", lambda row: _of(row, "rms"), unit="m"),
    Column("left_out", "left out because", lambda row: row.reason, optional=True),
    key="planes",
)


def planes_document(search: PlaneSearch) -> Document:
    """Where the plane is in each cloud."""
    figures: Json = {
        "name": search.name,
        "clouds": len(search.clouds),
        "found": len(search.found),
        "depth_noise": {"along_mm": plain(search.noise, "m")},
    }
    title = f"Plane {search.name} in clouds"
    return Document(NAME, title, search.assessment, [PLANES.of(search.clouds)], figures)
