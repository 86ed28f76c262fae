"""How much longer a printed body is along x and along y than its file says: two unknowns.

Paper is fed, and plastic shrinks, by another factor along each axis. With s = (s_x, s_y) a point
l of an artefact or a board is at ``diag(1 + s_x, 1 + s_y, 1) l``. Each has a prior of the body's
grade. What both have in common is a scale, which free lengths of the arm take up: then only the
difference of the two is determined, and the ± of each says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.model.parameters import Parameter

OWNER: Final = "stretch"
KEYS: Final = ("x", "y")


def stretch_parameters(body: str, prior: float | None) -> tuple[Parameter, ...]:
    """The unknowns ``stretch[body].x|y``; none where a body is taken for what its file says.

    The prior is the standard deviation of each, as a ratio.
    """
    if prior is None:
        return ()
    # Bounds, in standard deviations of the prior.
    farthest = 10.0
    most = farthest * prior
    return tuple(
        Parameter(f"{OWNER}[{body}]", key, "1", 0.0, -most, most, prior, prior_fixed=True)
        for key in KEYS
    )


def is_stretch(parameter: Parameter) -> bool:
    """Whether it is one of `stretch_parameters`."""
    return parameter.owner.startswith(f"{OWNER}[")


def stretched_point(point: Symbol, stretch: Symbol) -> Symbol:
    """A point (3,) of a body with the stretch (2,)."""
    return ca.vertcat((1 + stretch[0]) * point[0], (1 + stretch[1]) * point[1], point[2])


def stretch_factors(parameters: Iterable[Parameter], values: Mapping[str, float]) -> FloatArray:
    """(3,) factors on a body's coordinates, by a term's own unknowns; 1 where none is a stretch."""
    by_key = {p.key: values.get(p.name, 0.0) for p in parameters if is_stretch(p)}
    return np.array([1.0 + by_key.get(key, 0.0) for key in KEYS] + [1.0])
