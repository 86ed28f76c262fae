"""A job of tracked points for pybotics (PyPI): a modified Denavit-Hartenberg table of a serial arm.

pybotics has no fit of its own. Its documentation gives `optimize_accuracy` to SciPy's
`least_squares`: one residual for each pose, the distance of the tip. A distance is never negative,
and this slows the steps of least squares down. `residuals="coordinates"` therefore gives the three
coordinates of each pose, with the same kinematics and the same unknowns.
"""

from __future__ import annotations

import importlib.metadata
import sys
from functools import reduce
from pathlib import Path
from time import process_time
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from suta_calib import Samples
from suta_calib.arrays import FloatArray
from suta_calib.model import DhRow, DhTable

Residuals = Literal["distances", "coordinates"]


def version_in(folder: Path | None) -> str | None:
    """The pybotics that stands in a folder (pip's `--target`), or None."""
    found = importlib.metadata.distributions(name="pybotics", path=[str(folder)])
    return next((each.version for each in found), None)


def predicted(
    folder: Path,
    table: DhTable,
    instrument: FloatArray,
    fit: Samples,
    q: FloatArray,
    residuals: Residuals,
    most: int,
) -> tuple[FloatArray, float, bool]:
    """Fit every number of the table, the tip's position and the pose of the instrument.

    Args:
        folder: where pybotics is.
        table: modified, of the nominal arm.
        instrument: (4, 4) pose of the base in the instrument to start from.
        fit: what is fitted.
        q: (n, joints) readings to predict.
        residuals: of each pose, one distance or three coordinates.
        most: evaluations.

    Returns:
        (n, 3) positions in the instrument, m; processor seconds of the fit; whether it converged.
    """
    sys.path.append(str(folder))  # last: what our own environment has too comes from there
    from pybotics.optimization import OptimizationHandler, optimize_accuracy

    began = process_time()
    handler = OptimizationHandler(
        robot_of(table, instrument),
        kinematic_chain_mask=[True] * (4 * len(table.joints)),
        tool_mask=[True] * 3 + [False] * 3,  # positions do not tell how the tip is turned
        world_mask=[True] * 6,
    )

    def coordinates(x: FloatArray, handler: Any, q: FloatArray, seen: FloatArray) -> FloatArray:
        handler.apply_optimization_vector(x)
        return (positions(handler.robot, q) - seen).ravel()

    found = least_squares(
        optimize_accuracy if residuals == "distances" else coordinates,
        handler.generate_optimization_vector(),
        args=(handler, fit.q, fit.position),
        x_scale="jac",
        max_nfev=most,
    )
    seconds = process_time() - began
    handler.apply_optimization_vector(found.x)
    return positions(handler.robot, q), seconds, found.status > 0


def robot_of(table: DhTable, instrument: FloatArray) -> Any:
    """The arm of a table, seen from the instrument: fixed rows are part of its world or tool."""
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.link import MDHLink, PrismaticMDHLink, RevoluteMDHLink
    from pybotics.robot import Robot
    from pybotics.tool import Tool

    kinds = {"revolute": RevoluteMDHLink, "prismatic": PrismaticMDHLink, "fixed": RevoluteMDHLink}

    def link(row: DhRow) -> MDHLink:
        return kinds[row.motion](row.alpha, row.a, row.theta, row.d)

    moving = [k for k, row in enumerate(table.rows) if row.motion != "fixed"]
    before, behind = table.rows[: moving[0]], table.rows[moving[-1] + 1 :]
    world = reduce(np.matmul, [link(row).transform() for row in before], instrument)
    tool = reduce(np.matmul, [link(row).transform() for row in behind], np.eye(4))
    chain = MDHKinematicChain([link(row) for row in table.rows[moving[0] : moving[-1] + 1]])
    return Robot(chain, Tool(tool), world)


def positions(robot: Any, q: FloatArray) -> FloatArray:
    """(n, 3) of the tip."""
    return np.array([robot.fk(reading)[:3, 3] for reading in q])
