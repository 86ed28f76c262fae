from __future__ import annotations

import math
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from emulated import TRUTH, landmark_stops, true_landmarks, write_artefact

from suta_calib.emulation import (
    Motion,
    Still,
    Stops,
    artefact_set,
    pivoting,
    point_set,
    posture_of,
    recorded,
    stops,
    sweep,
)
from suta_calib.emulation.motion import continuous
from suta_calib.emulation.script import parse_pose
from suta_calib.emulation.trajectories import parse_posture
from suta_calib.errors import InputError, JobError, SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import NoiseLevels, PoseSpec, read_simulation, simulate

ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
PANDA = ROBOTS / "panda_description/urdf/panda.urdf"
POSTURE = np.deg2rad([15, 175, 160, 110, -90, -125])
POINT = np.array([0.4625, 0.0125, 0.15])


# ── Rests and motions between them ───────────────────────────────────────────────────────────
def test_every_rest_is_on_its_landmark_with_the_true_arm(arm: ArmModel, tmp_path: Path) -> None:
    motion = landmark_stops(arm, tmp_path, rest=2.0, move=1.0)
    assert [tuple(each.values()) for each in motion.labels] == [
        (placement, "1", mark) for placement in ("P1", "P2") for mark in "ABC"
    ]
    assert motion.rounds == (2, 5)
    resting = np.concatenate([[motion.arrival(k) + s for s in (0.01, 1.0, 1.99)] for k in range(6)])
    labels = [dict(motion.labels[k]) for k in range(6) for _ in range(3)]
    _, tip = arm.forward(motion.readings(resting), TRUTH)
    np.testing.assert_allclose(tip, true_landmarks(tmp_path, labels), atol=1e-9)
    _, believed = arm.forward(motion.readings(resting))
    assert np.linalg.norm(believed - tip, axis=1).min() > 1e-3


def test_the_arm_moves_smoothly_and_only_between_rests(arm: ArmModel, tmp_path: Path) -> None:
    motion = landmark_stops(arm, tmp_path, rest=1.0, move=0.5)
    time = np.arange(-0.5, motion.end + 1.0, 1e-3)
    q = motion.readings(time)
    speed = np.abs(np.diff(q, axis=0)).max(axis=1) / 1e-3
    moving = speed > 1e-12
    resting = ~np.isnan(motion.resting_on(time))
    assert not moving[resting[1:] & resting[:-1]].any()
    assert np.count_nonzero(np.diff(moving.astype(int)) == 1) == 5
    # Minimum jerk: the highest speed is 15/8 of the mean, the acceleration never jumps.
    way = np.abs(np.diff(motion.posture, axis=0)).max(axis=1)
    assert speed.max() == pytest.approx(15 / 8 * way.max() / 0.5, rel=1e-4)
    jerk = np.abs(np.diff(q, n=3, axis=0)).max() / 1e-9
    assert jerk < 1.1 * 60 * way.max() / 0.5**3


P1 = {"P1": parse_pose("P1=437.5,12.5,0,0,0,-105")[1]}


def test_landmarks_are_gone_through_in_the_order_asked_for(arm: ArmModel, tmp_path: Path) -> None:
    plan = artefact_set(write_artefact(tmp_path), P1, 2, NoiseLevels())
    motion = stops(arm, TRUTH, plan, sequence=("C", "A"))
    assert [(e["repeat"], e["landmark"]) for e in motion.labels] == [
        *(("1", "C"), ("1", "A"), ("2", "C"), ("2", "A"))
    ]
    assert motion.rounds == (1, 3)
    with pytest.raises(InputError, match=r"no landmark 'D'.*A, B, C"):
        stops(arm, TRUTH, plan, sequence=("A", "D"))


def test_seating_scatters_as_much_as_it_is_said_to(arm: ArmModel, tmp_path: Path) -> None:
    plan = artefact_set(write_artefact(tmp_path), P1, 30, NoiseLevels(seating=2e-4))
    one, other = (stops(arm, TRUTH, plan, seed=seed) for seed in (1, 2))
    _, tip = arm.forward(one.posture, TRUTH)
    scatter = (tip.reshape(30, 3, 3) - tip.reshape(30, 3, 3).mean(axis=0)).std(ddof=1)
    assert scatter == pytest.approx(2e-4, rel=0.15)
    assert not np.allclose(one.posture, other.posture)
    np.testing.assert_array_equal(one.posture, stops(arm, TRUTH, plan, seed=1).posture)


