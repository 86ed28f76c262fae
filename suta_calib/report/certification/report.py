"""A certification for a terminal and as a section of a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text as Line

from suta_calib.certification.artefact_file import frame_sentence, noise_source
from suta_calib.certification.result import Certification, CertifiedLandmark
from suta_calib.certification.trust import verdict_on
from suta_calib.report.certification.plots import certification_figure
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.units import NOTHING

NAME: Final = "certify"
POSITION_HEADS: Final = ("landmark", "x, mm", "y, mm", "z, mm", "σ, µm", "turn, deg", "tilt, deg")
PILLAR_HEADS: Final = (
    "landmark",
    "σ x, µm",
    "σ y, µm",
    "σ z, µm",
    "flat to, µm",
    "uneven, µm",
    "0-2, mm",
    "1-3, mm",
    "flats, mm",
)
DEVIATION_HEADS: Final = ("landmark", "dx, mm", "dy, mm", "dz, mm", "length, mm", "turn, deg")
SPACER_HEADS: Final = ("spacer", "length, mm", "± 95 %, mm", "nominal, mm", "off by, mm")


def certification_tables(found: Certification) -> RenderableType:
    """Positions, deviations from the drawing, spacers, noise and verdict, in 80 columns."""
    parts = [_console("Landmarks", POSITION_HEADS, _positions(found))]
    if found.comparison is not None:
        title = f"Certified less drawn ({found.comparison.drawing.name}), best superposition"
        parts.append(_console(title, DEVIATION_HEADS, _deviations(found)))
    if found.spacers:
        parts.append(_console("Spacers", SPACER_HEADS, _spacers(found)))
    return Group(*parts, *(Line(line) for line in _facts(found)), "", *_verdict(found))


def certification_section(found: Certification) -> Section:
    """Pictures and tables for a report."""
    parts: list[Text | Plot | Table] = [
        *(Text(line) for line in _facts(found)),
        Plot(certification_figure(found)),
        _table("Landmarks", POSITION_HEADS, _positions(found)),
        _table("Pillars", PILLAR_HEADS, _pillars(found)),
        Text(
            "flat to: largest distance of a touch from the top's plane; uneven: from the middle of "
            "one diagonal of the holes to the middle of the other; 0-2, 1-3: their lengths; flats: "
            "their distance."
        ),
    ]
    if found.comparison is not None:
        title = f"Certified less drawn: {found.comparison.drawing.name}"
        parts.append(_table(title, DEVIATION_HEADS, _deviations(found)))
    if found.spacers:
        parts.append(_table("Spacers", SPACER_HEADS, _spacers(found)))
    return Section(NAME, f"Certification of {found.name}", verdict_on(found), parts)


def _verdict(found: Certification) -> list[RenderableType]:
    return verdict_lines(verdict_on(found))


def _facts(found: Certification) -> list[str]:
    ground = found.ground
    facts = [
        f"Frame: {frame_sentence(found)}",
        f"One touched coordinate scatters by {1e6 * found.noise:.2f} µm ({noise_source(found)}); "
        f"95 % intervals are ± {found.coverage_factor:.2f} σ. σ above is the largest of a "
        "landmark's three, and what artefact.yaml states.",
        f"Ground: {ground.count} touches, {1e6 * ground.rms:.1f} µm RMS, flat to "
        f"{1e6 * ground.flatness:.1f} µm.",
    ]
    if found.side is not None:
        facts[-1] += (
            f" Side: {found.side.count} touches, {1e6 * found.side.rms:.1f} µm RMS; the direction "
            f"of x is known to {np.degrees(found.heading_std):.5f}°."
        )
    return facts


def _positions(found: Certification) -> list[list[str]]:
    return [
        [
            _named(found, mark),
            *(f"{1e3 * v + 0.0:.4f}" for v in mark.position),
            f"{1e6 * mark.sigma:.2f}",
            _degrees(mark.yaw, 3),
            _degrees(mark.tilt, 3),
        ]
        for mark in found.landmarks
    ]


def _named(found: Certification, mark: CertifiedLandmark) -> str:
    return f"{mark.name} (damaged)" if mark.name in found.damaged else mark.name


def _pillars(found: Certification) -> list[list[str]]:
    return [
        [
            _named(found, mark),
            *(f"{1e6 * v:.2f}" for v in mark.std),
            f"{1e6 * mark.flatness:.1f}",
            f"{1e6 * mark.symmetry:.1f}",
            *(f"{1e3 * v:.4f}" for v in mark.diagonals),
            NOTHING if mark.flats is None else f"{1e3 * mark.flats:.4f}",
        ]
        for mark in found.landmarks
    ]


def _deviations(found: Certification) -> list[list[str]]:
    assert found.comparison is not None
    rows = []
    for mark, off, turn in zip(
        found.landmarks, found.comparison.deviation, found.comparison.turn, strict=True
    ):
        lengths = [*off, np.linalg.norm(off)]
        # Rounded first: a −0.0000 would suggest a direction that is not there.
        rounded = [round(float(1e3 * v), 4) + 0.0 for v in lengths]
        shown = [f"{v:+.4f}" if np.isfinite(v) else NOTHING for v in rounded]
        turned = _degrees(float(turn), 3) if np.isfinite(turn) else NOTHING
        rows.append([_named(found, mark), *shown[:3], shown[3].lstrip("+"), turned])
    return rows


def _spacers(found: Certification) -> list[list[str]]:
    return [
        [
            spacer.name,
            f"{1e3 * spacer.length:.4f}",
            f"{1e3 * found.coverage_factor * spacer.std:.4f}",
            NOTHING if spacer.nominal is None else f"{1e3 * spacer.nominal:.4f}",
            NOTHING if spacer.deviation is None else f"{1e3 * spacer.deviation:+.4f}",
        ]
        for spacer in found.spacers
    ]


def _degrees(angle: float | None, decimals: int) -> str:
    return NOTHING if angle is None else f"{np.degrees(angle) + 0.0:.{decimals}f}"


def _console(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> RenderableType:
    table = number_table(title, *heads)
    for row in rows:
        table.add_row(Line(row[0]), *row[1:])
    return table


def _table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    return Table(heads, rows, frozenset(range(1, len(heads))), title)
