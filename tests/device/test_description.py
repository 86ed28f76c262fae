from __future__ import annotations

from pathlib import Path

import pytest

from suta_calib.device import JointSpec, read_device
from suta_calib.device.description import UNASKED
from suta_calib.device.formats import FORMATS, Format
from suta_calib.errors import DeviceFileError
from suta_calib.registry import shipped

GOOD = """\
port: /dev/ttyACM0
baudrate: 115200
format: lines
unit: counts
counts_per_turn: 4096
joints: [{name: joint_1, sign: -1}, {name: joint_2}]
"""


def read(folder: Path, text: str):
    path = folder / "device.yaml"
    path.write_text(text, encoding="utf-8")
    return read_device(path)


def test_a_device_file_is_read(tmp_path: Path) -> None:
    spec = read(tmp_path, GOOD)
    assert (spec.port, spec.baudrate, spec.format) == ("/dev/ttyACM0", 115200, "lines")
    assert (spec.unit, spec.counts_per_turn) == ("counts", 4096)
    assert spec.joints == (JointSpec("joint_1", -1), JointSpec("joint_2", 1))
    assert spec.names == ("joint_1", "joint_2")


def test_port_and_joints_are_enough_for_frames(tmp_path: Path) -> None:
    spec = read(tmp_path, "port: COM3\njoints: [{name: a}]\n")
    assert (spec.format, spec.unit, spec.counts_per_turn) == ("frames", "counts", 4194304)


def test_a_port_beside_the_file_is_found_from_anywhere(tmp_path: Path) -> None:
    (tmp_path / "arm").touch()
    text = "port: {}\njoints: [{{name: a}}]\n"
    assert read(tmp_path, text.format("arm")).port == str(tmp_path / "arm")
    assert read(tmp_path, text.format("COM3")).port == "COM3"
    assert read(tmp_path, text.format("socket://arm:5000")).port == "socket://arm:5000"


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("port: /dev/ttyACM0\n", "", None, ["port", "no such key"]),
        ("port: /dev/ttyACM0", "port: 3", 1, ["port", "3", "text"]),
        ("port: /dev/ttyACM0", "port: socket://arm", 1, ["socket://arm", "socket://host:port"]),
        ("port: /dev/ttyACM0", "port: spy://COM3?file=a", 1, ["spy://COM3?file=a", "/dev/ttyACM0"]),
        ("baudrate: 115200", "baudrate: fast", 2, ["baudrate", "fast", "whole number"]),
        ("baudrate: 115200", "baudrate: 0", 2, ["baudrate", "0"]),
        ("baudrate", "baud_rate", 2, ["baud_rate", "did you mean 'baudrate'"]),
        ("format: lines", "format: line", 3, ["'line'", "frames, lines", "did you mean 'lines'"]),
        ("unit: counts", "unit: grad", 4, ["'grad'", "counts, rad, deg"]),
        ("format: lines\nunit: counts", "format: frames\nunit: rad", 4, ["'rad'", "counts"]),
        ("format: lines", "format: frames", 5, ["4096", "4194304", "22-bit"]),
        ("counts_per_turn: 4096\n", "", None, ["counts_per_turn", "the format is lines in counts"]),
        ("counts_per_turn: 4096", "counts_per_turn: 1", 5, ["counts_per_turn", "1"]),
        ("[{name: joint_1, sign: -1}, {name: joint_2}]", "[]", 6, ["joints", "empty list"]),
        ("[{name: joint_1, sign: -1}, {name: joint_2}]", "6", 6, ["joints", "6"]),
        ("sign: -1", "sign: 0", 6, ["joints[0].sign", "0", "1 or -1"]),
        ("sign: -1", "sign: left", 6, ["joints[0].sign", "left"]),
        ("{name: joint_2}", "{name: joint_1}", 6, ["joints[1].name", "twice"]),
        ("{name: joint_2}", "{name: joint_2, ratio: 0}", 6, ["joints[1].ratio", "turns of the"]),
        ("{name: joint_2}", "{name: joint_2, zero: 0.5}", 6, ["joints[1].zero", "whole number"]),
        ("sign: -1", "counts_per_turn: 1", 6, ["joints[0].counts_per_turn", "1"]),
        ("{name: joint_2}", "{nam: joint_2}", 6, ["joints[1].nam", "did you mean 'name'"]),
    ],
)
def test_what_cannot_be_used_is_named(
    tmp_path: Path, old: str, new: str, line: int | None, words: list[str]
) -> None:
    assert old in GOOD
    with pytest.raises(DeviceFileError) as caught:
        read(tmp_path, GOOD.replace(old, new))
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "device.yaml"))
    assert caught.value.line == line
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_more_joints_than_a_frame_can_have_are_refused(tmp_path: Path) -> None:
    joints = ", ".join(f"{{name: j{k}}}" for k in range(256))
    with pytest.raises(DeviceFileError, match="256 joints"):
        read(tmp_path, f"port: COM3\njoints: [{joints}]\n")


