"""The clock of an instrument that sees a moving arm: how late its observations are, as an unknown.

An observation of row i shows the arm as it was at ``t_i + δ``: t_i is the time of the row, δ the
unknown ``time_offset[LABEL]``. The poses of the term follow from the readings then, so that the
derivative of a residual by δ is its derivative by the pose, times the velocity of the tip.
"""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.arrays import BoolArray
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, SamplesError, SutaCalibWarning
from suta_calib.measurements.fields import Value, keyed
from suta_calib.measurements.samples import Samples
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.model.parameters import LEAST_SIZE, Parameter
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.units import from_ms, ms

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel

OWNER: Final = "time_offset"


def _positive_ms(section: YamlSection, name: str) -> float:
    return from_ms(section.number(name, "positive"))


@dataclass(frozen=True)
class TimeOffset(Displayable):
    """What is known of an instrument's clock: the key ``time_offset_ms`` of a row.

    Attributes:
        bound: largest difference of the two clocks, s.
        prior: standard deviation of the difference before any data, s; None where nobody knows.
    """

    bound: float = keyed(
        Value("ms", _positive_ms),
        "Largest time offset. Rows that are nearer to a gap in time, or to the end of a file, are "
        "left out.",
        0.1,
        "bound",
    )
    prior: float | None = keyed(
        Value("ms", _positive_ms),
        "Standard deviation of the time offset before any data; default: unknown.",
        None,
        "prior",
    )

    def __post_init__(self) -> None:
        for name, size in (("bound", self.bound), ("prior", self.prior)):
            if size is not None and not LEAST_SIZE <= size < math.inf:
                raise ParameterError(f"{size!r}", "s, greater than 0", where=f"TimeOffset: {name}")

    def parameter(self, label: str) -> Parameter:
        """The unknown ``time_offset[label]``."""
        owner = f"{OWNER}[{label}]"
        sizes = -self.bound, self.bound, self.prior
        return Parameter(owner, "", "s", 0.0, *sizes, prior_fixed=True)


def clocked(poses: PoseSource, name: str, reach: float) -> PoseSource:
    """The poses at times that an unknown of this name moves; as they are where no arm has them.

    Args:
        poses: of an arm that moves.
        name: of the unknown.
        reach: how far from its time a row may have been seen, s.

    Warns:
        SutaCalibWarning: many rows that are left out.

    Raises:
        SamplesError: times that tell nothing of how the arm moved between them.
    """
    # Postures that nobody recorded, such as planned ones, are of an arm at rest.
    if not isinstance(poses, ArmPoses) or poses.samples.time is None:
        return poses
    samples = poses.samples
    before = samples.motion
    if before is None:
        samples = _within(samples.in_motion(_turning(poses.arm)), reach)
    elif not before.of(samples.q):
        # Rows that are read in another way, on trial, need not be those of a motion.
        with suppress(SamplesError):
            samples = samples.in_motion(_turning(poses.arm))
    if samples is poses.samples and poses.clock == name:
        return poses
    return poses.by_clock(name, samples)


def _within(samples: Samples, bound: float) -> Samples:
    """The rows of which it is known what the joints read before and after."""
    motion = samples.motion
    assert motion is not None
    within = motion.recording.told(motion.moment, bound)
    left = int(len(within) - within.sum())
    near = f"nearer than {ms(bound):.4g} ms to a gap in time or to the end of a file"
    if not within.any():
        raise SamplesError(
            f"no row that is not {near}",
            "rows close in time, of a moving arm",
            where="time",
            hint="give a smaller bound, or record rows more often",
        )
    # Some at both ends are always lost.
    # Share of the rows that may be left out without a word.
    if left > 0.2 * len(within):
        warnings.warn(
            f"{left} of {len(within)} rows are {near}. What the joints read before or after is "
            "unknown, so they are left out",
            SutaCalibWarning,
            stacklevel=6,
        )
    return samples.take(within)


def _turning(arm: ArmModel) -> BoolArray:
    """(joints,) which joints are where they were after a full turn of their reading."""
    full_turn = 2.0 * np.pi - 1e-6
    return np.array(
        [j.type != "prismatic" and j.upper - j.lower >= full_turn for j in arm.readings]
    )
