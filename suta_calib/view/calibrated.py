"""A calibration as far as there is something to see of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.model.arm import ArmModel
from suta_calib.model.robot import AnyArm
from suta_calib.terms import Term
from suta_calib.trust.accuracy import Accuracy
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.tip import sensitivity
from suta_calib.units import mm


@dataclass(frozen=True, eq=False)
class Calibrated(Displayable):
    """A calibration, whether it was just made or read back.

    Attributes:
        title: what was calibrated.
        arm: at nominal; or the robot with its chains.
        values: of the calibrated arm's parameters by name, m or rad.
        names, covariance: p parameters that were estimated, and (p, p) how surely.
        terms: by set (``calibration``, ``validation``): each term with the values of its own
            unknowns and the arm's, m or rad.
        rms: by set, before and after, m.
        assessment: whether it may be used.
    """

    title: str
    arm: AnyArm
    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: FloatArray
    terms: Mapping[str, tuple[tuple[Term, Mapping[str, float]], ...]]
    rms: Mapping[str, tuple[float, float]]
    assessment: Assessment

    @classmethod
    def of(
        cls,
        examined: CalibrationExamination,
        assessment: Assessment,
        title: str = "",
    ) -> Calibrated:
        """One that was just made.

        Args:
            examined: of a problem over an arm.
            assessment: whether it may be used.
            title: what was calibrated; the arm's file by default.

        Raises:
            JobError: the problem looks at no arm.
        """
        solution, accuracy, arm = examined.solution, examined.accuracy, examined.arm
        if arm is None:
            raise JobError("observations without an arm", "samples with joint readings")
        sets = {"calibration": accuracy.calibration, "validation": accuracy.validation}
        rms = {
            name: (Accuracy.overall(terms, "before").rms, Accuracy.overall(terms, "after").rms)
            for name, terms in sets.items()
            if terms
        }
        fitted, held_out = (tuple(term.term for term in terms) for terms in sets.values())
        return cls(
            title or arm.urdf[0].name,
            arm,
            solution.values,
            *solution.arm_covariance,
            term_sets(fitted, held_out, solution.values, accuracy.held_out_values),
            rms,
            assessment,
        )

    @property
    def summary(self) -> str:
        """One line on the errors before and after."""
        shown = ((name, *(mm(rm) for rm in rms)) for name, rms in self.rms.items())
        return ", ".join(f"{name} {a:.3g} → {b:.3g} mm RMS" for name, a, b in shown)

    def tip(self, arm: ArmModel, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the calibrated tip of a chain is at readings (n, joints), and how surely.

        Returns:
            Positions (n, 3), m, and their covariances (n, 3, 3), m².
        """
        at = sensitivity(arm, self.values, self.names, q)
        return at.position, at.jacobian @ self.covariance @ np.swapaxes(at.jacobian, 1, 2)


def term_sets(
    observations: Sequence[Term],
    validation: Sequence[Term],
    values: Mapping[str, float],
    held_out: Mapping[str, float],
) -> dict[str, tuple[tuple[Term, Mapping[str, float]], ...]]:
    """Terms of ``calibration`` and ``validation``, each with the values that belong to it."""
    both = {**values, **held_out}
    return {
        "calibration": tuple((term, values) for term in observations),
        "validation": tuple((term, both) for term in validation),
    }
