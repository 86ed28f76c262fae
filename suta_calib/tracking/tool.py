"""A tool on the arm's tip: the answer of ``suta-calib pivot``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import refuse_unusable
from suta_calib.errors import InputError
from suta_calib.tracking.json_files import numbers, read_json_object

_MM = 1e-3
# m; a pivot offset beyond this is one in another unit.
_LARGEST = 10.0


@dataclass(frozen=True, eq=False)
class Tool:
    """Where a tool's tip is.

    Attributes:
        tip: (3,) in the arm's tip frame, m.
        std: (3,) its standard uncertainty along that frame's axes, m; None where not known.
    """

    tip: FloatArray
    std: FloatArray | None = None

    @classmethod
    def none(cls) -> Tool:
        """No tool: the tip is the arm's own."""
        return cls(np.zeros(3))


def read_tool(path: str | Path, *, anyway: bool = False) -> Tool:
    """Read ``tip.json``: ``{"tip_mm": [x, y, z], "tip_std_mm": [...]}``, the latter optional.

    Args:
        path: the file, or a pivot's ``result.json``, which has these keys too.
        anyway: take an answer that says of itself that it must not be used.

    Raises:
        InputError: unreadable, no ``tip_mm``, not three finite numbers within 10 m, or not to be
            used.
    """
    path = Path(path)
    data = read_json_object(path)
    if "tip_mm" not in data:
        raise InputError(
            f"only the keys {', '.join(data) or '(none)'}",
            '"tip_mm": [x, y, z], as suta-calib pivot --out writes it',
            file=path,
            where="tip_mm",
        )
    refuse_unusable(data, path, anyway=anyway)
    tip = _MM * numbers(data["tip_mm"], (3,), path, "tip_mm")
    if abs(tip).max() > _LARGEST:
        raise InputError(
            repr(data["tip_mm"]), f"mm, within {_LARGEST:g} m", file=path, where="tip_mm"
        )
    std = data.get("tip_std_mm")
    if std is None:
        return Tool(tip)
    return Tool(tip, _MM * numbers(std, (3,), path, "tip_std_mm"))
