"""Report of zero offsets: solutions that fit known poses, and undetermined offsets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from suta_calib.acquisition.zero_offsets import Branch, ContradictedZero, ZeroOffsets
from suta_calib.report.document import Document, Part, Text
from suta_calib.report.listing import Column, Json, Listing, plain, shown_as, written
from suta_calib.units import deg, mm

NAME: Final = "zero_offsets"
RESIDUAL: Final = Listing[Branch](
    "",
    Column("count", value=lambda branch: len(branch.distances)),
    Column("rms", unit="m"),
    Column("max", value=lambda branch: branch.distances.max(), unit="m"),
    Column("rms", value=lambda branch: branch.rms_angle, unit="rad"),
)
CONTRADICTED: Final = Listing[ContradictedZero](
    "", Column("row"), *written("distance", "rms", unit="m")
)


def zero_offsets_document(offsets: ZeroOffsets, written: Path | None = None) -> Document:
    """The branches that fit, with residuals, the chosen one, and the URDF that holds it, if any."""
    parts: list[Part] = [_branches(offsets).of(offsets.branches)]
    if written is not None:
        parts.append(Text(f"Written to {written}. Its joint positions are raw readings."))
    parameters = offsets.arm.parameters
    std = dict(zip(offsets.names, plain(offsets.chosen.std), strict=True))
    data: Json = {
        "status": offsets.status,
        "offsets": {
            name: {"unit": parameters[name].unit, "value": value, "std": std[name]}
            for name, value in offsets.values().items()
        },
        "redundancy": offsets.redundancy,
        "contradicted": offsets.contradicted and CONTRADICTED.record(offsets.contradicted),
        "undetermined": [combination.fixed for combination in offsets.undetermined],
        "combinations": [combination.direction for combination in offsets.undetermined],
        "residual": RESIDUAL.record(offsets.chosen),
        "branch": offsets.options.branch,
        "branches": [
            {"offsets": offsets.values(branche), **RESIDUAL.record(branche)}
            for branche in offsets.branches
        ],
        "urdf": None if written is None else str(written),
    }
    return Document(NAME, "Zero offsets", offsets.assessment, parts, data)


def _branches(offsets: ZeroOffsets) -> Listing[Branch]:
    """A column for every joint, in degrees, or mm where it slides."""
    unknown = {combination.fixed for combination in offsets.undetermined}

    def number(branch: Branch) -> str:
        k = offsets.branches.index(branch) + 1
        return f"{k} *" if k == offsets.options.branch else f"{k}"

    def cell(k: int) -> Callable[[Branch], str]:
        name = offsets.names[k]
        shown = mm if offsets.arm.parameters[name].unit == "m" else deg
        if name in unknown:
            return lambda _: "?"
        return lambda branch: (
            f"{shown(float(branch.offsets[k])):.3f} ± {shown(float(branch.std[k])):.3f}"
        )

    joints = (shown_as(joint, cell(k)) for k, joint in enumerate(offsets.arm.joints))
    return Listing(
        "Offsets, deg (mm)",
        Column("", "branch", cell=number),
        *joints,
        Column("", "RMS mm", lambda branch: branch.rms, "m"),
    )
