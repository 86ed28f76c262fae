"""Visits whose columns were misread: named where then the joints undo each other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, readings_for
from visits import DOWN, POINT, visits

from suta_calib.analysis.repeatability import repeatability
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel

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
        (lambda q: q[:, ::-1], "the joints' columns stand in the opposite order"),
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
        assert repeatability(arm, Samples.from_arrays(arm.joints, q)).misread is None


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
