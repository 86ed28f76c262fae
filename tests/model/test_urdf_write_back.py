from __future__ import annotations

import difflib
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.errors import OutputError, UrdfError
from suta_calib.model.chain import read_chain
from suta_calib.model.urdf import write_urdf

# Everything a tree-based writer would lose, and everything that could be taken for an origin.
AWKWARD = (Path(__file__).parents[1] / "data" / "awkward.urdf").read_bytes().decode()


@pytest.fixture
def awkward(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_bytes(AWKWARD.encode())
    return path


def written(source: Path, origins: dict[str, tuple[object, object]]) -> bytes:
    destination = source.with_name("calibrated.urdf")
    write_urdf(source, destination, origins)  # type: ignore[arg-type]
    return destination.read_bytes()


def difference(before: bytes, after: bytes) -> list[str]:
    """Removed and added lines, line ends included."""
    old, new = (text.decode("latin-1").splitlines(keepends=True) for text in (before, after))
    lines = list(difflib.unified_diff(old, new, n=0))[2:]
    return [line for line in lines if not line.startswith("@@")]


# ── The text ─────────────────────────────────────────────────────────────────────────────────
def test_nothing_new_changes_no_byte(awkward: Path) -> None:
    chain = read_chain(awkward, "tip")
    origins = {joint.name: (joint.xyz, joint.rpy) for joint in chain.joints}
    assert written(awkward, origins) == awkward.read_bytes()


KEPT = [0, 1.5, 0.5]
ORIGIN = '<origin xyz="0.0 0.0 0.25" rpy="0.0 0.0 0.0"/>'
TOOL_RPY = '       rpy="0 1.5707963267948966 0.3"'
SPIN = '<joint name="spin" type="continuous">'
CHANGES = {
    "one number": ("turn", [0, 0.1, 0.1 + 0.2], KEPT, "0 0.10 -2e-1", "0 0.10 0.3"),
    "the other attribute": ("turn", [0, 0.1, -0.2], [0, -1e-7, 2], "0  1.50 .5", "0 -1e-07 2.0"),
    "an attribute that is missing": (
        *("tool", [0, 0, 0.25], [0, math.pi / 2, 0.3]),
        *(TOOL_RPY, TOOL_RPY + ' xyz="0.0 0.0 0.25"'),
    ),
    "one that is missing, for nothing": ("tool", [0, 0, 0], [0, math.pi / 2, 0.3], "", ""),
    "an origin that is missing, in line": ("spin", [0, 0, 0.25], [0, 0, 0], SPIN, SPIN + ORIGIN),
}


@pytest.mark.parametrize("how", CHANGES)
def test_nothing_else_changes(how: str, awkward: Path) -> None:
    joint, xyz, rpy, old, new = CHANGES[how]
    assert old in AWKWARD
    after = written(awkward, {joint: (xyz, rpy)})
    assert after.decode() == (AWKWARD.replace(old, new) if old else AWKWARD)


def test_the_first_of_several_origins_is_the_one_that_counts(awkward: Path) -> None:
    text = AWKWARD.replace("</origin >", '</origin><origin xyz="1 1 1"/>')
    awkward.write_bytes(text.encode())
    after = written(awkward, {"turn": ([0, 0.1, 5], [0, 1.5, 0.5])})
    assert after.decode() == text.replace("-2e-1", "5.0")


def test_a_missing_origin_is_added_on_a_line_of_its_own(awkward: Path) -> None:
    after = written(awkward, {"push": ([0, 0, 0.25], [0, 0, 0])})
    assert difference(AWKWARD.encode(), after) == [f"+    {ORIGIN}\n"]


@pytest.mark.parametrize(
    ("encoding", "mark"),
    [("utf-8", b""), ("utf-8", b"\xef\xbb\xbf"), ("iso-8859-1", b""), ("windows-1252", b"")],
)
def test_line_ends_and_encodings_survive(tmp_path: Path, encoding: str, mark: bytes) -> None:
    text = AWKWARD.replace("utf-8", encoding).replace("exported", "exporté").replace("\n", "\r\n")
    source = tmp_path / "arm.urdf"
    source.write_bytes(mark + text.encode(encoding))
    after = written(source, {"turn": ([0, 0.1, 5], [0, 1.5, 0.5]), "push": ([0, 0, 1], [0, 0, 0])})
    assert difference(source.read_bytes(), after) == [
        "-" + (old := next(line for line in text.splitlines(True) if "0.10" in line)),
        "+" + old.replace("-2e-1", "5.0"),
        '+    <origin xyz="0.0 0.0 1.0" rpy="0.0 0.0 0.0"/>\r\n',
    ]
    assert after.startswith(mark + b"<?xml")


def test_entities_and_large_files_do_not_shift_positions(tmp_path: Path) -> None:
    entity = "<joint name='tool'><origin xyz='1 1 1'/></joint>"
    head = f'<!DOCTYPE robot [<!ENTITY long "{entity}">]>\n<robot'
    text = AWKWARD.replace("<robot", head, 1).replace("<gazebo ", "&long;<gazebo ")
    text = text.replace("<!-- exported", "<!-- " + "é\n" * 700_000)
    source = tmp_path / "arm.urdf"
    source.write_bytes(text.encode())
    after = written(source, {"tool": ([0, 0, 0], [0, 0, 0.3])}).decode()
    assert after == text.replace("1.5707963267948966", "0.0")


# ── Refusals ─────────────────────────────────────────────────────────────────────────────────
def test_an_unknown_joint_is_refused_and_nothing_is_written(awkward: Path) -> None:
    with pytest.raises(UrdfError, match=r"arm\.urdf: 'trun': found no joint.*mean 'turn'"):
        written(awkward, {"trun": (np.zeros(3), np.zeros(3))})
    assert [path.name for path in awkward.parent.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_not_written(awkward: Path, bad: float) -> None:
    with pytest.raises(OutputError, match=r"joint 'turn'.*not finite"):
        written(awkward, {"turn": ([0, bad, 0], np.zeros(3))})
    assert [path.name for path in awkward.parent.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (AWKWARD.encode("utf-16"), "UTF-16"),
        (AWKWARD.replace("utf-8", "shift_jis").encode("ascii", "replace"), "multi-byte"),
        (AWKWARD.replace("utf-8", "klingon").encode(), "unknown encoding"),
        (AWKWARD.replace("</robot>", "").encode(), r"arm\.urdf:\d+: found text that cannot be"),
        (AWKWARD.replace('"push"', '"turn"').encode(), r"'turn' twice"),
    ],
    ids=["utf-16", "shift_jis", "klingon", "not xml", "twice"],
)
def test_what_cannot_be_edited_in_place_is_refused(
    awkward: Path, data: bytes, message: str
) -> None:
    awkward.write_bytes(data)
    with pytest.raises(UrdfError, match=message):
        written(awkward, {"turn": (np.ones(3), np.zeros(3))})


DOUBLE = st.floats(allow_nan=False, allow_infinity=False)


@given(
    xyz=st.tuples(DOUBLE, DOUBLE, DOUBLE),
    rpy=st.tuples(DOUBLE, DOUBLE, DOUBLE),
    name=st.sampled_from(["turn", "push", "spin", "tool"]),
)
def test_written_doubles_are_read_back_exactly(
    tmp_path_factory: pytest.TempPathFactory,
    xyz: tuple[float, ...],
    rpy: tuple[float, ...],
    name: str,
) -> None:
    source = tmp_path_factory.getbasetemp() / "arm.urdf"
    source.write_bytes(AWKWARD.encode())
    root = ElementTree.fromstring(written(source, {name: (xyz, rpy)}))
    joint = next(joint for joint in root.findall("joint") if joint.get("name") == name)
    origin = joint.find("origin")
    texts = [(origin.get(key) if origin is not None else None) for key in ("xyz", "rpy")]
    values = [tuple(map(float, (text or "0 0 0").split())) for text in texts]
    np.testing.assert_allclose(values, [xyz, rpy], rtol=1e-15, atol=0.51e-12)


def test_rounding_of_products_is_not_written(awkward: Path) -> None:
    """Numbers that moved by less than 1e-12 keep their spelling, and no others have such digits."""
    for noise in (3.8e-19, -6.1e-17, 4.9e-13):
        near = {"turn": ([noise, 0.1 + noise, -0.2 - noise], [noise, 1.5 - noise, 0.5 + noise])}
        assert written(awkward, near) == awkward.read_bytes()
        assert written(awkward, {"push": ([noise] * 3, [noise] * 3)}) == awkward.read_bytes()
    after = written(awkward, {"turn": ([0.25, -3.8e-19, 1 / 3], [-0.0, 1.5, math.pi / 2])})
    new = AWKWARD.replace("0 0.10 -2e-1", "0.25 0.0 0.333333333333")
    assert after.decode() == new.replace("0  1.50 .5", "0 1.50 1.570796326795")
