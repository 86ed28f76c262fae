"""A plain CSV file is read at once; it says what it says line by line, or is left to that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from suta_calib.errors import SamplesError
from suta_calib.measurements import CsvTable, csv_table, read_csv_table
from suta_calib.measurements.plain_csv import PlainColumns

PLAIN = "a,b,label\n1,-2.5e-3,P1\n0.1,1e400,P2\n"
NUMBERS = "a,b\n1,-2.5e-3\n.5,+1E5\n"
# What must be looked at line by line: each differs from a plain file in one thing.
AWKWARD = (
    PLAIN.replace("1,-2", "1, -2"),
    PLAIN.replace("P1", '"P,1"'),
    PLAIN.replace("P1", "P\N{LATIN SMALL LETTER E WITH ACUTE}1"),
    PLAIN.replace("P1", "P1\t"),
    PLAIN.replace("P1", "P1\x0c"),
    PLAIN.replace("P1\n", "P1\n\n"),
    PLAIN.replace("P1\n", "P1\r"),
    PLAIN.replace("P1\n", "P1\n# a comment\n"),
    PLAIN.replace("label", ""),
    "# a comment\n" + PLAIN,
    "\n" + PLAIN,
    PLAIN.rstrip("\n"),
    "a\n1\n\n2\n",
    NUMBERS.replace(",+", ", +"),
    NUMBERS.replace(".5", "# .5"),
    NUMBERS.replace("\n.5", "\n\n.5"),
    NUMBERS.rstrip("\n"),
)
REFUSED = (
    PLAIN.replace(",P1", ""),
    # As many cells as there should be, in the wrong rows.
    PLAIN.replace(",P1", "").replace("P2", "P2,P3"),
    PLAIN.replace("b,", "a,"),
    "a;b\n1;2\n",
    "a,b\n",
    "",
    NUMBERS.replace(",+1E5", ""),
    NUMBERS.replace(",+1E5", ",1,2"),
    NUMBERS.replace("b", "a"),
)


def write(folder: Path, text: str) -> Path:
    path = folder / "rows.csv"
    path.write_bytes(text.encode())
    return path


def line_by_line(path: Path, monkeypatch: pytest.MonkeyPatch) -> CsvTable:
    with monkeypatch.context() as patch:
        patch.setattr(PlainColumns, "of", lambda _: None)
        return read_csv_table(path)


@pytest.mark.parametrize("text", [PLAIN, PLAIN.replace("\n", "\r\n"), "a\n1\n2\n", NUMBERS])
def test_a_plain_file_is_read_at_once_and_says_the_same(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, text)
    slow = line_by_line(path, monkeypatch)
    monkeypatch.setattr(csv_table, "_csv_rows", lambda *_: pytest.fail("line by line"))
    fast = read_csv_table(path)
    assert fast == slow
    assert list(fast.columns) == list(slow.columns)


@pytest.mark.parametrize("text", AWKWARD)
def test_any_other_is_read_line_by_line(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, text)
    assert PlainColumns.of(text) is None
    assert read_csv_table(path) == line_by_line(path, monkeypatch)


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_refused_is_explained_alike(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(SamplesError) as slow:
        line_by_line(path, monkeypatch)
    with pytest.raises(SamplesError) as fast:
        read_csv_table(path)
    assert str(fast.value) == str(slow.value)


@pytest.mark.parametrize("odd", ["1_000", "nan", "", "one", "0x1p3", "1e400"])
def test_numbers_of_a_plain_file_are_those_of_its_cells(odd: str, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    values = random.normal(size=(50, 2)) * 10.0 ** random.integers(-300, 300, (50, 2))
    lines = [f"{x!r},P{k},{y!r}" for k, (x, y) in enumerate(values.tolist())]
    table = read_csv_table(write(tmp_path, "\n".join(["x,label,y", *lines, ""])))
    assert isinstance(table.columns, PlainColumns)
    for name in "xy":
        each = np.array([csv_table.number_in(cell) for cell in table.cells(name)])
        assert table.numbers(name).tobytes() == each.tobytes()
    lines[30] = f"0.5,P,{odd}"
    table = read_csv_table(write(tmp_path, "\n".join(["x,label,y", *lines, ""])))
    np.testing.assert_array_equal(table.numbers("x")[29:32], [values[29, 0], 0.5, values[31, 0]])
    with pytest.raises(SamplesError, match=rf"csv:32: found '{odd}' .*'y'|csv:32.*y.*'{odd}'"):
        table.numbers("y")
    with pytest.raises(SamplesError, match="'P0'"):
        table.numbers("label")


def test_numbers_are_those_of_one_cell_after_another_to_the_last_bit() -> None:
    random = np.random.default_rng(0)
    values = random.normal(size=500) * 10.0 ** random.integers(-300, 300, 500)
    cells = [*map(repr, values.tolist()), "inf", "-0", "1.", ".5", "1E5"]
    each = np.array([csv_table.number_in(cell) for cell in cells])
    assert csv_table._numbers(cells).tobytes() == each.tobytes()
    # Python takes these for numbers, or takes them for none: neither is one here.
    for odd in ("1_000", "\N{ARABIC-INDIC DIGIT ONE}", "", "one"):
        np.testing.assert_array_equal(csv_table._numbers(["1", odd, "2"]), [1.0, np.nan, 2.0])
