"""One call: from observations and an arm to a calibration with its verdict."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from suta_calib.errors import InputError
from suta_calib.job.calibration import Calibration, CalibrationJob
from suta_calib.job.in_python import Free
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import GEOMETRIC
from suta_calib.model.robot import Robot
from suta_calib.solver.options import SolverOptions
from suta_calib.terms.term import Term


def calibrate(
    arm: ArmModel | Robot | CalibrationJob | str | Path,
    terms: Term | Sequence[Term] = (),
    *,
    validation: Term | Sequence[Term] = (),
    free: Free = GEOMETRIC,
    options: SolverOptions = SolverOptions(),
) -> Calibration:
    """Calibrate an arm from observations, and assess the result.

    ::

        arm = ArmModel.from_urdf("arm.urdf", tip="tool0")
        fitted = TrackedPoint.from_arrays(arm, q, position=p)
        held = TrackedPoint.from_arrays(arm, q2, position=p2)
        result = calibrate(arm, [fitted], validation=[held])
        print(result.assessment)
        result.write_urdf("calibrated.urdf")

    Args:
        arm: at nominal, which all terms are over; a robot, over whose chains they are; or, in place
            of arm and terms, a job, or the path of its ``calibration.yaml``, which says everything
            itself.
        terms: what is fitted, of any kinds, together.
        validation: what is never fitted: how good the answer is on data that it has not seen.
        free: what is unknown: names, globs, `Selection`s, or ``geometric`` for all placements and
            joint offsets. What is given neither bounds nor a prior gets the prior that is usual: 2
            mm and 0.5° for a placement, 10° for an offset. The data widen it where they contradict.
        options: how to solve.

    Returns:
        The answer, converged or not; its ``assessment`` says whether it may be used.

    Raises:
        InputError: something that cannot be used: what was found, what was expected.
    """
    if isinstance(arm, ArmModel | Robot):
        job = CalibrationJob.of_terms(arm, terms, validation, free=free, options=options)
        return job.run()
    if isinstance(arm, str | Path):
        arm = CalibrationJob.load(arm)
    if not isinstance(arm, CalibrationJob):
        expected = "an ArmModel, a Robot, a CalibrationJob, or the path of a job"
        raise InputError(type(arm).__name__, expected, where="calibrate: arm")
    if terms or validation or free != GEOMETRIC or options != SolverOptions():
        hint = "put them into the job's file, or give the arm and terms"
        raise InputError("a job and more arguments", "a job alone", where="calibrate", hint=hint)
    return arm.run()
