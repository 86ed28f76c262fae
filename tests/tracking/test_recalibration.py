"""Zeros that drift while an arm is tracked: found with true ±, and never put into the poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import SUTA_URDF

from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.errors import InputError
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.tracking import TipKinematics, Tracker, Tracking, TrackingSession, TrackOptions
from suta_calib.tracking.bounded_walk import BoundedWalk
from suta_calib.tracking.docking import Docking
from suta_calib.tracking.publisher import pose_dict
from suta_calib.tracking.recalibration import (
    DriftSpec,
    KnownPoint,
    Recalibration,
    RecalibrationSpec,
    read_recalibration,
)
from suta_calib.tracking.uncertainty import CalibrationUncertainty
from suta_calib.units import from_deg

DOCKS = {"left": np.array([0.35, 0.1, 0.2]), "right": np.array([0.3, -0.25, 0.3])}
# Drift of a zero, and its time constant, s.
DRIFT, LONG = from_deg(0.1), 7200.0
SPEC = RecalibrationSpec(
    {name: KnownPoint(place, 1e-3) for name, place in DOCKS.items()}, drift=DriftSpec(DRIFT, 2.0)
)


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.from_urdf(SUTA_URDF, "tip")


def calibrated(arm: ArmModel) -> CalibrationUncertainty:
    """A calibration to 0.05 mm and 0.01°."""
    names = [n for n in arm.parameters if n in arm.geometric and n not in arm.like_offsets]
    names += [f"{joint}.offset" for joint in arm.joints]
    units = [arm.parameters[name].unit for name in names]
    stds = np.array([5e-5 if unit == "m" else from_deg(0.01) for unit in units])
    return CalibrationUncertainty(
        Path("result.json"), tuple(names), np.diag(stds**2), {}, "covariance", (), {}
    )


class DriftingArm:
    """An arm that was calibrated with an error, and whose zeros walk."""

    def __init__(self, arm: ArmModel, seed: int) -> None:
        self.arm, self.random = arm, np.random.default_rng([43, seed])
        known = calibrated(arm)
        stds = np.sqrt(np.diag(known.covariance))
        self.truth = {
            name: arm.parameters[name].nominal + std * self.random.standard_normal()
            for name, std in zip(known.names, stds, strict=True)
        }
        self.zeros = DRIFT * self.random.standard_normal(len(arm.joints))
        points = {n: p + 1e-3 * self.random.standard_normal(3) for n, p in DOCKS.items()}
        known_points = {name: KnownPoint(place, 1e-3) for name, place in points.items()}
        self.live = Recalibration(arm, known, replace(SPEC, points=known_points))
        self.time = 0.0

    def wait(self, seconds: float) -> None:
        decay = np.exp(-seconds / LONG)
        step = np.sqrt(1 - decay**2) * DRIFT * self.random.standard_normal(len(self.zeros))
        self.zeros, self.time = decay * self.zeros + step, self.time + seconds

    @property
    def values(self) -> dict[str, float]:
        """True parameters, the drift among them."""
        offsets = {f"{joint}.offset" for joint in self.arm.joints}
        added = dict(zip(sorted(offsets), self.zeros, strict=True))
        return {name: value + added.get(name, 0.0) for name, value in self.truth.items()}

    def readings_at(self, place: FloatArray) -> FloatArray:
        """Readings of some posture that puts the tip on a place, to 0.1 mm."""
        kinematics = InverseKinematics(self.arm, self.values)
        target = Targets((place + 1e-4 * self.random.standard_normal(3))[None], np.eye(3)[None])
        posture = kinematics.random_readings(self.random, 1)
        answer = kinematics.solve(replace(target, matching="position"), posture, self.random)
        assert answer.reached[0]
        return np.asarray(answer.q[0])

    def touch(self, name: str) -> None:
        self.live.touch(name, self.readings_at(DOCKS[name]), self.time)

    def deviations(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of zeros and of tips in 20 postures, in standard deviations.

        And how far the tips are off (20, 2), m: with what the touches add, and without.
        """
        found = np.array([*self.live.zeros.values()])
        tips, off = list[FloatArray](), list[FloatArray]()
        for q in InverseKinematics(self.arm, {}).random_readings(self.random, 20):
            shift, std = self.live.correction(q)
            true = self.arm.forward(q[None], self.values)[1][0]
            away = self.live.tip(q) - true
            tips.append((away + shift) / std)
            off.append(np.linalg.norm([away + shift, away], axis=1))
        return (found[:, 0] - self.zeros) / found[:, 1], np.concatenate(tips), np.array(off)


