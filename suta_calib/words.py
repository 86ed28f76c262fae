"""Names in sentences: a few of many, and combinations of parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence


def listed(names: Sequence[str], most: int = 6) -> str:
    """Names in a sentence; only a count of those beyond the first few."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def enumerated(names: Sequence[str], last: str = "and") -> str:
    """All names in a sentence: ``a, b and c``."""
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def kept(names: Sequence[str], most: int = 3) -> str:
    """What must stay as it is: ``joint_2.z keeps its nominal value``; empty where nothing must."""
    if not names:
        return ""
    shown = [*names[:most], *([f"{len(names) - most} more"] if len(names) > most else [])]
    if len(shown) == 1:
        return f"{shown[0]} keeps its nominal value"
    return f"{', '.join(shown[:-1])} and {shown[-1]} keep their nominal values"


def combination(direction: Mapping[str, float], held: str = "") -> str:
    """A combination of parameters as a sum: ``joint_2.y − joint_3.z``, the held one first.

    Factors have two digits.
    """
    parts = []
    ranked = sorted(direction.items(), key=lambda item: (item[0] != held, -abs(item[1])))
    for name, factor in ranked:
        size = abs(factor)
        # A step of one in the second digit.
        is_one = math.isclose(size, 1.0, abs_tol=0.05)
        times = "" if is_one else f"{size:.0f}·" if size >= 10.0 else f"{size:.2g}·"
        sign = "−" if factor < 0 else "+"
        parts.append(f"{sign} {times}{name}")
    return " ".join(parts).removeprefix("+ ")


def seen_from(seen: str, seeing: str) -> str:
    """The name of the chain that ends at one tip and begins at another; nothing for the base."""
    return f"{seen} seen from {seeing}" if seeing else seen
