"""The arm on a cable, moving in the browser, with how sure its tip is."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec
from suta_calib.device.reading import Reading
from suta_calib.tracking.tracker import matched_joints
from suta_calib.units import mm
from suta_calib.view.calibrated import Calibrated
from suta_calib.view.calibration import UNSURE
from suta_calib.view.scene import Ellipsoids
from suta_calib.view.server import Viewer


class LiveArm:
    """Moves what a viewer of a calibration shows as a device reads.

    Attributes:
        shown: how many readings were shown.

    Raises:
        InputError: the device lacks a joint of the chain.
    """

    def __init__(self, viewer: Viewer, calibrated: Calibrated, device: DeviceSpec) -> None:
        self._viewer, self._calibrated, self._device = viewer, calibrated, device
        names = [joint.name for joint in device.joints]
        self._columns = matched_joints(calibrated.arm, names, device.path)
        self.shown = 0

    def follow(self, over: Callable[[], bool], say: Callable[[str], None]) -> None:
        """Show the latest reading again and again, until ``over`` says so.

        Args:
            over: asked between readings.
            say: called with one sentence for everything that was wrong and went on.

        Raises:
            DeviceError: the device cannot be opened, was never heard, or cannot be understood.
        """
        with Bus(self._device, reconnect=True, on_event=say) as bus:
            while not over():
                if readings := bus.read(0.1):
                    self.show(readings[-1])
                    # More often nobody sees, and a browser cannot keep up.
                    time.sleep(1 / 30)

    def show(self, reading: Reading) -> None:
        """Show one reading; where an encoder raises its error flag the arm stays as it was."""
        arm, flags = self._calibrated.arm, reading.error[self._columns]
        q = reading.angles[self._columns]
        wrong = [name for name, flag in zip(arm.joints, flags, strict=True) if flag]
        tips = {one.bodies.tip: self._calibrated.tip(one, q[None]) for one in arm.arms}
        position, covariance = (np.concatenate(part) for part in zip(*tips.values(), strict=True))
        label = f"not valid: error flag of {', '.join(wrong)}"
        if not wrong:
            self._viewer.move(q)
            self.shown += 1
            label = "; ".join(map(_place, tips, position, covariance))
        self._viewer.show_tip(Ellipsoids.of("tip", position, covariance, UNSURE), label)


def _place(chain: str, position: FloatArray, covariance: FloatArray) -> str:
    """A tip (3,), m, with its standard deviations: ``left: 120.00 ± 0.10, …, … mm``."""
    numbers = zip(mm(position), mm(np.sqrt(np.diagonal(covariance))), strict=True)
    place = ", ".join(f"{p:.2f} ± {s:.2f}" for p, s in numbers) + " mm"
    return f"{chain}: {place}" if chain else place
