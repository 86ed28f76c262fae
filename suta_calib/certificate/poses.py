"""A pose as results with uncertainties."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from suta_calib.certificate.answer import Record, quantities
from suta_calib.certificate.content import CertifiedValue
from suta_calib.units import stored, text

AXES = ("x", "y", "z")


def pose_of(
    record: Record, std: Record, factor: float, prefix: str = ""
) -> tuple[CertifiedValue, ...]:
    """The pose that an answer wrote under keys with a prefix, with its standard deviations."""
    return tuple(
        pose_quantities(
            record[f"{prefix}position_mm"],
            [std[f"{axis}_mm"] for axis in AXES],
            record[f"{prefix}rpy_deg"],
            [std[f"r{axis}_deg"] for axis in AXES],
            factor,
        )
    )


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
        spread = text(factor * float(stored(float(std), "rad")), "rad", with_unit=True)
        remark = f"U of a turn about its {axis} axis: {spread}"
        yield CertifiedValue(name, float(stored(float(angle), "rad")), "rad", remark=remark)
