"""Report of a pivot calibration: tip and posts, fit of the poses, rotations of the tool."""

from __future__ import annotations

from typing import Final

from suta_calib import report
from suta_calib.arrays import FloatArray
from suta_calib.measurements.pose_files import ToolPoses
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.report.document import Document, Figure, File, Part, Text
from suta_calib.report.listing import Column, Json, Listing, Table, json_text, plain, written
from suta_calib.report.poses import (
    axes_with_std,
    covariance_record,
    fit_texts,
    fitted_rows,
    residuals_file,
)
from suta_calib.report.uncertainty import budget_record
from suta_calib.units import deg, text

NAME: Final = "pivot"
MOST_POSTS: Final = 12
TIP: Final = Listing[PivotCalibration]("", *written("tip", "tip_std", unit="m"))
# The post is that of the first row.
CALIBRATION: Final = Listing[PivotCalibration](
    "",
    *TIP.columns,
    Column("post", unit="m"),
    Column("post_std", value=lambda row: row.post_std(), unit="m"),
    *written("rms", "sigma", unit="m"),
    Column("turn", unit="rad"),
)
# Points by name, with the standard deviation of each coordinate, (3,), m.
PLACES: Final = Listing[tuple[str, FloatArray, FloatArray]](
    "Tip in the tool, post in the tracker, mm",
    Column("", "", lambda row: row[0]),
    *axes_with_std(lambda row: row[1], lambda row: row[2]),
)


def pivot_document(calibration: PivotCalibration, data: ToolPoses) -> Document:
    """Tip, posts, fit; with ``residuals.csv``, and ``tip.json`` where the tip may be used."""
    parts: list[Part] = [places_table(calibration, labelled=data.point is not None)]
    if (more := len(calibration.posts) - MOST_POSTS) > 0:
        parts.append(Text(f"and {more} more posts: use --json"))
    touched = {} if data.point is None else {"point": data.point.tolist()}
    fit = (
        f"rms {text(calibration.rms, 'm', with_unit=True)} (3-D); "
        f"the tool was turned by {deg(calibration.turn):.0f}° RMS"
    )
    parts += [
        *fit_texts(fit, "pose", calibration, data.lines),
        residuals_file(calibration.inliers, {"line": data.lines, **touched}, calibration.residuals),
        Figure(lambda: report.pivot_plot(calibration, data)),
    ]
    if calibration.assessment.usable:
        parts.append(File("tip.json", lambda: json_text(TIP.record(calibration))))
    order = [f"{name}.{axis}" for name in ("tip", *calibration.posts) for axis in "xyz"]
    record: Json = CALIBRATION.record(calibration)
    if data.point is not None:
        record["posts_mm"] = plain(calibration.posts, "m")
        record["posts_std_mm"] = {n: plain(calibration.post_std(n), "m") for n in calibration.posts}
    record |= {
        **fitted_rows(calibration, data.lines),
        "covariance": covariance_record(calibration.covariance, order, "m²"),
        "uncertainty": [budget_record(calibration.budget)],
        "input": str(data.path),
    }
    about = NAME, "Pivot calibration", calibration.assessment
    return Document(*about, parts, record, "result", calibration.in_a_line)


def places_table(calibration: PivotCalibration, *, labelled: bool) -> Table:
    """Tip and posts, ± std, mm; posts that are labelled have their names."""
    posts = [
        (f"post {name}" if labelled else "post", post, calibration.post_std(name))
        for name, post in list(calibration.posts.items())[:MOST_POSTS]
    ]
    title = PLACES.title if len(calibration.posts) == 1 else PLACES.title.replace("post", "posts")
    return PLACES.of([("tip", calibration.tip, calibration.tip_std), *posts], title)
