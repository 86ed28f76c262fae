"""What a calibration would say of each parameter and of the tip, from information alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suta_calib.analysis.planning.information import SharedInformation, Space
from suta_calib.analysis.tip_uncertainty import Sensitivity
from suta_calib.arrays import FloatArray
from suta_calib.units import Unit


@dataclass(frozen=True)
class Expected:
    """One parameter.

    Attributes:
        name, unit: as in the problem.
        plausible: how far off it might be, m or rad.
        std: predicted standard deviation, None where it would be held.
    """

    name: str
    unit: Unit
    plausible: float
    std: float | None


@dataclass(frozen=True, eq=False)
class Forecast:
    """All of them, and the tip in a region after registration.

    Attributes:
        parameters: the arm's.
        fixed: names of those that would be held at nominal.
        tip: root mean square 3-D uncertainty, m, if held parameters are as far off as plausible.
        tip_estimated: the same if held parameters are exact: what the calibration's own ± tell.
    """

    parameters: tuple[Expected, ...]
    fixed: tuple[str, ...]
    tip: float
    tip_estimated: float


def forecast(space: Space, information: SharedInformation, tip: Sensitivity) -> Forecast:
    """Predict what data that tell this much would give.

    Args:
        space: the unknowns.
        information: information on them.
        tip: postures of the region, with derivatives by the arm's parameters in their order.
    """
    identification = space.identify(information)
    fixed = {int(k) for k in identification.fixed}
    estimated = np.array([k for k in range(len(space.names)) if k not in fixed], dtype=np.intp)
    covariance = space.covariance(information, estimated)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    arm = list(space.parameters.values())[: space.arm_count]
    expected = [
        Expected(p.name, p.unit, p.plausible, None if k in fixed else float(std[k]))
        for k, p in enumerate(arm)
    ]
    return Forecast(
        parameters=tuple(expected),
        fixed=tuple(e.name for e in expected if e.std is None),
        tip=_rms(space, space.plausible_covariance(information), tip),
        tip_estimated=_rms(space, covariance, tip),
    )


def _rms(space: Space, covariance: FloatArray, tip: Sensitivity) -> float:
    arm = slice(0, space.arm_count)
    std = tip.std(covariance[arm, arm], tip.registered())
    return float(np.sqrt(np.mean(std**2)))
