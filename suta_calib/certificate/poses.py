"""Poses and cameras as results with uncertainties."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from suta_calib.certificate.answer import Record, quantities
from suta_calib.certificate.content import CertifiedValue, ValueTable
from suta_calib.geometry.lens import CENTRE, FOCAL
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.units import deg, mm, std_text, stored

AXES = ("x", "y", "z")


def pose_of(matrix: Any, std: Record, factor: float) -> tuple[CertifiedValue, ...]:
    """A pose (4, 4), m, with the standard deviations that an answer wrote beside it."""
    pose = np.asarray(matrix, dtype=float)
    if pose.shape != (4, 4):
        raise ValueError(f"a pose of shape {pose.shape}")
    return tuple(
        pose_quantities(
            mm(pose[:3, 3]).tolist(),
            [std[f"{axis}_mm"] for axis in AXES],
            deg(rpy_from_rotation(pose[:3, :3])).tolist(),
            [std[f"r{axis}_deg"] for axis in AXES],
            factor,
        )
    )


def camera_tables(cameras: Mapping[str, Record | None], factor: float) -> Iterator[ValueTable]:
    """Intrinsics of cameras by name, as an answer wrote them; none of those that were held."""
    for name, camera in cameras.items():
        if camera and ((camera.get("std") or {}).get("fx")) is not None:
            yield camera_table(f"Intrinsics of camera {name}".rstrip(), camera, factor)


def camera_table(title: str, camera: Record, factor: float) -> ValueTable:
    """Intrinsics with ``std`` of each."""
    std: Record = camera["std"]
    pairs = [(name, camera[name], std[name]) for name in std if name != "distortion"]
    distortion = zip(camera.get("distortion") or (), std.get("distortion") or (), strict=True)
    pairs += [(f"distortion {k}", *both) for k, both in enumerate(distortion, 1)]
    rows = [
        # What the model of the lens holds at nothing has no ±.
        CertifiedValue(
            *(name, float(value), "px" if name in (*FOCAL, *CENTRE) else "1"),
            float(spread) or None,
            factor,
        )
        for name, value, spread in pairs
    ]
    about = f"Model of the lens: {camera['distortion_model']}, its terms in the order of OpenCV."
    return ValueTable(title, tuple(rows), about)


def pose_quantities(
    position: Sequence[float],
    position_std: Sequence[float],
    rpy: Sequence[float] | None,
    rotation_std: Sequence[float] | None,
    factor: float,
) -> Iterator[CertifiedValue]:
    """Coordinates with U; angles with U of a turn about each axis; none of a point's.

    Args:
        position: (3,) mm.
        position_std: (3,) mm, standard uncertainties.
        rpy: (3,) deg, as a URDF has them.
        rotation_std: (3,) deg, of small turns about the axes of the frame itself.
        factor: coverage factor.
    """
    yield from quantities(AXES, position, position_std, "m", factor)
    if rpy is None or rotation_std is None:
        return
    for name, axis, angle, std in zip(
        ("roll", "pitch", "yaw"), AXES, rpy, rotation_std, strict=True
    ):
        spread = factor * float(stored(float(std), "rad"))
        remark = f"U of a turn about its {axis} axis: {std_text(spread, 'rad')}"
        value = float(stored(float(angle), "rad"))
        yield CertifiedValue(name, value, "rad", remark=remark, resolution=spread)