def test_a_simulations_set_rests_where_its_samples_were_taken(repository: Path) -> None:
    spec = read_simulation(repository / "data/suta/simulation.yaml")
    made = simulate(spec)
    motion = stops(made.arm, made.values, spec.sets[0], seed=spec.seed, posture=spec.posture)
    samples = np.concatenate([f.samples.q for f in made.files if f.path.startswith("calibration/")])
    away = np.abs((motion.posture - samples + np.pi) % (2 * np.pi) - np.pi)
    assert 1e-6 < away.max() < 1.5e-4, "the samples have the encoders' noise, the motion has not"
    assert len(motion.rounds) == 15


def test_fixed_points_are_touched_from_many_directions(arm: ArmModel) -> None:
    plan = point_set({"F1": PoseSpec(np.eye(3), POINT)}, 6, math.radians(40), NoiseLevels())
    motion = stops(arm, TRUTH, plan)
    rotation, tip = arm.forward(motion.posture, TRUTH)
    np.testing.assert_allclose(tip, np.tile(POINT, (6, 1)), atol=1e-9)
    assert {tuple(each.items()) for each in motion.labels} == {(("point", "F1"),)}
    assert np.ptp(rotation[:, :, 2], axis=0).max() > 0.2


def test_a_place_out_of_reach_is_named(arm: ArmModel, tmp_path: Path) -> None:
    far = {"P9": parse_pose("P9=5000,0,0")[1]}
    with pytest.raises(JobError, match=r"landmark 'A' of placement 'P9' out of the arm's reach"):
        stops(arm, TRUTH, artefact_set(write_artefact(tmp_path), far), path=Path("job.yaml"))


def test_joints_that_turn_fully_go_the_shorter_way() -> None:
    posture = np.array([[3.0, 3.0], [-3.0, -3.0], [2.5, 2.5]])
    found = continuous(posture, np.array([True, False]))
    np.testing.assert_allclose(found[:, 0], [3.0, 2 * np.pi - 3.0, 2.5])
    np.testing.assert_array_equal(found[:, 1], posture[:, 1])


@pytest.mark.parametrize(
    "text", ["P1", "=1,2,3", "P1=1,2", "P1=1,2,x", "P1=1,2,3,4,5", "P1=1,2,nan"]
)
def test_a_placement_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="LABEL=x,y,z"):
        parse_pose(text, "--placement")


