"""Whatever a file is: exit code 2, one line that names it, and nothing written."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_job import Capture, cli
from hostile_scene import GIVEN, JOB, SAMPLES, URDF, command_line

from suta_calib.cli._app import COMMANDS

# Longer than any file's name may be; a line that nobody reads is as good as none.
LONGEST = 1500


def test_every_command_is_in_the_table() -> None:
    """A new command is not added without what it reads and writes."""
    assert set(GIVEN) == set(COMMANDS)


@contextmanager
def spoilt(path: Path, content: bytes | None) -> Iterator[None]:
    """A file with other content, or a folder in its place, for as long as that lasts."""
    good = path.read_bytes()
    path.unlink()
    if content is None:
        path.mkdir()
    elif content != GONE:
        path.write_bytes(content)
    try:
        yield
    finally:
        if path.is_dir():
            path.rmdir()
        path.write_bytes(good)


def refused(capsys: Capture, command: str, scene: Path, out: Path) -> str:
    """The one line of a command that must refuse, after a look that it left nothing behind."""
    before = sorted(scene.rglob("*"))
    code = cli(*command_line(command, scene, out))
    stdout, stderr = capsys.readouterr()
    errors = [line for line in stderr.splitlines() if "warning: " not in line]
    assert (code, stdout, len(errors)) == (2, "", 1), (code, stdout, stderr)
    assert errors[0].startswith("suta-calib: error: ")
    assert len(errors[0]) < LONGEST
    assert sorted(scene.rglob("*")) == before
    assert not list(out.parent.rglob("*"))
    return errors[0]


GONE = b"gone"
# What becomes of a good file; None is a folder in its place.
MALFORMED: dict[str, Callable[[bytes], bytes | None]] = {
    "missing": lambda _: GONE,
    "a folder": lambda _: None,
    "empty": lambda _: b"",
    "blank": lambda _: b" \n\t\r\n",
    "binary": lambda _: bytes(range(256)) * 4,
    "half": lambda good: good[: len(good) // 2].rpartition(b",")[0],
    "header only": lambda good: good.splitlines(keepends=True)[0],
    "a NUL in it": lambda good: good[: len(good) // 2] + b"\0" + good[len(good) // 2 :],
    "UTF-16": lambda good: good.decode().encode("utf-16"),
    "a line of 100,000 characters": lambda good: good + b"x" * 100_000 + b"\n",
    "another format": lambda _: b"<html><body>504 Gateway Timeout</body></html>\n",
}


@pytest.mark.parametrize("how", MALFORMED)
@pytest.mark.parametrize("command", [name for name in GIVEN if GIVEN[name].reads])
def test_malformed_files(
    command: str, how: str, scene: Path, tmp_path: Path, capsys: Capture
) -> None:
    """Of a job, which one reader reads for all commands, all files for one of them."""
    names = GIVEN[command].reads
    if names == GIVEN["calibrate"].reads and command != "calibrate":
        turn = [*GIVEN].index(command) + [*MALFORMED].index(how)
        names = (names[turn % len(names)],)
    for name in names:
        path = scene / name
        with spoilt(path, MALFORMED[how](path.read_bytes())):
            if how in GIVEN[command].welcome:
                assert cli(*command_line(command, scene)) == 0
                continue
            line = refused(capsys, command, scene, tmp_path / "out")
        # A job names the line in which it asks for a file that is not there.
        assert path.name in line or f"{path.parent.name}/*.csv" in line, line


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no /dev/zero")
@pytest.mark.parametrize("command", [name for name in GIVEN if GIVEN[name].reads])
def test_what_never_ends_or_never_begins(
    command: str, scene: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device in place of the first file of a command, a pipe in place of the last."""
    monkeypatch.setattr("suta_calib.inputs.PATIENCE", 0.01)
    reads = GIVEN[command].reads
    for name, kind in ((reads[0], "device"), (reads[-1], "pipe")):
        path = scene / name
        with spoilt(path, GONE):
            if kind == "pipe":
                os.mkfifo(path)
            else:
                path.symlink_to("/dev/zero")
            line = refused(capsys, command, scene, tmp_path / "out")
            path.unlink()
        assert path.name in line or f"{path.parent.name}/*.csv" in line, line


