"""The terminal's sink: however narrow it is, no number and no name is cut."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from suta_calib.assessment import Assessment
from suta_calib.cli._output import console
from suta_calib.report.console import FittedTable, rendered
from suta_calib.report.document import Document, Text
from suta_calib.report.listing import Column, Listing

ROWS = [
    (f"joint_{k}.a_rather_long_parameter_name", 0.0123456 * k, 1e-5, "told by these data")
    for k in range(1, 4)
]
ROW = Listing[tuple[str, float, float, str]](
    "Parameters",
    Column("", "parameter", lambda row: row[0]),
    Column("", "value, mm", lambda row: row[1], "m"),
    Column("", "± std, mm", lambda row: row[2], "m"),
    Column("", "state", lambda row: row[3]),
)
SENTENCE = "The file /some/where/that/has/a/rather/long/name/of/its/own/calibration.yaml is meant."
ANSWER = Document(
    "scene",
    "Scene",
    Assessment.of(SENTENCE, care=[SENTENCE]),
    [
        Text(SENTENCE),
        Text(SENTENCE, bullet=True),
        Text(SENTENCE, look="remedy"),
        ROW.of(ROWS),
        ROW.facts(ROWS[0]),
    ],
)


def shown(width: int, encoding: str = "utf-8") -> str:
    """The answer as it stands on a terminal of so many columns."""
    written = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="replace")
    Console(file=written, width=width, highlight=False).print(rendered(ANSWER), crop=False)
    written.seek(0)
    return written.read()


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "latin-1"])
@pytest.mark.parametrize("width", [20, 40, 60, 80, 81, 100, 120, 200])
def test_every_word_is_there_whole(width: int, encoding: str) -> None:
    said = shown(width, encoding)
    words = set(said.split())
    assert "…" not in said
    assert set(SENTENCE.split()) <= words
    for name, value, std, state in ROWS:
        # A name may go on in the next line after its dot.
        owner, key = name.split(".")
        assert name in words or {f"{owner}.", key} <= words
        assert {f"{1e3 * value:.3f}", f"{1e3 * std:.3f}"} <= words
        assert set(state.split()) <= words


def test_lines_are_longer_than_the_terminal_only_where_a_word_is() -> None:
    for width in (40, 60, 80):
        for line in shown(width).splitlines():
            assert len(line.rstrip()) <= width or len(max(line.split(), key=len)) > width - 8


def test_a_table_that_fits_is_a_table_and_one_that_does_not_is_lines() -> None:
    wide, narrow = shown(100), shown(40)
    head = r"^ *parameter +value, mm +± std, mm +state"
    assert re.search(head, wide, re.MULTILINE)
    assert not re.search(head, narrow, re.MULTILINE)
    assert re.search(
        r"^Parameters\nparameter\n    joint_1\S+\n  value, mm 12\.346  ± std, mm 0\.010\n"
        r"  state told by these data\n",
        narrow,
        re.MULTILINE,
    )


def test_rows_that_are_not_shown_are_counted() -> None:
    long = Document("long", "Long", Assessment("good"), [ROW.of(ROWS * 9), ROW.of(ROWS)])
    text = io.StringIO()
    Console(file=text, width=100).print(rendered(long))
    assert text.getvalue().count("joint_") == 25
    assert "--verbose shows 2 rows of the first table and one table more." in text.getvalue()


def test_words_stand_below_their_row_before_a_table_is_given_up() -> None:
    """As many columns as it takes, the widest first; never numbers, and never the first."""
    given = "joint_1.offset, joint_2.offset and 17 more"
    row = Listing[tuple[str, float, str, str]](
        "",
        Column("", "parameter", lambda row: row[0]),
        Column("", "value, mm", lambda row: row[1], "m"),
        Column("", "state", lambda row: row[2]),
        Column("", "given", lambda row: row[3]),
    )
    rows = [("joint_1.x", 0.01, "identified", given), ("joint_1.y", 0.02, "held", "")]
    listed = row.of([*rows, rows[0]])

    def lines(width: int) -> list[str]:
        out = io.StringIO()
        Console(file=out, width=width, highlight=False).print(FittedTable(listed))
        return [line.strip() for line in out.getvalue().splitlines()]

    def rows_of(width: int) -> list[str]:
        found = lines(width)
        first = (k for k, line in enumerate(found) if line.startswith("joint_1.x"))
        return found[next(first) :]

    wide = rows_of(60)
    assert wide[0].split() == ["joint_1.x", "10.000", "identified", "joint_1.offset,"]
    below = lines(46)
    told = " ".join(" ".join(below).split())
    assert told.startswith("parameter value, mm state ")
    first = f"joint_1.x 10.000 identified given {given}"
    assert told.endswith(f" {first} joint_1.y 20.000 held {first}")
    narrow = rows_of(23)
    assert narrow[0].split() == ["joint_1.x", "10.000"]
    assert narrow[1].startswith("state identified")
    assert given in " ".join(narrow)
    assert lines(15)[0] == "parameter"


def test_a_name_is_broken_after_its_dot_before_a_table_is_given_up() -> None:
    """Numbers and units never are, and a name that has room is not."""
    for width in (57, 64):
        said = shown(width)
        assert re.search(r"^ joint_1\. +12\.346 +0\.010", said, re.MULTILINE)
        assert re.search(r"^ a_rather_long_parameter_name", said, re.MULTILINE)
    for width in (65, 120):
        found = r"^ joint_1\.a_rather_long_parameter_name +12\.346"
        assert re.search(found, shown(width), re.MULTILINE)
    # With what is no number below its row, a name may still be broken.
    assert re.search(r"^ joint_1\. +12\.346 +0\.010$", shown(56).replace(" \n", "\n"), re.MULTILINE)


def test_a_table_is_as_complete_in_a_pipe_as_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for width in ("40", "80", "120"):
        monkeypatch.setenv("COLUMNS", width)
        console().print(rendered(ANSWER), crop=False)
        said = capsys.readouterr().out
        words = set(said.split())
        for name, value, _, state in ROWS:
            assert all(part in said for part in name.split("."))
            assert f"{1e3 * value:.3f}" in words
            assert set(state.split()) <= words


def test_no_color_means_no_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    def codes() -> set[str]:
        out = io.StringIO()
        Console(file=out, force_terminal=True, width=80).print(rendered(ANSWER), crop=False)
        return set(re.findall(r"\x1b\[([\d;]*)m", out.getvalue()))

    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    assert any("3" in code.split(";")[-1][:1] for code in codes())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not any(re.match(r"(\d;)?[34]\d", code) for code in codes())


def test_a_label_with_a_blank_is_not_broken() -> None:
    rows = [("stretch[my own sheet].x", 0.01 * k, 1e-5, "told by these data") for k in range(2)]
    written = io.StringIO()
    table = Document("scene", "Scene", Assessment.of("Done."), [ROW.of(rows)])
    Console(file=written, width=62, highlight=False).print(rendered(table), crop=False)
    assert written.getvalue().count("stretch[my own sheet].x") == 2