def test_a_placement_is_in_mm_and_degrees() -> None:
    label, pose = parse_pose(" P1 = 100, -20 ,3, 0, 0, 90")
    assert label == "P1"
    np.testing.assert_allclose(pose.position, [0.1, -0.02, 0.003])
    np.testing.assert_allclose(pose.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


# ── Pivoting ─────────────────────────────────────────────────────────────────────────────────
def test_a_pivoting_tip_stays_on_its_point(arm: ArmModel) -> None:
    motion = pivoting(arm, TRUTH, POINT, posture=POSTURE, cone=math.radians(25), period=10.0)
    time = np.linspace(0, 10, 3001)
    q = motion.readings(time)
    rotation, tip = arm.forward(q, TRUTH)
    np.testing.assert_allclose(tip, np.tile(POINT, (len(time), 1)), atol=1e-6)
    tilt = np.degrees(np.arccos(np.clip((rotation[0].T @ rotation)[:, 2, 2], -1, 1)))
    assert 20 < tilt.max() < 25.1
    assert np.abs(np.diff(q, axis=0)).max() < 0.05, "no jump from one branch to another"
    np.testing.assert_allclose(q[-1], q[0], atol=1e-9)
    _, nominal = arm.forward(q)
    assert np.linalg.norm(nominal - nominal.mean(axis=0), axis=1).max() > 1e-3


def test_a_redundant_arm_can_pivot_too() -> None:
    if not PANDA.is_file():
        pytest.skip("example-robot-data is not installed")
    panda = ArmModel.from_urdf(PANDA, "panda_hand_tcp")
    start = posture_of(panda)
    motion = pivoting(panda, {}, posture=start, cone=math.radians(10), period=5.0)
    _, tip = panda.forward(motion.readings(np.linspace(0, 5, 400)))
    np.testing.assert_allclose(tip, np.tile(panda.forward(start)[1], (400, 1)), atol=1e-6)


def test_a_point_that_cannot_be_pivoted_on_is_told(arm: ArmModel) -> None:
    with pytest.raises(JobError, match=r"out of the arm's reach.*closest.*smaller"):
        pivoting(arm, TRUTH, np.array([3.0, 0.0, 0.0]), posture=POSTURE)


# ── Trajectories ─────────────────────────────────────────────────────────────────────────────
def test_every_joint_swings_reverses_and_comes_back(arm: ArmModel) -> None:
    motion = sweep(arm, POSTURE, amplitude=0.3, slowest=0.1, fastest=1.0, duration=20.0)
    time = np.linspace(0, 20, 20001)
    q = motion.readings(time)
    np.testing.assert_allclose(q[[0, -1]], [POSTURE, POSTURE], atol=1e-12)
    assert np.abs(q - POSTURE).max(axis=0) == pytest.approx(0.3, rel=0.01)
    velocity = np.diff(q, axis=0)
    reversals = [np.flatnonzero(np.diff(np.sign(v)) != 0) for v in velocity.T]
    assert all(len(each) >= 18 for each in reversals)
    together = np.intersect1d(reversals[0] // 50, reversals[1] // 50)
    assert len(together) < len(reversals[0]) / 3


def test_swings_keep_to_the_joints_limits(tmp_path: Path) -> None:
    limited = tmp_path / "arm.urdf"
    limited.write_text(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute">'
        '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="-0.1" upper="0.4" effort="1" velocity="1"/></joint></robot>'
    )
    arm = ArmModel.from_urdf(limited, "b")
    q = sweep(arm, np.array([0.0]), amplitude=1.0).readings(np.linspace(0, 60, 5000))
    assert -0.1 <= q.min() < -0.09
    assert q.max() < 0.11


def test_a_trajectory_from_a_file_goes_through_its_rows(arm: ArmModel, tmp_path: Path) -> None:
    rows = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.4, (12, 6)), axis=0)
    time = 5 + np.cumsum(np.full(12, 0.25))
    file = tmp_path / "path.csv"
    lines = [",".join(map(str, [t, *row])) for t, row in zip(time, rows, strict=True)]
    file.write_text(f"time,{','.join(arm.joints)}\n" + "\n".join(lines) + "\n")
    motion = recorded(file, arm)
    np.testing.assert_allclose(motion.readings(time - time[0]), rows, atol=1e-12)
    np.testing.assert_allclose(motion.readings(np.array([-1.0, 99.0])), rows[[0, -1]], atol=1e-12)
    assert motion.end == pytest.approx(2.75)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,joint_1\n0,1\n1,2\n", "column 'joint_2'"),
        ("joint_1\n0\n", "column 'time'"),
        ("time,JOINTS\n0,1,1,1,1,1,1\n0,1,1,1,1,1,1\n", "path.csv:3.*found 0.*more than 0"),
        ("time,JOINTS\n0,1,1,1,1,1,1\n", "two or more"),
        ("time,JOINTS\n0,1,1,1,1,1,x\n1,1,1,1,1,1,1\n", "path.csv:2.*finite number"),
    ],
)
def test_a_trajectory_that_cannot_be_followed_is_refused(
    arm: ArmModel, tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text.replace("JOINTS", ",".join(arm.joints)))
    with pytest.raises(SamplesError, match=message):
        recorded(file, arm)


def test_postures_are_given_by_name_or_in_full(arm: ArmModel) -> None:
    assert parse_posture(arm, "joint_2=90, joint_6=-45") == pytest.approx(
        {"joint_2": math.pi / 2, "joint_6": -math.pi / 4}
    )
    assert parse_posture(arm, "1,2,3,4,5,6") == pytest.approx(
        {f"joint_{k}": math.radians(k) for k in range(1, 7)}
    )
    assert parse_posture(arm, "") == {}
    for wrong in ("1,2", "joint_1=x", "joint_1"):
        with pytest.raises(InputError, match="JOINT=DEGREES"):
            parse_posture(arm, wrong)
    with pytest.raises(InputError, match=r"no joint 'joint_7'.*joint_6"):
        posture_of(arm, {"joint_7": 0.0})
    with pytest.raises(InputError, match="joint_1"):
        posture_of(arm, {"joint_1": 4.0})


@pytest.mark.parametrize("still", [Still(np.array([0.5])), Stops(np.array([[0.5]]), ({},))])
def test_what_stands_still_stands_still(still: Motion) -> None:
    np.testing.assert_array_equal(still.readings(np.array([-1.0, 1e6])), [[0.5], [0.5]])


def test_without_a_posture_one_is_found_that_can_be_tilted(arm: ArmModel) -> None:
    """In the middle of its joints' ranges this arm is stretched, and cannot tilt its tool."""
    motion = pivoting(arm, TRUTH, cone=math.radians(20), period=10.0)
    _, tips = arm.forward(motion.readings(np.linspace(0.0, 10.0, 40)), TRUTH)
    assert np.ptp(tips, axis=0).max() < 1e-5
