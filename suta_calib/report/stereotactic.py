"""Report of a stereotactic navigation problem, and its files in the CIS formats."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from suta_calib.arrays import FloatArray
from suta_calib.errors import OutputError
from suta_calib.plotting.look import BLUE, GREY, ORANGE, WIDTH
from suta_calib.plotting.style import plain_log
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.report.document import Document, Figure, File, Part, Text
from suta_calib.report.listing import (
    Column,
    Json,
    Listing,
    components,
    plain,
    shown_as,
    written,
)
from suta_calib.report.poses import axes_with_std
from suta_calib.report.svg import picture, svg_text
from suta_calib.stereotactic.cis_files import output1_text, points_text
from suta_calib.stereotactic.distortion import DistortionCorrection
from suta_calib.stereotactic.navigation import Navigation
from suta_calib.stereotactic.solve import StereotacticErrors, StereotacticResult
from suta_calib.units import mm, text

NAME: Final = "stereotactic"


# The two pivots by name.
PIVOTS: Final = Listing[tuple[str, PivotCalibration]](
    "Posts in the EM tracker, mm",
    Column("", "pivot", lambda row: row[0]),
    *axes_with_std(lambda row: row[1].post, lambda row: row[1].post_std()),
    Column("pivot_rms", "rms", lambda row: row[1].rms, "m"),
    shown_as(
        "frames",
        lambda row: (
            f"{len(row[1].inliers)}" + f", {len(row[1].outliers)} off" * bool(row[1].outliers)
        ),
    ),
    Column("post_std", None, lambda row: row[1].post_std(), "m"),
    *(c.over(lambda row: row[1]) for c in written("post", "tip", "tip_std", unit="m")),
    Column("pivot_outliers", None, lambda row: row[1].outliers),
)
# Of the lengths (n,) of errors.
SIZES: Final = (
    Column[FloatArray]("rms", "rms", lambda sizes: np.sqrt(np.mean(sizes**2)), "m"),
    Column[FloatArray]("mean", "mean", lambda sizes: sizes.mean(), "m"),
    Column[FloatArray]("max", "max", lambda sizes: sizes.max(), "m"),
    Column[FloatArray]("count", "count", len, form="d"),
)
READINGS: Final = Listing[tuple[str, FloatArray]](
    "EM markers, distance from their true places, mm",
    Column("", "readings", lambda row: row[0]),
    *(column.over(lambda row: row[1]) for column in SIZES),
)
# The EM probe's tip by frame, (3,), m, and the error to expect there.
NAVIGATION: Final = Listing[tuple[int, tuple[FloatArray, float]]](
    "EM probe's tip in CT, mm",
    Column("", "frame", lambda row: row[0], form="d"),
    *components("xyz", lambda row: row[1][0], "m"),
    Column("", "expected error", lambda row: row[1][1], "m"),
)
REGISTRATION: Final = Listing[Navigation](
    "",
    Column("nav", value=lambda row: row.ct, unit="m"),
    Column("nav_expected_error", value=lambda row: row.target_error, unit="m"),
    Column("T_ct_em", value=lambda row: row.registration.matrix),
    Column("fiducial_rms", value=lambda row: row.registration.rms, unit="m"),
    Column("fiducial_outliers", value=lambda row: row.registration.outliers),
)


@dataclass(frozen=True, eq=False)
class ComparedOutput:
    """Distances (n,), m, of something from where the given files have it; one of a single thing."""

    key: str
    name: str
    sizes: FloatArray

    def record(self) -> Json:
        """As JSON has it."""
        if len(self.sizes) == 1 and self.key.endswith("post"):
            return {f"{self.key}_mm": plain(self.sizes[0], "m")}
        return {
            f"{self.key}_{name}": size for name, size in (c.entry(self.sizes) for c in SIZES[1:3])
        }


COMPARISON: Final = Listing[ComparedOutput](
    "Difference to the given output files, mm",
    Column("", "distance of", lambda row: row.name),
    Column("", "mean", lambda row: row.sizes.mean(), "m", form=".4f"),
    Column(
        "",
        "max",
        lambda row: None if row.key.endswith("post") else row.sizes.max(),
        "m",
        form=".4f",
    ),
)


def stereotactic_document(result: StereotacticResult, errors: StereotacticErrors) -> Document:
    """Posts, EM readings, navigation, comparison; the picture and the output files.

    Files are written of any answer: the assessment says whether to use them. ``errors`` are those
    against output files that were given.
    """
    name, compared = result.data.name, _compared(errors)
    parts: list[Part] = [PIVOTS.of(_pivots_of(result))]
    readings = [("as measured", _sizes(result.em_error))]
    if (correction := result.correction) is None:
        parts.append(READINGS.of(readings))
    else:
        done = f"corrected, degree {correction.degree}" if correction.degree else "no distortion"
        left_out = text(correction.cross_validation[correction.degree], "m", with_unit=True)
        readings.append((done, _sizes(correction.residuals)))
        parts += [READINGS.of(readings), Text(f"frames left out of the fit: rms {left_out}")]
    if (navigation := result.navigation) is not None:
        tips = zip(navigation.ct, navigation.target_error.tolist(), strict=True)
        registration = navigation.registration
        off = f", {len(registration.outliers)} of them off" * (not registration.inliers.all())
        fiducials = f"registered by {len(navigation.fiducials)} fiducials{off}"
        rms = text(registration.rms, "m", with_unit=True)
        parts += [NAVIGATION.of(enumerate(tips, start=1)), Text(f"{fiducials}: rms {rms}")]
    parts.append(COMPARISON.of(compared))
    if lost := {kind: count for kind, count in result.outliers.items() if count}:
        counts = ", ".join(f"{count} in {kind}" for kind, count in lost.items())
        parts.append(Text(f"Markers left out: {counts}"))
    parts.append(Figure(partial(stereotactic_plot, result)))
    first, second = (f"{name}-output{k}.txt" for k in (1, 2))
    parts.append(File(first, lambda: output1_text(result.output1, first)))
    if navigation is not None:
        in_ct = navigation.ct
        parts.append(File(second, lambda: points_text((len(in_ct),), second, in_ct)))
    data = _data(result) | {
        "comparison": {
            key: value for comparison in compared for key, value in comparison.record().items()
        }
    }
    title = f"Stereotactic navigation: {name}"
    return Document(f"{name}-{NAME}", title, result.assessment, parts, data, "files")


def check_given(answer: Document, folder: Path, inputs: Path) -> None:
    """Refuse to replace what may be the reference that came with the inputs.

    Raises:
        OutputError: the folder to write into is that of the inputs, and a file in it differs.
    """
    if not (inputs.is_dir() and folder.is_dir() and folder.samefile(inputs)):
        return
    for part in answer.parts:
        if not isinstance(part, File):
            continue
        path = folder / part.name
        if path.exists() and path.read_bytes() != part.as_bytes():
            raise OutputError(
                f"{path}: not written: found another result beside the inputs, perhaps the one "
                "that came with them; choose another folder with --out"
            )


def _data(result: StereotacticResult) -> Json:
    content: Json = {"name": result.data.name}
    for name, pivot in _pivots_of(result):
        record = PIVOTS.record((name, pivot))
        content |= {f"{name.lower()}_{key}": value for key, value in record.items()}
    content["em_readings"] = {"before": Listing("", *SIZES).record(_sizes(result.em_error))}
    if result.outliers:
        content["marker_outliers"] = dict(result.outliers)
    if (correction := result.correction) is not None:
        content["em_readings"]["after"] = Listing("", *SIZES).record(_sizes(correction.residuals))
        content["degree"] = correction.degree
        content["cross_validation_mm"] = plain(correction.cross_validation, "m")
        content["continuation"] = correction.continuation
        content["extrapolated"] = dict(result.extrapolated)
        errors = {use: correction.extrapolation_error(p) for use, p in result.data.em_uses.items()}
        content["extrapolation_error_mm"] = plain(errors, "m")
        navigation = result.navigation
        content |= {"nav_mm": None} if navigation is None else REGISTRATION.record(navigation)
    return content


def _pivots_of(result: StereotacticResult) -> list[tuple[str, PivotCalibration]]:
    return [("EM", result.em_pivot), ("optical", result.optical_pivot)]


def _sizes(vectors: FloatArray) -> FloatArray:
    """Lengths (n,) of vectors (..., 3)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1)).ravel()


