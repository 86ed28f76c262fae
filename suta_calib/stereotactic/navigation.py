"""Position of the EM probe's tip in CT, its expected error, and a check of the fiducials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.pose_calibration.consensus import DIMENSION
from suta_calib.pose_calibration.registration import Registration
from suta_calib.stereotactic.marker_cloud import OF_A_POSE
from suta_calib.units import mm


@dataclass(frozen=True, eq=False)
class Navigation:
    """Positions of the EM probe's tip in CT.

    Attributes:
        registration: ``T_ct_em`` by the fiducials.
        fiducials: (N_B, 3) the fiducials by the EM probe, corrected, in the EM tracker, m.
        em: (N_frames, 3) the tip while navigating, corrected, in the EM tracker, m.
        tip_error: (N_frames,) 3-D RMS error to expect there for what the markers are read wrongly,
            more where they lie outside what a correction is fitted to, m.
        fiducial_error: (N_B,) the same of the tip in the fiducials, m.
    """

    registration: Registration
    fiducials: FloatArray
    em: FloatArray
    tip_error: FloatArray
    fiducial_error: FloatArray

    @property
    def ct(self) -> FloatArray:
        """(N_frames, 3) the tip while navigating, in CT, m."""
        return self.registration.act(self.em)

    @property
    def target_error(self) -> FloatArray:
        """(N_frames,) expected error by the registration and by the readings, 3-D RMS, m."""
        return np.hypot(self.registration.target_error(self.em), self.tip_error)

    @property
    def unexplained(self) -> str:
        """A note on fiducials that deviate from the others by more than their readings scatter.

        So few of them hardly tell which is wrong; empty where the readings explain it.
        """
        fitted, registration = self.registration.inliers, self.registration
        freedom = DIMENSION * int(fitted.sum()) - OF_A_POSE
        # A registration takes as much of the errors as it has unknowns.
        explained = rms_length(self.fiducial_error[fitted][:, None])
        explained *= np.sqrt(freedom / (DIMENSION * int(fitted.sum())))
        # Chance of fiducials as far off by the readings alone below which something else is wrong.
        if freedom < 1 or chdtrc(freedom, (registration.rms / explained) ** 2 * freedom) > 1e-5:
            return ""
        residuals = np.where(fitted, np.linalg.norm(registration.residuals, axis=1), 0.0)
        return (
            f"The fiducials are {mm(registration.rms):.2f} mm RMS from the places that the other "
            f"fiducials predict; the readings of the probe explain {mm(explained):.2f} mm. One "
            "fiducial was touched beside its place, has moved, or is wrong in CT. No ± includes "
            f"this error. Fiducial {int(np.argmax(residuals)) + 1} has the largest error, "
            f"{mm(residuals.max()):.2f} mm."
        )