def test_an_absent_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(DeviceFileError, match=r"nothing\.yaml"):
        read_device(tmp_path / "nothing.yaml")


def test_a_joint_may_have_its_own_zero_gear_and_encoder(tmp_path: Path) -> None:
    joint = "{name: joint_2, zero: 2048, ratio: 3, counts_per_turn: 1024}"
    spec = read(tmp_path, GOOD.replace("{name: joint_2}", joint))
    assert spec.joints == (JointSpec("joint_1", -1), JointSpec("joint_2", 1, 2048.0, 3.0, 1024))
    frames = "port: COM3\njoints: [{name: a, zero: 7}]\n"
    assert read(tmp_path, frames).joints == (JointSpec("a", 1, 7.0),)
    with pytest.raises(DeviceFileError, match=r":2: joints\[0\].ratio: .*frames are one turn"):
        read(tmp_path, frames.replace("zero: 7", "ratio: 2"))


def test_formats_of_devices_that_speak_by_themselves_are_those_that_are_not_asked() -> None:
    assert set(UNASKED) == {name for name, form in shipped(FORMATS).items() if not form.asked}


def test_further_numbers_have_names(tmp_path: Path) -> None:
    assert read(tmp_path, GOOD).extra_columns == ()
    spec = read(tmp_path, GOOD + "extra_columns: [ax, ay, az]\n")
    assert (spec.extra_columns, spec.numbers) == (("ax", "ay", "az"), 5)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("[ax, ax]", ["extra_columns[1]", "'ax' twice"]),
        ("[ax, joint_2]", ["extra_columns[1]", "'joint_2' as a joint"]),
        ("[time]", ["extra_columns[0]", "'time'", "none of sequence, time"]),
        ("[stroke]", ["'stroke'"]),
        ("['a,b']", ["'a,b'", "without commas"]),
        ("[]", ["empty list"]),
        ("3", ["3"]),
    ],
)
def test_names_that_cannot_be_columns_are_refused(
    tmp_path: Path, columns: str, words: list[str]
) -> None:
    with pytest.raises(DeviceFileError) as caught:
        read(tmp_path, f"{GOOD}extra_columns: {columns}\n")
    assert caught.value.line == 7
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("form", shipped(FORMATS).values(), ids=shipped(FORMATS))
def test_only_some_formats_contain_more_than_joints(tmp_path: Path, form: Format) -> None:
    text = f"port: x\nformat: {form.name}\nunit: counts\ncounts_per_turn: 4194304\n"
    text += "joints: [{name: a}]\nextra_columns: [ax]\n"
    if form.extra_columns:
        assert read(tmp_path, text).extra_columns == ("ax",)
    else:
        with pytest.raises(DeviceFileError, match=r"extra_columns: found ax.*format: lines"):
            read(tmp_path, text)
