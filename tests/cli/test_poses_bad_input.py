"""Bad poses and points: one line that names the place, exit code 2, and no output."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_job import refused
from pose_scenes import PAIR, POSE, pair_numbers, pivot_numbers, point_numbers, write_csv

Spoil = Callable[[list[list[str]]], object]
COMMANDS = {"pivot": ("p.csv",), "hand-eye": ("h.csv",), "register": ("a.csv", "b.csv")}
PREFIX = {"pivot": "", "hand-eye": "b_", "register": ""}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Files that all three commands accept, until a test spoils one."""
    data = tmp_path / "data"
    data.mkdir()
    write_csv(data / "p.csv", POSE, pivot_numbers(["left"] * 12))
    write_csv(data / "h.csv", PAIR, pair_numbers(12, "eye-in-hand"))
    for name, points in zip("ab", point_numbers(12), strict=True):
        write_csv(data / f"{name}.csv", ("x", "y", "z"), points)
    return data


def refuses(folder: Path, command: str, *options: object) -> str:
    """The one line of a command that must refuse, without writing anything."""
    before = sorted(folder.rglob("*"))
    files = [folder / name for name in COMMANDS[command]]
    out = () if "--out" in options else ("--out", folder / "out")
    line = refused(command, *files, *options, *out, "--json")
    assert sorted(folder.rglob("*")) == before
    return line


def spoil_text(folder: Path, command: str, change: Callable[[str], str]) -> None:
    """Change the last of the files that a command reads."""
    path = folder / COMMANDS[command][-1]
    old = path.read_text()
    path.write_text(change(old))
    assert path.read_text() != old


def cell(column: str, line: int, value: str) -> Callable[[str, str], str]:
    def change(text: str, prefix: str) -> str:
        rows = [row.split(",") for row in text.splitlines()]
        rows[line - 1][rows[0].index(prefix + column)] = value
        return "\n".join(map(",".join, rows)) + "\n"

    return change


def renamed(old: str, new: str) -> Callable[[str, str], str]:
    def change(text: str, prefix: str) -> str:
        header, _, rest = text.partition("\n")
        names = [prefix + new if name == prefix + old else name for name in header.split(",")]
        return ",".join(names) + "\n" + rest

    return change


def first_lines(count: int) -> Callable[[str, str], str]:
    return lambda text, _: "".join(text.splitlines(keepends=True)[:count])


# What is spoilt → what the one line must say after the file's name.
BAD: dict[str, tuple[Callable[[str, str], str], str]] = {
    "column missing": (renamed("y", "why"), r":1: column '(b_)?y': found only"),
    "nan": (cell("x", 4, "nan"), r":4: column '(b_)?x': found 'nan'"),
    "infinite": (cell("z", 5, "-inf"), r":5: column '(b_)?z': found '-inf'"),
    "text": (cell("y", 3, "1,5".replace(",", ";")), r":3: column '(b_)?y': found '1;5'"),
    "empty cell": (cell("y", 3, ""), r":3: column '(b_)?y': found ''"),
    "too large": (cell("y", 3, "1e200"), r":3: column '(b_)?y': found '1e200'"),
    "both units": (renamed("x", "x_mm"), r":1: found columns .*expected either"),
    "column twice": (renamed("y", "x"), r":1: found the column '(b_)?x' more than once"),
    "half a line": (
        lambda text, _: text[: text.rstrip().rindex(",")],
        r":13: found \d+ cells; expected \d+.*ends in the middle of a row",
    ),
    "semicolons": (lambda text, _: text.replace(",", ";"), r":1: found the header .*commas"),
}


@pytest.mark.parametrize(("change", "says"), BAD.values(), ids=BAD)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_bad_file(
    folder: Path, command: str, change: Callable[[str, str], str], says: str
) -> None:
    spoil_text(folder, command, lambda text: change(text, PREFIX[command]))
    line = refuses(folder, command)
    assert re.search(re.escape(str(folder / COMMANDS[command][-1])) + says, line), line


@pytest.mark.parametrize("command", ["pivot", "hand-eye"])
def test_a_zero_quaternion(folder: Path, command: str) -> None:
    prefix = PREFIX[command]
    for name in POSE[3:]:
        spoil_text(folder, command, lambda text, n=name: cell(n, 6, "0")(text, prefix))
    line = refuses(folder, command)
    assert re.search(r"\.csv:6: column '(b_)?qx': found a quaternion of length 0", line)


@pytest.mark.parametrize("command", ["pivot", "hand-eye"])
def test_an_orientation_missing(folder: Path, command: str) -> None:
    spoil_text(folder, command, lambda text: renamed("qw", "w")(text, PREFIX[command]))
    assert re.search(r":1: column '(b_)?qw'.*quaternion", refuses(folder, command))


