"""Rows that a robust fit left behind are named beside the errors."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import arm_named

from suta_calib import Calibration, Noise, TrackedPoint, calibrate
from suta_calib.report.errors import far_rows

ARM = arm_named("suta")


def calibrated(error: float, **noise: float) -> Calibration:
    """Forty positions of which row 7 is off by so much, m."""
    random = np.random.default_rng(4)
    q = random.uniform(-1.5, 1.5, (40, len(ARM.joints)))
    seen = ARM.forward(q, {"joint_3.offset": 0.01})[1] + 1e-4 * random.standard_normal((40, 3))
    seen[7] += [0.0, 0.0, error]
    fitted = TrackedPoint.from_arrays(ARM, q, position=seen, noise=Noise(**noise))
    return calibrate(ARM, fitted, free=["*.offset"])


def sentences(result: Calibration) -> list[str]:
    """What is said of far rows."""
    return [part.text for part in far_rows(result.accuracy.calibration)]


@pytest.mark.parametrize(
    ("noise", "weight"), [({"huber": 3e-4}, "little weight"), ({}, "full weight: the job has no h")]
)
def test_a_row_far_off_is_named(noise: dict[str, float], weight: str) -> None:
    (said,) = sentences(calibrated(0.08, **noise))
    assert said.startswith("1 of 40 fitted rows of tracked_point is more than 10 times as far off")
    assert "row 7 (" in said
    assert weight in said


def test_of_sound_rows_nothing_is_said() -> None:
    assert sentences(calibrated(0.0, huber=3e-4)) == []
