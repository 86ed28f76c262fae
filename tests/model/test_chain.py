from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from suta_calib.model.chain import read_chain

ARM = (Path(__file__).parents[1] / "data" / "serial_arm.urdf").read_text()


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def test_the_chain_is_what_the_file_says(urdf: Path) -> None:
    chain = read_chain(urdf, "tip")
    assert (chain.robot, chain.base, chain.tip, chain.tip_link) == ("arm", "base", "tip", "tip")
    assert [joint.name for joint in chain.joints] == ["turn", "push", "spin", "tool"]
    assert [joint.name for joint in chain.moving] == ["turn", "push", "spin"]
    assert [joint.line for joint in chain.joints] == [
        line_of(ARM, f'<joint name="{joint.name}" ') for joint in chain.joints
    ]
    turn, _, spin, tool = chain.joints
    np.testing.assert_array_equal(turn.xyz, [0, 0.1, -0.2])
    np.testing.assert_array_equal(turn.rpy, [0, 1.5, 0.5])
    np.testing.assert_allclose(turn.axis, [0, 0.6, -0.8], rtol=1e-15)
    assert (turn.parent, turn.child, turn.lower, turn.upper) == ("base", "upper", -1, 2)
    assert (spin.lower, spin.upper) == (-math.inf, math.inf)
    np.testing.assert_array_equal(tool.xyz, [0, 0, 1])
    assert not tool.moving


def test_what_is_left_out_has_urdfs_defaults(urdf: Path) -> None:
    push = read_chain(urdf, "tip").joints[1]
    np.testing.assert_array_equal([*push.xyz, *push.rpy], np.zeros(6))
    np.testing.assert_array_equal(push.axis, [1, 0, 0])
    assert (push.lower, push.upper) == (0, 0.3)


@pytest.mark.parametrize("length", [1e-9, 7.0, 1e300])
def test_an_axis_of_any_length_is_a_direction(urdf: Path, length: float) -> None:
    urdf.write_text(ARM.replace("0 3 -4", f"0 {0.6 * length!r} {-0.8 * length!r}"))
    np.testing.assert_allclose(read_chain(urdf, "tip").joints[0].axis, [0, 0.6, -0.8], rtol=1e-15)


def test_a_joint_as_tip_means_its_child_link(urdf: Path) -> None:
    chain = read_chain(urdf, "push")
    assert (chain.tip, chain.tip_link) == ("push", "slide")
    assert [joint.name for joint in chain.joints] == ["turn", "push"]


def test_the_chain_may_start_above_the_root(urdf: Path) -> None:
    chain = read_chain(urdf, "tip", "upper")
    assert chain.base == "upper"
    assert [joint.name for joint in chain.joints] == ["push", "spin", "tool"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        *(
            ('name="grip" type="revolute"', f'name="grip" type="{kind}"')
            for kind in ("floating", "a")
        ),
        ('<robot name="arm">', '<robot name="arm" xmlns="http://www.ros.org">'),
        ('<robot name="arm">', '<robot name="arm" sim:x="1">'),
        ('<robot name="arm">', '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'),
        ('lower="-1" upper="2" ', ""),
    ],
    ids=[
        "outside the chain",
        "of no type",
        "namespace",
        "undeclared prefix",
        "expanded xacro",
        "limits",
    ],
)
def test_what_is_nobodys_business(urdf: Path, old: str, new: str) -> None:
    """Joints of other types outside the chain, namespaces; limits that are not given are none."""
    assert old in ARM
    urdf.write_text(ARM.replace(old, new))
    turn, *others = read_chain(urdf, "tip").joints
    assert len(others) == 3
    assert (turn.lower, turn.upper) == ((-1, 2) if new else (-math.inf, math.inf))
