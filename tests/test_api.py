"""One call from Python: arms and observations without files, and one judged answer."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulated import arm_named
from terms_cases import AVAILABLE, problem_of

from suta_calib import ArmModel, InputError
from suta_calib.errors import UrdfError
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.terms import (
    KINDS,
    ArmPoses,
    CameraView,
    FixedPoint,
    HandEye,
    MeasuredRange,
    PairwiseDistance,
    Term,
    TouchedPlane,
    TrackedPoint,
)
from suta_calib.terms.from_arrays import attributes_of


def test_an_arm_is_read_from_the_text_of_a_urdf(suta_urdf: Path, tmp_path: Path) -> None:
    text = suta_urdf.read_text(encoding="utf-8")
    from_file = ArmModel.from_urdf(suta_urdf, "tip")
    q = np.full((1, len(from_file.joints)), 0.3)
    for given in (text, f"\ufeff{text}", f"\n  {text}"):
        arm = ArmModel.from_urdf(given, tip="tip")
        np.testing.assert_array_equal(arm.forward(q)[1], from_file.forward(q)[1])
        arm.write_urdf(tmp_path / "arm.urdf", {"joint_4.z": 0.58})
        from_file.write_urdf(tmp_path / "again.urdf", {"joint_4.z": 0.58})
        assert (tmp_path / "arm.urdf").read_bytes() == (tmp_path / "again.urdf").read_bytes()


def test_text_is_in_the_encoding_that_it_declares(suta_urdf: Path) -> None:
    text = suta_urdf.read_text(encoding="utf-8").replace('"tip"', '"Spitze_ä"')
    text = f'<?xml version="1.0" encoding="iso-8859-1"?>\n{text[text.index("<robot") :]}'
    assert "Spitze_ä".encode("latin-1") in ArmModel.from_urdf(text, "Spitze_ä").urdf[1]
    with pytest.raises(UrdfError, match="text of a URDF: found text that cannot be encoded"):
        ArmModel.from_urdf(text.replace("ä", "漢"), "Spitze_漢")


@pytest.mark.parametrize(
    ("given", "tip", "said"),
    [
        ("<robot", "tip", "the text of a URDF:1: found text that is not XML"),
        ("<robot name='a'></robot>", "tip", "the text of a URDF:1: found no <joint> in <robot>"),
        ("<sdf/>", "tip", "the text of a URDF:1: found the root element <sdf>"),
        ("no_such.urdf", "tip", "no_such.urdf: found no such file"),
        (b"<robot/>", "tip", "urdf: found bytes; expected the path or the text of a URDF"),
        (None, "tip", "urdf: found NoneType; expected the path or the text of a URDF"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_named(given: str, tip: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        ArmModel.from_urdf(given, tip)
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize("tip", ["tool", None, 7])
def test_a_tip_that_is_not_there_is_named(suta_urdf: Path, tip: str) -> None:
    with pytest.raises(UrdfError, match=r"the text of a URDF: tip: found '?(tool|None|7)"):
        ArmModel.from_urdf(suta_urdf.read_text(encoding="utf-8"), tip)


# ── observations from arrays ─────────────────────────────────────────────────────────────────
def arrays_of(term: Term) -> dict[str, Any]:
    """What a term was made of, as `from_arrays` takes it."""
    samples = term.poses.samples
    found = {
        "position": samples.position,
        "orientation": samples.rotation,
        "position_sigma": samples.position_sigma,
        "pixels": samples.pixels,
        "direction": samples.direction,
    }
    attributes = {name: getattr(term, name) for name in attributes_of(type(term))}
    known = {name: array for name, array in found.items() if array is not None}
    return {**attributes, **known, **samples.labels, **samples.numbers}


@pytest.mark.parametrize("name", AVAILABLE)
def test_every_kind_is_made_from_arrays(name: str) -> None:
    (term,) = problem_of(name).terms
    assert isinstance(term.poses, ArmPoses)
    again = type(term).from_arrays(term.poses.arm, term.poses.samples.q, **arrays_of(term))
    assert [p.name for p in again.own] == [p.name for p in term.own]
    for block, same in zip(term.blocks, again.blocks, strict=True):
        np.testing.assert_array_equal(block.samples, same.samples)
        np.testing.assert_allclose(block.data, same.data, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_help_shows_what_a_kind_takes(kind: type[Term]) -> None:
    constructor = kind.from_arrays
    taken = inspect.signature(constructor).parameters
    assert [*taken][:2] == ["arm", "q"]
    assert {*kind.columns.labels} <= {*taken}
    assert all(f"    {name}: " in str(constructor.__doc__) for name in kind.columns.labels)


ARM = arm_named("suta")
Q = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 6))
SEEN = ARM.forward(Q)[1]
WRONG: list[tuple[type[Term], dict[str, Any], str]] = [
    (TrackedPoint, {}, "tracked_point: found no position; expected position: (n, 3) in m"),
    (TrackedPoint, {"position": SEEN[:5]}, "position: found shape (5, 3); expected shape (12, 3)"),
    (TrackedPoint, {"position": SEEN * np.nan}, "position[0, 0]: found nan"),
    (TrackedPoint, {"position": SEEN * 1e9}, "coordinates of a grid? subtract an origin"),
    (TrackedPoint, {"position": "here"}, "position: found no array of numbers"),
    (TrackedPoint, {"position": SEEN + 1j}, "position: found no array of numbers"),
    (TrackedPoint, {"position": [[1, 2, 3], [4, 5]]}, "position: found no array of numbers"),
    (TrackedPoint, {"position": np.ma.masked_less(SEEN, 0.3)}, ": found nan; expected a finite"),
    (TrackedPoint, {"position": SEEN, "positon": SEEN}, "did you mean 'position'?"),
    (TrackedPoint, {"position": SEEN, "landmark": "A"}, "found the argument 'landmark'"),
    (TrackedPoint, {"position": SEEN, "target": ["A"] * 5}, "target: found 5 labels; expected 12"),
    (TrackedPoint, {"position": SEEN, "target": ["A"] * 11 + [None]}, "target[11]: found None"),
    (TrackedPoint, {"position": SEEN, "target": ["A"] * 11 + [""]}, "target[11]: found ''"),
    (TrackedPoint, {"position": SEEN, "orientation": np.ones((12, 4))}, "a quaternion of length 2"),
    (
        TrackedPoint,
        {"position": SEEN, "orientation": np.ones((12, 3))},
        "expected shape (12, 3, 3)",
    ),
    (TrackedPoint, {"position": SEEN, "position_sigma": -1e-4}, "a number greater than 0"),
    (TrackedPoint, {"position": SEEN, "noise": 1e-3}, "noise: found 0.001 (float); expected Noise"),
    (TrackedPoint, {"position": SEEN, "label": 3}, "label: found 3 (int); expected str"),
    (TrackedPoint, {"position": SEEN, "direction": Q}, "expected -1, 0 or 1"),
    (TrackedPoint, {"position": SEEN, "temperature": 293.0}, "expected °C, from -60 to 150"),
    (TrackedPoint, {"position": SEEN, "origin": ["a"]}, "origin: found 1 entries; expected 12"),
    (HandEye, {"position": SEEN}, "hand_eye: found no orientation"),
    (FixedPoint, {}, "fixed_point: found no point; expected point: a label for each row, or one"),
    (
        TouchedPlane,
        {"plane": "A", "radius": "thick"},
        "radius: found 'thick' (str); expected float",
    ),
    (TouchedPlane, {"plane": "A", "radius": -0.01}, "radius: found -0.01"),
    (MeasuredRange, {"anchor": "A", "length": np.zeros(12)}, "length[0]: found 0"),
    (PairwiseDistance, {"placement": 1, "repeat": 1, "landmark": "A"}, "found no artefact"),
    (
        PairwiseDistance,
        {"placement": 1, "repeat": 1, "landmark": "A", "artefact": "artefact.yaml"},
        "artefact: found 'artefact.yaml' (str); expected Artefact",
    ),
    (CameraView, {"pixels": np.ones((12, 3, 2))}, "camera_view: found no board"),
    (CameraView, {"pixels": np.ones((12, 3))}, "pixels: found shape (12, 3)"),
]


@pytest.mark.parametrize(("kind", "given", "said"), WRONG, ids=[said for _, _, said in WRONG])
def test_arrays_that_cannot_be_used_are_refused_in_words(
    kind: type[Term], given: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError) as refused:
        kind.from_arrays(ARM, Q, **given)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("q", "said"),
    [
        (np.degrees(Q), "looks like degrees: convert to radians"),
        (Q[:, :5], "tracked_point: q: found shape (12, 5); expected (n, 6)"),
        (Q[0], "tracked_point: q: found shape (6,)"),
        (Q[:0], "tracked_point: q: found no samples"),
        (Q * np.inf, "q[0, 0]: found"),
        (None, "q: found"),
    ],
)
def test_readings_that_cannot_be_used_are_refused_in_words(q: Any, said: str) -> None:
    with pytest.raises(InputError) as refused:
        TrackedPoint.from_arrays(ARM, q, position=SEEN)
    assert said in str(refused.value)


def test_an_arm_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"arm: found 'arm.urdf' \(str\); expected an ArmModel"):
        TrackedPoint.from_arrays("arm.urdf", Q, position=SEEN)


def test_quaternions_are_x_y_z_w() -> None:
    turned = ARM.forward(Q)[0]
    by_matrix, by_quaternion = (
        HandEye.from_arrays(ARM, Q, position=SEEN, orientation=orientation)
        for orientation in (turned, quaternion_from_rotation(turned))
    )
    np.testing.assert_allclose(
        by_matrix.poses.samples.rotation, by_quaternion.poses.samples.rotation, atol=1e-12
    )


def test_one_label_stands_for_all_rows() -> None:
    term = FixedPoint.from_arrays(ARM, Q, point="post")
    assert term.places[0] == ["post"]
