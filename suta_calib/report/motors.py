"""Report of a motor map: which motor moves which joint, how, and what else would fit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from suta_calib.acquisition.motor_mapping import MappedJoint, MotorMap
from suta_calib.acquisition.motor_search import MotorOrder
from suta_calib.report.document import Document, Part, Text
from suta_calib.report.listing import Column, Listing
from suta_calib.units import deg

NAME: Final = "motors"


def _zero(row: MappedJoint) -> str:
    """By how much the zero moves, and its ±; in words where the touches do not show it."""
    return "kept" if row.std is None else f"{deg(row.change):+.1f} ± {deg(row.std):.1f}"


def _counts(row: MappedJoint) -> str:
    return f"{row.counts[0]:.0f} ± {row.counts[1]:.0f}"


def _range(row: MappedJoint) -> str:
    return f"{deg(row.lowest):.0f} to {deg(row.highest):.0f}"


JOINTS: Final = Listing[MappedJoint](
    "Joints and their motors: zero and counts as the touches show them, angles in the touches",
    Column("joint", "joint"),
    Column("motor", "motor"),
    Column("id", None, lambda row: row.spec.number, optional=True),
    Column("sign", "sign", lambda row: row.spec.sign, sign=True, form=".0f"),
    Column("zero", "zero", lambda row: row.spec.zero, form=".0f"),
    Column("zero_change", "moved, deg", lambda row: row.change, "rad", cell=_zero),
    Column("zero_std", None, lambda row: row.std, "rad"),
    Column("counts_per_turn", "counts", lambda row: row.counts[0], form=".0f", cell=_counts),
    Column("counts_per_turn_std", None, lambda row: row.counts[1]),
    Column("lowest", "range, deg", unit="rad", cell=_range),
    Column("highest", None, unit="rad"),
)


def motors_document(mapping: MotorMap, written: Mapping[str, Path | None]) -> Document:
    """The joints with their motors, orders that also fit, and what was written."""
    parts: list[Part] = [JOINTS.of(mapping.joints)]
    if (device := written.get("device")) is not None:
        parts.append(Text(f"Written to {device}."))
    if (folder := written.get("samples")) is not None:
        parts.append(Text(f"The samples, as this device gives them: {folder}."))
    names = mapping.arm.joints

    def order(one: MotorOrder) -> dict[str, object]:
        return {
            "motors": {joint: names[k] for joint, k in zip(names, one.motors, strict=True)},
            "signs": dict(zip(names, one.signs.tolist(), strict=True)),
            "rms_mm": 1e3 * one.rms,
        }

    data = {
        "status": mapping.status,
        "touches": mapping.touches,
        **order(mapping.best),
        "next_rms_mm": 1e3 * mapping.next_rms,
        "also_fits": [order(other) for other in mapping.others],
        "joints": [JOINTS.record(row) for row in mapping.joints],
        **{key: None if path is None else str(path) for key, path in written.items()},
    }
    return Document(NAME, "Motors and joints", mapping.assessment, parts, data)
