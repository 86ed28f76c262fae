from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.errors import UrdfError
from suta_calib.model.chain import Chain, read_chain

ARM = (Path(__file__).parents[1] / "data" / "serial_arm.urdf").read_text()


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def refusal(path: Path, text: str, tip: str = "tip", base: str | None = None) -> UrdfError:
    """The error for this text; every one is a single line that names the file."""
    path.write_text(text)
    with pytest.raises(UrdfError) as caught:
        read_chain(path, tip, base)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert len(message.splitlines()) == 1
    return caught.value


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def test_an_undeclared_prefix_excuses_nothing_else(urdf: Path) -> None:
    text = ARM.replace("</robot>", "<sim:a/><open></robot>")
    assert "not XML" in str(refusal(urdf, text))


REPLACEMENTS = {
    "root": ("robot", "model", "the root element <model>; expected <robot>", "<model"),
    "xml": ("</transmission>", "", "not XML", "</robot>"),
    "link twice": ('"tip"/>', '"hand"/>', "already used in line 8", 'hand"/>\n  <joint'),
    "joint twice": ('"push"', '"turn"', "the joint name 'turn', already", '"turn" type="pris'),
    "link": (
        '<link name="upper"/>',
        "",
        "'upper', which is not defined",
        '<child link="upper"',
    ),
    "no parent": ('<parent link="upper"/>', "", "joint 'push': found no <parent>", '"push"'),
    "no child": ('<child link="slide"/>', "", "joint 'push': found no <child>", '"push"'),
    "empty child": ('<child link="slide"/>', "<child/>", "<child>: found no link", "<child/>"),
    "loop": (
        '<child link="hand"/>',
        '<child link="slide"/>',
        "link 'slide': found two joints, 'push' (line 17) and 'grip'",
        'name="grip"',
    ),
    "cycle": ('<parent link="base"/>', '<parent link="tip"/>', "a cycle", None),
    "two roots": (
        '<link name="tip"/>',
        '<link name="tip"/><link name="a"/><link name="b"/><joint name="ab" type="fixed">'
        '<parent link="a"/><child link="b"/></joint>',
        "2 links without a parent: 'base', 'a'; expected one root",
        '"a"',
    ),
    "floating": (
        '"spin" type="continuous"',
        '"spin" type="floating"',
        "type 'floating'; expected revolute, continuous, prismatic or fixed in the chain; choose "
        "its child as the base: 'wrist'",
        '"spin"',
    ),
    "planar": ('"spin" type="continuous"', '"spin" type="planar"', "type 'planar'", '"spin"'),
    "unknown": ('"spin" type="continuous"', '"spin" type="hinge"', "type 'hinge'", '"spin"'),
    "no type": ('"spin" type="continuous"', '"spin"', "joint 'spin': found no type", '"spin"'),
    "mimic": (
        '<origin rpy="0 0 1"/>',
        '<mimic joint="trun"/>',
        "joint 'spin': <mimic>: found the joint 'trun', which is not defined",
        "<mimic",
    ),
    "count": ("0 0.1 -2e-1", "0 0.1", "<origin>: found xyz='0 0.1'; expected 3 finite", "<origin"),
    "text": ("0 0.1 -2e-1", "0 a 1", "xyz='0 a 1'", "<origin"),
    "nan": ("0 0.1 -2e-1", "0 nan 1", "xyz='0 nan 1'", "<origin"),
    "infinite": ("0 0.1 -2e-1", "0 1e999 1", "xyz='0 1e999 1'", "<origin"),
    "underscore": ("0 0.1 -2e-1", "0 1_0 1", "xyz='0 1_0 1'", "<origin"),
    "empty": ("0 0.1 -2e-1", "", "xyz=''", "<origin"),
    "rpy": ("0 1.5 .5", "0 1.5 .5 1", "rpy='0 1.5 .5 1'", "<origin"),
    "substitution": ("0 1.5 .5", "0 0 ${pi/2}", "run xacro first", "<origin"),
    "axis": ("0 3 -4", "0 x 1", "joint 'turn': <axis>: found xyz='0 x 1'", "<axis"),
    "no axis": ("0 3 -4", "0 0 0.0", "xyz='0 0 0.0'; expected a direction", "<axis"),
    "limit": ('upper="2"', 'upper="two"', "upper='two'; expected a finite number", "<limit"),
}


