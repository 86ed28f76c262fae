"""Report of corners in pictures: pictures that show the board, and the calibrated camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.colors import LogNorm

from suta_calib.plotting.look import BLUE, GREY, WIDTH
from suta_calib.report.document import Document, Figure, File, Part, Text
from suta_calib.report.listing import Column, Json, Listing
from suta_calib.report.svg import picture, svg_text
from suta_calib.report.uncertainty import budget_record
from suta_calib.trust.uncertainty_budget import KnownScatter, UncertaintyBudget, axis_budget
from suta_calib.units import Unit, mm, text
from suta_calib.vision import drawn
from suta_calib.words import listed

if TYPE_CHECKING:
    from suta_calib.measurements import Camera
    from suta_calib.vision import BoardDepth, Detection, SearchedPicture
    from suta_calib.vision.camera_fit import CameraFit

NAME: Final = "detect"
_PIXELS: Final = frozenset({"fx", "fy", "cx", "cy"})

VIEWS: Final = Listing["SearchedPicture"](
    "Pictures",
    Column("image", "picture", lambda view: view.picture.name),
    Column("corners", "corners", lambda view: len(view.board.point) if view.board else 0, form="d"),
    Column("rms", "RMS, px", unit="px"),
    Column("sigma", "σ, px", lambda view: _board_figure(view, "std"), unit="px"),
    Column("blur", "blur, px", lambda view: _board_figure(view, "blur"), unit="px", form=".2f"),
    Column("left_out", "left out because", lambda view: view.reason),
    key="pictures",
)


def _board_figure(view: SearchedPicture, what: str) -> float | None:
    if view.board is None:
        return None
    value = float(np.median(getattr(view.board, what)))
    return value if np.isfinite(value) else None


@dataclass(frozen=True)
class Intrinsic:
    """One of a camera's numbers, and its standard deviation, or None."""

    name: str
    value: float
    std: float | None

    @property
    def unit(self) -> Unit:
        """Pixels, or none."""
        return "px" if self.name in _PIXELS else "1"

    def shown(self, value: float | None) -> str:
        """With as many decimals as it has."""
        return text(value, self.unit, decimals=2 if self.name in _PIXELS else 5)


CAMERA: Final = Listing[Intrinsic](
    "Camera",
    Column("", "", lambda row: row.name),
    Column("", "value", cell=lambda row: row.shown(row.value), numeric=True),
    Column("", "± std", cell=lambda row: row.shown(row.std), numeric=True),
    Column("", "unit", lambda row: "px" if row.unit == "px" else ""),
)


def intrinsics_of(camera: Camera) -> list[Intrinsic]:
    """Rows of a camera, in the order of its file."""
    stds = camera.stds
    return [
        Intrinsic(name, value, None if stds is None else float(stds[k]))
        for k, (name, value) in enumerate(camera.values.items())
    ]


def camera_record(camera: Camera) -> Json:
    """A camera as JSON has it: its numbers by name, and ``std`` of each where it is known."""
    size = {"width": camera.width, "height": camera.height}
    record: Json = {**size, "distortion_model": camera.lens.name, **camera.values}
    if camera.stds is not None:
        record["std"] = dict(zip(camera.lens.names, camera.stds.tolist(), strict=True))
    return record


def _budgets(fit: CameraFit) -> list[UncertaintyBudget]:
    """What the uncertainty of the focal length and of the principal point is made of."""
    covariance, scatter = fit.camera.covariance, KnownScatter(fit.freedom)
    assert covariance is not None
    parts = (
        ("focal length", "the focal length along one axis of the picture", slice(0, 2)),
        ("principal point", "one coordinate of the principal point", slice(2, 4)),
    )
    return [
        replace(axis_budget(of, "px", covariance[at, at], scatter), name=name)
        for name, of, at in parts
    ]


def detect_document(
    detection: Detection, *, pictures: bool = False, depth: BoardDepth | None = None
) -> Document:
    """Pictures with the board and without, and the camera; ``NAME.found.jpg`` of each if asked."""
    # Most pictures of a table on a console; JSON and the page have all.
    many = len(detection.views) > 40
    parts: list[Part] = [VIEWS.of(detection.views, place="page" if many else "everywhere")]
    if many:
        lost = [view for view in detection.views if view.board is None]
        parts.append(VIEWS.of(lost, "Left out", place="console"))
    sentence = f"{detection.detected} of {len(detection.views)} pictures show the board"
    if detection.rms is not None:
        sentence += f"; reprojection RMS {text(detection.rms, 'px', with_unit=True)} (2-D)"
    parts.append(Text(sentence))
    if depth is not None:
        parts.append(Text(_depth_sentence(depth)))
    if detection.camera is not None:
        by = "calibrated from these pictures" if detection.fit else "as given"
        title = f"Camera ({detection.camera.lens.name}), {by}"
        parts += [
            CAMERA.of(intrinsics_of(detection.camera), title),
            Figure(partial(_plot, detection), "Where corners were found, and their errors"),
        ]
    if detection.fit is not None:
        sure = detection.fit.projection
        middle, worst = (text(std, "px") for std in (sure.middle, sure.worst))
        certainty = (
            f"The lens is of the model {detection.fit.camera.lens.called}. Where the camera sees a "
            f"far point is known to ± {middle} px in the middle of the picture, and to ± {worst} "
            "px where it is worst: if that part matters, take pictures with the board there"
        )
        parts += [
            Text(certainty),
            Figure(partial(_sure, detection.fit), "How sure the projection is"),
        ]
    if pictures:
        parts += [
            File(_file_name(v.picture.name), partial(drawn, v, detection)) for v in detection.views
        ]
    data: Json = {
        "images": len(detection.views),
        "detected": detection.detected,
        "corners": len(detection.corners),
        "rms_px": detection.rms,
        "board": detection.board.row(),
        "calibrated": detection.fit is not None,
        "camera": None if detection.camera is None else camera_record(detection.camera),
    }
    if detection.fit is not None:
        data["covered"] = detection.fit.covered
        sure = detection.fit.projection
        data["uncertainty"] = [budget_record(one) for one in _budgets(detection.fit)]
        data["projection_std_px"] = {"middle": sure.middle, "worst": sure.worst}
    assessment = detection.assessment
    if depth is not None:
        assessment = assessment.with_care(depth.notes)
        data |= {
            "points": len(depth.points),
            "points_rms_mm": None if depth.middle_rms is None else mm(depth.middle_rms),
            "points_size": None if depth.size is None else depth.size[0],
            "corners_without_depth": dict(depth.lost),
        }
    return Document(NAME, "Corners in pictures", assessment, parts, data)