def _compared(errors: StereotacticErrors) -> list[ComparedOutput]:
    given = (
        ("c_expected", "expected EM markers", errors.expected),
        ("em_post", "EM post", errors.em_post),
        ("optical_post", "optical post", errors.optical_post),
        ("nav", "tip in CT", errors.navigation),
    )
    return [
        ComparedOutput(key, name, np.atleast_1d(np.asarray(sizes, dtype=float)).ravel())
        for key, name, sizes in given
        if sizes is not None
    ]


def stereotactic_plot(result: StereotacticResult) -> str:
    """An SVG: map of the EM readings' errors and residuals of the pivots, mm.

    With a correction also its effect and its cross-validation.
    """
    rows = 1 if result.correction is None else 2
    with picture(NAME, (1.25 * WIDTH, 3.7 * rows)) as figure:
        panels = figure.subplots(rows, 2, squeeze=False)
        _map(figure, panels[0, 0], result)
        _pivots(panels[0, 1], result)
        if result.correction is not None:
            _effect(panels[1, 0], result.em_error, result.correction)
            _validation(panels[1, 1], result.correction)
        return svg_text(figure, NAME, f"Stereotactic navigation: {result.data.name}")


def _map(figure: Picture, axes: Axes, result: StereotacticResult) -> None:
    """Mean error in cells of the middle third of the volume, seen along z."""
    points, errors = (mm(v.reshape(-1, 3)) for v in (result.expected, result.em_error))
    low, high = np.quantile(points[:, 2], [1 / 3, 2 / 3])
    slab = (points[:, 2] >= low) & (points[:, 2] <= high)
    plane, vectors = points[slab, :2].T, errors[slab].T
    across, up = plane
    # of the map, in each direction
    number, *edges = np.histogram2d(across, up, bins=8)
    sums = [np.histogram2d(across, up, bins=edges, weights=v)[0] for v in (*plane, *vectors)]
    x, y, *error = np.array(sums) / np.where(number, number, np.nan)
    sizes = np.linalg.norm(error, axis=0)
    arrows = axes.quiver(
        *(x, y, error[0], error[1], sizes), cmap="viridis_r", angles="xy", pivot="tail", width=0.006
    )
    axes.set_aspect("equal")
    axes.margins(0.12)
    axes.grid()
    axes.set_title("Error of the EM readings (arrows enlarged)")
    axes.set_xlabel(f"x in the EM tracker, mm (z from {low:.0f} to {high:.0f} mm)")
    axes.set_ylabel("y in the EM tracker, mm")
    figure.colorbar(arrows, ax=axes, shrink=0.85).set_label("mean error in 3-D, mm")


