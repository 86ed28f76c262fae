"""The arm with its whole geometry free: what it can do by itself is no fault of a landmark.

A job usually estimates fewer parameters than the arm has. What the others get wrong shows as
errors of about a millimetre that differ from landmark to landmark, and no metric can tell such an
error from a landmark that is not where it is certified. So the search for outliers lets every
joint's placement and offset give way within what a built arm departs from its drawing: priors of
`LENGTH` and `ANGLE`, which also keep in place whatever the data cannot tell.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter, ParameterSet

# Standard deviations of a built arm about its drawing or URDF, m and rad.
LENGTH: Final = 5e-3
ANGLE: Final = math.radians(1.0)


def whole_arm(arm: ArmModel | None, job: ParameterSet) -> ParameterSet:
    """The job's unknowns as they are, and the rest of the arm's geometry with priors.

    Args:
        arm: the arm, or None where no term looks at one.
        job: the arm's parameters of the job.
    """
    if arm is None:
        return job
    known = {name: p for name, p in job.items() if p.free}
    for name, p in arm.select("geometric", "*.offset").items():
        if name not in known:
            known[name] = _loose(p)
    return ParameterSet(known.values())


def _loose(p: Parameter) -> Parameter:
    return replace(
        p,
        lower=-math.inf,
        upper=math.inf,
        prior=LENGTH if p.unit == "m" else ANGLE,
        plausible=math.nan,
        free=True,
    )