def _depth_sentence(depth: BoardDepth) -> str:
    """How many corners have a depth, and how well they fit the board."""
    lost = sum(depth.lost.values())
    sentence = f"{len(depth.points)} of {len(depth.points) + lost} corners were found in 3-D"
    if depth.middle_rms is not None:
        rms = text(depth.middle_rms, "m", with_unit=True)
        away = text(float(np.median(depth.points.position[:, 2])), "m", with_unit=True)
        sentence += f". They are {rms} (3-D RMS) from the corners of the board, at {away}"
    why = [f"{count}: {reason}" for reason, count in depth.lost.items()]
    return f"{sentence}. Left out: {listed(why)}" if why else sentence


def _file_name(picture: str) -> str:
    """Of a picture's drawing, whatever folders its name has."""
    return f"{Path(picture).with_suffix('').as_posix().replace('/', '_')}.found.jpg"


def _plot(detection: Detection) -> str:
    """An SVG: corners over the picture, and reprojection errors."""
    camera, residuals = detection.camera, detection.residuals
    assert camera is not None
    assert residuals is not None
    with picture(NAME, (1.3 * WIDTH, 3.8)) as figure:
        where, left = figure.subplots(1, 2, width_ratios=(1.4, 1))
        # A drawing of more corners is many megabytes.
        step = max(1, len(residuals) // 5000)
        marks: dict[str, Any] = {"color": BLUE, "ms": 1.5, "alpha": 0.6, "linestyle": "none"}
        where.plot(*detection.corners.pixel[::step].T, marker="o", **marks)
        where.set_xlim(-0.5, camera.width - 0.5)
        where.set_ylim(camera.height - 0.5, -0.5)
        where.set_aspect("equal")
        where.set_title("Corners of all pictures")
        where.set_xlabel("u, px")
        where.set_ylabel("v, px")
        left.plot(*residuals[::step].T, marker="o", **marks)
        largest = float(np.nanmax(np.abs(residuals), initial=0.01)) * 1.1
        for axis in (left.axhline, left.axvline):
            axis(0, color=GREY, lw=0.8, zorder=0)
        left.set_xlim(-largest, largest)
        left.set_ylim(largest, -largest)
        left.set_aspect("equal")
        left.set_title("Reprojection errors")
        left.set_xlabel("along u, px")
        left.set_ylabel("along v, px")
        return svg_text(figure, NAME, "Corners in the picture, and reprojection errors")


def _sure(fit: CameraFit) -> str:
    """An SVG: standard deviation of the projection over the picture."""
    sure, camera = fit.projection, fit.camera
    with picture(f"{NAME}-sure", (WIDTH, 3.4)) as figure:
        axes = figure.subplots()
        shown = np.maximum(sure.std, 1e-3)
        least = float(np.nanmin(shown))
        # What is hardly known at all says no more by how little.
        most = max(min(float(np.nanmax(shown)), 100.0 * least), 1.5 * least)
        levels = np.geomspace(least, most, 9)
        filled = axes.contourf(
            sure.u, sure.v, shown, levels, cmap="cividis", norm=LogNorm(least, most), extend="max"
        )
        axes.plot(*fit.used.pixel[:: max(1, len(fit.used) // 2000)].T, ".", color="w", ms=0.6)
        axes.set_xlim(-0.5, camera.width - 0.5)
        axes.set_ylim(camera.height - 0.5, -0.5)
        axes.set_aspect("equal")
        axes.set_xlabel("u, px")
        axes.set_ylabel("v, px")
        ticks = levels[::2]
        bar = figure.colorbar(filled, ax=axes, ticks=ticks, aspect=16, shrink=0.9)
        bar.ax.set_yticklabels([f"{tick:.2g}" for tick in ticks])
        bar.ax.minorticks_off()
        bar.set_label("± where a far point is seen, px")
        return svg_text(figure, f"{NAME}-sure", "Standard deviation of the projection")
