"""Gravity as a sensor on the arm felt it: zeros of joints by a phone, and what it does not show."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_job import cli, spoken
from five_joints import AXES, urdf

from suta_calib import (
    ArmModel,
    Gravity,
    Selection,
    SensorMount,
    UpDirection,
    calibrate,
    observe,
)
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector
from suta_calib.job.calibration import CalibrationJob
from suta_calib.terms import ArmPoses, Noise

OFFSETS = Selection(("*.offset",), bound_rad=math.radians(15))
PHONE = math.radians(0.2)
STANDS = UpDirection(np.array([0.0, 0.0, 1.0]))


def felt(
    arm: ArmModel, rng: np.random.Generator, n: int, sigma: float = PHONE, mount: object = None
) -> tuple[np.ndarray, dict[str, float], dict[str, np.ndarray]]:
    """Readings, true offsets of 2° (the first joint's is nil), and what a phone feels, in g."""
    truth = {f"{name}.offset": math.radians(2) * rng.standard_normal() for name in arm.joints[1:]}
    q = rng.uniform(-1.8, 1.8, (n, len(arm.joints)))
    turned, _ = arm.forward(q, truth)
    up = turned.transpose(0, 2, 1)[:, :, 2] @ (np.eye(3) if mount is None else mount)
    up = np.einsum("nij,nj->ni", rotation_from_vector(sigma * rng.standard_normal((n, 3))), up)
    return q, truth, dict(zip(("ax", "ay", "az"), up.T, strict=True))


def test_a_phone_tells_the_zeros_of_all_joints_but_the_first() -> None:
    """Twenty-five postures, 0.2° of noise, 2° of offsets: each within 0.15°, twelve times."""
    arm = ArmModel.from_urdf(urdf(AXES["crossed"]), tip="tip")
    known = SensorMount(np.eye(3))
    off = []
    for seed in range(12):
        q, truth, up = felt(arm, np.random.default_rng(seed), 25)
        result = calibrate(arm, [Gravity.from_arrays(arm, q, sensor=known, **up)], free=OFFSETS)
        assert result.estimates["j1.offset"].state == "unidentified"
        assert result.estimates["j1.offset"].std is None
        off.append([result.estimates[n].value - v for n, v in truth.items()])
        ratio = [
            (result.estimates[n].value - v) / result.estimates[n].std for n, v in truth.items()
        ]
        assert np.abs(ratio).max() < 4.0
    assert np.degrees(np.abs(off).max()) < 0.15


def test_parallel_joints_show_only_their_sum_until_a_sensor_sits_between_them() -> None:
    arm = ArmModel.from_urdf(urdf(AXES["parallel"]), tip="tip")
    q, truth, up = felt(arm, np.random.default_rng(0), 30, sigma=0.0)
    term = Gravity.from_arrays(arm, q, **up)
    result = calibrate(arm, [term], free=OFFSETS)
    unknown = {n for n, e in result.estimates.items() if e.state == "unidentified"}
    # The first turns about the vertical, and the last is taken up by the unknown mount.
    assert {"j1.offset", "j5.offset"} < unknown
    (sum_of,) = {"j2.offset", "j3.offset", "j4.offset"} - unknown
    assert result.estimates[sum_of].value == pytest.approx(
        sum(truth[f"j{k}.offset"] for k in (2, 3, 4)), abs=1e-6
    )


def test_zeros_that_only_priors_split_are_named_with_what_to_do() -> None:
    arm = ArmModel.from_urdf(urdf(AXES["parallel"]), tip="tip")
    free = Selection(("*.offset",), prior_rad=math.radians(3), fixed=True)
    known = SensorMount(np.eye(3))
    q, truth, up = felt(arm, np.random.default_rng(0), 30)
    hand = Gravity.from_arrays(arm, q, sensor=known, **up)
    result = calibrate(arm, [hand], free=free)
    (split,) = result.examined.prior_splits
    assert split.names == ("j2.offset", "j3.offset", "j4.offset")
    assert split.links == ("l2", "l3")
    # Of three alike, a part of two thirds of the variance is not told.
    np.testing.assert_allclose(np.degrees(split.stds), 3.0 * math.sqrt(2.0 / 3.0), rtol=0.02)
    steps = {
        name: np.degrees(result.estimates[name].value - true)
        for name, true in truth.items()
        if name in split.names
    }
    assert abs(sum(steps.values())) < 0.5 < max(map(abs, steps.values()))
    assert result.assessment.level == "care"
    said = " ".join(result.assessment.notes)
    assert "tell only the sum of j2.offset, j3.offset and j4.offset" in said
    assert "comes from its prior (± 2.4 deg)" in said
    assert "links l2 and l3 too: for each, add a row of kind gravity with its name" in said
    # What is not split is not said, whatever its prior.
    crossed = ArmModel.from_urdf(urdf(AXES["crossed"]), tip="tip")
    q, _, up = felt(crossed, np.random.default_rng(0), 30)
    told = calibrate(crossed, [Gravity.from_arrays(crossed, q, sensor=known, **up)], free=free)
    assert told.estimates["j1.offset"].state == "prior"
    assert told.examined.prior_splits == ()
    assert observe(told.solution.problem).splits == ()
    assert observe(result.solution.problem).assessment.level == "care"


def test_no_predicted_std_is_larger_than_its_prior() -> None:
    """Readings of one rest repeat its error: they are believed too much, but nobody forgets."""
    arm = ArmModel.from_urdf(urdf(AXES["parallel"]), tip="tip")
    free = Selection(("*.offset",), prior_rad=math.radians(0.02), fixed=True)
    q, _, up = felt(arm, np.random.default_rng(0), 3)
    again = np.repeat(np.arange(3), 200)
    readings = {axis: g[again] for axis, g in up.items()}
    term = Gravity.from_arrays(arm, q[again], sensor=SensorMount(np.eye(3)), **readings)
    look = observe(calibrate(arm, [term], free=free).solution.problem)
    stds = [p.std for p in look.prospects.values() if p.prior is not None and p.std is not None]
    assert len(stds) == 5
    assert max(stds) <= math.radians(0.02)


def job(folder: Path, rows: str, arm: str = "{urdf: arm.urdf, tip: tip}") -> Path:
    path = folder / "job.yaml"
    path.write_text(
        f"arm: {arm}\nparameters: [{{select: ['*.offset'], bound_deg: 15}}]\nobservations:\n{rows}",
        encoding="utf-8",
    )
    return path


def test_a_sensor_on_another_link_is_a_row_with_link(tmp_path: Path) -> None:
    """The joints in between need no column; a joint may be called as a column of angles is."""
    names = ("j1", "pitch", "j3", "j4", "roll")
    (tmp_path / "arm.urdf").write_text(urdf(AXES["parallel"], names), encoding="utf-8")
    sets = {name: {"kind": "gravity", "samples": 20, "link": name} for name in ("l2", "l3")}
    (tmp_path / "sim.yaml").write_text(
        yaml.safe_dump(
            {
                "arm": {"urdf": "arm.urdf", "tip": "tip"},
                "errors": [{"select": ["pitch.offset", "j3.offset", "j4.offset"], "std_deg": 2}],
                "noise": {"instrument_deg": 0.2},
                "sets": {"tip": {"kind": "gravity", "samples": 20}, **sets},
            }
        ),
        encoding="utf-8",
    )
    assert cli("simulate", tmp_path / "sim.yaml", "--out", tmp_path) == 0
    header = (tmp_path / "l2" / "samples.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header == "j1,pitch,ax,ay,az"
    given = "sensor: {rotation_rpy_deg: [0, 0, 0]}"
    rows = f" - {{kind: gravity, samples: tip/*.csv, {given}}}\n" + "".join(
        f" - {{kind: gravity, link: {n}, samples: {n}/*.csv, {given}}}\n" for n in ("l2", "l3")
    )
    path = job(tmp_path, rows)
    result = CalibrationJob.load(path).run()
    truth = yaml.safe_load((tmp_path / "truth.yaml").read_text(encoding="utf-8"))["parameters"]
    for name, true in truth.items():
        estimate = result.estimates[name]
        assert estimate.std is not None
        assert abs(estimate.value - math.radians(true["value_deg"])) < 4 * estimate.std
        assert math.degrees(estimate.std) < 0.15
    # Of directions no length is an unknown, and none is asked for.
    assert not any("measures a length" in note for note in result.assessment.notes)
    assert set(result.solution.values) > {"sensor[l2].rx", "sensor[l3].rz", "sensor[tip].ry"}
    path.write_text(path.read_text(encoding="utf-8").replace("link: l2", "link: l22"), "utf-8")
    code, _, said = spoken("calibrate", path)
    assert code == 2
    assert "found 'l22'" in said
    assert "did you mean 'l2'?" in said


def test_angles_of_an_inclinometer_say_the_same() -> None:
    arm = ArmModel.from_urdf(urdf(AXES["crossed"]), tip="tip")
    mount = rotation_from_rpy([0.4, -0.3, 1.0])
    q, truth, up = felt(arm, np.random.default_rng(3), 30, sigma=0.0, mount=mount)
    x, y, z = up.values()
    angles = {"roll": np.arctan2(y, z), "pitch": np.arctan2(-x, np.hypot(y, z))}
    by_up, by_angles = (
        calibrate(arm, [Gravity.from_arrays(arm, q, up=STANDS, **numbers)], free=OFFSETS)
        for numbers in (up, angles)
    )
    for name in ("j2.offset", "j3.offset", "j4.offset"):
        assert by_angles.estimates[name].value == pytest.approx(truth[name], abs=1e-6)
        assert by_up.estimates[name].value == pytest.approx(truth[name], abs=1e-6)
    exchanged = {"roll": angles["pitch"], "pitch": angles["roll"]}
    wrong = calibrate(arm, [Gravity.from_arrays(arm, q, up=STANDS, **exchanged)], free=OFFSETS)
    assert "roll and pitch are exchanged" in " ".join(wrong.assessment.notes)


def test_a_zero_error_of_the_accelerometer_is_found() -> None:
    arm = ArmModel.from_urdf(urdf(AXES["crossed"]), tip="tip")
    q, truth, up = felt(arm, np.random.default_rng(4), 60, sigma=1e-4)
    bias = dict(zip(up, (0.02, -0.03, 0.01), strict=True))
    shifted = {name: 9.81 * (value + bias[name]) for name, value in up.items()}
    term = Gravity.from_arrays(arm, q, sensor=SensorMount(np.eye(3)), bias=0.02, **shifted)
    result = calibrate(arm, [term], free=OFFSETS)
    for name, true in truth.items():
        assert result.estimates[name].value == pytest.approx(true, abs=math.radians(0.02))
    found = [result.solution.values[f"sensor.b{axis}"] for axis in "xyz"]
    # One direction is compared, not its length: the zero errors are told by how it turns.
    np.testing.assert_allclose(found, list(bias.values()), atol=2e-3)


def a_term(up: dict[str, np.ndarray], q: np.ndarray, **more: object) -> Gravity:
    return Gravity.from_arrays(ArmModel.from_urdf(urdf(AXES["crossed"]), "tip"), q, **up, **more)


@pytest.fixture
def phone() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    arm = ArmModel.from_urdf(urdf(AXES["crossed"]), tip="tip")
    q, _, up = felt(arm, np.random.default_rng(5), 20)
    return q, up


def scaled(up: dict[str, np.ndarray], rows: list[int], by: float) -> dict[str, np.ndarray]:
    factor = np.ones(len(up["ax"]))
    factor[rows] = by
    return {name: value * factor for name, value in up.items()}


@pytest.mark.parametrize(
    ("rows", "by", "words"),
    [
        ([*range(12, 20)], 9.81, "are g and m/s² mixed"),
        ([3], 0.0, "an acceleration of 0 "),
        ([*range(20)], 0.0, "accelerations of zero"),
    ],
)
def test_what_is_no_gravity_is_refused(
    rows: list[int], by: float, words: str, phone: tuple[np.ndarray, dict[str, np.ndarray]]
) -> None:
    q, up = phone
    with pytest.raises(SamplesError, match=words):
        a_term(scaled(up, rows, by), q).check_enough()


def test_too_few_and_alike_postures_are_refused(
    phone: tuple[np.ndarray, dict[str, np.ndarray]],
) -> None:
    q, up = phone
    with pytest.raises(SamplesError, match="2 rows; expected at least 3"):
        a_term(up, q).take([0, 1]).check_enough()
    with pytest.raises(SamplesError, match="postures that turn the sensor"):
        a_term(up, q).take([0] * 6).check_enough()
    with pytest.raises(SamplesError, match="only ax, ay; expected columns ax, ay, az, or"):
        a_term({"ax": up["ax"], "ay": up["ay"]}, q)


def test_an_arm_that_moved_is_said(phone: tuple[np.ndarray, dict[str, np.ndarray]]) -> None:
    q, up = phone
    assert not a_term(up, q).doubts
    ((said, level),) = a_term(scaled(up, [4, 9], 1.2), q).doubts.items()
    assert level == "care"
    assert said.startswith("2 of 20 rows (row 4 is the first) felt other than gravity: 1.2 times")


def test_left_handed_axes_do_no_harm_and_are_said(
    phone: tuple[np.ndarray, dict[str, np.ndarray]],
) -> None:
    """The unknown mount and an arm that hangs take them up; with a known mount they are named."""
    q, up = phone
    mirrored = {**up, "ay": -up["ay"]}
    right, left = a_term(up, q), a_term(mirrored, q)
    assert not right.notes
    (note,) = left.notes
    assert "hangs from its base" in note
    values = []
    for term in (right, left):
        assert isinstance(term.poses, ArmPoses)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SutaCalibWarning)
            result = calibrate(term.poses.arm, [term], free=OFFSETS)
        values.append(result.estimates["j3.offset"].value)
    assert values[0] == pytest.approx(values[1], abs=1e-9)
    known = a_term(mirrored, q, sensor=SensorMount(np.eye(3)), angular_noise=Noise(PHONE))
    result = calibrate(known.poses.arm, [known], free=OFFSETS)
    assert not result.assessment.usable or result.assessment.level == "care"
    assert "left-handed" in " ".join(result.assessment.notes)


def test_a_given_base_takes_its_uncertainty_to_the_zeros() -> None:
    """Up known to 1° only: j2, whose axis is level whatever j1 reads, cannot be better told."""
    arm = ArmModel.from_urdf(urdf("yxyxy"), tip="tip")
    q, _, up = felt(arm, np.random.default_rng(6), 40)
    rough = replace(STANDS, std=math.radians(1.0))
    poses = Gravity.from_arrays(arm, q, **up).poses
    assert isinstance(poses, ArmPoses)
    stds = []
    for given in (STANDS, rough):
        term = Gravity(poses, up=given, sensor=SensorMount(np.eye(3)))
        result = calibrate(arm, [term], free=OFFSETS)
        stds.append(math.degrees(result.estimates["j1.offset"].std or 0.0))
    assert stds[0] < 0.2
    assert 0.8 < stds[1] < 1.2
