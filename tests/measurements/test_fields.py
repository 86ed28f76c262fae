"""Keys stated once, in the fields of a dataclass: read in SI, refused with their line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from suta_calib.errors import JobError
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.measurements.fields import (
    TEXT,
    choice,
    fields_of,
    keyed,
    mapping,
    quantity,
    read_as,
    rows,
    whole_number,
)


@dataclass(frozen=True)
class Stage:
    """Of a table."""

    travel: float = keyed(quantity("m", "positive"), "How far it goes.")
    axis: str = keyed(choice(("x", "y")), "Along which axis.", "x")


@dataclass(frozen=True)
class Table:
    """A table with stages."""

    name: str = keyed(TEXT, "What it is called.")
    main: Stage = keyed(mapping(Stage), "The stage below.")
    lean: float | None = keyed(quantity("rad"), "How it leans.", None)
    steps: int = keyed(whole_number(1, 10), "How many.", 2)
    others: tuple[Stage, ...] = keyed(
        rows(lambda row: read_as(Stage, row), fields_of(Stage)), "Above it.", ()
    )
    line: int | None = None


def table(folder: Path, text: str) -> Table:
    path = folder / "table.yaml"
    path.write_text(text, encoding="utf-8")
    section = YamlSection(read_yaml(path, JobError), JobError)
    return read_as(Table, section, line=section.line)


def test_a_mapping_becomes_a_dataclass_in_si(tmp_path: Path) -> None:
    found = table(
        tmp_path,
        "name: T\nmain: {travel_mm: 250}\nlean_deg: 180\nothers: [{travel_mm: 1, axis: y}]\n",
    )
    assert found == Table("T", Stage(0.25), pytest.approx(math.pi), 2, (Stage(1e-3, "y"),))
    assert fields_of(Table).names == ("name", "main", "lean_deg", "steps", "others")
    assert fields_of(Table).required == ("name", "main")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: T\nmain: {travel: 1}\n", r"2: main.travel: found an unknown key; .*'travel_mm'"),
        ("name: T\n", "main: found no such key; expected a value: this key is required"),
        ("name: T\nmain: {travel_mm: 0}\n", "2: main.travel_mm: found 0; expected a positive"),
        ("name: T\nmain: {travel_mm: .inf}\n", "2: main.travel_mm: found inf; expected a finite"),
        ("name: T\nmain: {travel_mm: 1, axis: z}\n", "main.axis: found 'z'; expected one of x, y"),
        ("name: T\nmain: {travel_mm: 1}\nsteps: 11\n", "3: steps: found 11; expected a whole"),
        ("name: T\nmain: {travel_mm: 1}\nothers: []\n", "3: others: found an empty list"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(JobError, match=message):
        table(tmp_path, text)