CELLS = ("nan", "inf", "-1e999", "0,5", "abc", "", "1_000", "٣", "0x10")


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (command, name)
        for command, given in GIVEN.items()
        for name in given.reads
        if name.endswith((".csv", ".txt"))
    ],
)
def test_cells_that_are_no_numbers(
    command: str, name: str, scene: Path, tmp_path: Path, capsys: Capture
) -> None:
    path = scene / name
    lines = path.read_text().splitlines()
    cells = lines[2].split(",")
    numeric = next(k for k, cell in enumerate(cells) if "." in cell)
    for value in CELLS:
        row = ",".join([*cells[:numeric], value, *cells[numeric + 1 :]])
        content = "\n".join([*lines[:2], row, *lines[3:]]) + "\n"
        with spoilt(path, content.encode()):
            line = refused(capsys, command, scene, tmp_path / "out")
        assert f"{path.name}:3: " in line, line


# File, what is replaced in it, by what, and what the line must say.
VALUES = (
    ("observe", JOB, "bound_deg: 15", "prior_deg: 1.0e-160", r":3: parameters\[0\].prior_deg"),
    ("observe", JOB, "sigma_mm: 0.05", "sigma_mm: 1.0e-300", r":6: observations\[0\].sigma_mm"),
    ("observe", JOB, "sigma_mm: 0.05", "huber_mm: 1.0e300", r":6: observations\[0\].huber_mm"),
    ("observe", JOB, "tip: tip", "tip: tipp", r":1: arm.tip: .*arm.urdf.*did you mean 'tip'"),
    ("observe", JOB, "tip: tip", "tip: tip, base: flor", r":1: arm.base: .*arm.urdf"),
    ("observe", URDF, 'xyz="0 0 0.571"', 'xyz="0 0 1e200"', r":\d+: joint 'joint_4': <origin>"),
    ("iso10360", URDF, 'xyz="0 0 0.571"', 'xyz="0 0 1e200"', r":\d+: joint 'joint_4': <origin>"),
    ("measure", "artefact.yaml", "[100, 0, 0]", "[1.0e11, 0, 0]", r":4: landmarks.B.position_mm"),
    ("monitor", "device.yaml", "no-such-port", "x" * 5000, r":1: port: .*at most"),
)


@pytest.mark.parametrize(("command", "name", "old", "new", "says"), VALUES)
def test_values_that_cannot_be_meant(
    command: str,
    name: str,
    old: str,
    new: str,
    says: str,
    scene: Path,
    tmp_path: Path,
    capsys: Capture,
) -> None:
    path = scene / name
    text = path.read_text()
    assert old in text
    with spoilt(path, text.replace(old, new, 1).encode()):
        assert re.search(name + says, refused(capsys, command, scene, tmp_path / "out"))


def test_a_link_to_nothing_is_not_passed_over(scene: Path, tmp_path: Path, capsys: Capture) -> None:
    link = (scene / SAMPLES).with_name("day2.csv")
    link.symlink_to("/archive/day2.csv")
    try:
        line = refused(capsys, "observe", scene, tmp_path / "out")
    finally:
        link.unlink()
    assert "calibration.yaml:6: " in line
    assert "day2.csv, a link to /archive/day2.csv, which does not exist" in line


def test_a_file_that_is_cut_in_its_last_number(
    scene: Path, tmp_path: Path, capsys: Capture
) -> None:
    """Where all numbers have as many decimals, or far more characters, it is sure; else likely."""
    path = scene / "a.csv"
    header, *rows = path.read_text().splitlines()
    fixed = [",".join(f"{float(cell):.6f}" for cell in row.split(",")) for row in rows]
    whole = "\n".join([header, *fixed])
    shortest = min(len(row.rpartition(",")[2]) for row in rows[:-1])
    near, far = (f"0.{'3' * (shortest - 2 - fewer)}" for fewer in (2, 3))
    cut = "error: {}:13: found '{}' at the end of the file, without a line break; "
    for content, says in (
        (
            whole[:-2],
            f"{cut}expected 6 decimals, as in all other rows",
        ),
        (
            "\n".join([header, *rows[:-1], f"0.1,0.2,{far}"]),
            f"{cut}expected {shortest} characters or more, as in all other rows",
        ),
        (
            "\n".join([header, *rows[:-1], f"0.1,0.2,{near}"]),
            "warning: {}:13: found '{}' at the end",
        ),
    ):
        with spoilt(path, content.encode()):
            code = cli(*command_line("register", scene))
        err = capsys.readouterr().err
        assert says.format(path, content.rpartition(",")[2]) in err
        assert code == (2 if "error" in says else code)
    for content in (whole, whole + "\n"):
        with spoilt(path, content.encode()):
            assert cli(*command_line("register", scene)) == 0
        assert not capsys.readouterr().err
