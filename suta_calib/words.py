"""Names in sentences: a few of many, and combinations of parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

MOST_NAMES: Final = 6


def listed(names: Sequence[str], most: int = MOST_NAMES) -> str:
    """Names in a sentence; only a count of those beyond the first few."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def combination(direction: Mapping[str, float], held: str = "") -> str:
    """A combination of parameters as a sum: ``joint_2.y − joint_3.z``, the held one first."""
    parts = []
    ranked = sorted(direction.items(), key=lambda item: (item[0] != held, -abs(item[1])))
    for name, factor in ranked:
        size = abs(factor)
        times = "" if math.isclose(size, 1.0, rel_tol=5e-4) else f"{size:.3g}·"
        sign = "−" if factor < 0 else "+"
        parts.append(f"{sign} {times}{name}")
    return " ".join(parts).removeprefix("+ ")
