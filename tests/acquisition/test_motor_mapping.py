"""Motors and joints from touches of a sheet: found in any order, and never guessed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hobby_arms import sheet
from servo_arms import SLOPE, TABLE, TICKS, URDF, ServoArm, arm_with_pen, placed

from suta_calib.acquisition.motor_mapping import MotorMap, map_motors
from suta_calib.acquisition.motor_search import MotorMapOptions
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import rotation_from_rpy, wrap
from suta_calib.job.pen import PEN, with_pen
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.terms import ArmPoses, GivenPose, TouchedLandmark

POSTURE = (0.0, -20.0, 45.0, 45.0, 0.0)
OPTIONS = MotorMapOptions(tip_std=0.05, starts=1)
# As a Koch arm has them: motors named otherwise, some turned round.
ORDER, SIGNS = (0, 2, 1, 3, 4), (-1, 1, -1, 1, -1)


def touched(
    servos: ServoArm, places: Sequence[int] = (0, 1), *, turn_deg: float = 60.0, count: int = 15
) -> TouchedLandmark:
    """Touches of crosses, met to 0.3 mm, on the table and on a slope."""
    crosses, readings, marks, labels = sheet(), [], list[str](), list[str]()
    for place in places:
        at = placed(crosses, (TABLE, SLOPE)[place])[:count]
        at = at + 3e-4 * servos.random.standard_normal(at.shape)
        readings.append(servos.readings(servos.touching(at, POSTURE, turn_deg)))
        marks += [*crosses.landmarks][:count]
        labels += [f"P{place}"] * count
    names = {"placement": labels, "repeat": ["1"] * len(labels), "landmark": marks}
    samples = Samples.from_arrays(servos.arm.joints, np.concatenate(readings), labels=names)
    return TouchedLandmark(ArmPoses(servos.arm, samples), crosses)


def mapped(servos: ServoArm, term: TouchedLandmark, **options: Any) -> MotorMap:
    return map_motors(servos.arm, [term], servos.device, replace(OPTIONS, **options))


@pytest.fixture(scope="module")
def servos() -> ServoArm:
    return ServoArm.made(arm_with_pen(), 1, order=ORDER, signs=SIGNS)


@pytest.fixture(scope="module")
def touches(servos: ServoArm) -> TouchedLandmark:
    return touched(servos)


@pytest.fixture(scope="module")
def found(servos: ServoArm, touches: TouchedLandmark) -> MotorMap:
    return mapped(servos, touches)


def test_order_and_signs_are_found_and_said(found: MotorMap) -> None:
    assert found.status == "found"
    assert found.best.motors.tolist() == [*ORDER]
    assert found.best.signs.tolist() == [*SIGNS]
    assert found.next_rms > 2.5 * found.best.rms
    notes = " ".join(found.assessment.notes)
    assert "The motor called elbow_flex moves shoulder_lift. The two were exchanged." in notes
    assert "wrist_roll counts backwards: its sign is reversed." in notes
    assert "The zero of shoulder_pan, wrist_roll does not show in these touches" in notes


def test_the_zeros_that_show_are_within_their_uncertainty(
    servos: ServoArm, found: MotorMap
) -> None:
    shown = [k for k, row in enumerate(found.joints) if row.std is not None]
    assert shown == [1, 2, 3]
    for k in shown:
        std = found.joints[k].std
        assert std is not None
        assert abs(found.best.offsets[k] - servos.zero[k]) < 3 * std < np.radians(8)


def test_the_corrected_device_gives_the_joints_angles(servos: ServoArm, found: MotorMap) -> None:
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 5))
    sent = servos.ticks(q)
    device = found.corrected
    angles = np.empty_like(q)
    for column, spec in enumerate(device.joints):
        angle = spec.sign * (sent[:, column] - spec.zero) * 2 * np.pi / TICKS
        angles[:, servos.arm.joints.index(spec.name)] = wrap(angle)
    shown = [1, 2, 3]
    assert np.abs(angles - q)[:, shown].max() < np.radians(4)
    assert device.joints[1].name == "elbow_flex"
    assert [spec.number for spec in device.joints] == [1, 2, 3, 4, 5]
    # Samples that were read before, as this device would have given them.
    before = dict(zip(servos.arm.joints, (sent.T - TICKS // 2) * 2 * np.pi / TICKS, strict=True))
    again = found.reread(before)
    assert np.allclose([again[name] for name in servos.arm.joints], angles.T, atol=1e-12)


def test_counts_of_a_turn_show_in_the_touches(
    servos: ServoArm, touches: TouchedLandmark, found: MotorMap
) -> None:
    for row in found.joints[1:4]:
        counts, std = row.counts
        assert abs(counts - TICKS) < max(4 * std, 0.05 * TICKS)
    # A device whose file says 1024 counts makes four times the angle of each reading.
    samples = touches.poses.samples
    term = touches.over_poses(ArmPoses(servos.arm, replace(samples, q=4.0 * samples.q)))
    device = replace(servos.device, counts_per_turn=TICKS // 4)
    signs = dict(zip(servos.arm.joints, SIGNS, strict=True))
    answer = map_motors(servos.arm, [term], device, replace(OPTIONS, signs=signs))
    assert answer.best.motors.tolist() == [*ORDER]
    assert answer.corrected.counts_per_turn == TICKS
    assert f"A turn has {TICKS} counts, not {TICKS // 4}." in answer.assessment.notes


def test_a_direction_that_does_not_show_is_not_guessed() -> None:
    """The hand is never turned: whether the last motor counts backwards is open."""
    servos = ServoArm.made(arm_with_pen(), 1, order=ORDER, signs=SIGNS)
    still = touched(servos, (0,), turn_deg=2.0)
    answer = mapped(servos, still)
    assert answer.status == "ambiguous"
    assert not answer.assessment.usable
    note = answer.assessment.notes[0]
    assert note.startswith("Not decided: whether wrist_roll counts forwards or backwards.")
    assert "--sign wrist_roll=1" in note
    known = mapped(servos, still, signs={"wrist_roll": SIGNS[4]})
    assert known.status == "found"
    assert known.best.signs.tolist() == [*SIGNS]


def test_an_arm_without_limits_may_be_its_own_mirror_image() -> None:
    """Shoulder, elbow and wrist the other way, with zeros on the other side, fit as well."""
    text = re.sub(r"<limit[^>]*/>", "", with_pen(URDF, "hand", Path(), Path()))
    arm = ArmModel.from_urdf(text.replace('"revolute"', '"continuous"'), PEN)
    servos = ServoArm.made(arm, 1)
    answer = mapped(servos, touched(servos), signs={"wrist_roll": 1})
    assert answer.best.signs.tolist() == [1] * 5
    assert answer.status == "ambiguous"
    assert (
        "the limits of the joints in the URDF would tell them apart" in answer.assessment.notes[0]
    )


def test_a_known_pose_of_the_sheet_shows_the_first_zero(
    servos: ServoArm, touches: TouchedLandmark
) -> None:
    position, rpy = TABLE
    rotation = rotation_from_rpy(np.radians(rpy))
    pose = GivenPose(np.array(position) / 1e3, rotation, np.full(3, 2e-3), np.radians(1))
    answer = mapped(servos, replace(touches, given={"P0": pose}))
    assert answer.joints[0].std is not None
    assert abs(answer.best.offsets[0] - servos.zero[0]) < 4 * answer.joints[0].std


def test_touches_of_other_crosses_fit_nothing(servos: ServoArm, touches: TouchedLandmark) -> None:
    samples = touches.poses.samples
    shuffled = np.random.default_rng(1).permutation(samples.labels["landmark"])
    labels = {**samples.labels, "landmark": shuffled}
    term = touches.over_poses(ArmPoses(servos.arm, replace(samples, labels=labels)))
    known = dict.fromkeys(servos.arm.joints, 1)
    answer = mapped(servos, term, signs=known)
    assert answer.status == "no_fit"
    assert "No order and no directions of the motors" in answer.assessment.notes[0]


def test_what_cannot_be_mapped_is_refused(servos: ServoArm, touches: TouchedLandmark) -> None:
    with pytest.raises(InputError, match="found touches: 3 at P0; expected at least 4"):
        mapped(servos, touches.take(range(3)))
    with pytest.raises(InputError, match="no touches"):
        map_motors(servos.arm, [], servos.device)
    with pytest.raises(InputError, match="elbow; expected one of shoulder_pan"):
        mapped(servos, touches, signs={"elbow": 1})


@pytest.mark.slow
def test_forty_arms_are_mapped_or_left_open() -> None:
    """No arm of forty, whatever the order of its motors, is mapped wrongly."""
    found = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        order = random.permutation(5).tolist()
        signs = random.choice((1, -1), 5).tolist()
        arm = ServoArm.made(arm_with_pen(), seed, order=order, signs=signs)
        answer = mapped(arm, touched(arm))
        right = (answer.best.motors.tolist(), answer.best.signs.tolist()) == (order, signs)
        assert right or answer.status != "found"
        found += answer.status == "found"
    assert found >= 38
