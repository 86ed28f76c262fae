"""The terminal's sink: however narrow it is, no number and no name is cut."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from suta_calib.assessment import Assessment
from suta_calib.report.console import rendered
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
        assert {name, f"{1e3 * value:.3f}", f"{1e3 * std:.3f}"} <= words
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
        r"^Parameters\nparameter joint_1\S+\n  value, mm 12\.346  ± std, mm 0\.010\n"
        r"  state told by these data\n",
        narrow,
        re.MULTILINE,
    )
