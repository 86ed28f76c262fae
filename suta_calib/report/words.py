"""Combinations of parameters in words."""

from __future__ import annotations

import math
from collections.abc import Mapping


def combination(direction: Mapping[str, float], fixed: str = "") -> str:
    """A combination of parameters as a sum: ``joint_2.y − joint_3.z``, the held one first."""
    parts = []
    ranked = sorted(direction.items(), key=lambda item: (item[0] != fixed, -abs(item[1])))
    for name, factor in ranked:
        size = abs(factor)
        times = "" if math.isclose(size, 1.0, rel_tol=5e-4) else f"{size:.3g}·"
        sign = "−" if factor < 0 else "+"
        parts.append(f"{sign} {times}{name}")
    return " ".join(parts).removeprefix("+ ")
