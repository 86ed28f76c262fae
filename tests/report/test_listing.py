"""Rows declared once: what JSON, console, page and CSV make of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from lxml import html
from report_scenes import console_text

from suta_calib.assessment import Assessment
from suta_calib.report.console import rendered
from suta_calib.report.document import Document, Text
from suta_calib.report.listing import Column, Listing, csv_text
from suta_calib.report.page import page_with
from suta_calib.units import NOTHING, Unit


@dataclass(frozen=True)
class Row:
    name: str
    size: float
    unit: Unit = "m"
    given: tuple[str, ...] = ()


ROWS = (Row("a", 0.0012), Row("b", math.radians(-2.0), "rad", ("a",)))
PLAIN = Listing[Row](
    "Plain",
    Column("name", "name"),
    Column("size", "size", unit="m", sign=True),
    Column("ends", None, lambda row: np.array([-row.size, row.size]), "m"),
    key="plain",
)
OWN = Listing[Row](
    "Own units",
    Column("name", "name"),
    Column("size", "size", unit=lambda row: row.unit, si=True),
    Column("unit", "unit"),
    Column("given", "given", cell=lambda row: ", ".join(row.given), optional=True),
    Column("", "fine", lambda row: row.unit == "m", tone=lambda _: "good"),
    key="own",
    named=True,
    strong=lambda row: row.unit == "rad",
)


def document(*parts: object) -> Document:
    assessment = Assessment("care", "as it is", ("know <this>",))
    return Document("scene", "A scene", assessment, parts)  # type: ignore[arg-type]


def test_a_column_has_one_unit_in_keys_texts_and_files() -> None:
    assert PLAIN.record(ROWS[0]) == {"name": "a", "size_mm": 1.2, "ends_mm": [-1.2, 1.2]}
    assert PLAIN.of(ROWS).cells[0] == ["a", "+1.200"]
    assert csv_text(PLAIN, ROWS[:1]).splitlines()[0] == "name,size_mm,ends_mm"
    assert PLAIN.of([Row("x", math.nan)]).cells == [["x", NOTHING]]
    assert PLAIN.record(Row("x", math.inf))["size_mm"] is None


def test_rows_with_units_of_their_own_are_written_in_si() -> None:
    found = OWN.records(ROWS)
    assert found == {
        "a": {"size": 0.0012, "unit": "m"},
        "b": {"size": math.radians(-2.0), "unit": "rad", "given": ["a"]},
    }
    table = OWN.of(ROWS)
    assert table.heads == ["name", "size", "unit", "given", "fine"]
    assert [row[1] for row in table.cells] == ["1.200", "-2.0000"]
    assert table.numeric == {1}
    assert table.strong == {1}
    assert OWN.of(ROWS[:1]).heads == ["name", "size", "unit", "fine"]


def test_a_column_of_a_part_keeps_what_it_is() -> None:
    inner = OWN.columns[1].over(lambda pair: pair[1])  # type: ignore[var-annotated]
    assert inner.text((0, ROWS[1])) == "-2.0000"
    assert inner.flush_right


def test_parts_are_shown_where_they_belong() -> None:
    answer = document(
        Text("What was found", look="heading"),
        Text("first", bullet=True),
        Text("do this", look="remedy"),
        Text("page <only>", place="page", look="verbatim"),
        PLAIN.of(ROWS, place="console"),
        OWN.of(ROWS, "Two of them", folded=True),
        OWN.of(ROWS, "Own", place="verbose"),
    )
    said = console_text(rendered(answer))
    assert "→ do this" in said
    assert "+1.200" in said
    assert "page <only>" not in said
    assert "Two of them" not in said
    assert said.startswith("Take care. As it is")
    assert "Own" not in said
    assert "Own" in console_text(rendered(answer, verbose=True))
    page = html.fromstring(page_with(answer, None))
    assert page.xpath("//h3/text()") == ["What was found"]
    assert page.xpath("//pre/text()") == ["page <only>"]
    assert page.xpath("//p[@class='remedy']/text()") == ["do this"]
    assert page.xpath("//main//details/summary/text()") == ["Two of them"]
    assert page.xpath("//tr[@class='strong']/td[1]/text()") == ["b"]
    assert page.xpath("//span[@class='tone good']/text()") == ["True", "False"]
    assert "Plain" not in page.text_content()
    assert set(answer.json()) == {"plain", "own", "verdict"}
    assert answer.json()["verdict"]["notes"] == ["know <this>"]


def test_an_answer_that_opens_the_report_leaves_nothing_of_an_earlier_one() -> None:
    earlier = page_with(document(Text("old")), None)
    opening = Document("result", "New", Assessment("good"), [Text("new")], written="opening")
    page = html.fromstring(page_with(opening, earlier))
    assert [str(each.get("id")) for each in page.iter("section")] == ["result"]
    below = html.fromstring(page_with(document(Text("later")), page_with(opening, earlier)))
    assert [str(each.get("id")) for each in below.iter("section")] == ["result", "scene"]
