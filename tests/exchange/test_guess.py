"""What ``import --guess`` takes: the right reading, one that it calls a guess, or none."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from foreign import imported, written
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.model import ArmModel

FORMS = ("vector", "xyz", "zyx", "ZYX", "XYZ", "xyzw", "wxyz")
NAMES = {
    "": "",
    "rx": "x,y,z,rx,ry,rz",
    "roll": "x,y,z,roll,pitch,yaw",
    "abc": "x,y,z,a,b,c",
    "q": "x,y,z,q0,q1,q2,q3",
}


def motion(arm: ArmModel, seed: int, smooth: bool) -> tuple[FloatArray, FloatArray]:
    """Rotations (60, 3, 3) and positions (60, 3), m, of an arm's tip: a recording, or postures."""
    rng = np.random.default_rng(seed)
    count = len(arm.joints)
    if smooth:
        t = np.linspace(0, 4, 60)[:, None]
        q = rng.uniform(-1, 1, count) + rng.uniform(0.2, 1.2, count) * np.sin(
            rng.uniform(0.5, 1.5, count) * t + rng.uniform(0, 6, count)
        )
    else:
        q = rng.uniform(-1.5, 1.5, (60, count))
    return arm.forward(q)


def layout(
    path: Path,
    R: FloatArray,
    p: FloatArray,
    form: str,
    length: str,
    angle: str,
    first: str,
    names: str,
) -> Path:
    """The poses as another program would write them."""
    turn = Rotation.from_matrix(R)
    if form in ("xyzw", "wxyz"):
        numbers = np.roll(turn.as_quat(), form == "wxyz", axis=1)
    elif form == "vector":
        numbers = turn.as_rotvec()
    else:
        numbers = turn.as_euler(form)
    if angle == "deg":
        numbers = np.rad2deg(numbers)
    parts = [p * (1e3 if length == "mm" else 1.0), numbers]
    rows = np.hstack(parts if first == "position" else parts[::-1])
    return written(path, rows, header=NAMES[names])


def outcome(path: Path, R: FloatArray, p: FloatArray) -> str:
    """``asks``, ``right``, ``said`` (wrong, and called a guess), or ``wrong``."""
    try:
        found = imported(path, guess=True)
    except InputError:
        return "asks"
    position = np.stack([found.columns[axis] for axis in "xyz"], axis=1)
    quaternion = np.stack([found.columns[name] for name in ("qx", "qy", "qz", "qw")], axis=1)
    error = np.abs(rotation_from_quaternion(quaternion) - R).max()
    if np.allclose(position, p, atol=1e-6) and error < 1e-6:
        return "right"
    told = any(note.startswith("Guessed: ") for note in found.notes)
    return "said" if told and found.assessment.level == "care" else "wrong"


def outcomes(arm: ArmModel, seeds: range, folder: Path) -> dict[str, list[str]]:
    """Layouts by what comes of them."""
    found: dict[str, list[str]] = {}
    for seed, smooth in itertools.product(seeds, (True, False)):
        R, p = motion(arm, seed, smooth)
        for form, length, first, angle in itertools.product(
            FORMS, ("m", "mm"), ("position", "rotation"), ("rad", "deg")
        ):
            quaternion = form in ("xyzw", "wxyz")
            if quaternion and angle == "deg":
                continue
            headers = [""] if first == "rotation" else ["", "q" if quaternion else "rx"]
            headers += {"xyz": ["roll"], "ZYX": ["abc"]}.get(form, []) * (first == "position")
            for names in headers:
                path = folder / "t.csv"
                layout(path, R, p, form, length, angle, first, names)
                how = f"{form} {length} {angle} {first} {names} {seed} {smooth}"
                found.setdefault(outcome(path, R, p), []).append(how)
    return found


@pytest.mark.parametrize("seeds", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_no_layout_is_misread_in_silence(seeds: int, suta_urdf: Path, tmp_path: Path) -> None:
    """Of all the layouts of an arm's poses none is wrong and called good."""
    arm = ArmModel.from_urdf(suta_urdf, tip="tip")
    found = outcomes(arm, range(seeds), tmp_path)
    assert not found.get("wrong")
    # Right are roll, pitch, yaw and KUKA's angles: other orders than the usual one cannot be seen.
    assert len(found["right"]) > 0.2 * sum(map(len, found.values()))


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_a_scalar_that_is_never_negative_says_the_order(order: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    turn = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, (20, 3)))
    position = rng.uniform(0.2, 0.8, (20, 3))
    numbers = np.roll(turn.as_quat(canonical=True), order == "wxyz", axis=1)
    path = written(tmp_path / "t.csv", np.hstack([position, numbers]))
    assert outcome(path, turn.as_matrix(), position) == "right"
    written(path, np.hstack([position, np.where(np.arange(20)[:, None] % 2, 1, -1) * numbers]))
    with pytest.raises(InputError, match=r"give --rotation xyzw\|wxyz$"):
        imported(path, guess=True)


def test_a_rotation_vector_in_front_of_millimetres(tmp_path: Path) -> None:
    """They were read as metres and degrees, with angles to 1065 degrees, and called good."""
    rng = np.random.default_rng(0)
    rows = np.hstack([rng.uniform(-1.5, 1.5, (30, 3)), rng.uniform(-1000, 1065, (30, 3))])
    path = written(tmp_path / "t.csv", rows)
    said = r"plausible interpretations: Euler angles in rad and a position in mm; a rotation vector"
    with pytest.raises(InputError, match=said):
        imported(path, guess=True)
    found = imported(path, guess=True, rotation="vector")
    np.testing.assert_allclose(found.columns["x"], rows[:, 3] / 1e3)
    assert [note.partition(".")[0] for note in found.notes] == [
        "Guessed: --first rotation",
        "Guessed: --unit mm,rad",
    ]


def test_rotations_that_jump_between_neighbours_are_of_another_form(tmp_path: Path) -> None:
    """A motion through half a turn: a rotation vector changes its sign, and is near in no other."""
    angle = np.linspace(2.5, 3.8, 40)
    axis = np.array([0.48, 0.64, 0.6])
    turn = Rotation.from_rotvec(angle[:, None] * axis)
    position = np.array([900.0, 100.0, 1200.0]) + 50 * np.sin(angle)[:, None]
    path = written(tmp_path / "t.csv", np.hstack([position, turn.as_rotvec()]))
    assert outcome(path, turn.as_matrix(), position / 1e3) == "right"


@pytest.mark.parametrize(
    ("header", "scale", "says"),
    [
        ("joint_1,joint_2", 2000.0, "look like degrees"),
        (
            "x,y,z",
            30.0,
            "positions about .* away, in m or mm; expected numbers that allow only one unit",
        ),
        ("x,y,z,roll,pitch,yaw", 900.0, "no angles of a usual form"),
    ],
)
def test_numbers_that_allow_no_guess(header: str, scale: float, says: str, tmp_path: Path) -> None:
    rows = scale * np.random.default_rng(0).uniform(0.5, 1, (10, header.count(",") + 1))
    path = written(tmp_path / "t.csv", rows, header=header)
    with pytest.raises(InputError, match=says):
        imported(path, guess=True)
