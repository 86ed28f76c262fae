"""What is said of a calibration, and what an instrument sees of an arm with known truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from suta_calib import ArmModel, Assessment, Noise, Samples, Solution, Term
from suta_calib.arrays import FloatArray
from suta_calib.geometry import rotation_from_vector
from suta_calib.terms import KINDS, ArmPoses, Setup
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination

LEARNT = Noise()


def assessed(solution: Solution, validation: Sequence[Term] = ()) -> Assessment:
    """The assessment of a solution."""
    return assess_calibration(CalibrationExamination.of(solution, validation))


def notes_on(solution: Solution, validation: Sequence[Term] = ()) -> str:
    """Its notes, one after another."""
    return " ".join(assessed(solution, validation).notes)


def watched(
    arm: ArmModel,
    q: FloatArray,
    truth: Mapping[str, float],
    error: FloatArray | float = 0.0,
    *,
    read: FloatArray | None = None,
    stated: Noise = LEARNT,
) -> Term:
    """The tip at postures, as an instrument somewhere sees it; ``read`` is what encoders say."""
    position = arm.forward(q, truth)[1] @ rotation_from_vector([0.3, -1.2, 0.7]).T
    position += np.array([1.1, -0.4, 0.6]) + error
    samples = Samples.from_arrays(arm.joints, q if read is None else read, position=position)
    return KINDS["tracked_point"].over(ArmPoses(arm, samples), Setup(None, stated, Noise()))