def _pivots(axes: Axes, result: StereotacticResult) -> None:
    """Distance of each probe's tip from its post, frame by frame."""
    for (name, pivot), marker, colour in zip(_pivots_of(result), "os", (BLUE, ORANGE), strict=True):
        residuals = np.linalg.norm(pivot.residuals, axis=1)
        frames, label = np.arange(1, len(residuals) + 1), f"{name}, rms {mm(pivot.rms):.3g} mm"
        axes.plot(frames, mm(residuals), marker, color=colour, markersize=4.5, label=label)
        lost = [int(row) for row in pivot.outliers]
        if lost:
            axes.plot(*(frames[lost], mm(residuals[lost]), "x"), color="black", label="outlier")
    axes.set_ylim(bottom=0)
    axes.grid(axis="y")
    axes.set_title("Pivots", pad=22)
    axes.set_xlabel("frame")
    axes.set_ylabel("distance of the tip from the post, mm")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))


def _effect(axes: Axes, before: FloatArray, correction: DistortionCorrection) -> None:
    """How many markers are off by how much, before and after."""
    sizes = [mm(_sizes(v)) for v in (before, correction.residuals)]
    # Two decimals in the files: below that there is nothing to see.
    least, most = 1e-3, max(float(sizes[0].max()), float(sizes[1].max()), 1e-2)
    bins = np.geomspace(least, most, 40)
    looks = (("as measured", ORANGE, "////"), ("corrected", BLUE, ""))
    for values, (label, colour, hatch) in zip(sizes, looks, strict=True):
        look: dict[str, Any] = {"edgecolor": colour, "hatch": hatch, "alpha": 0.75, "label": label}
        face, clipped = "white" if hatch else colour, np.clip(values, least, most)
        axes.hist(clipped, bins.tolist(), histtype="stepfilled", facecolor=face, **look)
    plain_log(axes.xaxis, axes.set_xscale)
    axes.set_title("EM markers", pad=22)
    axes.set_xlabel("distance from the optical tracker's measurement, mm")
    axes.set_ylabel("markers")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))


def _validation(axes: Axes, correction: DistortionCorrection) -> None:
    """Error of left-out frames by degree."""
    degrees = list(correction.cross_validation)
    rms = [mm(value) for value in correction.cross_validation.values()]
    axes.plot(degrees, rms, "o-", color=GREY, markerfacecolor=BLUE, markeredgecolor=BLUE)
    chosen = correction.degree
    ring: dict[str, Any] = {"ms": 12, "mfc": "none", "mec": ORANGE, "mew": 2}
    at = mm(correction.cross_validation[chosen])
    axes.plot([chosen], [at], "o", label=f"chosen: {chosen}", **ring)
    plain_log(axes.yaxis, axes.set_yscale)
    axes.set_xticks(degrees)
    axes.grid(axis="y", which="both")
    axes.set_title("Frames left out of the fit", pad=22)
    axes.set_xlabel("degree of the correction (0: none)")
    axes.set_ylabel("rms error, mm")
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
