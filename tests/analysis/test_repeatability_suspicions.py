"""Rows that are no visits as they stand: copies, misread columns, a joint that stood still."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, readings_for
from studies import first_of, of_size
from visits import DOWN, POINT, visits

from suta_calib.analysis.repeatability import Repeatability, repeatability
from suta_calib.analysis.repeatability.suspicions import first_written
from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel


def visited_by(arm: ArmModel, q: FloatArray, **labels: list[str]) -> Repeatability:
    return repeatability(arm, Samples.from_arrays(arm.joints, q, labels=labels))


run = partial(visited_by, arm_named("suta"))


@cache
def sound_visits(n: int, seed: int) -> Repeatability:
    return run(visits(n, 3e-4, seed, tilt=5e-3).q)


@pytest.mark.parametrize("jitter", [0.0, 1e-7, 5e-7])
@pytest.mark.parametrize("seed", first_of(range(4)))
@pytest.mark.parametrize(("n", "times"), [(15, 2), (10, 3), (30, 2), (120, 2)])
def test_visits_that_are_appended_again_count_once(
    n: int, times: int, seed: int, jitter: float
) -> None:
    sound = visits(n, 3e-4, seed, tilt=5e-3)
    random = np.random.default_rng(seed)
    again = [sound.q + jitter * random.standard_normal(sound.q.shape) for _ in range(times - 1)]
    found, once = run(np.vstack([sound.q, *again])), sound_visits(n, seed)
    assert found.position.count == n
    assert found.copies == n * (times - 1)
    assert found.position.rms.interval() == once.position.rms.interval()
    assert found.assessment.level == "care"
    says = f"{n * (times - 1)} of {n * times} rows have the readings of another row"
    assert any(says in note for note in found.assessment.notes)
    assert once.copies == 0


def test_a_copy_across_the_turn_and_among_others_is_found() -> None:
    q = visits(40, 3e-4, tilt=5e-3).q
    rows = [0, 1, 2, 3, 3, *range(4, 40), 7]
    again = q[rows]
    again[-1, 4] += 2 * np.pi
    found = run(again)
    assert found.copies == 2
    assert found.position.count == 40


def test_a_copy_under_another_label_is_no_visit_either() -> None:
    q = visits(30, 3e-4, tilt=5e-3).q
    with pytest.raises(SamplesError, match=r"2 visits with protocol 'b' \(20 rows"):
        run(np.vstack([q, q[:20], q[:2] + 1e-3]), protocol=["a"] * 30 + ["b"] * 22)


def test_rows_that_are_all_one_visit_are_refused() -> None:
    with pytest.raises(SamplesError, match=r"1 visits \(29 rows are copies of others"):
        run(np.repeat(visits(1, 0.0).q, 30, axis=0))


@pytest.mark.parametrize("seeds", of_size(6, 20))
@pytest.mark.parametrize("bits", [12, 14, 17, 22])
def test_encoders_are_given_no_copies(bits: int, seeds: int) -> None:
    """Where all are coarse, an arm reads the same when it comes back."""
    step = 2 * np.pi / 2**bits
    readings = [step * np.round(visits(60, 1e-4, seed).q / step) for seed in range(seeds)]
    assert all(first_written(q, ["rad"] * 6).all() for q in readings)
    assert run(readings[0]).copies == 0


@pytest.mark.parametrize("seeds", of_size(12, 40))
def test_an_exact_robot_in_several_postures_is_given_no_copies(seeds: int) -> None:
    for n in (8, 15, 30, 120):
        for seed in range(seeds):
            random = np.random.default_rng(seed)
            posture = np.repeat(random.uniform(-2.0, 2.0, (5, 6)), -(-n // 5), axis=0)[:n]
            q = posture + 1e-5 * random.standard_normal((n, 6))
            step = 2 * np.pi / 2**22
            for readings in (q, step * np.round(q / step)):
                assert first_written(readings, ["rad"] * 6).all()


def test_what_is_left_is_told_by_its_own_rows() -> None:
    sound = visits(40, 3e-4, tilt=5e-3)
    found = repeatability(arm_named("suta"), sound.take([*range(20), *range(20), *range(20, 40)]))
    assert found.samples.origin == sound.origin


Change = Callable[[FloatArray], FloatArray]


@pytest.fixture(scope="module")
def visited(repository: Path, suta: ArmModel) -> Samples:
    """One point, touched from many sides."""
    file = repository / "data" / "accuracy" / "visits.csv"
    q = np.loadtxt(file, delimiter=",", skiprows=1, usecols=range(6))
    return Samples.from_arrays(suta.joints, q)


@pytest.fixture(scope="module")
def suta(suta_urdf: Path) -> ArmModel:
    return ArmModel.from_urdf(suta_urdf, "tip")


def one_row_late(q: FloatArray) -> FloatArray:
    return np.column_stack([q[:, :2], np.roll(q[:, 2], 1), q[:, 3:]])


def in_unit(column: int, unit: float, q: FloatArray) -> FloatArray:
    return q * np.where(np.arange(q.shape[1]) == column, unit, 1.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda q: q * [1, 1, -1, 1, 1, 1], "joint_3 counts the other way"),
        (lambda q: q[:, [0, 2, 1, 3, 4, 5]], "the columns of joint_2 and joint_3 are exchanged"),
        (lambda q: q[:, ::-1], "the joints' columns are in the opposite order"),
        (one_row_late, "the readings of joint_3 are one row late"),
        *(
            (partial(in_unit, k, unit), f"the readings of joint_{k + 1} are in {name}, not rad")
            for k in range(6)
            for name, unit in (("degrees", math.degrees(1.0)), ("turns", 0.5 / math.pi))
            # In turns it does to the tip too little to be told from it.
            if (k, name) != (4, "turns")
        ),
    ],
)
def test_a_column_that_was_misread_is_named(
    visited: Samples, suta: ArmModel, change: Change, says: str
) -> None:
    found = repeatability(suta, replace(visited, q=change(visited.q)))
    assert found.misread is not None
    assert says in found.misread
    assert found.assessment.level == "bad"
    assert found.assessment.notes[0] == found.misread


def test_visits_that_are_read_rightly_are_left_alone(visited: Samples, suta: ArmModel) -> None:
    assert repeatability(suta, visited).misread is None


@pytest.mark.parametrize("name", ["suta", "ur5"])
@pytest.mark.parametrize("noise", [1e-5, 1e-3, 3e-2])
def test_an_arm_that_comes_back_in_one_posture_has_no_other_reading(
    name: str, noise: float
) -> None:
    """There only noise moves the joints, and in some postures it moves the tip far less."""
    arm = arm_named(name)
    for seed in range(5):
        random = np.random.default_rng(seed)
        posture = random.uniform(-2.0, 2.0, len(arm.joints))
        q = posture + noise * random.standard_normal((10 + 10 * seed, len(posture)))
        assert visited_by(arm, q).misread is None


def test_a_prismatic_joint_in_mm_is_named(tmp_path: Path, suta_urdf: Path) -> None:
    """The base slides: the last joint of a column in mm moves the tip by metres."""
    slide = (
        '<link name="rail"/><joint name="slide" type="prismatic"><parent link="rail"/>'
        '<child link="base_link"/><axis xyz="0 1 0"/>'
        '<limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>'
    )
    root = ArmModel.from_urdf(suta_urdf, "tip").chain.base
    text = suta_urdf.read_text().replace("</robot>", f"{slide.replace('base_link', root)}</robot>")
    (tmp_path / "rail.urdf").write_text(text)
    arm = ArmModel.from_urdf(tmp_path / "rail.urdf", "tip")
    assert arm.joints[0] == "slide"
    random = np.random.default_rng(0)
    moved = random.uniform(-0.05, 0.05, 30)
    position = POINT + 3e-4 * random.standard_normal((30, 3)) - moved[:, None] * [0, 1, 0]
    turn = rotation_from_vector(0.02 * random.standard_normal((30, 3)))
    first = visits(1, 0.0).q.repeat(30, axis=0)
    q = readings_for(arm_named("suta"), {}, position, turn @ DOWN, first)
    readings = Samples.from_arrays(arm.joints, np.column_stack([moved, q]))
    assert repeatability(arm, readings).assessment.level == "good"
    found = repeatability(arm, replace(readings, q=readings.q * [1e3, 1, 1, 1, 1, 1, 1]))
    assert found.misread is not None
    assert "the readings of slide are in mm, not m" in found.misread


TILT = np.radians(1.0)


@pytest.mark.parametrize(("joint", "n"), [*((joint, 30) for joint in range(5)), (2, 120)])
@pytest.mark.parametrize("seed", first_of(range(2)))
def test_an_encoder_that_hangs_is_named(joint: int, n: int, seed: int) -> None:
    arm, q = arm_named("suta"), visits(n, 3e-4, seed, tilt=TILT).q.copy()
    sound = visited_by(arm, q)
    q[:, joint] = q[0, joint] + 1e-6 * np.random.default_rng(seed).integers(-1, 2, n)
    found = visited_by(arm, q)
    (named,) = found.stuck
    assert named.joint == arm.joints[joint]
    # What scatters along the joint's own way is lost with it.
    truth = sound.position.rms.value
    assert 0.6 * truth < named.without < 1.05 * truth
    assert named.scatter == pytest.approx(found.position.rms.value)
    assert found.assessment.level == "care"
    assert any(note.startswith(f"{named.joint} reads ") for note in found.assessment.notes)


def test_what_is_not_named_does_no_harm() -> None:
    """In this posture the last joint hardly moves the tip; and where the arm hardly turns, none."""
    arm = arm_named("suta")
    for seed in range(4):
        for joint, tilt in ((5, TILT), *((k, np.radians(0.2)) for k in range(6))):
            q = visits(30, 3e-4, seed, tilt=tilt).q.copy()
            truth = visited_by(arm, q).position.rms.value
            q[:, joint] = q[0, joint]
            found = visited_by(arm, q)
            assert found.stuck or found.position.rms.value < 1.4 * truth


@pytest.mark.parametrize("seed", first_of(range(2)))
def test_an_encoder_that_knows_few_places_is_named(seed: int) -> None:
    arm, q = arm_named("suta"), visits(30, 3e-4, seed, tilt=TILT).q.copy()
    q[:, 3] = 0.02 * np.round(q[:, 3] / 0.02)
    (named,) = visited_by(arm, q).stuck
    assert named.joint == "joint_4"
    assert f"only {named.readings} values" in named.sentence


def locked(arm: ArmModel, joint: int, n: int, seed: int, by: float, size: FloatArray) -> FloatArray:
    """Readings of visits that scatter by ``size`` along each axis, with one joint that is still."""
    random, step = np.random.default_rng(seed), 1e-6
    posture = {
        "suta": [0.28, 2.45, 2.74, 2.15, 1.63, 2.64],
        "ur5": [0.3, -1.2, 1.4, -1.6, -1.4, 0.5],
    }
    q = np.tile(posture["ur5" if "elbow_joint" in arm.joints else "suta"], (n, 1))
    target = arm.forward(q)[1] + size * random.standard_normal((n, 3))
    free = [k for k in range(6) if k != joint]
    q[:, free] += by * random.standard_normal((n, 5))
    for _ in range(20):
        here = arm.forward(q)[1]
        off = target - here
        if np.abs(off).max() < 1e-9:
            break
        columns = [(arm.forward(q + step * np.eye(6)[k])[1] - here) / step for k in free]
        for row, jacobian in enumerate(np.stack(columns, axis=2)):
            q[row, free] += np.linalg.lstsq(jacobian, off[row], rcond=None)[0]
    assert np.abs(off).max() < 1e-8
    return q


@pytest.mark.parametrize("name", ["suta", "ur5"])
@pytest.mark.parametrize("n", [8, 15, 30, 120])
@pytest.mark.parametrize("seeds", of_size(4, 12))
def test_a_joint_that_was_locked_is_left_alone(name: str, n: int, seeds: int) -> None:
    arm = arm_named(name)
    for seed in range(seeds if n < 100 else min(seeds, 4)):
        for by, size in ((0.01, np.full(3, 3e-4)), (0.1, np.array([3e-4, 6e-5, 3e-5]))):
            assert not visited_by(arm, locked(arm, seed % 5, n, seed, by, size)).stuck