@pytest.mark.parametrize(
    ("command", "says"),
    [("pivot", "2 poses"), ("hand-eye", "2 pairs of poses"), ("register", "2 points")],
)
def test_too_few_rows(folder: Path, command: str, says: str) -> None:
    for name in COMMANDS[command]:
        (folder / name).write_text(first_lines(3)((folder / name).read_text(), ""))
    line = refuses(folder, command)
    assert str(folder / COMMANDS[command][0]) in line
    assert f"found {says}; expected at least 3" in line


@pytest.mark.parametrize("command", COMMANDS)
def test_copies_of_one_row(folder: Path, command: str) -> None:
    for name in COMMANDS[command]:
        header, row, *_ = (folder / name).read_text().splitlines()
        (folder / name).write_text("\n".join([header, *[row] * 8]) + "\n")
    line = refuses(folder, command)
    assert "found 8 rows, of which all but 1 repeat another" in line


def test_different_numbers_of_points(folder: Path) -> None:
    spoil_text(folder, "register", lambda text: first_lines(10)(text, ""))
    line = refuses(folder, "register")
    assert f"{folder / 'b.csv'}: found 9 rows; expected 12 rows, as in {folder / 'a.csv'}" in line


def test_a_tool_that_was_not_turned(folder: Path) -> None:
    numbers = pivot_numbers(["left"] * 12)
    numbers[:, 3:] = [0, 0, 0, 1]
    write_csv(folder / "p.csv", POSE, numbers)
    line = refuses(folder, "pivot")
    assert f"{folder / 'p.csv'}: found poses that do not determine the tip" in line
    assert "turn the tool" in line


def test_one_pose_on_a_post(folder: Path) -> None:
    labels = ["left"] * 11 + ["right"]
    write_csv(folder / "p.csv", (*POSE, "point"), pivot_numbers(labels), labels)
    line = refuses(folder, "pivot")
    assert f"{folder / 'p.csv'}: point: found one pose for point right" in line
    write_csv(folder / "p.csv", (*POSE, "point"), pivot_numbers(labels), ["a"] * 11 + [""])
    assert "p.csv:13: column 'point': found an empty cell" in refuses(folder, "pivot")


def test_a_hand_that_only_turned_about_one_axis(folder: Path) -> None:
    numbers = pair_numbers(12, "eye-in-hand")
    numbers[:, 3:7] = [0, 0, 0, 1]
    numbers[:, 10:] = [0, 0, 0, 1]
    write_csv(folder / "h.csv", PAIR, numbers)
    line = refuses(folder, "hand-eye")
    assert f"{folder / 'h.csv'}: found poses that do not determine X" in line
    assert "turn the hand" in line


def test_points_on_a_line(folder: Path) -> None:
    along = np.linspace(0, 1, 12)[:, None] * [0.1, 0.2, -0.1]
    for name in "ab":
        write_csv(folder / f"{name}.csv", ("x", "y", "z"), along + 0.1)
    line = refuses(folder, "register")
    assert f"{folder / 'a.csv'}: registered to {folder / 'b.csv'}: found points on a line" in line


def test_points_of_a_mirror(folder: Path) -> None:
    a, b = point_numbers(12)
    write_csv(folder / "a.csv", ("x", "y", "z"), a * [-1, 1, 1])
    write_csv(folder / "b.csv", ("x", "y", "z"), b)
    assert "mirror image" in refuses(folder, "register")


def test_points_in_another_unit(folder: Path) -> None:
    write_csv(folder / "b.csv", ("x", "y", "z"), 1e3 * point_numbers(12)[1])
    line = refuses(folder, "register")
    assert re.search(r"b\.csv: found points \d+ times as far apart", line)


def test_bad_targets(folder: Path) -> None:
    target = folder / "t.csv"
    for text, says in (("", "an empty file"), ("x,y,z\n1,2\n", ":2: found 2 cells")):
        target.write_text(text)
        line = refuses(folder, "register", "--target", target)
        assert str(target) in line
        assert says in line


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["pivot"], "POSES.csv"),
        (["register", "a.csv"], "B.csv"),
        (["pivot", "p.csv", "--seed", "-1"], "--seed"),
        (["hand-eye", "h.csv", "--setup", "eye"], "eye-to-hand"),
        (["hand-eye", "h.csv", "--model", "AX=YB"], "AX=ZB"),
        (["pivot", "p.csv", "q.csv"], "unexpected"),
    ],
)
def test_bad_usage(arguments: list[str], says: str) -> None:
    assert says in refused(*arguments)
