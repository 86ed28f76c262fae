"""What is written and can be read is read back as what it was, whatever the arm or the camera."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import result_of
from hypothesis import given, settings
from hypothesis import strategies as st

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.exchange import Result, export_formats, import_formats, read_foreign, write_foreign
from suta_calib.geometry.lens import LENSES, RATIONAL
from suta_calib.measurements import Camera, read_camera
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import OFFSET
from suta_calib.registry import shipped

# m and, of a rotation matrix, its elements: a Denavit-Hartenberg table has some for lines that are
# nearly parallel to meet far away, and what is lost there.
SAME = 1e-9
FAR = 10.0

# Numbers that arms are drawn with, where formulas have their special cases, and any others.
angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, 1e-3]) | st.floats(-3.1, 3.1)
lengths = st.sampled_from([0.0, 1e-3, -0.1, 0.35]) | st.floats(-1.0, 1.0)
axes = st.sampled_from(["1 0 0", "0 1 0", "0 0 1", "0 0 -1", "-1 0 0", "0.6 0 0.8"])
small = st.floats(-0.02, 0.02)


@st.composite
def joints(draw: st.DrawFn) -> list[tuple[str, str]]:
    """Type of each joint, and its origin and axis as a URDF has them; one moves at least."""
    kinds = draw(st.lists(st.sampled_from(["revolute", "prismatic", "continuous", "fixed"])))
    kinds = [*kinds[:5], draw(st.sampled_from(["revolute", "prismatic"]))]
    found = []
    for kind in kinds:
        xyz = " ".join(repr(draw(lengths)) for _ in range(3))
        rpy = " ".join(repr(draw(angles)) for _ in range(3))
        axis = "" if kind == "fixed" else f'<axis xyz="{draw(axes)}"/>'
        found.append((kind, f'<origin xyz="{xyz}" rpy="{rpy}"/>{axis}'))
    return found


def arm_of(parts: list[tuple[str, str]], file: Path) -> ArmModel:
    links = [f"link_{k}" for k in range(len(parts))] + ["tip"]
    inside = "".join(f'<link name="{name}"/>' for name in links)
    for k, (kind, body) in enumerate(parts):
        limit = '<limit lower="-4" upper="4" effort="1" velocity="1"/>' * (kind != "continuous")
        inside += (
            f'<joint name="j{k}" type="{kind}"><parent link="{links[k]}"/>'
            f'<child link="{links[k + 1]}"/>{body}{limit if kind != "fixed" else ""}</joint>'
        )
    file.write_text(f'<robot name="arm">{inside}</robot>')
    return ArmModel.from_urdf(file, "tip")


def poses(arm: ArmModel, values: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    readings = np.random.default_rng(0).uniform(-1.5, 1.5, (5, len(arm.joints)))
    return arm.forward(readings, values)


def every_way(form: str) -> list[dict[str, Any]]:
    """Every combination of the choices that a format offers."""
    offered = [
        [(o.name, c) for c in o.choices] for o in export_formats()[form].options if o.choices
    ]
    return [dict(chosen) for chosen in product(*offered)]


# Those of an arm that are read by us: as another program's file, or as a URDF.
WAYS = [
    (form, way)
    for form in sorted({"urdf", *shipped(export_formats())} & {"urdf", *import_formats()})
    for way in every_way(form)
]


@pytest.mark.parametrize(
    ("form", "way"), WAYS, ids=["-".join([form, *way.values()]) for form, way in WAYS]
)
@settings(max_examples=15)
@given(data=st.data())
def test_an_arm_is_read_back_as_it_was_written(
    form: str, way: dict[str, Any], data: st.DataObject, scratch: Path
) -> None:
    folder = scratch.parent
    arm = arm_of(data.draw(joints()), folder / "drawn.urdf")
    moved = (p for p in arm.offered.values() if p.geometric or p.key == OFFSET)
    values = {p.name: p.nominal + data.draw(small) for p in moved}
    found = write_foreign(result_of(arm, values, folder / "result.json"), form, **way)
    assert not found.lost
    path = found.write(folder / found.file)[0]
    if form in import_formats():
        read_foreign(path, form).write(path := folder / "back.urdf")
    rotation, position = poses(arm, values)
    again, there = poses(ArmModel.from_urdf(path, "tip"), {})
    np.testing.assert_allclose(again, rotation, atol=SAME)
    np.testing.assert_allclose(there, position, atol=SAME * FAR)


@settings(max_examples=40)
@given(data=st.data())
def test_a_camera_is_read_back_as_it_was_written(data: st.DataObject, scratch: Path) -> None:
    width, height = data.draw(st.integers(16, 9000)), data.draw(st.integers(16, 9000))
    focal = data.draw(st.lists(st.floats(0.3, 20.0), min_size=2, max_size=2))
    middle = data.draw(st.lists(st.floats(0.2, 0.8), min_size=2, max_size=2))
    lens = data.draw(st.sampled_from([*LENSES.values()]))
    form = data.draw(st.sampled_from(["camera-info", "opencv-camera", "kalibr"]))
    n = len(lens.distortion)
    distortion = data.draw(st.lists(st.floats(-0.3, 0.3), min_size=n, max_size=n))
    intrinsics = [*np.multiply(focal, width), *np.multiply(middle, (width, height)), *distortion]
    camera = Camera(width, height, np.array(intrinsics), lens=lens)
    result = Result(scratch, None, (), {"default": camera})
    if form == "kalibr" and (lens is RATIONAL or any(abs(k3) > 1e-5 for k3 in distortion[4:])):
        with pytest.raises(InputError, match="kalibr has no other"):
            write_foreign(result, form)
        return
    found = write_foreign(result, form)
    again = read_camera(found.write(scratch.with_name(found.file))[0])
    assert (again.width, again.height) == (width, height)
    assert again.lens is lens
    # A camchain has no k3, and one of less than 1e-5 is none.
    written = len(intrinsics) if form != "kalibr" else 8
    np.testing.assert_array_equal(again.intrinsics[:written], camera.intrinsics[:written])