def test_the_recursion_is_the_batch_estimate() -> None:
    """Linear observations of a walk and of constants: the same as all at once, to 1e-9."""
    random = np.random.default_rng(5)
    n, walking, decay_time, steps = 5, 3, 40.0, 12
    prior = np.diag(random.uniform(0.5, 2.0, n))
    drifting = np.array([*np.sqrt(np.diag(prior))[:walking], 0.0, 0.0])
    filtered = BoundedWalk(prior, drifting, decay_time)
    # All times as unknowns of one least-squares problem: the walk's states, then the constants.
    size = walking * steps + n - walking
    information, score = np.zeros((size, size)), np.zeros(size)
    constant = slice(walking * steps, size)
    information[constant, constant] = np.linalg.inv(prior[walking:, walking:])
    previous = None
    for k in range(steps):
        seconds = 0.0 if k == 0 else float(random.uniform(1, 60))
        filtered.advance(seconds)
        now = slice(walking * k, walking * (k + 1))
        decay = np.exp(-seconds / decay_time)
        if previous is None:
            information[now, now] += np.linalg.inv(prior[:walking, :walking])
        else:
            moved = np.zeros((walking, size))
            moved[:, now], moved[:, previous] = np.eye(walking), -decay * np.eye(walking)
            precision = np.diag(1 / ((1 - decay**2) * drifting[:walking] ** 2))
            information += moved.T @ precision @ moved
        slope, noise = random.standard_normal((3, n)), np.diag(random.uniform(0.1, 1, 3))
        residual = random.standard_normal(3)
        filtered.update(slope, residual, noise)
        wide = np.zeros((3, size))
        wide[:, now], wide[:, constant] = slope[:, :walking], slope[:, walking:]
        information += wide.T @ np.linalg.solve(noise, wide)
        score += wide.T @ np.linalg.solve(noise, residual)
        previous = now
    covariance = np.linalg.inv(information)
    last = np.r_[walking * (steps - 1) : size]
    np.testing.assert_allclose(filtered.mean, (covariance @ score)[last], atol=1e-9)
    np.testing.assert_allclose(filtered.covariance, covariance[np.ix_(last, last)], atol=1e-9)


def test_what_drifts_stays_within_its_prior() -> None:
    walk = BoundedWalk(np.diag([4.0, 1.0]), np.array([2.0, 0.0]), 10.0)
    walk.update(np.array([[1.0, 1.0]]), np.array([3.0]), np.array([[0.1]]))
    known = walk.covariance.copy()
    assert known[0, 0] < 4.0
    walk.advance(1e6)
    assert walk.covariance[0, 0] == pytest.approx(4.0)
    assert walk.mean[0] == pytest.approx(0.0)
    assert walk.covariance[1, 1] == pytest.approx(known[1, 1])


def test_touches_show_the_drift_of_the_zeros(arm: ArmModel) -> None:
    drifting = DriftingArm(arm, 1)
    before = drifting.live.correction(np.zeros(6))
    assert not before[0].any()
    for _ in range(6):
        drifting.wait(600.0)
        drifting.touch("left")
        drifting.touch("right")
    live = drifting.live
    assert [touch.used for touch in live.touches] == [True] * 12
    assert live.alarms == []
    zeros, tips, _ = drifting.deviations()
    assert np.abs(zeros).max() < 3.5
    assert np.sqrt(np.mean(tips**2)) < 2.0
    assert all(std < DRIFT for _, std in live.zeros.values())
    found = live.as_dict()
    assert found["touches"] == 12
    assert found["zeros_deg"]["joint_2"] == pytest.approx(np.degrees(live.zeros["joint_2"][0]))


