"""A Koch arm: its motors from touches, with joints as its public URDF has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hobby_arms import sheet
from servo_arms import ServoArm, placed

from suta_calib import Problem, SolverOptions, solve
from suta_calib.acquisition.motor_mapping import MotorMap, map_motors
from suta_calib.acquisition.motor_search import MotorMapOptions
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import register_points
from suta_calib.job.pen import PEN, with_pen
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import POSITION, ROTATION, Selection
from suta_calib.terms import ArmPoses, TouchedLandmark
from suta_calib.units import from_deg

# To the millimetre: where a joint begins in the one before, and its axis; the arm reaches along -x.
LAYOUT = (
    ("12 0 41", "0 0 -1"),
    ("0 -21 15", "0 1 0"),
    ("-15 6 108", "0 1 0"),
    ("-100 0 3", "0 1 0"),
    ("-45 13 0", "1 0 0"),
)
HAND = "link_5"
# Where the sheet lies, mm and deg; the posture about which it is touched, deg.
TABLE = ((-100.0, 0.0, 0.0), (0.0, 0.0, 180.0))
SLOPE = ((-100.0, 10.0, 20.0), (5.0, -12.0, 170.0))
POSTURE = (0.0, 0.0, -30.0, -25.0, 0.0)
IN_HAND = (-0.1, 0.005, 0.04)
ORDER, SIGNS = (0, 2, 1, 3, 4), (-1, 1, -1, 1, -1)


def koch(limit: float) -> str:
    """A URDF with this layout, whose joints turn so far to both sides, rad."""
    text = ['<robot name="koch"><link name="base_link"/>']
    for k, (origin, axis) in enumerate(LAYOUT, 1):
        xyz = " ".join(f"{float(number) / 1e3:g}" for number in origin.split())
        parent = f"link_{k - 1}" if k > 1 else "base_link"
        text += [
            f'<link name="link_{k}"/><joint name="joint_{k}" type="revolute">',
            f'<origin xyz="{xyz}"/><parent link="{parent}"/><child link="link_{k}"/>',
            f'<axis xyz="{axis}"/>',
            f'<limit lower="-{limit}" upper="{limit}" effort="1" velocity="5"/></joint>',
        ]
    return "\n".join([*text, "</robot>"])


def arm_of(urdf: str | Path) -> ArmModel:
    """The arm of a URDF, with a pen in its hand."""
    return ArmModel.from_urdf(with_pen(urdf, HAND, Path(), Path()), PEN)


def touched(servos: ServoArm) -> TouchedLandmark:
    """All crosses of a sheet in two places, each met to 0.3 mm."""
    crosses, readings = sheet(), list[FloatArray]()
    for place in (TABLE, SLOPE):
        at = placed(crosses, place)
        at = at + 3e-4 * servos.random.standard_normal(at.shape)
        readings.append(servos.readings(servos.touching(at, POSTURE)))
    marks = [*crosses.landmarks]
    labels = {
        "placement": ["table"] * len(marks) + ["slope"] * len(marks),
        "repeat": ["1"] * 2 * len(marks),
        "landmark": marks * 2,
    }
    samples = Samples.from_arrays(servos.arm.joints, np.concatenate(readings), labels=labels)
    return TouchedLandmark(ArmPoses(servos.arm, samples), crosses)


def mapped(urdf: str | Path) -> MotorMap:
    """What touches say of an arm whose motors are exchanged and turned round."""
    servos = ServoArm.made(arm_of(urdf), 1, order=ORDER, signs=SIGNS, zero_deg=3.0, pen=IN_HAND)
    term = touched(servos)
    return map_motors(servos.arm, [term], servos.device, MotorMapOptions(tip_std=0.05, starts=1))


@pytest.mark.parametrize("limit", [1.9, np.pi])
def test_the_motors_of_a_koch_are_found(limit: float) -> None:
    """Its public URDF lets each joint turn by half a turn to both sides: limits tell nothing."""
    found = mapped(koch(limit))
    assert found.status == "found"
    assert found.best.motors.tolist() == [*ORDER]
    assert found.best.signs.tolist() == [*SIGNS]


def test_touches_calibrate_a_koch() -> None:
    """Horns 1.5° off, lengths 1 mm, play of 1.5°: the tip is right to 0.5 mm above the sheet."""
    servos = ServoArm.made(arm_of(koch(1.9)), 0, zero_deg=1.5, pen=IN_HAND)
    arm = servos.arm
    unknowns = arm.select(
        Selection(arm.offsets, prior_rad=from_deg(3.0)),
        Selection("geometric", prior_m=1.5e-3, prior_rad=from_deg(0.7)),
        Selection(arm.like_offsets, fixed=True),
        Selection(tuple(f"{PEN}.{axis}" for axis in POSITION), prior_m=0.05),
        Selection(tuple(f"{PEN}.{angle}" for angle in ROTATION), fixed=True),
    )
    solution = solve(Problem([touched(servos)], unknowns), SolverOptions(starts=1, confirm=False))
    places = np.random.default_rng(1).uniform((-0.26, -0.1, 0.0), (-0.12, 0.1, 0.08), (30, 3))
    q = servos.touching(places, POSTURE)
    true = servos.at(q)[1]
    found = arm.forward(servos.read_at(q), solution.values)[1]
    turn, shift = register_points(found, true)[:2]
    assert np.sqrt(np.mean(np.sum((found @ turn.T + shift - true) ** 2, axis=1))) < 0.5e-3