@pytest.mark.parametrize("case", REPLACEMENTS.values(), ids=REPLACEMENTS)
def test_refusals_name_line_and_cause(urdf: Path, case: tuple[str, str, str, str | None]) -> None:
    old, new, message, place = case
    text = ARM.replace(old, new) if old == "robot" else ARM.replace(old, new, 1)
    assert text != ARM
    error = refusal(urdf, text)
    assert message in str(error)
    assert error.line is not None
    if place is not None:
        assert error.line == line_of(text, place)


@pytest.mark.parametrize(
    "text",
    [
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:include/></robot>',
        '<robot name="a">\n<xacro:property name="x" value="1"/></robot>',
    ],
    ids=["declared", "undeclared"],
)
def test_xacro_must_be_run_first(urdf: Path, text: str) -> None:
    error = refusal(urdf, text)
    assert error.line == 2
    assert "run xacro first" in str(error)


@pytest.mark.parametrize(
    ("tip", "base", "message"),
    [
        ("tpi", None, "tip: found 'tpi'; expected a link or a joint of the file; did you mean"),
        ("zzzzz", None, "links and joints in the file: 'base', 'upper', 'slide'"),
        ("tip", "bsae", "base: found 'bsae'; expected a link or a joint of the file; did you mean"),
        ("tip", "tip", "'tip' as both base and tip"),
        ("base", None, "'base' as both base and tip"),
        ("tip", "wrist", "only fixed joints between 'wrist' and 'tip'"),
    ],
)
def test_tip_and_base_must_be_ends_of_a_chain(
    urdf: Path, tip: str, base: str | None, message: str
) -> None:
    assert message in str(refusal(urdf, ARM, tip, base))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "an empty file"),
        (b" \n", "an empty file"),
        (b"solid stl", "not XML"),
        (ARM.replace("1.0", "1.0", 1).encode("utf-16"), "UTF-16"),
        (b'<robot name="a"><link name="b"/></robot>', "no <joint>"),
        (b"<robot name='a'>\xff</robot>", "not XML"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(data)
    with pytest.raises(UrdfError, match=re.escape(message)) as caught:
        read_chain(path, "tip")
    assert str(path) in str(caught.value)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UrdfError, match=r"nowhere\.urdf: found no such file"):
        read_chain(tmp_path / "nowhere.urdf", "tip")
    with pytest.raises(UrdfError, match="found a directory"):
        read_chain(tmp_path, "tip")
    with pytest.raises(UrdfError, match="unreadable"):
        read_chain("arm\0.urdf", "tip")


def test_a_bomb_of_entities_is_refused(urdf: Path) -> None:
    entities = '<!ENTITY e0 "0 0 0">'
    for i in range(1, 12):
        entities += f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">'
    text = ARM.replace('<robot name="arm">', f'<!DOCTYPE robot [{entities}]><robot name="arm">')
    refusal(urdf, text.replace("0 0.1 -2e-1", "&e11;"))


FRAGMENTS = st.sampled_from(
    ["<", ">", '"', "/", "0", "nan", "xyz", " ", "&", "tip", "base", "<!--", "é", "-", "joint", ""]
)


def chain_or_refusal(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    message = ""
    try:
        assert isinstance(read_chain(path, "tip"), Chain)
    except UrdfError as error:
        message = str(error)
    assert len(message.splitlines()) <= 1


@given(data=st.binary(max_size=200))
def test_any_bytes_are_a_chain_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    chain_or_refusal(tmp_path_factory.getbasetemp() / "bytes.urdf", data)


@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(ARM)), st.integers(0, 30), FRAGMENTS), min_size=1, max_size=4
    )
)
def test_any_damage_leaves_a_chain_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, edits: list[tuple[int, int, str]]
) -> None:
    text = ARM
    for start, length, inserted in edits:
        text = text[:start] + inserted + text[start + length :]
    chain_or_refusal(tmp_path_factory.getbasetemp() / "damaged.urdf", text.encode())