def test_a_change_that_no_drift_explains_is_an_alarm_and_is_not_taken_in(arm: ArmModel) -> None:
    drifting = DriftingArm(arm, 2)
    for _ in range(3):
        drifting.wait(60.0)
        drifting.touch("left")
        drifting.touch("right")
    zeros = drifting.live.zeros
    # Somebody knocks the tip: 3 mm.
    drifting.truth["tip.x"] += 3e-3
    drifting.touch("left")
    assert not drifting.live.touches[-1].used
    assert drifting.live.alarms == []
    drifting.touch("right")
    (alarm,) = drifting.live.alarms
    assert "neither the calibration's ± nor a drift of the zeros explains" in alarm
    assert "suta-calib check RESULT SAMPLES" in alarm
    assert drifting.live.zeros == zeros


def test_a_zero_that_drifts_too_far_is_an_alarm(arm: ArmModel) -> None:
    drifting = DriftingArm(arm, 3)
    live = drifting.live
    for k in range(24):
        drifting.time += 120.0
        drifting.zeros[2] = from_deg(0.025) * k
        drifting.touch("left" if k % 2 else "right")
    assert any(alarm.startswith("the zero of joint_3 has drifted by +0.") for alarm in live.alarms)
    assert len(live.alarms) == len(set(live.alarms))


def test_warmth_explains_what_it_does(arm: ArmModel) -> None:
    """Zeros that follow the temperature at once, while others hardly drift."""
    drift = DriftSpec(from_deg(0.005), 2.0, from_deg(0.02))
    drifting = DriftingArm(arm, 4)
    drifting.zeros = np.zeros(6)
    spec = replace(drifting.live.spec, drift=drift)
    live = Recalibration(arm, calibrated(arm), spec)
    per_kelvin = from_deg(0.02) * drifting.random.standard_normal(6)
    for k in range(24):
        warm = 20.0 + 10 * np.sin(k)
        drifting.zeros = per_kelvin * (warm - 20.0)
        name = "left" if k % 2 else "right"
        live.touch(name, drifting.readings_at(DOCKS[name]), 60.0 * k, warm)
    assert sum(touch.used for touch in live.touches) > 22
    drifting.zeros = per_kelvin * 10.0
    q = drifting.readings_at(np.array([0.33, 0.0, 0.25]))
    shift, std = live.correction(q, 30.0)
    true = arm.forward(q[None], drifting.values)[1][0]
    assert np.linalg.norm(live.tip(q) + shift - true) < 3 * np.linalg.norm(std)
    assert np.linalg.norm(live.tip(q) - true) > 2 * np.linalg.norm(live.tip(q) + shift - true)


def readings(q: FloatArray, start: float, random: np.random.Generator) -> Iterator[Reading]:
    """Two seconds at rest, a hundred readings a second."""
    for k in range(200):
        angles = q + 1e-6 * random.standard_normal(len(q))
        nothing = np.zeros(len(q), dtype=bool)
        yield Reading(k, start + 0.01 * k, angles, nothing, nothing, start + 0.01 * k)


