"""One picture of a stereotactic navigation problem: distortion, its correction, the pivots."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from suta_calib.arrays import FloatArray
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, plain_log, style, svg_text
from suta_calib.stereotactic.distortion import DistortionCorrection
from suta_calib.stereotactic.solve import StereotacticResult

MM: Final = 1e3
CELLS: Final = 8  # of the map, in each direction
NAME: Final = "stereotactic"


def stereotactic_figure(result: StereotacticResult) -> str:
    """A whole SVG document: map of the EM readings' errors and residuals of the pivots, mm.

    With a correction also its effect and its cross-validation.
    """
    with style(NAME):
        rows = 1 if result.correction is None else 2
        figure = Figure(figsize=(1.25 * WIDTH, 3.7 * rows), layout="constrained")
        panels = figure.subplots(rows, 2, squeeze=False)
        _map(figure, panels[0, 0], result)
        _pivots(panels[0, 1], result)
        if result.correction is not None:
            _effect(panels[1, 0], result.em_error, result.correction)
            _validation(panels[1, 1], result.correction)
        return svg_text(figure, NAME, f"Stereotactic navigation: {result.data.name}") + "\n"


def _map(figure: Figure, axes: Axes, result: StereotacticResult) -> None:
    """Mean error in cells of the middle third of the volume, seen along z."""
    points, errors = (MM * v.reshape(-1, 3) for v in (result.expected, result.em_error))
    low, high = np.quantile(points[:, 2], [1 / 3, 2 / 3])
    slab = (points[:, 2] >= low) & (points[:, 2] <= high)
    places, vectors = _cell_means(points[slab], errors[slab])
    sizes = np.linalg.norm(vectors, axis=1)
    arrows = axes.quiver(
        *(places[:, 0], places[:, 1], vectors[:, 0], vectors[:, 1], sizes),
        cmap="viridis_r",
        angles="xy",
        pivot="tail",
        width=0.006,
    )
    axes.set_aspect("equal")
    axes.margins(0.12)
    axes.grid()
    axes.set_title("Error of the EM readings (arrows enlarged)")
    axes.set_xlabel(f"x in the EM tracker, mm (z from {low:.0f} to {high:.0f} mm)")
    axes.set_ylabel("y in the EM tracker, mm")
    figure.colorbar(arrows, ax=axes, shrink=0.85).set_label("mean error in 3-D, mm")


def _cell_means(points: FloatArray, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean place and mean vector of the points in each cell of x and y that has any."""
    plane = points[:, :2]
    extent = np.maximum(np.ptp(plane, axis=0), 1e-9)
    cell = np.minimum(((plane - plane.min(axis=0)) / extent * CELLS).astype(int), CELLS - 1)
    _, which = np.unique(cell, axis=0, return_inverse=True)
    count = np.bincount(which)[:, None]
    sums = [
        np.stack([np.bincount(which, weights=column) for column in values.T], axis=1)
        for values in (points, vectors)
    ]
    return sums[0] / count, sums[1] / count


def _pivots(axes: Axes, result: StereotacticResult) -> None:
    """Distance of each probe's tip from its post, frame by frame."""
    drawn = (
        ("EM", result.em_pivot, "o", BLUE),
        ("optical", result.optical_pivot, "s", ORANGE),
    )
    for name, pivot, marker, colour in drawn:
        residuals = np.linalg.norm(pivot.residuals, axis=1)
        frames, label = np.arange(1, len(residuals) + 1), f"{name}, rms {MM * pivot.rms:.3g} mm"
        axes.plot(frames, MM * residuals, marker, color=colour, markersize=4.5, label=label)
        lost = [int(row) for row in pivot.outliers]
        if lost:
            axes.plot(*(frames[lost], MM * residuals[lost], "x"), color="black", label="outlier")
    axes.set_ylim(bottom=0)
    axes.grid(axis="y")
    axes.set_title("Pivots", pad=22)
    axes.set_xlabel("frame")
    axes.set_ylabel("distance of the tip from the post, mm")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))


def _effect(axes: Axes, before: FloatArray, correction: DistortionCorrection) -> None:
    """How many markers are off by how much, before and after."""
    sizes = [MM * np.linalg.norm(v, axis=-1).ravel() for v in (before, correction.residuals)]
    # Two decimals in the files: below that there is nothing to see.
    least, most = 1e-3, max(float(sizes[0].max()), float(sizes[1].max()), 1e-2)
    bins = np.geomspace(least, most, 40)
    looks = (("as measured", ORANGE, "////"), ("corrected", BLUE, ""))
    for values, (label, colour, hatch) in zip(sizes, looks, strict=True):
        clipped = np.clip(values, least, most)
        axes.hist(
            clipped,
            bins.tolist(),
            histtype="stepfilled",
            facecolor="white" if hatch else colour,
            edgecolor=colour,
            alpha=0.75,
            hatch=hatch,
            label=label,
        )
    plain_log(axes.xaxis, axes.set_xscale)
    axes.set_title("EM markers", pad=22)
    axes.set_xlabel("distance from where the optical tracker says, mm")
    axes.set_ylabel("markers")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))


def _validation(axes: Axes, correction: DistortionCorrection) -> None:
    """Error of left-out frames by degree."""
    degrees = list(correction.cross_validation)
    rms = [MM * value for value in correction.cross_validation.values()]
    axes.plot(degrees, rms, "o-", color=GREY, markerfacecolor=BLUE, markeredgecolor=BLUE)
    chosen = correction.degree
    axes.plot(
        *([chosen], [MM * correction.cross_validation[chosen]], "o"),
        markersize=12,
        markerfacecolor="none",
        markeredgecolor=ORANGE,
        markeredgewidth=2,
        label=f"chosen: {chosen}",
    )
    plain_log(axes.yaxis, axes.set_yscale)
    axes.set_xticks(degrees)
    axes.grid(axis="y", which="both")
    axes.set_title("Frames left out of the fit", pad=22)
    axes.set_xlabel("degree of the correction (0: none)")
    axes.set_ylabel("rms error, mm")
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
