"""The answer to a stereotactic navigation problem: as data, as tables, as files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError
from suta_calib.geometry.numbers import homogeneous
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.files import make_folder
from suta_calib.report.stereotactic.plots import stereotactic_figure
from suta_calib.stereotactic.cis_files import output1_text, output2_text
from suta_calib.stereotactic.comparison import StereotacticErrors
from suta_calib.stereotactic.solve import Navigation, StereotacticResult
from suta_calib.units import NOTHING, text

MM: Final = 1e3


# ── data ─────────────────────────────────────────────────────────────────────────────────────
def stereotactic_dict(
    result: StereotacticResult, assessment: Assessment, comparison: StereotacticErrors
) -> dict[str, Any]:
    """The answer as JSON data, lengths in mm."""
    found: dict[str, Any] = {
        "name": result.data.name,
        "verdict": assessment.as_dict(),
        **_pivot_dict("em", result.em_pivot),
        **_pivot_dict("optical", result.optical_pivot),
        "em_readings": {"before": _errors(result.em_error)},
    }
    if result.outliers:
        found["marker_outliers"] = dict(result.outliers)
    if (correction := result.correction) is not None:
        found["em_readings"]["after"] = _errors(correction.residuals)
        found["degree"] = correction.degree
        curve = correction.cross_validation
        found["cross_validation_mm"] = {str(d): MM * rms for d, rms in curve.items()}
        found["extrapolated"] = dict(result.extrapolated)
        found |= _navigation_dict(result.navigation)
    return found | {"comparison": _comparison_dict(comparison)}


def _pivot_dict(name: str, pivot: PivotCalibration) -> dict[str, Any]:
    return {
        f"{name}_post_mm": _mm(pivot.post),
        f"{name}_post_std_mm": _mm(pivot.post_std()),
        f"{name}_tip_mm": _mm(pivot.tip),
        f"{name}_tip_std_mm": _mm(pivot.tip_std),
        f"{name}_pivot_rms_mm": MM * pivot.rms,
        f"{name}_pivot_outliers": [int(row) for row in pivot.outliers],
    }


def _navigation_dict(found: Navigation | None) -> dict[str, Any]:
    if found is None:
        return {"nav_mm": None}
    registration = found.registration
    return {
        "nav_mm": [_mm(tip) for tip in found.ct],
        "nav_expected_error_mm": _mm(found.target_error),
        "T_ct_em": homogeneous(registration.rotation, registration.position).tolist(),
        "fiducial_rms_mm": MM * registration.rms,
        "fiducial_outliers": [int(row) for row in registration.outliers],
    }


def _comparison_dict(comparison: StereotacticErrors) -> dict[str, float]:
    found = {}
    for key, value in (("em_post", comparison.em_post), ("optical_post", comparison.optical_post)):
        if value is not None:
            found[f"{key}_mm"] = MM * value
    for key, many in (("c_expected", comparison.expected), ("nav", comparison.navigation)):
        if many is not None:
            found[f"{key}_mean_mm"] = MM * float(many.mean())
            found[f"{key}_max_mm"] = MM * float(many.max())
    return found


def _errors(vectors: FloatArray) -> dict[str, float | int]:
    """Lengths of (..., 3) vectors in figures, mm."""
    sizes = MM * np.linalg.norm(vectors, axis=-1)
    figures = {"rms_mm": np.sqrt(np.mean(sizes**2)), "mean_mm": sizes.mean(), "max_mm": sizes.max()}
    return {key: float(value) for key, value in figures.items()} | {"count": sizes.size}


def _mm(values: FloatArray) -> list[float]:
    return [MM * float(value) for value in values]


# ── files ────────────────────────────────────────────────────────────────────────────────────
def write_stereotactic(
    result: StereotacticResult, assessment: Assessment, folder: str | Path
) -> dict[str, Path]:
    """Write ``NAME-output1.txt``, ``NAME-output2.txt`` and ``NAME-stereotactic.svg``.

    An answer that must not be used yields only the picture.

    Args:
        result: the answer.
        assessment: on it.
        folder: created if it is not there.

    Returns:
        The files written, by name.

    Raises:
        OutputError: the folder or a file in it cannot be written, or the folder is that of the
            inputs and an output file that came with them differs: it is not replaced.
    """
    folder, name = Path(folder), result.data.name
    texts = {f"{name}-stereotactic.svg": stereotactic_figure(result)}
    if assessment.usable:
        if result.navigation is not None:
            file = f"{name}-output2.txt"
            texts[file] = output2_text(result.navigation.ct, file)
        file = f"{name}-output1.txt"
        texts[file] = output1_text(result.output1, file)
    make_folder(folder)
    _keep_given(texts, folder, result.data.prefix.parent)
    for file, content in texts.items():
        write_bytes_atomically(folder / file, content.encode())
    return {file: folder / file for file in texts}


def _keep_given(texts: Mapping[str, str], folder: Path, inputs: Path) -> None:
    """Refuse to replace what may be the reference that came with the inputs."""
    if not inputs.is_dir() or not folder.samefile(inputs):
        return
    for file, content in texts.items():
        path = folder / file
        if "-output" in file and path.exists() and path.read_bytes() != content.encode():
            raise OutputError(
                f"{path}: not written: found another answer beside the inputs, perhaps the one "
                "that came with them; choose another folder with --out"
            )


# ── tables ───────────────────────────────────────────────────────────────────────────────────
def stereotactic_tables(
    result: StereotacticResult, assessment: Assessment, comparison: StereotacticErrors
) -> RenderableType:
    """What a console shows: posts, EM readings, navigation, comparison, verdict; mm."""
    parts: list[RenderableType] = [_posts(result), _readings(result)]
    if result.navigation is not None:
        parts.append(_navigation(result.navigation))
    if not comparison.empty:
        parts.append(_comparison(comparison))
    if lost := {kind: count for kind, count in result.outliers.items() if count}:
        counts = ", ".join(f"{count} in {kind}" for kind, count in lost.items())
        parts.append(Text(f"Markers left out: {counts}"))
    return Group(*parts, "", *verdict_lines(assessment))


def _posts(result: StereotacticResult) -> Table:
    table = number_table("Posts in the EM tracker, mm", "pivot", "x", "y", "z", "rms", "frames")
    for name, pivot in (("EM", result.em_pivot), ("optical", result.optical_pivot)):
        values = zip(pivot.post, pivot.post_std(), strict=True)
        cells = [f"{text(value, 'm')} ± {text(std, 'm')}" for value, std in values]
        lost = len(pivot.outliers)
        frames = f"{len(pivot.residuals)}" + (f", {lost} off" if lost else "")
        table.add_row(name, *cells, text(pivot.rms, "m"), frames)
    return table


def _readings(result: StereotacticResult) -> Table:
    table = number_table(
        "EM markers, distance from where they were, mm", "readings", "rms", "mean", "max", "count"
    )
    rows = {"as measured": result.em_error}
    if (correction := result.correction) is not None:
        name = f"corrected, degree {correction.degree}" if correction.degree else "no distortion"
        rows[name] = correction.residuals
    for name, vectors in rows.items():
        errors = _errors(vectors)
        figures = [f"{errors[key]:.3f}" for key in ("rms_mm", "mean_mm", "max_mm")]
        table.add_row(name, *figures, str(errors["count"]))
    if correction is not None:
        left_out = correction.cross_validation[correction.degree]
        table.caption = f"frames left out of the fit: rms {text(left_out, 'm', with_unit=True)}"
    return table


def _navigation(found: Navigation) -> Table:
    table = number_table("EM probe's tip in CT, mm", "frame", "x", "y", "z", "expected error")
    for number, (tip, error) in enumerate(zip(found.ct, found.target_error, strict=True), 1):
        table.add_row(str(number), *(text(v, "m") for v in tip), text(error, "m"))
    lost = len(found.registration.outliers)
    table.caption = (
        f"registered by {len(found.fiducials)} fiducials"
        + (f", {lost} of them off" if lost else "")
        + f": rms {text(found.registration.rms, 'm', with_unit=True)}"
    )
    return table


def _comparison(comparison: StereotacticErrors) -> Table:
    table = number_table("Against the output files given, mm", "distance of", "mean", "max")
    for name, many in (
        ("expected EM markers", comparison.expected),
        ("EM post", comparison.em_post),
        ("optical post", comparison.optical_post),
        ("tip in CT", comparison.navigation),
    ):
        if many is not None:
            single = isinstance(many, float)
            most = NOTHING if single else f"{MM * float(np.max(many)):.4f}"
            table.add_row(name, f"{MM * float(np.mean(many)):.4f}", most)
    return table