def test_rests_on_a_point_are_touches_and_poses_stay_as_they_are(arm: ArmModel) -> None:
    drifting = DriftingArm(arm, 5)
    live, said = drifting.live, list[str]()
    docking = Docking(live, said.append)
    kinematics = TipKinematics(arm, uncertainty=calibrated(arm))
    tracker = Tracker(arm, arm.joints, kinematics, correction=live.correction)
    session = TrackingSession(tracker, [docking])
    elsewhere = drifting.readings_at(np.array([0.45, 0.2, 0.3]))
    for k, q in enumerate((drifting.readings_at(DOCKS["left"]), elsewhere)):
        for reading in readings(q, 10.0 * k, drifting.random):
            session.take(reading)
    assert docking.statistics() == {"touches": 1, "rests elsewhere": 1}
    assert [touch.point for touch in live.touches] == ["left"]
    assert said == []
    pose = session.last
    assert pose is not None
    assert pose.shift is not None
    assert pose.shift.any()
    plain = Tracker(arm, arm.joints, kinematics).pose(
        next(readings(elsewhere, 0.0, drifting.random))
    )
    np.testing.assert_allclose(pose.position, plain.position, atol=1e-4)
    assert "recalibrated" not in pose_dict(plain)
    assert pose_dict(pose)["recalibrated"]["shift"] == pose.shift.tolist()


def test_a_file_of_points_is_read(tmp_path: Path) -> None:
    path = tmp_path / "points.yaml"
    path.write_text(
        "points:\n  dock: {position_mm: [300, 0, 50], sigma_mm: 2}\n  3: {position_mm: [0, 1, 2]}\n"
        "reach_mm: 8\ndrift: {zeros_deg: 0.2, zeros_deg_per_kelvin: 0.01}\n"
    )
    spec = read_recalibration(path)
    assert [*spec.points] == ["dock", "3"]
    assert spec.points["dock"].position.tolist() == [0.3, 0.0, 0.05]
    assert (spec.points["dock"].sigma, spec.points["3"].sigma) == (2e-3, 1e-3)
    assert (spec.reach, spec.sigma) == (8e-3, 1e-4)
    assert spec.drift == DriftSpec(from_deg(0.2), 2.0, from_deg(0.01))
    for text, found in (
        ("reach_mm: 3\n", "points: found no such key"),
        ("points: {a: {position_mm: [1, 2, 3]}}\ndrfit: {}\n", "did you mean 'drift'"),
        ("points: {a: {sigma_mm: 3}}\n", "position_mm: found no such key"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=found):
            read_recalibration(path)


def test_what_cannot_be_recalibrated_is_refused(arm: ArmModel, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="points: found no points"):
        Recalibration(arm, None, RecalibrationSpec({}))
    with pytest.raises(InputError, match="found the point 'up'; expected one of left, right"):
        Recalibration(arm, None, SPEC).touch("up", np.zeros(6), 0.0)
    device = tmp_path / "device.yaml"
    joints = "\n".join(f"  - {{name: {joint}}}" for joint in arm.joints)
    device.write_text(f"port: loop://\njoints:\n{joints}\n")
    options = TrackOptions(SUTA_URDF, "tip", device, recalibrate=tmp_path / "points.yaml")
    with pytest.raises(InputError, match="found --recalibrate alone; expected --result"):
        Tracking(options)


@pytest.mark.slow
def test_the_uncertainty_is_true(arm: ArmModel) -> None:
    """Forty arms over four hours: zeros and tips are as far off as their ± says."""
    zeros, tips, off, alarms = list[FloatArray](), list[FloatArray](), list[FloatArray](), 0
    for seed in range(40):
        drifting = DriftingArm(arm, 100 + seed)
        for k in range(24):
            drifting.wait(600.0)
            drifting.touch("left" if k % 2 else "right")
        of_zeros, of_tips, of_places = drifting.deviations()
        zeros.append(of_zeros)
        tips.append(of_tips)
        off.append(of_places)
        alarms += len(drifting.live.alarms)
    assert alarms == 0
    # Figures of docs/guides/drift.md.
    with_touches, without = np.sqrt(np.mean(np.concatenate(off) ** 2, axis=0))
    assert with_touches == pytest.approx(0.8e-3, abs=0.1e-3)
    assert without == pytest.approx(1.8e-3, abs=0.1e-3)
    for deviations in (np.concatenate(zeros), np.concatenate(tips)):
        assert 0.85 < np.sqrt(np.mean(deviations**2)) < 1.2
        assert np.mean(np.abs(deviations) < 2.0) > 0.9
